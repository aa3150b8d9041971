"""A sampled linear model of a log's inputs and outputs, as numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.results import Brief
from diffthrust._support.transfer import Transfer, transfer_of
from diffthrust.blackbox._continuous import Method, continued
from diffthrust.blackbox._records import Channels
from diffthrust.blackbox._system import System
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log
from diffthrust.simulation._errors import Errors, errors

ModelKind = Literal["arx", "armax", "output_error", "state_space"]


@dataclass(frozen=True, eq=False, repr=False)
class SampledModel(Brief):
    """A sampled linear model of a log's inputs and outputs.

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
        num, _ = self.rational(*self.pair(input, output))
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
        if start not in ("estimated", "rest"):
            raise InputError(
                f"start: expected 'estimated' or 'rest', found {start!r}.", "Correct it."
            )
        record = self.channels.record(log)
        y = self.system.simulate(record.u, record.y if start == "estimated" else None)
        return {name: y[:, i] for i, name in enumerate(self.channels.outputs)}

    def predict(self, log: Log) -> dict[str, np.ndarray]:
        """One-step predictions of a log: by output ``(n,)``. Raises as `simulate`."""
        record = self.channels.record(log)
        y = self.system.predict(record.u, record.y)
        return {name: y[:, i] for i, name in enumerate(self.channels.outputs)}

    def errors(
        self, logs: Log | Sequence[Log], how: Literal["simulation", "prediction"] = "simulation"
    ) -> Errors:
        """RMSE, NRMSE and fit percent of free simulation, or of one-step prediction.

        The starting states of each log are estimated from it. Raises as `simulate`.
        """
        if how not in ("simulation", "prediction"):
            raise InputError(
                f"how: expected 'simulation' or 'prediction', found {how!r}.", "Correct it."
            )
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
        j, i = self.pair(input, output)
        a, b, c, d = continued(self._of(j, i), self.step, method or self.channels.hold)
        lag = self.plain.lags[j] * self.step if self.plain.lags else 0.0
        den = np.real(np.atleast_1d(np.poly(a)))
        # |C adj(s - A) B| = |s - A + B C| - |s - A|
        num = np.real(np.poly(a - b @ c)) - den + d[0, 0] * den
        # rounding in a leading coefficient would be a zero near infinity
        num[np.abs(num) < 1e-12 * np.abs(num).max(initial=0.0)] = 0.0
        if not num.any():
            num = np.zeros(1)
        return transfer_of((num, den, lag))

    def __str__(self) -> str:
        orders = ", ".join(f"{name} {value}" for name, value in self.orders.items())
        return f"{self.kind.replace('_', ' ')} ({orders})"

    def pair(self, input: str | None, output: str | None) -> tuple[int, int]:
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

    def _of(self, j: int, i: int) -> System:
        """The system of one input and one output, without noise and lag."""
        s = self.plain
        return System(s.a, s.b[:, [j]], s.c[[i]], s.d[[i]][:, [j]], np.zeros((s.order, 1)))

    def rational(self, j: int, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Numerator and denominator in z, highest power first, without the lag."""
        s = self._of(j, i)
        den = np.real(np.poly(s.a))
        num = np.real(np.poly(s.a - s.b @ s.c)) - den + s.d[0, 0] * den
        num[np.abs(num) < 1e-12 * max(1e-300, np.abs(num).max())] = 0.0
        first = int(np.argmax(num != 0)) if num.any() else num.size - 1
        return num[first:], den
