"""The start of an effect of the user's own, for what no known effect explains."""

from __future__ import annotations

from collections.abc import Sequence

from diffthrust._support.literals import ToCopy
from diffthrust.diagnosis._findings import Missing, Remaining
from diffthrust.diagnosis._ports import words_and_unit
from diffthrust.effects import Formula
from diffthrust.effects._class_text import class_name, effect_class_text
from diffthrust.estimation._origin import effects_line
from diffthrust.logs._units import same_unit
from diffthrust.models._base.model import Model

HOW = "Write the law that you suspect as an effect of your own, say in my_effect.py, and fit it:"
_NAME = "my_effect"
_USED = """

# In Python:
#     fit = dft.fit(model + {cls}(), logs, holdout=unseen)
# In a spec file:
#     {line}
"""


def own_effect(model: Model, remaining: Remaining, missing: Sequence[Missing]) -> str:
    """Python code of an effect with the port and the signal filled in.

    It runs as it stands: a term in proportion to the signal, of which the user makes the law.

    Args:
        model: the model of the last stage.
        remaining: what no known effect explains.
        missing: the missing signals, which know the units of their ports.
    """
    units = {m.port: m.unit for m in reversed(missing)}
    adds, signal = remaining.manner == "adds", remaining.signal
    here = units.get(remaining.port, _unit(model, remaining.port)) if adds else ""
    later = bool(signal.rate or signal.past is not None)
    unit = "" if later else _signal_units(model)[signal.name]
    per_signal = f"{_bracketed(here or '1')}/{_bracketed(unit)}" if unit else here
    term = f"strength * {signal.name}"
    formula = Formula(
        remaining.port,
        term if adds else f"value * (1 + {term})",
        strength=per_signal if same_unit(per_signal, per_signal) else "",
    )
    hint = f"from which to work out: {signal}; " if later else ""
    text = effect_class_text(formula, _NAME, hint=f"{hint}put your law in place of this line")
    cls = class_name(_NAME)
    return ToCopy(text + _USED.format(cls=cls, line=effects_line(model, [f"{_NAME}.py:{cls}"])))


def _unit(model: Model, place: str) -> str:
    """The unit of a port or of a channel."""
    channels = {**model.outputs, **model.optional_inputs, **model.inputs}
    return channels[place] if place in channels else words_and_unit(model, place)[1]


def _bracketed(unit: str) -> str:
    return f"({unit})" if set(unit) & {"/", " "} else unit


def _signal_units(model: Model) -> dict[str, str]:
    return {**model.inputs, **model.optional_inputs, **model.states, "time": "s"}
