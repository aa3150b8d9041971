"""Orders of black boxes, and the criteria by which they are chosen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import whole_number
from diffthrust.blackbox._prediction_error import Shape
from diffthrust.blackbox._records import Channels, SampledLog
from diffthrust.blackbox._system import System

_LAGS = 25
WHITENESS_LEVEL = 0.001
"""Probability of taking white residuals for correlated ones."""


def samples_of(records: Sequence[SampledLog]) -> int:
    """Number of measured outputs."""
    return int(sum(np.isfinite(record.y).sum() for record in records))


def bic_of(system: System, records: Sequence[SampledLog], size: int) -> tuple[float, np.ndarray]:
    """The Bayesian information criterion of the one-step errors, and their standard deviations.

    Source: Schwarz 1978, with the Gaussian likelihood of white errors. All models are rated on the
    same samples, each from its best starting states, which count as parameters of each record.
    """
    e = np.concatenate([record.y - system.predict(record.u, record.y) for record in records])
    if np.isinf(e).any():
        return np.inf, np.full(e.shape[1], np.inf)
    e = e[np.isfinite(e).all(axis=1)]
    spread = e.T @ e / len(e)
    # noise-free logs leave rounding only: the logarithm stays finite, and more orders gain nothing
    floor = 1e-26 * np.mean(np.concatenate([r.y[r.complete] for r in records]) ** 2)
    _, logarithm = np.linalg.slogdet(spread + floor * np.eye(len(spread)))
    free = size + len(records) * system.order
    # count all measurements: a model with a longer delay does not predict the first samples
    samples = sum(int(record.complete.sum()) for record in records)
    degrees = max(1.0, samples - free / len(spread))
    criterion = float(samples * logarithm + free * np.log(samples))
    return criterion, np.sqrt(np.diag(spread) * samples / degrees)


def memory_of(residuals: Sequence[np.ndarray], used: int) -> tuple[float, float]:
    """The correlation at one step, and its probability if residuals were white.

    Source: Ljung & Box 1978, pooled over stretches, with ``used`` coefficients taken off.
    """
    from scipy.stats import chi2  # takes a while

    pooled = np.concatenate(residuals)
    power = float(pooled @ pooled)
    # the chi-square law holds for many more samples than lags
    if pooled.size < 4 * _LAGS or not power > 0:
        return np.nan, np.nan
    lags = np.arange(1, _LAGS + 1)
    rho = [sum(float(e[k:] @ e[:-k]) for e in residuals if e.size > k) / power for k in lags]
    statistic = pooled.size * (pooled.size + 2) * np.sum(np.square(rho) / (pooled.size - lags))
    return rho[0], float(chi2.sf(statistic, max(1, _LAGS - used)))


def memory_note(memory: tuple[float, float], allowed_for: bool) -> tuple[str, ...]:
    """A note if residuals are not white."""
    if not memory[1] < WHITENESS_LEVEL:
        return ()
    means = "standard errors hold for white ones only."
    if allowed_for:
        means = "standard errors allow for that if the noise knows nothing of the input."
    return (
        f"The residuals last from sample to sample (correlation {memory[0]:.2f} at one step, "
        f"Ljung-Box p < {WHITENESS_LEVEL}): {means}",
    )


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
