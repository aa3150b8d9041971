"""Families of command sequences for an experiment, within limits, rates and rests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Space:
    """Constraints of a sequence."""

    time: np.ndarray  # sample instants [s], (T,), evenly spaced
    limits: Mapping[str, tuple[float, float]]  # of each moved input
    rates: Mapping[str, float]  # largest change per second, for some of them
    rest_duration: float  # at the start and at the end [s]
    seed: int  # of the random sequences

    @property
    def step(self) -> float:
        """Time between samples [s]."""
        return float(self.time[1] - self.time[0])

    @property
    def active(self) -> float:
        """Time between the two rests [s]."""
        return float(self.time[-1] - self.time[0]) - 2 * self.rest_duration

    def resting(self, name: str) -> float:
        """The value at rest: zero, or the limit nearest to it."""
        low, high = self.limits[name]
        return float(np.clip(0.0, low, high))


@dataclass(frozen=True)
class Design:
    """One sequence: kind (a key of `KINDS`), speed, size, and inputs that take part."""

    kind: str
    moved: Mapping[str, int] = field(hash=False)  # the inputs that follow it, with their signs
    share: float  # of the range from rest to the limits, above 0 and at most 1
    hold: float  # time per level [s]; of chirps and multisines half the shortest period
    bias: float = 0.0  # level of the other inputs, as a share from rest to the upper limit

    def levels(self, name: str, space: Space) -> tuple[float, float]:
        """Lowest and highest value of an input (equal if it is held)."""
        (low, high), rest_value = space.limits[name], space.resting(name)
        if name not in self.moved:
            value = rest_value + self.bias * (high - rest_value)
            return value, value
        bottom, top = (rest_value + self.share * (end - rest_value) for end in (low, high))
        if self.kind == "step up":
            return rest_value, top
        return bottom, rest_value if self.kind == "step down" else top

    def changed(self, faster: float, larger: float, space: Space) -> Design:
        """A neighbour with another speed and size, within the constraints."""
        timeless = self.kind in ("step up", "step down")
        hold = self.hold if timeless else _integer(self.hold / faster, space)
        return replace(self, hold=hold, share=float(np.clip(self.share * larger, 0.01, 1.0)))


def sequence(design: Design, space: Space) -> dict[str, np.ndarray]:
    """The values of every moved input at the sample instants.

    The sequence respects limits and rate limits exactly, and starts and ends at rest.
    """
    since = space.time - space.time[0] - space.rest_duration
    on = (since > -1e-9 * space.step) & (since < space.active - 1e-6 * space.step)
    shape = KINDS[design.kind].shape(np.where(on, since, 0.0), design.hold, space)
    out = {}
    for name, (low, high) in space.limits.items():
        rest_value, (bottom, top) = space.resting(name), design.levels(name, space)
        sign = design.moved.get(name, 1)
        if design.kind == "pulses":  # out of rest, to either side
            size = np.where(sign * shape > 0, top - rest_value, rest_value - bottom)
            values = rest_value + size * sign * shape
        else:
            begin, end = (bottom, top) if sign > 0 else (top, bottom)
            values = begin + (end - begin) * 0.5 * (1.0 + shape)
        values = np.clip(np.where(on, values, rest_value), low, high)
        out[name] = _within_rate(values, space.rates.get(name, np.inf), space.step, rest_value)
    return out


def _within_rate(values: np.ndarray, rate: float, step: float, rest_value: float) -> np.ndarray:
    """Follow the values as fast as the rate allows, and be back at rest in time for the end."""
    if not np.isfinite(rate):
        return values
    most = rate * step * (1.0 - 1e-9)  # rounding must not break the limit
    out = values.copy()
    out[0] = out[-1] = rest_value
    for k in range(1, out.size):
        out[k] = np.clip(out[k], out[k - 1] - most, out[k - 1] + most)
    out[-1] = rest_value
    # backwards as well: the end must be at rest, and a step down at the last moment would break the
    # rate
    for k in range(out.size - 2, -1, -1):
        out[k] = np.clip(out[k], out[k + 1] - most, out[k + 1] + most)
    return out


# -- shapes, from -1 to 1 over the time since the rest --------------------------------------------


def _count(t: np.ndarray, hold: float) -> np.ndarray:
    return np.floor(t / hold + 1e-6).astype(int)


def _reversals(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    return np.where(_count(t, hold) % 2 == 0, 1.0, -1.0)


def _pulses(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    """A pulse every four holds, to either side in turn."""
    k = _count(t, hold)
    return np.where(k % 4 == 0, np.where(k % 8 == 0, 1.0, -1.0), 0.0)


def _staircase(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    """Nine levels from the middle up, down and up again."""
    return _triangle((_count(t, hold) % 16) / 16)


def _random_staircase(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    # seeded by the space: equal designs have equal sequences, so that rankings can be repeated
    levels = np.random.default_rng(space.seed).uniform(-1.0, 1.0, _count(t, hold).max() + 1)
    return levels[_count(t, hold)] / np.abs(levels).max()


def _ramps(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    return _triangle((t / (4.0 * hold)) % 1.0)


def _triangle(turn: np.ndarray) -> np.ndarray:
    """Zero, up to one, down to minus one and back to zero over one turn."""
    return 1.0 - np.abs(4.0 * ((turn + 0.75) % 1.0) - 2.0)


def _chirp(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    """Exponential sweep from one period in the whole test to the shortest."""
    first, last = 1.0 / space.active, 0.5 / hold
    growth = max(last / first, 1.0 + 1e-6)
    # the integral of first growth^(t / active)
    turns = first * space.active / np.log(growth) * (growth ** (t / space.active) - 1.0)
    return np.sin(2.0 * np.pi * turns)


def _multisine(t: np.ndarray, hold: float, space: Space) -> np.ndarray:
    """Eight harmonics, evenly spread on a logarithmic scale, with random phases."""
    highest = max(0.5 * space.active / hold, 1.0)
    harmonics = np.unique(np.round(np.geomspace(1.0, highest, 8)))
    phases = np.random.default_rng(space.seed + 1).uniform(0.0, 2.0 * np.pi, harmonics.size)
    waves = np.sin(2.0 * np.pi * np.outer(t / space.active, harmonics) + phases).sum(axis=1)
    return waves / np.abs(waves).max()


@dataclass(frozen=True)
class Family:
    """A family of sequences: shape, description, hold times as shares of the test, and tempo."""

    shape: Callable[[np.ndarray, float, Space], np.ndarray]
    words: str
    holds: tuple[float, ...]
    tempo: str = ", each level held {hold:.3g} s"


_SHORT, _MIDDLE, _LONG = 1 / 160, 1 / 40, 1 / 10
KINDS: dict[str, Family] = {
    "step up": Family(lambda t, hold, space: np.ones_like(t), "Step", (1.0,), ""),
    "step down": Family(lambda t, hold, space: -np.ones_like(t), "Step", (1.0,), ""),
    "reversals": Family(
        _reversals, "Reversals", (_SHORT, _MIDDLE, _LONG), ", each side held {hold:.3g} s"
    ),
    "pulses": Family(
        _pulses, "Pulses", (_SHORT, _MIDDLE), ", each {hold:.3g} s long, one every {cycle:.3g} s"
    ),
    "staircase": Family(_staircase, "Staircase", (_MIDDLE, 1 / 16)),
    "random staircase": Family(_random_staircase, "Random staircase", (_SHORT, _MIDDLE, _LONG)),
    "ramps": Family(_ramps, "Ramps", (_MIDDLE, 1 / 4), ", each way in {way:.3g} s"),
    "chirp": Family(_chirp, "Chirp", (_SHORT, _MIDDLE), ", from {first:.2g} to {last:.3g} Hz"),
    "multisine": Family(_multisine, "Multisine", (_SHORT, _MIDDLE), ", up to {last:.3g} Hz"),
}
"""The families; one ramp takes the whole test, as a reference."""
_SHARES = (1.0, 0.4, 0.1)
_FEWER = {
    "step up": (1.0,),
    "step down": (1.0,),
    "reversals": (_MIDDLE, _LONG),
    "staircase": (1 / 16,),
    "random staircase": (_MIDDLE,),
}
"""Fewer hold times for several inputs, which are combined in several ways."""


def grid(space: Space) -> list[Design]:
    """The designs tried first: some 50 for one input, 80 for two."""
    names = tuple(space.limits)
    ways: list[tuple[Mapping[str, int], float]] = [({names[0]: 1}, 0.0)]
    holds, shares = {kind: rates.holds for kind, rates in KINDS.items()}, _SHARES
    if len(names) > 1:
        alternating = {name: 1 if i % 2 == 0 else -1 for i, name in enumerate(names)}
        ways = [({name: 1}, 0.6) for name in names]
        ways += [({name: 1}, 0.0) for name in names]
        ways += [(dict.fromkeys(names, 1), 0.0), (alternating, 0.0)]
        holds, shares = _FEWER, _SHARES[:2]
    designs = (
        Design(kind, moved, share, _integer(hold * space.active, space), bias)
        for moved, bias in ways
        for kind, parts in holds.items()
        for hold in parts
        for share in shares
    )
    unique: dict[tuple[object, ...], Design] = {}
    for design in designs:
        unique.setdefault(design_key(design), design)
    return list(unique.values())


def design_key(design: Design) -> tuple[object, ...]:
    """A key that is equal for equal designs."""
    moved = tuple(sorted(design.moved.items()))
    return (design.kind, moved, design.bias, round(design.share, 6), round(design.hold, 9))


def _integer(hold: float, space: Space) -> float:
    """A hold time of an integer number of samples, at least two."""
    samples = round(float(np.clip(hold, 0.0, space.active)) / space.step)
    return float(max(samples, 2) * space.step)
