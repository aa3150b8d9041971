"""The result of black-box identification: a sampled linear model, its words and its figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.report import Report, Section, Styled, notes
from diffthrust._support.results import Result
from diffthrust.blackbox._sampled_model import SampledModel
from diffthrust.estimation._estimate import parameter_rows
from diffthrust.logs._log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class BlackBox(Result, SampledModel):
    """A sampled linear model of a log's inputs and outputs, with its parameters and errors.

    Example:
        >>> model = dft.blackbox.arx(log, input="command", output="thrust", orders=(1, 1, 1))
        >>> model.kind, model.status, sorted(model.parameters)
        ('arx', <Status.CONVERGED: 'converged'>, ['a1', 'b1'])
        >>> figure = model.plot(unseen)
    """

    def to_control(self, form: Literal["transfer", "states"] = "transfer") -> Any:
        """The sampled model as an object of python-control, with the delay of the inputs in it.

        Args:
            form: "transfer" for a ``TransferFunction`` of one input and one output, "states" for a
                ``StateSpace`` of all.

        Raises:
            InputError: python-control is not installed, or several channels for "transfer".

        Example:
            >>> model = dft.blackbox.arx(log, input="command", output="thrust", orders=(1, 1, 1))
            >>> model.to_control().dt
            0.05
        """
        try:
            import control
        except ImportError:
            raise InputError(
                "to_control: python-control is not installed.",
                "Install it: python -m pip install control. BlackBox.transfer() needs no more than "
                "this library.",
            ) from None
        if form not in ("transfer", "states"):
            raise InputError(
                f"to_control, form: expected 'transfer' or 'states', found {form!r}.", "Correct it."
            )
        channels = self.channels
        lags = self.plain.lags or (0,) * len(channels.inputs)
        if form == "transfer":
            num, den = self.rational(*self.pair(None, None))
            return control.TransferFunction(
                num,
                np.concatenate([den, np.zeros(lags[0])]),
                self.step,
                inputs=list(channels.inputs),
                outputs=list(channels.outputs),
            )
        return control.StateSpace(
            *_with_lags(self, lags),
            self.step,
            inputs=list(channels.inputs),
            outputs=list(channels.outputs),
        )

    def _line(self) -> str:
        return f"{self}: {self.status}, {self.samples} samples"

    def _report(self) -> Report:
        channels = self.channels
        noise = ", ".join(
            f"{name} {value:.4g} {channels.units[name]}".rstrip()
            for name, value in self.noise.items()
        )
        heading = (
            f"{self}, from {', '.join(channels.inputs)} to {', '.join(channels.outputs)}, "
            f"a sample every {self.step:g} s"
        )
        return Report(
            Section("", Styled(heading, "strong"), f"Status: {self.status.value}"),
            Section("", parameter_rows(self.parameters)),
            Section(
                "",
                f"Poles: {', '.join(complex_word(pole) for pole in self.poles)} "
                f"({'stable' if self.stable else 'not stable'})",
                f"One-step error: {noise}; {self.samples} samples; BIC {self.bic:.1f}",
                *notes(self.notes),
            ),
        )

    @showing
    def plot(self, log: Log) -> Figure:
        """Measured, simulated and predicted outputs of a log, and the residuals."""
        from diffthrust.blackbox._figures import model_figure

        return model_figure(self, log)


def complex_word(value: complex) -> str:
    """A complex number with five digits: many poles lie close to 1."""
    if abs(np.imag(value)) < 1e-9 * max(1.0, abs(value)):
        return f"{np.real(value):.5g}"
    return f"{np.real(value):.5g} {'+' if np.imag(value) > 0 else '-'} {abs(np.imag(value)):.5g}i"


def _with_lags(model: SampledModel, lags: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """The matrices with a chain of states for each delayed input; without an offset."""
    m = len(model.channels.inputs)
    s = model.plain
    n, more = s.order, sum(lags[:m])
    a, b = np.zeros((n + more, n + more)), np.zeros((n + more, m))
    c, d = np.zeros((len(s.c), n + more)), np.zeros((len(s.c), m))
    a[:n, :n], c[:, :n] = s.a, s.c
    first = n
    for j, lag in enumerate(lags[:m]):
        if not lag:
            b[:n, j], d[:, j] = s.b[:, j], s.d[:, j]
            continue
        last = first + lag - 1
        # python-control has no input delay in discrete time: each is a chain of unit delays
        b[first, j] = 1.0
        for k in range(first, last):
            a[k + 1, k] = 1.0
        a[:n, last], c[:, last] = s.b[:, j], s.d[:, j]
        first = last + 1
    return a, b, c, d
