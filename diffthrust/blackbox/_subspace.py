"""State-space models by subspace identification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import check_word
from diffthrust.blackbox._model import BlackBox
from diffthrust.blackbox._polynomial import check_enough, searched
from diffthrust.blackbox._prediction_error import Shape, check_order
from diffthrust.blackbox._sampled import SampledLog, System, sampled_channels
from diffthrust.blackbox._search import armax_starts, bic_of, reflected, samples_of
from diffthrust.blackbox._simulation_error import simulation_fit
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log

_LONGEST = 30


def state_space(
    logs: Log | Sequence[Log],
    *,
    input: str | Sequence[str],
    output: str | Sequence[str],
    order: int = 2,
    delay: int = 1,
    offset: bool = False,
    refine: bool = True,
    focus: Literal["prediction", "simulation"] = "prediction",
    horizon: int | None = None,
) -> BlackBox:
    """x(t + 1) = A x + B u + K e, y = C x + D u + e, by a subspace method and a search.

    A long ARX model predicts the next ``horizon`` samples from the past; the directions in which
    these predictions vary most are the states, and the matrices follow by least squares. This works
    in closed loop and for unstable systems, unlike N4SID and MOESP, whose projections assume inputs
    independent of the noise. With one output a search then minimises the prediction error in the
    coefficients of A, B and C of such a system (`armax` of orders ``(order, order, order,
    delay)``), which have standard errors; several outputs keep the subspace estimate.

    A good one-step predictor need not simulate a run well: with smooth outputs (filtered speeds of
    a vessel) the subspace predicts from them and nearly misses the inputs. With
    ``focus="simulation"`` the error of free simulation is minimised instead, for one output or
    several, each scaled by its size; the predictor is dropped (K = 0).

    Args:
        logs: one or several, evenly sampled with the same step; missing outputs as NaN.
        input: name of the input, or several.
        output: name of the measured channel, or several.
        order: number of states.
        delay: samples after which inputs first act; 0 for a direct path D.
        offset: estimate a constant input.
        refine: minimise the error by a search, where one exists for the focus.
        focus: one-step prediction, or free simulation (also started from shorter horizons).
        horizon: of the long ARX model [samples]; by default that of the least Akaike criterion.

    Raises:
        InputError: channels are absent, samples uneven, numbers invalid, or stretches without a
            gap too short.

    Source: Jansson 2003 (SSARX); Chiuso 2007, Automatica 43 (PBSID); van der Veen et al. 2013,
    IET Control Theory & Applications 7.

    Example:
        >>> model = dft.blackbox.state_space(
        ...     log, input="command", output="thrust", order=1, refine=False
        ... )
        >>> model.singular_values.ndim, model.kind
        (1, 'state_space')
    """
    check_word("state_space, focus", focus, "prediction", "simulation")
    channels, records = sampled_channels(logs, input, output)
    order = check_order("state_space", "order", order)
    delay = check_order("state_space", "delay", delay)
    direct, lag = delay == 0, max(delay - 1, 0)
    m, p = len(channels.inputs), len(channels.outputs)
    series, level, size = _standardised(records, lag, offset)
    if horizon is None:
        horizon = _horizon(series, m, order, direct)
    elif check_order("state_space", "order", horizon) <= order:
        raise InputError(
            f"state_space, horizon: expected more than the order {order}, found {horizon}.",
            "Raise it, or leave it out.",
        )
    if offset:
        channels, records = sampled_channels(logs, input, output, offset=True)

    def of_horizon(horizon: int) -> tuple[System, np.ndarray]:
        a, b, c, d, k, values = _identified(series, m, order, horizon, direct)
        b, k = b / size[:m], k / size[m:]
        c, d = c * size[m:, None], d * size[m:, None] / size[:m]
        if offset:
            away = -level[:m]
            b = np.concatenate([b, (b @ away)[:, None]], axis=1)
            d = np.concatenate([d, (d @ away + level[m:])[:, None]], axis=1)
        return System(a, b, c, d, k, (lag,) * m + (0,) * offset), values

    system, values = of_horizon(horizon)
    free = order * (m + 2 * p) + direct * m * p + offset * p
    bic, deviation = bic_of(system, records, free)
    model = BlackBox(
        kind="state_space",
        orders={"order": order, "delay": delay},
        channels=channels,
        parameters={},
        covariance=None,
        noise={name: float(deviation[i]) for i, name in enumerate(channels.outputs)},
        polynomials={},
        system=system,
        plain=replace(system, k=np.zeros_like(system.k)),
        status=Status.CONVERGED,
        bic=bic,
        samples=samples_of(records),
        singular_values=values,
        notes=(f"The long ARX model has {horizon} lags.",),
    )
    if refine and focus == "simulation":
        shorter = {max(order + 1, round(share * horizon)) for share in (1 / 3, 2 / 3)}
        # several horizons are several starts: the error of free simulation has many minima
        starts = [system, *(of_horizon(h)[0] for h in sorted(shorter - {horizon}))]
        return _simulating(model, starts, records, direct, free - order * p)
    return _refined(model, records, order, delay) if refine and p == 1 else model


def _standardised(
    records: Sequence[SampledLog], lag: int, offset: bool
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Delayed inputs and outputs side by side, ``(n, m + p)``, NaN in gaps; their level and size.

    The mean is taken off before the regression and comes back as the offset input's columns.
    """
    joined = np.concatenate([np.concatenate([r.u, r.y], axis=1)[r.complete] for r in records])
    level = joined.mean(axis=0) if offset else np.zeros(joined.shape[1])
    before = np.full((lag, records[0].u.shape[1]), np.nan)
    late = (np.concatenate([before, r.u])[: len(r.u)] for r in records)
    series = [np.concatenate([u, r.y], axis=1) - level for u, r in zip(late, records, strict=True)]
    joined = np.concatenate(series)
    size = np.sqrt(np.mean(joined[np.isfinite(joined).all(axis=1)] ** 2, axis=0))  # any units
    size[~(size > 0)] = 1.0
    return [z / size for z in series], level, size


def _windows(series: Sequence[np.ndarray], length: int) -> np.ndarray:
    """All stretches of a given length without a gap, ``(count, length, m + p)``."""
    windows = [np.zeros((0, length, series[0].shape[1]))]
    for z in (z for z in series if len(z) >= length):
        view = np.lib.stride_tricks.sliding_window_view(z, length, axis=0)
        windows.append(np.moveaxis(view[np.isfinite(view).all(axis=(1, 2))], -1, 1))
    return np.concatenate(windows)


def _horizon(series: Sequence[np.ndarray], m: int, order: int, direct: bool) -> int:
    """The number of lags of least Akaike criterion, on the same samples for all."""
    width = series[0].shape[1]
    least = max(2 * order, order + 1, 5)
    samples = sum(int(np.isfinite(z).all(axis=1).sum()) for z in series)
    most = max(least, min(max(_LONGEST, 3 * order), samples // (8 * width)))
    # gaps cut long windows out of a log: lags are lowered until there are four windows for each
    # unknown
    while most > least and len(_windows(series, most + 1)) < 4 * most * width:
        most -= 1
    windows = _windows(series, most + 1)
    _check(windows, least, width)
    past = windows[:, :-1][:, ::-1].reshape(len(windows), -1)  # the latest lag first
    now = windows[:, -1]
    y, extra = now[:, m:], now[:, :m] if direct else np.zeros((len(now), 0))
    best = (np.inf, least)
    floor = 1e-20 * float(np.mean(y**2)) * np.eye(y.shape[1])
    for lags in range(least, most + 1):
        rows = np.concatenate([extra, past[:, : lags * width]], axis=1)
        wrong = y - rows @ np.linalg.lstsq(rows, y, rcond=None)[0]
        _, logarithm = np.linalg.slogdet(wrong.T @ wrong / len(y) + floor)
        best = min(best, (len(y) * logarithm + 2 * rows.shape[1] * y.shape[1], lags))
    return best[1]


def _check(windows: np.ndarray, lags: int, width: int) -> None:
    if len(windows) < 2 * lags * width:
        raise InputError(
            f"state_space: {len(windows)} stretches of {lags + 1} samples without a gap; expected "
            f"{2 * lags * width} or more.",
            "Give longer logs, a lower order, or a shorter horizon.",
        )


def _identified(
    series: Sequence[np.ndarray], m: int, order: int, horizon: int, direct: bool
) -> tuple[np.ndarray, ...]:
    """A, B, C, D, K and the singular values."""
    windows = _windows(series, horizon + 1)
    width = windows.shape[2]
    p = width - m
    _check(windows, horizon, width)
    if order > horizon * p:
        raise InputError(
            f"state_space, order: expected at most {horizon * p} states for a horizon of "
            f"{horizon} samples, found {order}.",
            "Raise the horizon or lower the order.",
        )
    past = windows[:, :-1].reshape(len(windows), -1)
    future = windows[:, 1:].reshape(len(windows), -1)
    u, y = windows[:, -1, :m], windows[:, -1, m:]
    extra = u if direct else u[:, :0]
    rows = np.concatenate([past, extra], axis=1)
    markov = np.linalg.lstsq(rows, y, rcond=None)[0][: horizon * width]
    stacked = np.zeros((horizon * p, horizon * width))
    for i in range(horizon):  # prediction of the i-th sample from now
        stacked[i * p : (i + 1) * p, i * width :] = markov[: (horizon - i) * width].T
    # the factor R weighs the past by its own covariance: the singular values are then of predicted
    # outputs, and not of coefficients
    _, r = np.linalg.qr(past)
    directions, values, _ = np.linalg.svd(stacked @ r.T, full_matrices=False)
    states = (directions[:, :order].T @ stacked).T
    x, following = past @ states, future @ states
    scale = np.sqrt(np.mean(x**2, axis=0))
    scale[scale == 0] = 1.0
    x, following = x / scale, following / scale
    outputs_from = np.concatenate([x, extra], axis=1)
    cd = np.linalg.lstsq(outputs_from, y, rcond=None)[0]
    e = y - outputs_from @ cd
    regressors = np.concatenate([x, u, e], axis=1)
    size = np.sqrt(np.mean(regressors**2, axis=0))
    small = size <= 1e-9 * np.sqrt(np.mean(y**2))  # errors at rounding level are no regressors
    regressors = np.where(small, 0.0, regressors)
    abk = np.linalg.lstsq(regressors, following, rcond=1e-12)[0]
    a, b, k = abk[:order].T, abk[order : order + m].T, abk[order + m :].T
    d = cd[order:].T if direct else np.zeros((p, m))
    return a, b, cd[:order].T, d, k, values


def _simulating(
    model: BlackBox,
    starts: Sequence[System],
    records: Sequence[SampledLog],
    direct: bool,
    size: int,
) -> BlackBox:
    """The same after searches for the least error of free simulation."""
    free = np.full(model.system.d.shape, direct)
    free[:, len(model.channels.inputs) :] = True  # of the offset
    ended = simulation_fit(starts, records, free)
    bic, deviation = bic_of(ended.system, records, size)
    return replace(
        model,
        system=ended.system,
        plain=ended.system,
        noise=dict(zip(model.channels.outputs, map(float, deviation), strict=True)),
        status=Status.CONVERGED if ended.stationary else Status.NOT_CONVERGED,
        bic=bic,
        notes=(
            *model.notes,
            "Fitted by free simulation: its prediction is its simulation; "
            f"{ended.agreeing} of {len(starts)} starts end there.",
        ),
    )


def _refined(model: BlackBox, records: Sequence[SampledLog], order: int, delay: int) -> BlackBox:
    """The same system after a search for the least prediction error."""
    s, inputs = model.system, model.system.b.shape[1]
    a = np.real(np.poly(s.a))
    direct = delay == 0
    rows, delays = [], []
    for j in range(inputs):
        num = np.real(np.poly(s.a - s.b[:, [j]] @ s.c)) - a + s.d[0, j] * a
        is_offset = j == len(model.channels.inputs)
        rows.append([num.sum()] if is_offset else num if direct else num[1:])
        delays.append(0 if is_offset else delay)
    shape = Shape(order, tuple(len(row) for row in rows), order, tuple(delays))
    try:
        check_enough("state_space", records, shape)
        c = reflected(np.real(np.poly(s.a - s.k @ s.c)))
        starts = [np.concatenate([a[1:], *rows, c[1:]]), *armax_starts(records, shape)]
        refined = searched("state_space", model.channels, records, shape, starts)
    except InputError:
        return model
    if not np.isfinite(refined.bic):
        return model
    return replace(
        refined,
        orders=model.orders,
        singular_values=model.singular_values,
        notes=(*model.notes, *refined.notes),
    )
