"""Whole-run errors by a plain least squares: the figures that a summary is held against.

The equations are written out here once more, in NumPy; SciPy fits them to whole runs from several
starts. A run is simulated from its first state to its end under its own inputs, by the classical
Runge-Kutta method with steps short enough for the fastest rate. All runs, and all the parameter
sets that a Jacobian needs, are integrated side by side.

    from reference import whole_runs as wr

    found = wr.fit(wr.twin_boat(), train, starts=4)      # train: list of wr.Run
    wr.errors(found.system, unseen, found.values)        # {"surge": 0.31, ..., "all": 0.74}

`all` is the root mean square over the channels, each channel's error pooled over the runs and
divided by the standard deviation of what was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

Array = np.ndarray
Signals = Mapping[str, Any]

_STEP_TIMES_RATE = 1.0
"""A Runge-Kutta step times the fastest rate: stable below 2.78, accurate to some 1e-3 here."""
_MOST_SUBSTEPS = 64
_BEYOND = 1e3
"""Residual, in standard deviations, of a run that cannot be simulated."""


@dataclass(frozen=True)
class Run:
    """One log as plain arrays in SI units; NaN where nothing was measured.

    ``linear`` names the inputs that run straight between samples, the others keep their value;
    ``unsigned`` the channels whose sensor gives no sign.
    """

    time: Array
    inputs: Mapping[str, Array]
    measured: Mapping[str, Array]
    initial: Mapping[str, float] = field(default_factory=dict)
    name: str = "run"
    linear: frozenset[str] = frozenset()
    unsigned: frozenset[str] = frozenset()

    @classmethod
    def of(cls, log: Any, **initial: float) -> Run:
        """The arrays of a log."""
        inputs = {name: np.asarray(x, float) for name, x in log.inputs.items()}
        measured = {name: np.asarray(x, float) for name, x in log.measured.items()}
        linear = frozenset(name for name, hold in log.hold.items() if hold == "linear")
        time, unsigned = np.asarray(log.time, float), frozenset(log.unsigned)
        return cls(time, inputs, measured, initial, log.name, linear, unsigned)


class Range(NamedTuple):
    """Start and bounds of a parameter; equal bounds hold it."""

    start: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class System:
    """States, their rates, and what is measured of them, as functions of arrays of any shape.

    ``rates(x, u, p)`` gives the rates of ``x`` (by state name), ``outputs(x, u, p)`` the channels;
    ``fastest(p)`` is the fastest rate [1/s], from which the substeps follow. ``delays`` names the
    parameter that delays an input [s]; ``linear`` the inputs that run straight between samples.
    """

    states: tuple[str, ...]
    rates: Callable[[Signals, Signals, Signals], Signals]
    outputs: Callable[[Signals, Signals, Signals], Signals]
    parameters: Mapping[str, Range]
    fastest: Callable[[Signals], Any] = lambda p: 0.0
    delays: Mapping[str, str] = field(default_factory=dict)
    linear: frozenset[str] = frozenset()
    angles: frozenset[str] = frozenset()

    def fixed(self, **values: float) -> System:
        """The same, with some parameters held at values."""
        held = {name: Range(value, value, value) for name, value in values.items()}
        return replace(self, parameters={**self.parameters, **held})

    def ranged(self, **ranges: tuple[float, float, float]) -> System:
        """The same, with other starts and bounds."""
        new = {name: Range(*r) for name, r in ranges.items()}
        return replace(self, parameters={**self.parameters, **new})


class Found(NamedTuple):
    """The lowest cost of all starts, and what the other starts reached."""

    system: System
    values: dict[str, float]
    errors: dict[str, float]
    costs: list[float]


def simulate(system: System, runs: Sequence[Run], values: Mapping[str, Any]) -> list[dict]:
    """Channels of every run; a parameter may be an array, one value for each of several sets.

    Each channel has the shape (samples, sets), or (samples,) where no parameter is an array.
    """
    sets = max((np.size(v) for v in values.values()), default=1)
    count, longest = len(runs), max(len(run.time) for run in runs)
    p = {n: np.broadcast_to(np.asarray(v, float), (sets,))[None, :] for n, v in values.items()}
    rate = float(np.max(system.fastest(p)))
    spacing = max(float(np.max(np.diff(run.time))) for run in runs)
    substeps = int(np.clip(np.ceil(spacing * rate / _STEP_TIMES_RATE), 1, _MOST_SUBSTEPS))
    dt = np.zeros((longest, count, 1))
    held = {n: np.zeros((longest, count, sets)) for n in runs[0].inputs}
    linear = system.linear | runs[0].linear
    following = {n: np.zeros((longest, count, sets)) for n in linear}
    for j, run in enumerate(runs):
        n = len(run.time)
        dt[: n - 1, j, 0] = np.diff(run.time)
        for name, series in run.inputs.items():
            moved = _delayed(run.time, series, values.get(system.delays.get(name, ""), 0.0), sets)
            held[name][:n, j] = moved
            held[name][n:, j] = moved[-1]
            if name in following:
                following[name][: n - 1, j] = moved[1:]
                following[name][n - 1 :, j] = moved[-1]
    x = {s: np.zeros((count, sets)) for s in system.states}
    for j, run in enumerate(runs):
        for s in system.states:
            x[s][j] = values.get(start_of(run, s), beginning(run, s))
    kept: list[Signals] = []
    with np.errstate(all="ignore"):
        for k in range(longest):
            u = {n: series[k] for n, series in held.items()}
            kept.append(system.outputs(x, u, p))
            if k == longest - 1:
                break
            h = dt[k] / substeps
            slopes = {n: (following[n][k] - u[n]) / substeps for n in following}
            for m in range(substeps):
                x = _step(system, x, u, slopes, m, h, p)
    out = []
    for j, run in enumerate(runs):
        n = len(run.time)
        channels = {
            c: np.array([np.broadcast_to(kept[k][c], (count, sets))[j] for k in range(n)])
            for c in kept[0]
        }
        channels |= {c: np.abs(channels[c]) for c in run.unsigned}
        out.append({c: v[:, 0] if sets == 1 else v for c, v in channels.items()})
    return out


def _step(system: System, x: Signals, u: Signals, slopes: Signals, m: int, h: Any, p: Signals):
    """One step of the classical Runge-Kutta method; linear inputs at the start, middle and end."""

    def given(share: float) -> Signals:
        return {**u, **{n: u[n] + s * (m + share) for n, s in slopes.items()}} if slopes else u

    def moved(rate: Signals, length: Any) -> Signals:
        return {s: x[s] + length * rate[s] for s in x}

    a = system.rates(x, given(0.0), p)
    b = system.rates(moved(a, 0.5 * h), given(0.5), p)
    c = system.rates(moved(b, 0.5 * h), given(0.5), p)
    d = system.rates(moved(c, h), given(1.0), p)
    return {s: x[s] + h / 6.0 * (a[s] + 2.0 * b[s] + 2.0 * c[s] + d[s]) for s in x}


def beginning(run: Run, state: str) -> float:
    """Where a state starts: as named, else at the first sample measured of it, else at zero."""
    if state in run.initial:
        return float(run.initial[state])
    series = run.measured.get(state)
    if series is None or not np.isfinite(series).any():
        return 0.0
    return float(series[np.isfinite(series)][0])


def start_of(run: Run, state: str) -> str:
    """The name of the parameter that says where a state of one run starts, if there is one."""
    return f"{run.name}: {state}"


def begun_freely(system: System, runs: Sequence[Run], *states: str, most: float = 2.0) -> System:
    """The system with the starts of some states of each run as parameters, for a fit."""
    names = {start_of(run, s): beginning(run, s) for run in runs for s in states}
    return system.ranged(**{name: (value, -most, most) for name, value in names.items()})


def begun_best(
    system: System, runs: Sequence[Run], values: Mapping[str, float], *states: str
) -> list[Run]:
    """Runs with states that nothing measures begun where each of them errs least.

    As a fitted model is held against an unseen run: its own start is no number of the model.
    """
    held = system.fixed(**{n: values[n] for n in system.parameters})
    begun = []
    for run in runs:
        found = fit(begun_freely(held, [run], *states), [run], starts=1, most=20, ftol=1e-6).values
        start = {s: found[start_of(run, s)] for s in states}
        begun.append(replace(run, initial={**run.initial, **start}))
    return begun


def _delayed(time: Array, series: Array, delay: Any, sets: int) -> Array:
    """A held input, later by ``delay``: the mean over each sample interval of what is in force.

    The mean keeps the output a smooth function of the delay, which steps between samples are not.
    """
    late = np.broadcast_to(np.asarray(delay, float), (sets,))
    if not late.any():
        return np.repeat(series[:, None], sets, axis=1)
    ends = np.append(time, 2.0 * time[-1] - time[-2])
    area = np.concatenate([[0.0], np.cumsum(series * np.diff(ends))])

    def sums(t: Array) -> Array:
        before = series[0] * np.minimum(t - time[0], 0.0)
        return np.interp(t, ends, area) + before

    return np.stack(
        [(sums(ends[1:] - d) - sums(ends[:-1] - d)) / np.diff(ends) for d in late], axis=1
    )


def errors(system: System, runs: Sequence[Run], values: Mapping[str, float]) -> dict[str, float]:
    """NRMSE by channel over whole runs, and ``all``: their root mean square."""
    modelled = simulate(system, runs, values)
    spread = spreads(system, runs)
    by_channel: dict[str, float] = {}
    for channel in runs[0].measured:
        measured = np.concatenate([run.measured[channel] for run in runs])
        predicted = np.concatenate([m[channel] for m in modelled])
        difference = predicted - measured
        if channel in system.angles:
            difference = (difference + np.pi) % (2 * np.pi) - np.pi
        finite = np.isfinite(measured)
        by_channel[channel] = float(np.sqrt(np.mean(difference[finite] ** 2)) / spread[channel])
    by_channel["all"] = float(np.sqrt(np.mean(np.square(list(by_channel.values())))))
    return by_channel


def spreads(system: System, runs: Sequence[Run]) -> dict[str, float]:
    """Standard deviation of what was measured, by channel over all runs; of angles unwrapped."""
    out = {}
    for channel in runs[0].measured:
        joined = np.concatenate([run.measured[channel] for run in runs])
        seen = _unwrapped(runs, channel) if channel in system.angles else joined
        out[channel] = float(np.nanstd(seen))
    return out


def _unwrapped(runs: Sequence[Run], channel: str) -> Array:
    series = [run.measured[channel][np.isfinite(run.measured[channel])] for run in runs]
    return np.concatenate([np.unwrap(x) for x in series])


def begun(
    rng: np.random.Generator | None, begin: Array, size: Array, low: Array, high: Array
) -> Array:
    """Where a least squares begins: as told, or drawn about it, within the bounds."""
    theta = begin.copy()
    if rng is not None:
        factors = np.exp(rng.uniform(-1.4, 1.4, begin.size))
        near = begin + size * rng.uniform(-3, 3, begin.size)
        theta = np.where((begin > 0) & (low >= 0), begin * factors, near)
    inner = 1e-9 * np.maximum(size, 1.0)
    return np.clip(theta, low + inner, high - inner)


def fit(
    system: System,
    runs: Sequence[Run],
    *,
    starts: int = 4,
    seed: int = 0,
    channels: Sequence[str] = (),
    most: int = 60,
    ftol: float = 1e-9,
    first: Mapping[str, float] | None = None,
    sizes: Mapping[str, float] | None = None,
) -> Found:
    """Least squares of whole runs, every channel by its standard deviation, from several starts.

    ``sizes`` divide the errors instead, by channel: the noise of each sensor, where it is known.

    The first start is that of the parameters (or ``first``), the others are drawn about it: by up
    to a factor of four where a parameter keeps its sign, else by three times its size.
    """
    channels = tuple(channels) or tuple(runs[0].measured)
    free = [n for n, r in system.parameters.items() if r.low < r.high]
    held = {n: r.start for n, r in system.parameters.items() if not r.low < r.high}
    low = np.array([system.parameters[n].low for n in free])
    high = np.array([system.parameters[n].high for n in free])
    begin = np.array([(first or {}).get(n, system.parameters[n].start) for n in free])
    size = np.where(begin != 0, np.abs(begin), np.where(np.isfinite(high), 0.3 * high, 1.0))
    measured = {c: [run.measured[c] for run in runs] for c in channels}
    spread = sizes or spreads(system, runs)
    weights = {
        c: 1.0 / (spread[c] * np.sqrt(sum(np.isfinite(x).sum() for x in measured[c])))
        for c in channels
    }

    def residuals(sets: Array) -> Array:
        """Shape (residuals, sets) for parameter sets of shape (sets, free)."""
        values = {**held, **{n: sets[:, i] for i, n in enumerate(free)}}
        modelled = simulate(system, runs, values)
        parts = []
        for c in channels:
            for series, out in zip(measured[c], modelled, strict=True):
                seen = np.isfinite(series)
                diff = out[c].reshape(len(series), -1)[seen] - series[seen, None]
                if diff.shape[1] != len(sets):
                    diff = np.broadcast_to(diff, (diff.shape[0], len(sets)))
                if c in system.angles:
                    diff = (diff + np.pi) % (2 * np.pi) - np.pi
                scaled = weights[c] * diff
                worst = _BEYOND * weights[c] / weights[c] / np.sqrt(len(series))
                parts.append(np.clip(np.nan_to_num(scaled, nan=worst, posinf=worst), -worst, worst))
        return np.concatenate(parts)

    def alone(theta: Array) -> Array:
        return residuals(theta[None])[:, 0]

    def jacobian(theta: Array) -> Array:
        step = 1e-6 * np.maximum(np.abs(theta), 1e-2 * size)
        step = np.where(theta + step > high, -step, step)
        sets = np.vstack([theta, theta + np.diag(step)])
        out = residuals(sets)
        return (out[:, 1:] - out[:, :1]) / step

    rng = np.random.default_rng(seed)
    best, costs = None, []
    for k in range(starts):
        theta = begun(rng if k else None, begin, size, low, high)
        found = least_squares(
            alone,
            theta,
            jac=jacobian,
            bounds=(low, high),
            x_scale=size,
            max_nfev=most,
            ftol=ftol,
        )
        costs.append(float(2.0 * found.cost))
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    values = {**held, **{n: float(v) for n, v in zip(free, best.x, strict=True)}}
    return Found(system, values, errors(system, runs, values), costs)


# --------------------------------------------------------------------------- the equations


def _signed(x: Any) -> Any:
    return x * np.abs(x)


def twin_boat(
    *,
    drag: Sequence[str] = (),
    current: bool = False,
    gain: bool = False,
    effort: bool = False,
    exchanged: bool = False,
    crossed: bool = False,
    power: bool = False,
    inflow: bool = False,
    coupling: bool = False,
    positions: bool = False,
) -> System:
    """Surge, sway, yaw of a boat with two thrusters (Siramdasu & Fahimi 2013, twin form).

    ``drag`` names axes ("surge", "sway", "yaw") with quadratic drag beside the linear one;
    ``gain``: left (1 + gain), right (1 - gain), of the forces; ``effort``: inputs are shares of
    full command, a force is |effort|^exponent; ``exchanged``: left is right; ``crossed``: a share
    of each force acts on the other side; ``power``: forces times |force / 10 N|^(power - 1);
    ``inflow``: of the thrust, loss times the surge is lost; ``coupling``: m23 and d23 of sway and
    yaw (Fossen 2011, section 7.1).
    """
    parameters = {
        "m11": Range(20.0, 0.01, 1e4),
        "m22": Range(20.0, 0.01, 1e4),
        "i33": Range(1.7, 1e-3, 1e3),
        "d11": Range(30.0, 0.0, 1e4),
        "d22": Range(30.0, 0.0, 1e4),
        "d33": Range(5.0, 0.0, 1e3),
        "lever_arm": Range(0.285, 0.285, 0.285),
        "exponent": Range(1.0, 0.3, 4.0) if effort else Range(1.0, 1.0, 1.0),
        **{f"q_{axis}": Range(1.0, 0.0, 1e4) for axis in drag},
    }
    if current:
        parameters |= {"to_north": Range(0.0, -2.0, 2.0), "to_east": Range(0.0, -2.0, 2.0)}
    if gain:
        parameters["gain"] = Range(0.0, -0.9, 0.9)
    extra = {
        "share": (crossed, Range(0.9, 0.0, 1.0)),
        "power": (power, Range(1.2, 0.3, 3.0)),
        "reference": (power, Range(10.0, 10.0, 10.0)),
        "loss": (inflow, Range(0.1, 0.0, 10.0)),
        "m23": (coupling, Range(0.0, -1e3, 1e3)),
        "d23": (coupling, Range(0.0, -1e4, 1e4)),
    }
    parameters |= {name: r for name, (there, r) in extra.items() if there}
    sides = ("right_force", "left_force") if exchanged else ("left_force", "right_force")

    def rates(x: Signals, u: Signals, p: Signals) -> Signals:
        left, right = (u[s] for s in sides)
        if effort:
            left, right = (np.sign(f) * np.abs(f) ** p["exponent"] for f in (left, right))
        if gain:
            left, right = left * (1.0 + p["gain"]), right * (1.0 - p["gain"])
        if crossed:
            moved = p["share"] * (right - left)
            left, right = left + moved, right - moved
        if power:
            left, right = (
                f * np.maximum(np.abs(f) / p["reference"], 0.02) ** (p["power"] - 1.0)
                for f in (left, right)
            )
        cos, sin, r = np.cos(x["heading"]), np.sin(x["heading"]), x["yaw_rate"]
        ahead = across = 0.0
        if current:
            ahead = p["to_north"] * cos + p["to_east"] * sin
            across = p["to_east"] * cos - p["to_north"] * sin
        ur, vr = x["surge"] - ahead, x["sway"] - across
        thrust = left + right
        if inflow:
            thrust = thrust - p["loss"] * np.abs(thrust) * ur
        fx = thrust - p["d11"] * ur + p["m22"] * vr * r
        fy = -p["d22"] * vr - p["m11"] * ur * r
        n = p["lever_arm"] * (left - right) - p["d33"] * r - (p["m22"] - p["m11"]) * ur * vr
        if "surge" in drag:
            fx = fx - p["q_surge"] * _signed(ur)
        if "sway" in drag:
            fy = fy - p["q_sway"] * _signed(vr)
        if "yaw" in drag:
            n = n - p["q_yaw"] * _signed(r)
        swaying, yawing = fy / p["m22"], n / p["i33"]
        if coupling:
            fx = fx + p["m23"] * r * r
            fy = fy - p["d23"] * r
            n = n - p["d23"] * vr - p["m23"] * ur * r
            whole = p["m22"] * p["i33"] - p["m23"] ** 2
            swaying = (p["i33"] * fy - p["m23"] * n) / whole
            yawing = (p["m22"] * n - p["m23"] * fy) / whole
        return {  # a constant current turns against the axes of a turning boat
            "surge": fx / p["m11"] + r * across,
            "sway": swaying - r * ahead,
            "yaw_rate": yawing,
            "north": x["surge"] * cos - x["sway"] * sin,
            "east": x["surge"] * sin + x["sway"] * cos,
            "heading": r,
        }

    def fastest(p: Signals) -> Any:
        linear = np.maximum(
            np.maximum(p["d11"] / p["m11"], p["d22"] / p["m22"]), p["d33"] / p["i33"]
        )
        if coupling:  # the masses that are left of two coupled ones are smaller
            linear = linear / np.maximum(1.0 - p["m23"] ** 2 / (p["m22"] * p["i33"]), 0.05)
        return 1.0 + linear + 2.0 * p["q_surge"] / p["m11"] if "surge" in drag else 1.0 + linear

    names = ("surge", "sway", "yaw_rate", "north", "east", "heading")
    if not positions and not current:  # the path does not act on the speeds

        def faster(x: Signals, u: Signals, p: Signals) -> Signals:
            all_rates = rates({**x, "heading": np.zeros(1)}, u, p)
            return {s: all_rates[s] for s in names[:3]}

        return System(names[:3], faster, lambda x, u, p: x, parameters, fastest)
    return System(
        names, rates, lambda x, u, p: x, parameters, fastest, angles=frozenset(["heading"])
    )


def yoerger(
    *,
    speed_only: bool = False,
    deadband: bool = False,
    sag: bool = False,
    delay: bool = False,
    damping: bool = False,
    saturation: bool = False,
    offset: bool = False,
    reverse: bool = False,
    full: float = 16.0,
) -> System:
    """W' = beta c - alpha W|W|, T = ct W|W| (Yoerger, Cooke & Slotine 1990), with effects.

    ``sag``: the drive times supply_voltage / nominal; ``reverse``: ct in reverse apart;
    ``deadband``: the command less the band; ``damping``: a torque in proportion to the speed;
    ``full``: the largest command, at which the shaft is fastest.
    """
    parameters = {
        "alpha": Range(0.037, 1e-6, 1e2),
        "beta": Range(42.0, 1e-6, 1e7),
        "ct": Range(0.019, 1e-9, 1e2),
        "nominal": Range(16.0, 16.0, 16.0),
    }
    extra = {
        "band": (deadband, Range(0.05, 0.0, 10.0)),
        "share": (sag, Range(0.5, 0.0, 1.5)),
        "delay": (delay, Range(0.05, 0.0, 1.0)),
        "linear": (damping, Range(1.0, 0.0, 1e3)),
        "limit": (saturation, Range(0.8, 0.05, 100.0)),
        "thrust_offset": (offset, Range(0.0)),
        "ct_reverse": (reverse, Range(0.019, 1e-9, 1e2)),
    }
    parameters |= {name: r for name, (there, r) in extra.items() if there}

    def rates(x: Signals, u: Signals, p: Signals) -> Signals:
        c = u["command"]
        if saturation:
            c = np.clip(c, -p["limit"], p["limit"])
        if deadband:
            c = np.sign(c) * np.maximum(np.abs(c) - p["band"], 0.0)
        drive = p["beta"] * c
        if sag:
            drive = drive * (1.0 + p["share"] * (u["supply_voltage"] / p["nominal"] - 1.0))
        load = p["alpha"] * _signed(x["speed"])
        return {"speed": drive - load - (p["linear"] * x["speed"] if damping else 0.0)}

    def outputs(x: Signals, u: Signals, p: Signals) -> Signals:
        ct = np.where(x["speed"] < 0, p["ct_reverse"], p["ct"]) if reverse else p["ct"]
        thrust = ct * _signed(x["speed"]) + (p["thrust_offset"] if offset else 0.0)
        return {"speed": x["speed"]} if speed_only else {"speed": x["speed"], "thrust": thrust}

    def fastest(p: Signals) -> Any:  # at the speed of a full command
        rate = 2.0 * np.sqrt(p["alpha"] * p["beta"] * full)
        return rate + (p["linear"] if damping else 0.0)

    delays = {"command": "delay"} if delay else {}
    return System(("speed",), rates, outputs, parameters, fastest, delays)


def speed_loop(*, delay: bool = False, deadband: bool = False) -> System:
    """W' = (gain sgn(c)|c|^exponent - W) / T, thrust = ct W|W|: a motor controller."""
    parameters = {
        "gain": Range(300.0, 1e-3, 1e5),
        "exponent": Range(1.0, 0.05, 4.0),
        "time_constant": Range(0.2, 1e-3, 1e2),
        "ct": Range(6e-4, 1e-9, 1e2),
    }
    if delay:
        parameters["delay"] = Range(0.05, 0.0, 1.0)
    if deadband:
        parameters["band"] = Range(0.05, 0.0, 1.0)

    def rates(x: Signals, u: Signals, p: Signals) -> Signals:
        c = u["command"]
        if deadband:
            c = np.sign(c) * np.maximum(np.abs(c) - p["band"], 0.0)
        target = p["gain"] * np.sign(c) * np.abs(c) ** p["exponent"]
        return {"speed": (target - x["speed"]) / p["time_constant"]}

    def outputs(x: Signals, u: Signals, p: Signals) -> Signals:
        return {"speed": x["speed"], "thrust": p["ct"] * _signed(x["speed"])}

    delays = {"command": "delay"} if delay else {}
    return System(("speed",), rates, outputs, parameters, lambda p: 1 / p["time_constant"], delays)


def two_tanks(*, overflow: bool = False, linear: bool = False) -> System:
    """Torricelli's tanks one above the other, the lower level measured [cm].

    ``linear``: flows in proportion to the levels beside the roots; ``overflow``: above the rim the
    upper tank spills at a rate, and a share of the spill falls into the lower one.
    """
    parameters = {
        "pump": Range(0.05, 0.005, 1.0),
        "upper_outlet": Range(0.05, 0.0, 1.0),
        "lower_outlet": Range(0.05, 0.0, 1.0),
    }
    if linear:
        parameters |= {"upper_linear": Range(0.0, -0.2, 0.2), "lower_linear": Range(0.0, -0.2, 0.2)}
    if overflow:
        parameters |= {
            "rate": Range(0.1, 0.0, 2.0),
            "rim": Range(6.0, 0.5, 20.0),
            "caught": Range(0.5, 0.0, 1.0),
        }

    def rates(x: Signals, u: Signals, p: Signals) -> Signals:
        upper, lower = (np.maximum(x[s], 0.0) for s in ("upper", "lower"))
        through, out = p["upper_outlet"] * np.sqrt(upper), p["lower_outlet"] * np.sqrt(lower)
        if linear:
            through = through + p["upper_linear"] * upper
            out = out + p["lower_linear"] * lower
        spill = p["rate"] * np.maximum(upper - p["rim"], 0.0) if overflow else 0.0
        caught = p["caught"] * spill if overflow else 0.0
        return {
            "upper": p["pump"] * u["voltage"] - through - spill,
            "lower": through + caught - out,
        }

    return System(
        ("upper", "lower"),
        rates,
        lambda x, u, p: {"lower": x["lower"]},
        parameters,
        lambda p: 0.2 + (p["rate"] if overflow else 0.0),
    )


def rail_axis(
    *,
    viscous: bool = True,
    quadratic: bool = False,
    dry: bool = False,
    offset: bool = False,
    waves: bool = False,
) -> System:
    """The EMPS carriage: mass a = force - viscous v - quadratic v|v| - dry tanh(v/w) - offset.

    ``waves``: the force gains height sin(per_speed (v - shift)) besides.
    """
    parameters = {"mass": Range(95.0, 1.0, 1e5), "width": Range(2e-3, 2e-3, 2e-3)}
    extra = {
        "viscous": (viscous, Range(200.0, 0.0, 1e5)),
        "quadratic": (quadratic, Range(67.0, 0.0, 1e5)),
        "dry": (dry, Range(15.0, 0.0, 1e3)),
        "offset": (offset, Range(0.0, -1e3, 1e3)),
        "height": (waves, Range(-20.0, -1e3, 1e3)),
        "per_speed": (waves, Range(30.0, 1.0, 200.0)),
        "shift": (waves, Range(0.0, -0.1, 0.1)),
    }
    parameters |= {name: r for name, (there, r) in extra.items() if there}

    def rates(x: Signals, u: Signals, p: Signals) -> Signals:
        v = x["velocity"]
        force = u["force"] - (p["offset"] if offset else 0.0)
        if viscous:
            force = force - p["viscous"] * v
        if quadratic:
            force = force - p["quadratic"] * _signed(v)
        if dry:
            force = force - p["dry"] * np.tanh(v / p["width"])
        if waves:
            force = force + p["height"] * np.sin(p["per_speed"] * (v - p["shift"]))
        return {"position": v, "velocity": force / p["mass"]}

    def fastest(p: Signals) -> Any:
        return 1.0 + (p["dry"] / p["width"] / p["mass"] if dry else 0.0)

    return System(
        ("position", "velocity"),
        rates,
        lambda x, u, p: x,
        parameters,
        fastest,
        linear=frozenset(["force"]),
    )
