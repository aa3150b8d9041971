"""The controls of a model: effects to tick, port by port, and sliders of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from html import escape
from typing import Any

from bokeh.layouts import column
from bokeh.models import CheckboxGroup, CustomJSTickFormatter, Select, Slider

from diffthrust._support.words import humanize
from diffthrust.diagnosis._explained_share import SureShare, Worth, sure_share
from diffthrust.diagnosis._report.text import unmeasured_rivals
from diffthrust.estimation._estimate import shown_unit
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.parameter import Parameter
from diffthrust.workbench._look import RIGHT, Edit, heading, text
from diffthrust.workbench._session import Session
from diffthrust.workbench._signal_path import PathFigure, signal_path

_TITLE = 42
"""Display: characters beside the value of a slider."""
_STEPS = 400
"""Display: positions of a slider, more than the pixels that it has."""
_FOLDED = "label, .bk-slider-title { white-space: normal; }"
"""Display: long names go on in a second line; they were cut off."""
FOUND, CONSTANTS = "Found or added", "Constants that the model holds"


class Controls:
    """The right-hand side of the page, in the units of the logs.

    ``on_slide`` is told a parameter and its value at each move, ``on_release`` that the mouse has
    let a slider go.
    """

    def __init__(
        self,
        session: Session,
        shown: ShownUnits,
        *,
        on_edit: Edit,
        on_slide: Callable[[str, float], None],
        on_release: Callable[[], None],
    ) -> None:
        self.session, self.shown = session, shown
        self.edit, self.on_slide, self.on_release = on_edit, on_slide, on_release
        ports = dict.fromkeys(port for effect in session.effects.values() for port in effect.ports)
        self.port = Select(
            title="Effects to add or take away",
            options=[
                FOUND,
                *((p, f"At {p}") for p in ports),
                *[CONSTANTS] * bool(session.constants),
            ],
            value=FOUND,
            width=RIGHT - 20,
        )
        self.port.on_change("value", lambda attr, old, new: self._show_effects())
        self.path = PathFigure(
            signal_path(session.task.model), ports, lambda port: self.port.update(value=port)
        )
        self.boxes = CheckboxGroup(labels=[], active=[], width=RIGHT - 20, stylesheets=[_FOLDED])
        self.boxes.on_change("active", self._on_boxes)
        self.about = text()
        self.sliders = column(width=RIGHT - 10)
        self.layout = column(
            heading("Signal path: tap a blue frame to see what may be missing there"),
            self.path.figure,
            self.port,
            self.boxes,
            heading("Parameters: drag, and the model follows"),
            self.sliders,
            self.about,
            width=RIGHT,
        )
        self._listed: list[str] = []
        self._setting = False
        self._sliders: dict[str, tuple[Slider, float]] = {}

    def show(self, *, awake: bool) -> None:
        """Show the session; ``awake`` are sliders whose model is compiled, and follows at once."""
        self._show_effects()
        self._show_sliders(awake)

    # -- effects ---------------------------------------------------------------------------------

    def _show_effects(self) -> None:
        session, at = self.session, self.port.value
        worth, diagnosis = self._worth(), session.diagnosis
        rivals = unmeasured_rivals(diagnosis) if diagnosis else {}
        added, effects = session.setup.effects, session.effects
        places = {name: effect.ports for name, effect in effects.items()}
        places |= dict.fromkeys(session.constants, (CONSTANTS,))
        named = {*added, *session.found, *worth} if at == FOUND else set()

        def order(name: str) -> tuple[bool, float]:
            share = worth[name].share if name in worth else math.nan
            return name not in added, -share if math.isfinite(share) else math.inf

        names = sorted((n for n, of in places.items() if at in of or n in named), key=order)
        self._listed = names
        self.boxes.labels = [humanize(name) + _worth_words(worth.get(name)) for name in names]
        self.boxes.active = [i for i, name in enumerate(names) if name in added]
        lines = [
            f"<b>{escape(humanize(n))}</b>: {escape(self._about(n, worth, rivals))}" for n in names
        ]
        hint = "No effect yet. Diagnose ranks them; or tap a box for what may be missing there."
        self.about.text = "".join(f'<p class="quiet">{line}</p>' for line in lines or [hint])
        self.path.mark(at, {p for name in added if name in effects for p in effects[name].ports})

    def _worth(self) -> dict[str, Worth]:
        """By name what the diagnosis says that effects and laws remove."""
        if (diagnosis := self.session.diagnosis) is None:
            return {}
        laws = {(of.form.formula if of.form else of.curve).name: of.worth for of in diagnosis.laws}
        return {**diagnosis.possible, **diagnosis.worth, **laws}

    def _about(self, name: str, worth: Mapping[str, Worth], rivals: Mapping[str, str]) -> str:
        """The first sentence of what an effect or a constant is, its worth, what may look alike."""
        session = self.session
        if name in session.constants:
            p = session.constants[name]
            held = session.diagnosis.held if session.diagnosis else {}
            sentence = f"{p.doc or 'a constant'}, held at {p.value:.4g} {p.unit}".rstrip()
            if name in held:
                sentence += f"; these logs suggest {held[name].wanted:.4g}"
        elif name in session.laws:
            sentence = "The law that was learned: see its tab below the plots"
        else:
            paragraph = (type(session.effects[name]).__doc__ or "").strip().partition("\n\n")[0]
            sentence = " ".join(paragraph.split()).partition(". ")[0].rstrip(".")
        if name in worth:
            share = sure_share(worth[name]) or SureShare(worth[name])
            of = f"squared {share.channel} error" if share.channel else "squared error"
            sentence += f". Removes {share.worth} of the {of} of whole runs"
        if name in rivals:
            sentence += f". The {rivals[name]} was not measured: it could look like this"
        return sentence

    def _on_boxes(self, attr: str, old: list[int], new: list[int]) -> None:
        added = self.session.setup.effects
        ticked = {name: index in new for index, name in enumerate(self._listed)}
        for name, wanted in ticked.items():
            if wanted != (name in added):
                self.edit(partial(self.session.tick if wanted else self.session.untick, name))

    # -- sliders ---------------------------------------------------------------------------------

    def _show_sliders(self, awake: bool) -> None:
        """Show the values of the model's parameters; new sliders for new effects."""
        parameters = {n: p for n, p in self.session.task.model.parameters.items() if not p.fixed}
        self._setting = True
        if list(parameters) != list(self._sliders):
            old = self._sliders  # with another range the same value would be in another place
            self._sliders = {n: old.get(n) or self._slider(n, p) for n, p in parameters.items()}
            self.sliders.children = [slider for slider, _ in self._sliders.values()]
        fit = self.session.fit if self.session.fitted else None
        for name, p in parameters.items():
            slider, per = self._sliders[name]
            if not slider.start <= per * p.value <= slider.end:
                slider.update(**_ends(p, per))
            error = fit.parameters[name].std_error if fit else None
            within = f" (± {per * error:.2g})" if error else ""
            title = self._title(name, p, within)
            slider.update(title=title, value=per * p.value, disabled=not awake)
        self._setting = False

    def _title(self, name: str, parameter: Parameter, within: str) -> str:
        """What stands before the value, with what the parameter is where there is room for it."""
        _, unit = shown_unit(parameter, self.session.task.model, self.shown)
        words = humanize(name.replace(".", ", "))
        behind = f"{f' [{unit}]' if unit else ''}{within}"
        longer = f"{words}, {parameter.doc}{behind}"
        return longer if parameter.doc and len(longer) <= _TITLE else words + behind

    def _slider(self, name: str, parameter: Parameter) -> tuple[Slider, float]:
        """A slider in the unit of the logs, and how many of these the parameter's own has."""
        per, _ = shown_unit(parameter, self.session.task.model, self.shown)
        slider = Slider(
            value=per * parameter.value,
            format=CustomJSTickFormatter(code="return `${Number(tick.toPrecision(4))}`"),
            width=RIGHT - 30,
            margin=(1, 8, 1, 8),
            stylesheets=[_FOLDED],
            **_ends(parameter, per),
        )
        slider.on_change("value", lambda attr, old, new: self._on_value(name, new / per))
        # the throttled value is not set until the first drag ends: it only says that one has ended
        slider.on_change("value_throttled", lambda attr, old, new: self.on_release())
        return slider, per

    def _on_value(self, name: str, value: float) -> None:
        if not self._setting:
            self.on_slide(name, value)


def _worth_words(worth: Worth | None) -> str:
    """What an effect removes, behind its name: as in the verdict, of one channel where need be."""
    if worth is None:
        return ""
    if (sure := sure_share(worth)) is None:
        return f": removes {worth.cells[0]}, perhaps none"
    of = f" of the {sure.channel} error" if sure.channel else ""
    return f": removes {sure.worth.cells[0]}{of}"


def _ends(parameter: Parameter, per: float) -> dict[str, Any]:
    """Of a slider: the bounds, and around the value where there is none."""
    (low, high), value = parameter.limits, parameter.value
    reach = 2 * abs(value) or (parameter.size or 1.0)
    if math.isinf(low):
        low = min(value - reach, -reach if parameter.null == 0.0 else value)
    if math.isinf(high):
        high = max(value, low) + reach
    return {"start": per * low, "end": per * high, "step": per * (high - low) / _STEPS}
