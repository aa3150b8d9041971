"""Residuals of polynomial models with their gradients by filtering.

All models here are A(q) y = sum of q^-delay B(q) u + C(q) e, with C = 1 (ARX), a free C (ARMAX), or
C = A (output error). Source: Ljung 1999, System Identification, 2nd
edition, sections 10.2 and 10.3. The past before a record is eliminated in each stretch (variable
projection, Golub & Pereyra 1973): of a simulation as free starting values, of a free C as errors of
the same law, with which the likelihood is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import whole_number
from diffthrust.blackbox._sampled import Channels, SampledLog, passed


@dataclass(frozen=True)
class Shape:
    """The numbers of coefficients of A, of each input's B, and of C, which may be ``tied`` to A."""

    na: int
    nb: tuple[int, ...]
    nc: int
    delays: tuple[int, ...]
    """Of each input [samples]."""
    tied: bool = False

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.na + sum(self.nb) + self.nc

    @property
    def first(self) -> int:
        """The first sample with all its inputs inside the record."""
        return max(d + n - 1 for d, n in zip(self.delays, self.nb, strict=True))

    @property
    def reach(self) -> int:
        """Number of past samples in an equation."""
        return max(self.na, self.first)

    def split(self, theta: np.ndarray) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
        """Polynomials A, B by input, and C."""
        a = np.concatenate([[1.0], theta[: self.na]])
        ends = self.na + np.cumsum([0, *self.nb])
        b = [theta[i:j] for i, j in pairwise(ends)]
        c = a if self.tied else np.concatenate([[1.0], theta[ends[-1] :]])
        return a, b, c

    def late(self, record: SampledLog, t: np.ndarray) -> list[np.ndarray]:
        """The inputs that samples ``t`` of a record depend on, each by its coefficient."""
        lags = enumerate(zip(self.delays, self.nb, strict=True))
        return [record.u[t - d - i, j] for j, (d, n) in lags for i in range(n)]

    @property
    def without_c(self) -> Shape:
        """The same without C."""
        return Shape(self.na, self.nb, 0, self.delays)

    def with_c(self, theta: np.ndarray, c: np.ndarray) -> np.ndarray:
        """The coefficients with C replaced."""
        return np.concatenate([theta[: self.na + sum(self.nb)], c[1:]])


Orders = Sequence[int | Sequence[int]]
"""A number for each name; nb and delay may be tuples by input."""
_LEAST = {"na": 0, "nb": 1, "nc": 0, "nf": 0, "delay": 0, "order": 1}


def shape_of(what: str, orders: Orders, names: Sequence[str], channels: Channels) -> Shape:
    """The coefficients for given orders, one for each name of ``("na", "nb", "delay")``."""
    if not isinstance(orders, Sequence) or len(orders) != len(names):
        raise InputError(
            f"{what}, orders: expected ({', '.join(names)}), found {orders!r}.",
            f"Write orders=({', '.join('1' if n in ('delay', 'nc') else '2' for n in names)}).",
        )
    numbers_by_name: dict[str, Any] = dict(zip(names, orders, strict=True))
    count = len(channels.inputs)
    by_input = {}
    for name in ("nb", "delay"):
        value = numbers_by_name.pop(name)
        several = isinstance(value, Sequence) and not isinstance(value, str)
        values = list(value) if several else [value] * count
        if len(values) != count:
            raise InputError(
                f"{what}, orders: expected {name} once or for each of {count} inputs, found "
                f"{value!r}.",
                "Correct it.",
            )
        by_input[name] = [check_order(what, name, v) for v in values]
    numbers = {name: check_order(what, name, value) for name, value in numbers_by_name.items()}
    nb, delay = by_input["nb"], by_input["delay"]
    if channels.offset:
        # an offset is one more input that is always 1: it needs one coefficient and no delay
        nb, delay = [*nb, 1], [*delay, 0]
    tied = "nf" in numbers
    na = numbers["nf" if tied else "na"]
    return Shape(na, tuple(nb), numbers.get("nc", 0), tuple(delay), tied)


def check_order(what: str, name: str, value: Any) -> int:
    """Check an order against the least value of its name."""
    return whole_number(f"{what}, {name}", value, _LEAST[name])


def equations(record: SampledLog, shape: Shape) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows of past values, and the output, for each stretch without a gap.

    Returns:
        ``(samples (n,), rows (n, na + nb), y (n,))`` of each stretch; y = rows @ (a, b) + C e.
    """
    y, rows = record.y[:, 0], []
    for begin, end in record.segments:
        t = np.arange(max(begin + shape.na, shape.first), end)
        if t.size:
            columns = [-y[t - i] for i in range(1, shape.na + 1)]
            rows.append((t, np.stack(columns + shape.late(record, t), axis=1), y[t]))
    return rows


@dataclass(frozen=True)
class Stretch:
    """Residuals of samples without a gap."""

    residuals: np.ndarray
    """``(n,)``, with a free C followed by the errors before the first sample."""
    samples: int
    """Number of measured ones."""
    gradient: np.ndarray
    """Of the residuals, by coefficients, ``(n, k)``."""
    past: int = 0
    """Number of values before the first sample that were eliminated."""
    log_determinant: float = 0.0
    """Of the covariance of the output's errors, in units of their variance."""
    slope: np.ndarray | float = 0.0
    """Of ``log_determinant``, ``(k,)``."""

    @property
    def errors(self) -> np.ndarray:
        """Residuals of measured samples."""
        return self.residuals[: self.samples]


def stretches(records: Sequence[SampledLog], shape: Shape, theta: np.ndarray) -> list[Stretch]:
    """Residuals by stretch."""
    residuals_of = _simulated if shape.tied else _predicted
    return [stretch for record in records for stretch in residuals_of(record, shape, theta)]


def _predicted(record: SampledLog, shape: Shape, theta: np.ndarray) -> list[Stretch]:
    """C e = A y - B u in each stretch without a gap, with errors before it of the same variance.

    Left free, the errors before a stretch would be too large without a price where C has a zero
    outside the unit circle, and the search would end there: white noise on the output, whose C is
    A, did so in half of all records. Source: Box & Jenkins 1976, appendix A7.4.
    """
    _, _, c = shape.split(theta)
    count, out = shape.nc, []
    # what the errors before a stretch, the latest first, add to its first samples
    entering = np.array([[c[t + j] if t + j <= count else 0.0 for j in range(1, count + 1)]
                         for t in range(count)]).reshape(count, count)  # fmt: skip
    for _, rows, y in equations(record, shape):
        wrong = y - rows @ theta[: rows.shape[1]]
        if not count:
            out.append(Stretch(wrong, y.size, -rows))
            continue
        e, answers = passed(c, wrong), -_pulses(c, y.size, count) @ entering[: y.size]
        _check_finite(e, answers)
        basis = np.concatenate([answers, np.eye(count)])
        e = np.concatenate([e, np.zeros(count)])
        past = np.linalg.lstsq(basis, -e, rcond=None)[0]
        e = e + basis @ past

        def by_c(now: np.ndarray, before: np.ndarray) -> list[np.ndarray]:
            joined = np.concatenate([before[::-1], now])
            return [-passed(c, joined[count - i : count - i + now.size])
                    for i in range(1, count + 1)]  # fmt: skip

        slopes = np.stack(by_c(e[: y.size], past), axis=1)
        gradient = np.concatenate([-passed(c, rows), slopes], axis=1)
        gradient = np.concatenate([gradient, np.zeros((count, theta.size))])
        spread = basis.T @ basis
        turned = np.stack([by_c(answers[:, j], unit) for j, unit in enumerate(np.eye(count))])
        slope = np.zeros(theta.size)
        slope[-count:] = 2.0 * np.einsum("jk,kit,tj->i", np.linalg.inv(spread), turned, answers)
        out.append(
            Stretch(e, y.size, _freed(gradient, basis), count, np.linalg.slogdet(spread)[1], slope)
        )
    return out


def _simulated(record: SampledLog, shape: Shape, theta: np.ndarray) -> list[Stretch]:
    """Y - w with A w = B u + starting values; gaps are left out."""
    a, b, _ = shape.split(theta)
    t = np.arange(min(shape.first, len(record.u)), len(record.u))
    measured = record.complete[t]
    if not measured.any():
        return []
    y = record.y[t, 0][measured]
    rows = passed(a, np.stack(shape.late(record, t), axis=1))
    driven = rows @ np.concatenate(b)
    basis = _pulses(a, t.size, shape.na)
    _check_finite(driven, basis)
    # nearly equal poles make nearly equal responses: directions at rounding level are left out
    start = np.linalg.lstsq(basis[measured], y - driven[measured], rcond=1e-12)[0]
    w = driven + basis @ start
    past = passed(a, w)
    by_a = [_later(past, i) for i in range(1, shape.na + 1)]
    gradient = np.concatenate([*(x[:, None] for x in by_a), -rows], axis=1)[measured]
    freed = _freed(gradient, basis[measured])
    return [Stretch(y - w[measured], y.size, freed, start.size)]


def _check_finite(*series: np.ndarray) -> None:
    """Raise before LAPACK receives non-finite output of an unstable filter."""
    if not all(np.isfinite(x).all() for x in series):
        raise FloatingPointError


def _later(x: np.ndarray, samples: int) -> np.ndarray:
    return np.concatenate([np.zeros(samples), x])[: x.size]


def _pulses(c: np.ndarray, size: int, count: int) -> np.ndarray:
    """Responses to starting values at the first samples, ``(size, count)``."""
    pulse = passed(c, np.eye(1, size)[0])
    later = [_later(pulse, i) for i in range(min(count, size))]
    return np.stack(later, axis=1) if later else np.zeros((size, 0))


def _freed(gradient: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """The gradient with starting values profiled out (projected off their responses)."""
    # Kaufman's simplification of the variable-projection gradient: its second term is of the order
    # of the residuals
    q, _ = np.linalg.qr(basis)
    return gradient - q @ (q.T @ gradient)
