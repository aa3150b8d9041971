"""The result of black-box identification: a sampled linear model, its words and its figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.names import listing
from diffthrust._support.report import Report, Section, Styled, notes
from diffthrust._support.results import Result
from diffthrust._support.transfer import Transfer, transfer_of
from diffthrust._support.validation import check_word
from diffthrust.blackbox._sampled import Channels, System
from diffthrust.estimation._estimate import Estimate, parameter_rows
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log
from diffthrust.simulation._errors import Errors, errors

ModelKind = Literal["arx", "armax", "output_error", "state_space"]
Method = Literal["zero", "linear", "tustin"]
_Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A, B, C and D."""
_CLOSE = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class BlackBox(Result):
    """A sampled linear model of a log's inputs and outputs, with its parameters and errors.

    Args:
        kind: "arx", "armax", "output_error" or "state_space".
        orders: requested orders, by name.
        channels: inputs, outputs, their units, and the step.
        parameters: an `Estimate` for each; empty for matrices, which depend on the states' basis.
        covariance: of the parameters, ``(k, k)``; ``None`` if they are not identifiable. Like the
            standard errors it assumes white residuals, except for an output error, where it allows
            for correlated ones; see ``notes``.
        noise: standard deviation of the one-step prediction's error by output, in its unit.
        polynomials: A, C, and B by input, as coefficients of 1, q^-1, ... (B: from q^-delay on);
            empty for a state space.
        system: state-space form with predictor; its last input is 1 if an offset is estimated.
        plain: the same without states of the noise, from inputs to outputs.
        status: what may be claimed.
        bic: of the one-step errors, counting starting states as parameters; comparable between
            models of the same logs and outputs.
        samples: number of measured outputs.
        singular_values: of a subspace identification, for choosing an order; else empty.
        notes: caveats, one sentence each.

    Example:
        >>> model = dft.blackbox.arx(log, input="command", output="thrust", orders=(1, 1, 1))
        >>> model.kind, model.status, sorted(model.parameters)
        ('arx', <Status.CONVERGED: 'converged'>, ['a1', 'b1'])
        >>> model.step, model.poles.shape, model.stable, model.zeros().size
        (0.05, (1,), True, 0)
        >>> sorted(model.simulate(unseen)), sorted(model.predict(unseen))
        (['thrust'], ['thrust'])
        >>> list(model.errors(unseen).channels), model.transfer().den.size
        (['thrust'], 2)
        >>> figure = model.plot(unseen)
    """

    kind: ModelKind
    orders: Mapping[str, Any]
    channels: Channels = field(repr=False)
    parameters: Mapping[str, Estimate] = field(repr=False)
    covariance: np.ndarray | None = field(repr=False)
    noise: Mapping[str, float]
    polynomials: Mapping[str, np.ndarray] = field(repr=False)
    system: System = field(repr=False)
    plain: System = field(repr=False)
    status: Status
    bic: float = np.nan
    samples: int = 0
    singular_values: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    notes: tuple[str, ...] = ()

    @property
    def step(self) -> float:
        """Time between samples [s]."""
        return self.channels.step

    @property
    def poles(self) -> np.ndarray:
        """Poles in z, from inputs to outputs, ``(n,)``."""
        return np.linalg.eigvals(self.plain.a)

    @property
    def stable(self) -> bool:
        """Whether all poles lie within the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))

    def zeros(self, input: str | None = None, output: str | None = None) -> np.ndarray:
        """Zeros in z from one input to one output, without those of a delay."""
        num, _ = _fraction(*self._of(*self._pair(input, output)))
        return np.roots(num)

    def simulate(
        self, log: Log, *, start: Literal["estimated", "rest"] = "estimated"
    ) -> dict[str, np.ndarray]:
        """Simulate the outputs of a log from its inputs.

        Args:
            log: with the inputs; for ``start="estimated"`` also with the outputs.
            start: starting states estimated from the log's outputs, or all zero, like the inputs
                before the log.

        Returns:
            By output ``(n,)``, in the unit of the model's logs; with estimated starting states NaN
            in the first samples, up to the largest input delay.

        Raises:
            InputError: a channel is absent, or samples are uneven or have another step.
        """
        check_word("start", start, "estimated", "rest")
        record = self.channels.record(log)
        y = self.system.simulate(record.u, record.y if start == "estimated" else None)
        return dict(zip(self.channels.outputs, y.T, strict=True))

    def predict(self, log: Log) -> dict[str, np.ndarray]:
        """One-step predictions of a log: by output ``(n,)``. Raises as `simulate`."""
        record = self.channels.record(log)
        y = self.system.predict(record.u, record.y)
        return dict(zip(self.channels.outputs, y.T, strict=True))

    def errors(
        self, logs: Log | Sequence[Log], how: Literal["simulation", "prediction"] = "simulation"
    ) -> Errors:
        """RMSE, NRMSE and fit percent of free simulation, or of one-step prediction.

        The starting states of each log are estimated from it. Raises as `simulate`.
        """
        check_word("how", how, "simulation", "prediction")
        logs = [logs] if isinstance(logs, Log) else list(logs)
        pairs: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for log in logs:
            outputs = self.simulate(log) if how == "simulation" else self.predict(log)
            for name, modelled in outputs.items():
                measured = log.values(name, self.channels.units[name])
                # the first samples, in which inputs from before the log have a part, are left out
                measured = np.where(np.isnan(modelled), np.nan, measured)
                pairs.setdefault(name, []).append((measured, measured - modelled))
        return errors(pairs)

    def transfer(
        self, input: str | None = None, output: str | None = None, method: Method | None = None
    ) -> Transfer:
        """The continuous transfer function from one input to one output, with its dead time.

        It is accepted wherever the library takes a linear system, as in `dft.cycles.limit_cycles`.

        Args:
            input: name of the input; optional if there is only one.
            output: likewise.
            method: "zero" for an input held between samples, "linear" for a linear one; by default
                as in the logs. "tustin" is the bilinear transformation.

        Raises:
            InputError: a channel is unknown, or the poles have no continuous counterpart.
        """
        j, i = self._pair(input, output)
        matrices = _continued(*self._of(j, i), self.step, method or self.channels.hold)
        lag = self.plain.lags[j] * self.step if self.plain.lags else 0.0
        return transfer_of((*_fraction(*matrices), lag))

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
            import control as library
        except ImportError:
            raise InputError(
                "to_control: python-control is not installed.",
                "Install it: python -m pip install control. BlackBox.transfer() needs no more than "
                "this library.",
            ) from None
        # its own types lead Pyright in circles, after which it refuses every np.ix_ of the package
        control: Any = library
        check_word("to_control, form", form, "transfer", "states")
        s, m = self.plain, len(self.channels.inputs)
        lags = s.lags[:m] or (0,) * m
        names: Any = {"inputs": [*self.channels.inputs], "outputs": [*self.channels.outputs]}
        if form == "transfer":
            num, den = _fraction(*self._of(*self._pair(None, None)))
            den = np.concatenate([den, np.zeros(lags[0])])
            return control.TransferFunction(num, den, self.step, **names)
        # python-control has no input delay in discrete time: each is a chain of unit delays
        chains = (
            (np.eye(n, k=-1), np.eye(n, 1), np.eye(1, n, n - 1), [[float(n == 0)]]) for n in lags
        )
        late = control.append(*(control.StateSpace(*chain, self.step) for chain in chains))
        prompt = control.StateSpace(s.a, s.b[:, :m], s.c, s.d[:, :m], self.step)
        return control.ss(prompt * late, **names)

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
                f"Poles: {', '.join(_complex_word(pole) for pole in self.poles)} "
                f"({'stable' if self.stable else 'not stable'})",
                f"One-step error: {noise}; {self.samples} samples; BIC {self.bic:.1f}",
                *notes(self.notes),
            ),
        )

    @showing
    def plot(self, log: Log) -> Figure:
        """Measured, simulated and predicted outputs of a log, and the residuals."""
        from diffthrust.blackbox._figures import model_figure

        # an output error predicts what it simulates
        predicted = {} if self.kind == "output_error" else self.predict(log)
        fits = {name: error.fit_percent for name, error in self.errors(log).channels.items()}
        title = f"{log.name}: {self}"
        units = self.channels.units
        return model_figure(title, log, units, self.simulate(log), predicted, fits)

    def __str__(self) -> str:
        orders = ", ".join(f"{name} {value}" for name, value in self.orders.items())
        return f"{self.kind.replace('_', ' ')} ({orders})"

    def _pair(self, input: str | None, output: str | None) -> tuple[int, int]:
        """The indices of an input and an output."""
        places = []
        named = (("input", input, self.channels.inputs), ("output", output, self.channels.outputs))
        for what, name, available in named:
            if name is None and len(available) == 1:
                name = available[0]
            if name not in available:
                raise InputError(
                    f"{what}: expected one of {listing(available)}, found {name!r}.",
                    f"Write {what}={available[0]!r}.",
                )
            places.append(available.index(name))
        return places[0], places[1]

    def _of(self, j: int, i: int) -> _Matrices:
        """A, B, C and D of one input and one output, without noise and lag."""
        s = self.plain
        return s.a, s.b[:, [j]], s.c[[i]], s.d[[i]][:, [j]]


def _fraction(a: Any, b: Any, c: Any, d: Any) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of one input and one output, highest power first."""
    den = np.real(np.atleast_1d(np.poly(a)))
    # |C adj(s - A) B| = |s - A + B C| - |s - A|
    num = np.real(np.poly(a - b @ c)) - den + d[0, 0] * den
    # rounding in a leading coefficient would be a zero near infinity
    num[np.abs(num) < 1e-12 * max(1e-300, np.abs(num).max())] = 0.0
    first = int(np.argmax(num != 0)) if num.any() else num.size - 1
    return num[first:], den


def _complex_word(value: complex) -> str:
    """A complex number with five digits: many poles lie close to 1."""
    if abs(np.imag(value)) < 1e-9 * max(1.0, abs(value)):
        return f"{np.real(value):.5g}"
    return f"{np.real(value):.5g} {'+' if np.imag(value) > 0 else '-'} {abs(np.imag(value)):.5g}i"


def _continued(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, step: float, method: str
) -> tuple[np.ndarray, ...]:
    """A, B, C and D of the continuous system whose sampling gives a system.

    The input between samples is held (``"zero"``) or ``"linear"``, which is inverted exactly;
    ``"tustin"`` is the bilinear transformation, for any system without a pole at -1.
    """
    check_word("method", method, "zero", "linear", "tustin")
    n = len(a)
    if method == "tustin":
        if np.min(np.abs(np.linalg.eigvals(a) + 1.0)) < 1e-9:
            raise InputError(
                "The sampled model has a pole at -1, which the bilinear transformation has not.",
                "Choose another order.",
            )
        inverse = np.linalg.inv(a + np.eye(n))
        # shared between B and C, as in control texts: the gramians stay those of the sampled system
        root = 2.0 / np.sqrt(step)
        grown = 2.0 / step * (a - np.eye(n)) @ inverse
        return grown, root * inverse @ b, root * c @ inverse, d - c @ inverse @ b
    grown = _logarithm(a) / step
    by_value, by_slope = _steps(grown, step)
    if method == "zero":
        return grown, np.linalg.solve(by_value, b), c, d
    # With z = x - by_slope B u, a linear input acts like a step of u.
    b = np.linalg.solve(by_value - by_slope + a @ by_slope, b)
    return grown, b, c, d - c @ by_slope @ b


def _steps(a: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Response within a step to u held, and to u rising from 0 to 1; ``(n, n)`` each."""
    from scipy.linalg import expm

    n = len(a)
    # Van Loan 1978: one exponential of a block matrix gives the integrals of exp(A t), without the
    # inverse of A, which an integrator does not have
    block = np.zeros((3 * n, 3 * n))
    block[:n, :n] = a * step
    block[:n, n : 2 * n] = np.eye(n) * step
    block[n : 2 * n, 2 * n :] = np.eye(n)
    grown = expm(block)
    return grown[:n, n : 2 * n], grown[:n, 2 * n :]


def _logarithm(a: np.ndarray) -> np.ndarray:
    from scipy.linalg import expm, logm

    poles = np.linalg.eigvals(a)
    # a sampled pole is exp(s T): never zero, and negative only as one of a pair that has lost its
    # partner
    real = np.abs(poles.imag) < 1e-12 * np.abs(poles)
    lost = poles[(np.abs(poles) < 1e-9) | (real & (poles.real <= 0))]
    if not lost.size:
        full: Any = logm(a)
        real_part = np.real(full)
        # the principal logarithm of a nearly defective matrix may be wrong without an error: taken
        # back
        if np.allclose(expm(real_part), a, rtol=_CLOSE, atol=_CLOSE):
            return real_part
    where = ", ".join(f"{pole.real:.3g}" for pole in lost) or "what rounding cannot tell from those"
    raise InputError(
        f"The sampled model has poles at {where}; no continuous system of its order, sampled, has "
        "poles at zero or on the negative real axis.",
        "Choose a lower order, no more coefficients in B than in A, or method='tustin'.",
    )
