"""The start of an effect of the user's own, for what no known effect explains."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from diffthrust.models._base.model import Model

if TYPE_CHECKING:
    from diffthrust.diagnosis._result import Diagnosis

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


def skeleton(diag: Diagnosis) -> str:
    """Python code of an effect with the port and the signal filled in; "" with nothing left.

    It runs as it stands: a term in proportion to the signal, of which the user makes the law.
    """
    left = diag.remaining
    if left is None:
        return ""
    found = next((m for m in diag.missing if m.port == left.port), None)
    adds = left.manner == "adds"
    here = (found.unit if found else _unit(diag.model, left.port)) if adds else ""
    signal, unit = _signal(diag.model, left.depends_on)
    effects = [*(effect.name for effect in diag.fit.model.effects), "my_effect.py:MyEffect"]
    return _CODE.format(
        port=left.port,
        signal=signal,
        law="value + self.strength * signal" if adds else "value * (1.0 + self.strength * signal)",
        unit=f"{_bracketed(here or '1')}/{_bracketed(unit)}" if unit else here,
        effects=", ".join(f'"{name}"' for name in effects),
    )


def _unit(model: Model, place: str) -> str:
    """The unit of a port, which ends its description, or of a channel."""
    channels = {**model.outputs, **model.optional_inputs, **model.inputs}
    if place in channels:
        return channels[place]
    ends = re.search(r"\[([^]]*)\]$", model.ports.get(place, ""))
    return ends[1] if ends else ""


def _bracketed(unit: str) -> str:
    return f"({unit})" if set(unit) & {"/", " "} else unit


def _signal(model: Model, words: str) -> tuple[str, str]:
    """The signal as an effect reads it, and its unit: ``|speed|`` is ``jnp.abs(s.speed)``."""
    known = {**model.inputs, **model.optional_inputs, **model.states, "time": "s"}
    plain = "time" if words == "time since the start" else words.strip("|")
    if plain in known:
        read = f"s.{plain}"
        return (f"jnp.abs({read})" if words == f"|{plain}|" else read), known[plain]
    inside = [name for name in re.findall(r"\w+", words) if name in known]
    read = f"s.{inside[0]}" if inside else "s.time"
    return f"{read}  # from which to work out: {words}", ""
