"""The report of a black-box model, as data."""

from __future__ import annotations

import numpy as np

from diffthrust._support.report import Report, Section, Styled, notes
from diffthrust.blackbox._sampled_model import SampledModel
from diffthrust.estimation._estimate import parameter_rows


def model_report(model: SampledModel) -> Report:
    """Kind, orders, parameters, poles and notes."""
    channels = model.channels
    noise = ", ".join(
        f"{name} {value:.4g} {channels.units[name]}".rstrip() for name, value in model.noise.items()
    )
    heading = (
        f"{model}, from {', '.join(channels.inputs)} to {', '.join(channels.outputs)}, "
        f"a sample every {model.step:g} s"
    )
    return Report(
        Section("", Styled(heading, "strong"), f"Status: {model.status.value}"),
        Section("", parameter_rows(model.parameters)),
        Section(
            "",
            f"Poles: {', '.join(complex_word(pole) for pole in model.poles)} "
            f"({'stable' if model.stable else 'not stable'})",
            f"One-step error: {noise}; {model.samples} samples; BIC {model.bic:.1f}",
            *notes(model.notes),
        ),
    )


def complex_word(value: complex) -> str:
    """A complex number with five digits: many poles lie close to 1."""
    if abs(np.imag(value)) < 1e-9 * max(1.0, abs(value)):
        return f"{np.real(value):.5g}"
    return f"{np.real(value):.5g} {'+' if np.imag(value) > 0 else '-'} {abs(np.imag(value)):.5g}i"
