"""Axes of sensors that the logs contradict: forward, port, up, and declared as starboard and down.

The readings of all sensors of a craft are brought to the channels of its body, by the axes that are
declared, and held together by kinematics. Where that fails, other axes are tried for each sensor
and for several at once (whoever takes a log of ROS for one of an autopilot turns all of them), and
those named with which most holds together.

A sensor away from the centre reads what the turning adds, and its place may not be known: of
velocities that counts which the rates of turn do not explain. So a boat whose sway is its turning
says nothing of the axes of its sway.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from diffthrust._support.words import joined
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.models._craft.craft import Craft
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._record import FIRM, LOOSE, OPPOSED, Record, correlation, record

_UPRIGHT = 5.0
"""Mean force per mass along z [m/s^2] from which on it is gravity: a vehicle that lies on its side
for half of a log has less."""
_RATES = ("roll_rate", "pitch_rate", "yaw_rate")

Frames = Mapping[str, str]
"""The axes of each sensor that has a choice."""


class _Relation(NamedTuple):
    """Whether readings obey (1 to -1), and what is wrong where they do not, with its number."""

    together: float
    words: str
    number: str

    @property
    def score(self) -> int:
        """What it counts for the axes under which it is so."""
        return int(self.together > FIRM) - 2 * int(self.together < OPPOSED)


def misframed(log: Log, model: Model | None) -> Iterator[Doubt]:
    """A doubt on the axes of a craft's sensors, where others fit the log."""
    if not isinstance(model, Craft):
        return
    units = {n: m.model for n, m in model.sensors.items() if len(m.model.frames) > 1}
    units = {n: unit for n, unit in units.items() if any(c.startswith(f"{n}.") for c in log.units)}
    declared = {n: unit.frame for n, unit in units.items()}
    present = _relations(log, model, declared)
    if not any(each.together < LOOSE for each in present.values()):
        return
    choices = {
        words: _relations(log, model, dict(zip(units, words, strict=True)))
        for words in product(*(unit.frames for unit in units.values()))
    }
    scores = {words: sum(r.score for r in each.values()) for words, each in choices.items()}

    def rank(words: tuple[str, ...]) -> tuple[int, int]:
        changes = sum(a != b for a, b in zip(words, declared.values(), strict=True))
        return -scores[words], changes

    best = min(choices, key=rank)
    after = choices[best]
    mended = [n for n, r in present.items() if r.together < LOOSE and after[n].together > FIRM]
    if not mended or scores[best] <= sum(each.score for each in present.values()):
        return
    improved = [
        f"{present[n].words} ({present[n].number}; as below {after[n].number})" for n in mended
    ]
    turned = [
        {n: w for n, w in zip(units, words, strict=True) if w != declared[n]}
        for words in choices
        if rank(words) == rank(best)
    ]
    mend = " Or: ".join(_line(frames, model) for frames in turned)
    yield Doubt(next(iter(turned[0])), "frame", f"{'; '.join(improved)}.", mend)


def _line(turned: Frames, model: Craft) -> str:
    kinds = {n: type(model.sensors[n].model).__name__ for n in turned}
    python = joined([f'{n}=dft.sensors.{kinds[n]}(frame="{f}")' for n, f in turned.items()])
    spec = joined([f'frame = "{f}" below [sensors.{n}]' for n, f in turned.items()])
    return f"{python}; in a spec file {spec}."


def _relations(log: Log, model: Craft, frames: Frames) -> dict[str, _Relation]:
    """What holds together, and what does not, where sensors have these axes."""
    values, names = _of_body(log, model, frames)
    r = record(Log(log.time, {}, values, name=log.name)) if values else None
    if r is None:
        return {}
    relations = {}
    rates = [r.mean(name) for name in _RATES if name in r.values]
    for channel, words, seen, due in (*_turning(r), *_moving(r)):
        together = _together(seen, due, [] if channel in _RATES else rates)
        if np.isfinite(together):
            verb = "opposes" if together < 0 else "does not follow"
            words = f"{names[channel]} {verb} {words}"
            relations[channel] = _Relation(together, words, f"correlation {together:+.2f}")
    if "z_force" in values:
        mean = float(np.nanmean(values["z_force"]))
        words = f"{names['z_force']} is that of a vehicle upside down"
        upright = float(np.clip(-mean / _UPRIGHT, -1.0, 1.0))
        relations["z_force"] = _Relation(upright, words, f"mean {mean:+.3g} m/s^2")
    return relations


_Pairs = Iterator[tuple[str, str, np.ndarray, np.ndarray]]
"""A channel, what it must follow in words, and both."""


def _or_level(r: Record, take: Callable[[str], np.ndarray], *names: str) -> list[np.ndarray]:
    """Means or rates of angles and speeds, zero of those that are not measured."""
    return [take(n) if n in r.values else np.zeros(r.size - 2 * r.half) for n in names]


def _turning(r: Record) -> _Pairs:
    """Rates of turn beside the rates of the angles; Fossen 2021, equation 2.39."""
    if "heading" not in r.values:
        return
    roll, pitch = _or_level(r, r.mean, "roll", "pitch")
    rolling, pitching, yawing = _or_level(r, r.rate, "roll", "pitch", "heading")
    due = (
        rolling - yawing * np.sin(pitch),
        pitching * np.cos(roll) + yawing * np.cos(pitch) * np.sin(roll),
        yawing * np.cos(pitch) * np.cos(roll) - pitching * np.sin(roll),
    )
    for channel, each in zip(_RATES, due, strict=True):
        if channel in r.values:
            yield channel, "the rates of the angles", r.mean(channel), each


def _moving(r: Record) -> _Pairs:
    """Velocities beside the rates of the position."""
    if {"north", "east", "heading"} <= {*r.values}:
        for channel, due in r.track().items():
            if channel in r.values:
                yield channel, "the track, turned by the heading", r.mean(channel), due
    if {"depth", "heave"} <= {*r.values}:
        roll, pitch, surge, sway = _or_level(r, r.mean, "roll", "pitch", "surge", "sway")
        down = r.mean("heave") * np.cos(pitch) * np.cos(roll)
        down = down + sway * np.cos(pitch) * np.sin(roll) - surge * np.sin(pitch)
        yield "heave", "the rate of the depth", down, r.rate("depth")


def _together(seen: np.ndarray, due: np.ndarray, turns: list[np.ndarray]) -> float:
    """Correlation of two series, of what rates of turn leave of both."""
    columns = np.stack([np.ones_like(seen), *turns], axis=1)
    x, y = (v - columns @ np.linalg.lstsq(columns, v, rcond=None)[0] for v in (seen, due))
    # what remains of a channel that stands still is rounding
    return correlation(x, y) if np.ptp(seen) > 0 and np.ptp(due) > 0 else np.nan


def _of_body(
    log: Log, model: Craft, frames: Frames
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """What a log measures as channels of the body, and what is said of each."""
    values = {n: v for n, v in log.measured.items() if "." not in n and n in model.outputs}
    names = {n: n for n in values}
    for name, mounted in model.sensors.items():
        sensor, prefix = mounted.model, f"{name}."
        if name in frames and frames[name] != sensor.frame:
            sensor = type(sensor)(frame=frames[name])
        read = {n.removeprefix(prefix): v for n, v in log.measured.items() if n.startswith(prefix)}
        for channel, series in sensor.as_of_body(read).items():
            if channel not in values:
                values[channel], names[channel] = np.asarray(series), f"{channel} of {name}"
    return values, names
