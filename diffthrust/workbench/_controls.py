"""The controls of a model: effects to tick, port by port, and sliders of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from html import escape

from bokeh.layouts import column
from bokeh.models import BasicTickFormatter, CheckboxGroup, Select, Slider

from diffthrust._support.words import humanize
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.estimation._estimate import shown_unit
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.workbench._look import RIGHT, heading, text
from diffthrust.workbench._path_figure import PathFigure
from diffthrust.workbench._signal_path import signal_path

_TITLE = 42
"""Display: characters beside the value of a slider."""
_STEPS = 400
"""Display: positions of a slider, more than the pixels that it has."""
FOUND, CONSTANTS = "Found or added", "Constants that the model holds"


def slider_range(parameter: Parameter) -> tuple[float, float]:
    """The ends of a slider: the bounds, and around the value where there is none.

    Example:
        >>> slider_range(dft.Parameter(0.04, bounds=(0, None)))
        (0.0, 0.12)
    """
    (low, high), value = parameter.limits, parameter.value
    reach = 2 * abs(value) or (parameter.size or 1.0)
    if math.isinf(low):
        low = min(value - reach, -reach if parameter.null == 0.0 else value)
    if math.isinf(high):
        high = max(value, low) + reach
    return low, high


class Controls:
    """The right-hand side of the page.

    Args:
        model: as it was opened.
        addable: the effects that may be added, by name.
        constants: what is said of the constants that may be estimated, by name.
        shown: the units of the logs.
        on_tick: is told the names of the effects that are ticked.
        on_slide: is told a parameter and its value, at each move.
        on_release: is called when the mouse lets a slider go.
    """

    def __init__(
        self,
        model: Model,
        addable: Mapping[str, Effect],
        constants: Mapping[str, str],
        shown: ShownUnits,
        *,
        on_tick: Callable[[str, bool], None],
        on_slide: Callable[[str, float], None],
        on_release: Callable[[], None],
    ) -> None:
        self.addable, self.constants = addable, constants
        self.shown, self.on_tick = shown, on_tick
        self.on_slide, self.on_release = on_slide, on_release
        ports = dict.fromkeys(port for effect in addable.values() for port in effect.ports)
        self.path = PathFigure(signal_path(model), list(ports), self._choose)
        self.port = Select(
            title="Effects to add or take away",
            options=[FOUND, *((p, f"At {p}") for p in ports), *[CONSTANTS] * bool(constants)],
            value=FOUND,
            width=RIGHT - 20,
        )
        self.port.on_change("value", lambda attr, old, new: self._list_effects())
        self.boxes = CheckboxGroup(labels=[], active=[], width=RIGHT - 20)
        self.boxes.on_change("active", self._on_boxes)
        self.about = text()
        self.sliders = column(width=RIGHT - 10)
        self.layout = column(
            heading("Signal path: tap a blue box to see what may be missing there"),
            self.path.figure,
            self.port,
            self.boxes,
            heading("Parameters: drag, and the model follows"),
            self.sliders,
            self.about,
            width=RIGHT,
        )
        self.effects: tuple[str, ...] = ()
        self.found: tuple[str, ...] = ()
        self.worth: Mapping[str, Worth] = {}
        self._listed: list[str] = []
        self._setting = False
        self._sliders: dict[str, tuple[Slider, float]] = {}

    # -- effects ---------------------------------------------------------------------------------

    def show_effects(
        self,
        addable: Mapping[str, Effect],
        constants: Mapping[str, str],
        effects: tuple[str, ...],
        found: tuple[str, ...],
        worth: Mapping[str, Worth],
    ) -> None:
        """Show what may be added or estimated, what the model has of it, what each is worth."""
        self.addable, self.constants = addable, constants
        self.effects, self.found, self.worth = effects, found, worth
        self._list_effects()

    def _choose(self, port: str) -> None:
        self.port.value = port

    def _list_effects(self) -> None:
        at = self.port.value
        ports = {name: effect.ports for name, effect in self.addable.items()}
        ports |= dict.fromkeys(self.constants, (CONSTANTS,))
        found = {*self.effects, *self.found, *self.worth} if at == FOUND else set()
        names = [name for name, places in ports.items() if at in places or name in found]
        names.sort(key=lambda n: (n not in self.effects, -self._share(n)))
        self._listed, self._setting = names, True
        self.boxes.labels = [self._label(name) for name in names]
        self.boxes.active = [i for i, name in enumerate(names) if name in self.effects]
        self._setting = False
        lines = [f"<b>{escape(humanize(n))}</b>: {escape(self._about(n))}" for n in names]
        if not lines:
            lines = [
                "No effect yet. Diagnose ranks them; or tap a box for what may be missing there."
            ]
        self.about.text = "".join(f'<p class="quiet">{line}</p>' for line in lines)
        added: dict[str, int] = {}
        for name in self.effects:
            for port in self.addable[name].ports if name in self.addable else ():
                added[port] = added.get(port, 0) + 1
        self.path.mark(at, added)

    def _share(self, name: str) -> float:
        share = self.worth[name].share if name in self.worth else -math.inf
        return share if math.isfinite(share) else -math.inf

    def _label(self, name: str) -> str:
        worth = self.worth.get(name)
        return humanize(name) + (f": removes {worth.cells[0]}" if worth else "")

    def _about(self, name: str) -> str:
        """The first sentence of what an effect or a constant is, and what it is worth."""
        sentence = self.constants.get(name, "")
        if not sentence:
            paragraph = (type(self.addable[name]).__doc__ or "").strip().partition("\n\n")[0]
            sentence = " ".join(paragraph.split()).partition(". ")[0].rstrip(".")
        worth = self.worth.get(name)
        return sentence + (f". Removes {worth} of the squared error of whole runs" if worth else "")

    def _on_boxes(self, attr: str, old: list[int], new: list[int]) -> None:
        if not self._setting:
            for index in {*old} ^ {*new}:
                self.on_tick(self._listed[index], index in new)

    # -- sliders ---------------------------------------------------------------------------------

    def show_parameters(self, model: Model, *, awake: bool) -> None:
        """Show the values of a model's parameters; new sliders for new effects.

        Args:
            model: the present one.
            awake: its programs are compiled, so that a slider is followed at once.
        """
        parameters = {n: p for n, p in model.parameters.items() if not p.fixed}
        self._setting = True
        if list(parameters) != list(self._sliders):
            made = {name: self._slider(name, p, model) for name, p in parameters.items()}
            self._sliders = made
            self.sliders.children = [slider for slider, _ in made.values()]
        for name, p in parameters.items():
            slider, per = self._sliders[name]
            value = per * p.value
            if not slider.start <= value <= slider.end:
                low, high = slider_range(p)
                slider.update(start=per * low, end=per * high, step=per * (high - low) / _STEPS)
            slider.update(value=value, disabled=not awake)
        self._setting = False

    def _slider(self, name: str, parameter: Parameter, model: Model) -> tuple[Slider, float]:
        per, unit = shown_unit(parameter, model, self.shown)
        low, high = slider_range(parameter)
        words = humanize(name.replace(".", ", "))
        quantity = f"{words} [{unit}]" if unit else words
        longer = f"{words}, {parameter.doc}" + (f" [{unit}]" if unit else "")
        slider = Slider(
            title=longer if parameter.doc and len(longer) <= _TITLE else quantity,
            start=per * low,
            end=per * high,
            step=per * (high - low) / _STEPS,
            value=per * parameter.value,
            format=BasicTickFormatter(precision=4),
            width=RIGHT - 30,
            margin=(1, 8, 1, 8),
        )
        slider.on_change("value", lambda attr, old, new: self._on_value(name, new / per))
        # the throttled value is not set until the first drag ends: it only says that one has ended
        slider.on_change("value_throttled", lambda attr, old, new: self._on_end())
        return slider, per

    def _on_value(self, name: str, value: float) -> None:
        if not self._setting:
            self.on_slide(name, value)

    def _on_end(self) -> None:
        if not self._setting:
            self.on_release()
