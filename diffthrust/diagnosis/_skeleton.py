"""The start of an effect of the user's own, for what no known effect explains."""

from __future__ import annotations

from collections.abc import Sequence

from diffthrust.diagnosis._findings import Missing, Remaining, SignalForm
from diffthrust.diagnosis._ports import words_and_unit
from diffthrust.models._base.model import Model

HOW = "Write the law that you suspect as an effect of your own, say in my_effect.py, and fit it:"
_CODE = '''import jax.numpy as jnp

import diffthrust as dft


class MyEffect(dft.Effect):
    """What happens there, in one line."""

    name = "my_effect"
    port = "{port}"
    strength: float = dft.parameter(0.0, unit="{unit}", null=0.0, size=1.0)

    def __call__(self, value, s):
        signal = {signal}
        return {law}  # put your law in place of this line


# In Python:      fit = dft.fit(model + MyEffect(), logs, holdout=unseen)
# In a spec file: effects = [{effects}]
'''


def skeleton(model: Model, left: Remaining, missing: Sequence[Missing]) -> str:
    """Python code of an effect with the port and the signal filled in.

    It runs as it stands: a term in proportion to the signal, of which the user makes the law.

    Args:
        model: the model of the last stage.
        left: what no known effect explains.
        missing: the missing signals, which know the units of their ports.
    """
    units = {m.port: m.unit for m in reversed(missing)}
    adds = left.manner == "adds"
    here = units.get(left.port, _unit(model, left.port)) if adds else ""
    signal, unit = _read(model, left.signal)
    effects = [*(effect.name for effect in model.effects), "my_effect.py:MyEffect"]
    return _CODE.format(
        port=left.port,
        signal=signal,
        law="value + self.strength * signal" if adds else "value * (1.0 + self.strength * signal)",
        unit=f"{_bracketed(here or '1')}/{_bracketed(unit)}" if unit else here,
        effects=", ".join(f'"{name}"' for name in effects),
    )


def _unit(model: Model, place: str) -> str:
    """The unit of a port or of a channel."""
    channels = {**model.outputs, **model.optional_inputs, **model.inputs}
    return channels[place] if place in channels else words_and_unit(model, place)[1]


def _bracketed(unit: str) -> str:
    return f"({unit})" if set(unit) & {"/", " "} else unit


def _read(model: Model, signal: SignalForm) -> tuple[str, str]:
    """The signal as an effect reads it, and its unit."""
    if signal.rate or signal.past is not None:
        return f"s.{signal.name}  # from which to work out: {signal}", ""
    units = {**model.inputs, **model.optional_inputs, **model.states, "time": "s"}
    return f"s.{signal.name}", units[signal.name]
