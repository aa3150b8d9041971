"""The class of an effect of one's own for what remains, its port and its signal filled in."""

from __future__ import annotations

from collections.abc import Sequence

from diffthrust._support.literals import ToCopy
from diffthrust.diagnosis._candidates import words_and_unit
from diffthrust.diagnosis._missing import Missing, Remaining
from diffthrust.effects import Formula
from diffthrust.effects._class_text import class_name, effect_class_text
from diffthrust.estimation._model_lines import effects_line
from diffthrust.logs._units import same_unit
from diffthrust.models._base.model import Model

EFFECT_NAME = "my_effect"
_EFFECT_USE = """

# In Python:
#     fit = dft.fit(model + {cls}(), logs, holdout=unseen)
# In a spec file:
#     {line}
"""


def own_effect(model: Model, remaining: Remaining, missing: Sequence[Missing]) -> str:
    """Python code of an effect for what is left, its port and signal filled in.

    It runs as it stands: a term in proportion to the signal, in place of which the user puts a law.

    Args:
        model: the model of the last stage.
        remaining: what none of the effects tried explains.
        missing: the missing signals, which know the units of their ports.
    """
    adds, signal, port = remaining.manner == "adds", remaining.signal, remaining.port
    channels = {**model.outputs, **model.optional_inputs, **model.inputs}
    units = {m.port: m.unit for m in reversed(missing)}
    if not adds:
        port_unit = ""
    elif port in units:
        port_unit = units[port]
    else:
        port_unit = channels[port] if port in channels else words_and_unit(model, port)[1]
    # a rate or a past mean is no attribute of `s`: the user has to work it out first
    derived = bool(signal.rate or signal.past is not None)
    per_signal = port_unit
    if not derived:
        signals = {**model.inputs, **model.optional_inputs, **model.states, "time": "s"}
        if signals[signal.name]:
            per_signal = f"{_bracketed(port_unit or '1')}/{_bracketed(signals[signal.name])}"
    term = f"strength * {signal.name}"
    formula = Formula(
        port,
        term if adds else f"value * (1 + {term})",
        strength=per_signal if same_unit(per_signal, per_signal) else "",
    )
    hint = f"from which to work out: {signal}; " if derived else ""
    hint += "put your law in place of this line"
    text = effect_class_text(formula, EFFECT_NAME, hint=hint)
    cls = class_name(EFFECT_NAME)
    line = effects_line([*model.effects, f"{EFFECT_NAME}.py:{cls}"])
    return ToCopy(text + _EFFECT_USE.format(cls=cls, line=line))


def _bracketed(unit: str) -> str:
    return f"({unit})" if set(unit) & {"/", " "} else unit
