"""Black-box models as text."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from diffthrust.blackbox._sampled_model import SampledModel
from diffthrust.estimation._tables import parameter_table


def model_table(model: SampledModel) -> RenderableType:
    """Kind, orders, parameters, poles and notes."""
    channels = model.channels
    noise = ", ".join(f"{name} {value:.4g} {channels.units[name]}".rstrip()
                      for name, value in model.noise.items())  # fmt: skip
    parts: list[RenderableType] = [
        Text(f"{model}, from {', '.join(channels.inputs)} to {', '.join(channels.outputs)}, "
             f"a sample every {model.step:g} s", style="bold"),
        Text(f"Status: {model.status.value}"),
    ]  # fmt: skip
    if model.parameters:
        parts += [Text(), parameter_table(model.parameters)]
    parts += [
        Text(),
        Text(f"Poles: {', '.join(complex_word(pole) for pole in model.poles)} "
             f"({'stable' if model.stable else 'not stable'})"),
        Text(f"One-step error: {noise}; {model.samples} samples; BIC {model.bic:.1f}"),
        *(Text(f"Note: {note}") for note in model.notes),
    ]  # fmt: skip
    return Group(*parts)


def complex_word(value: complex) -> str:
    """A number of the complex plane with five digits: many poles lie close to 1."""
    if abs(np.imag(value)) < 1e-9 * max(1.0, abs(value)):
        return f"{np.real(value):.5g}"
    return f"{np.real(value):.5g} {'+' if np.imag(value) > 0 else '-'} {abs(np.imag(value)):.5g}i"
