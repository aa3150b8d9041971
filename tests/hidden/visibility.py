"""How well a hidden effect shows: the likelihood ratio that an optimal filter would find.

The difference that an effect makes to the noise-free outputs, less what other values of the basic
parameters can imitate, is passed with all its competitors through one Kalman filter along the
trajectory: process noise, its memory and coloured sensor noise are states, all with their true
sizes. The whitened rest, squared and summed, is the log-likelihood ratio (twice the difference of
log-likelihoods) of the truth against the basic model refitted; nothing that reads the same logs
can find more. Spikes are left out: they cost one sample in a hundred.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .plants import Hidden, Plant

Array = np.ndarray
_STEP = 1e-3
_NEVER_FREE = ("lever_arm",)


class Visibility(NamedTuple):
    """Likelihood ratio of the truth, and the error with and without it over the noise."""

    ratio: float
    excess: Mapping[str, float]


def visibility(
    plant: Plant, rivals: Iterable[Hidden] = (), *, logs: int = 2, rounds: int = 4
) -> Visibility:
    """Show what the hidden effects of a plant leave that nothing basic imitates.

    Args:
        plant: the plant with its hidden effects.
        rivals: small trial effects which may also imitate it, as directions of either sign.
        logs: number of logs that are seen.
        rounds: of refitting the basic parameters; one does for a small effect.

    Returns:
        The likelihood ratio, and for each channel the root mean square of signal and noise over
        that of the noise, after the basic parameters were refitted by simulation error.
    """
    basic = replace(plant, hidden={})
    filters = [Whitener(plant, k) for k in range(logs)]
    truth = [_outputs(plant, k) for k in range(logs)]
    free = _free(plant)
    z = np.zeros(len(free))
    for _ in range(rounds):  # Gauss-Newton in the logarithms of the basic parameters
        base = _at(basic, free, z)
        start = [_outputs(base, k) for k in range(logs)]
        directions = [_at(basic, free, z + _STEP * row) for row in np.eye(len(free))]
        rest, columns = _whitened(filters, truth, start, directions)
        z = z + np.clip(_STEP * _solve(columns, rest), -0.5, 0.5)
    base = _at(basic, free, z)
    start = [_outputs(base, k) for k in range(logs)]
    trials = [replace(base, hidden=rival) for rival in rivals]
    rest, columns = _whitened(filters, truth, start, [*directions, *trials])
    rest = rest - columns @ _solve(columns, rest)
    return Visibility(float(rest @ rest), _excess(plant, truth, start))


def _solve(columns: Array, rest: Array) -> Array:
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.linalg.lstsq(columns / size, rest, rcond=1e-9)[0] / size


def _free(plant: Plant) -> list[str]:
    held = (*_NEVER_FREE, *(("exponent",) if plant.system == "twin" else ()))
    return [name for name in plant.parameters if name not in held]


def _at(plant: Plant, free: list[str], z: Array) -> Plant:
    moved = {n: plant.parameters[n] * np.exp(x) for n, x in zip(free, z, strict=True)}
    return replace(plant, parameters={**plant.parameters, **moved})


def _outputs(plant: Plant, index: int) -> Array:
    """Noise-free readings of the channels that have sensors, ``(channels, samples)``."""
    measured = plant.run(index).measured
    return np.array([measured[name] for name in plant.sensors])


def _whitened(filters: list, truth: list, start: list, others: list[Plant]) -> tuple[Array, Array]:
    """The rest and its competitors, whitened, all logs one after the other."""
    rows = []
    for k, (white, y, y0) in enumerate(zip(filters, truth, start, strict=True)):
        moved = [_outputs(other, k) - y0 for other in others]
        rows.append(white(np.array([y - y0, *moved])))
    joined = np.concatenate(rows, axis=1)
    return joined[0], joined[1:].T


def _excess(plant: Plant, truth: list, start: list) -> dict[str, float]:
    square = np.mean(
        [np.mean((y - y0) ** 2, axis=1) for y, y0 in zip(truth, start, strict=True)], 0
    )
    return {
        name: float(np.sqrt(1.0 + s / sensor.std**2))
        for s, (name, sensor) in zip(square, plant.sensors.items(), strict=True)
    }


class Whitener:
    """The Kalman filter of a plant's noise along one of its trajectories.

    States: deviations of the plant's own states, process noise, coloured sensor noise.
    """

    def __init__(self, plant: Plant, index: int) -> None:
        """Linearise along the trajectory of the plant as it is."""
        record = plant.run(index)
        dt = float(plant.time[1])
        slopes, reading = (
            _thruster(plant, record) if plant.system == "thruster" else _vessel(plant, record)
        )
        samples, own, _ = slopes.shape
        pushes = _pushes(plant)
        gusts = pushes.shape[1]
        sensors = list(plant.sensors.values())
        channels = len(sensors)
        size = own + gusts + channels
        self.move = np.zeros((samples, size, size))
        self.move[:, :own, :own] = np.eye(own) + dt * slopes
        self.move[:, :own, own : own + gusts] = dt * pushes
        self.noise = np.zeros((size, size))
        cover = np.zeros((size, size))
        if plant.gust is not None:
            keep = np.exp(-dt / plant.gust.time_constant)
            for j, std in enumerate(plant.gust.std):
                i = own + j
                self.move[:, i, i] = keep
                self.noise[i, i], cover[i, i] = std**2 * (1.0 - keep**2), std**2
        for j, s in enumerate(sensors):
            i = own + gusts + j
            self.move[:, i, i] = s.correlation
            self.noise[i, i], cover[i, i] = s.std**2 * (1.0 - s.correlation**2), s.std**2
        for i in range(own):  # the initial states are free
            cover[i, i] = 1e2 * max(s.std for s in sensors) ** 2
        self.read = np.zeros((samples, channels, size))
        self.read[:, :, :own] = reading
        self.read[:, :, own + gusts :] = np.eye(channels)
        self.fine = np.diag([s.quantum**2 / 12.0 + (1e-3 * s.std) ** 2 for s in sensors])
        self._steps(cover)

    def _steps(self, cover: Array) -> None:
        """Gains and whitening factors, which no series changes."""
        self.gains, self.factors = [], []
        for move, read in zip(self.move, self.read, strict=True):
            spread = read @ cover @ read.T + self.fine
            gain = cover @ read.T @ np.linalg.inv(spread)
            self.gains.append(move @ gain)
            self.factors.append(np.linalg.inv(np.linalg.cholesky(spread)))
            cover = move @ (cover - gain @ read @ cover) @ move.T + self.noise
            cover = 0.5 * (cover + cover.T)

    def __call__(self, series: Array) -> Array:
        """Innovations of ``(m, channels, samples)`` over their spread, ``(m, values)``."""
        state = np.zeros((self.move.shape[1], len(series)))
        out = []
        columns = np.moveaxis(series, 0, 2)
        for k, (move, gain) in enumerate(zip(self.move, self.gains, strict=True)):
            new = columns[:, k] - self.read[k] @ state
            out.append(self.factors[k] @ new)
            state = move @ state + gain @ new
        return np.concatenate(out).T


def _pushes(plant: Plant) -> Array:
    """How process noise enters the plant's own states."""
    if plant.gust is None:
        return np.zeros((1 if plant.system == "thruster" else 6, 0))
    if plant.system == "thruster":
        return np.ones((1, 1))
    p = plant.parameters
    return np.vstack([np.diag([1.0 / p["m11"], 1.0 / p["m22"], 1.0 / p["i33"]]), np.zeros((3, 3))])


def _thruster(plant: Plant, record) -> tuple[Array, Array]:
    """Slopes of the acceleration and of the readings along the run."""
    speed, p = np.abs(record.truth["speed"]), plant.parameters
    rows = {"speed": np.ones_like(speed), "thrust": 2.0 * p["ct"] * speed}
    slopes = -2.0 * p["alpha"] * speed
    return slopes[:, None, None], np.array([rows[name] for name in plant.sensors]).T[:, :, None]


def _vessel(plant: Plant, record) -> tuple[Array, Array]:
    """The same for the vessel's six states, from its basic equations."""
    u, v, r, _, _, psi = (record.truth[name] for name in _STATES)
    p, zero = plant.parameters, np.zeros(len(record.time))
    c, s = np.cos(psi), np.sin(psi)
    m11, m22, i33 = p["m11"], p["m22"], p["i33"]
    rows = [
        [zero - p["d11"] / m11, m22 * r / m11, m22 * v / m11, zero, zero, zero],
        [-m11 * r / m22, zero - p["d22"] / m22, -m11 * u / m22, zero, zero, zero],
        [-(m22 - m11) * v / i33, -(m22 - m11) * u / i33, zero - p["d33"] / i33, zero, zero, zero],
        [c, -s, zero, zero, zero, -u * s - v * c],
        [s, c, zero, zero, zero, u * c - v * s],
        [zero, zero, zero + 1.0, zero, zero, zero],
    ]
    picks = np.array([[float(name == state) for state in _STATES] for name in plant.sensors])
    return np.moveaxis(np.array(rows), 2, 0), np.broadcast_to(picks, (len(zero), *picks.shape))


_STATES = ("surge", "sway", "yaw_rate", "north", "east", "heading")
