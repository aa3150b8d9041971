"""Sound logs: parts of measured ones, and simulated ones with noise of all kinds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from hidden.sets import draw

import diffthrust as dft

from . import measured
from .measured import MODELS

KINDS = (
    "none",
    "none_ar",
    "field-none",
    "vessel_none",
    "field-vessel_none",
    "field-clear/command_deadband",
    "clear/reverse_thrust_asymmetry",
    "clear/coulomb_friction",
    "poor/command_deadband",
    "poor/cavitation",
    "clear/thrust_sensor_offset",
    "clear/actuator_lag",
    "clear/command_delay",
    "vessel/water_current",
)


def unknown(found: tuple[dft.soundness.Doubt, ...]) -> list[dft.soundness.Doubt]:
    """Doubts but for one that is true of a part of sound logs.

    The yaw rate of the Esso Osaka's berthing runs is filtered: it follows the rate of the heading
    after 0.6 to 1.0 s in all three (and the speeds follow the track after 0.6 to 0.9 s).
    """
    return [
        d
        for d in found
        if not ((d.channel, d.kind) == ("yaw_rate", "lag") and d.evidence.startswith("berthing"))
    ]


def parts(root: Path, rng: np.random.Generator) -> Iterator[tuple[dft.Log, dft.Model]]:
    """Parts of measured logs without end: a random log, a random stretch of it."""
    sets = {name: measured.logs(root, name) for name in MODELS}
    names = ("ngs_thruster", "blueboat", "esso_osaka", "ngs_thruster", "blueboat", "emps")
    while True:
        for name in names:
            log = sets[name][rng.integers(len(sets[name]))]
            share = rng.uniform(0.3, 1.0)
            begin = rng.uniform(0.0, 1.0 - share) * log.duration
            yield log.slice(begin, begin + share * log.duration), MODELS[name]


def simulated(rng: np.random.Generator) -> Iterator[tuple[dft.Log, dft.Model]]:
    """Simulated logs without end, with hidden effects or none, cut to random lengths."""
    while True:
        for kind in KINDS:
            drawn = draw(kind, int(rng.integers(1 << 30)))
            log = drawn.train[0]
            share = rng.uniform(0.15, 1.0)
            begin = rng.uniform(0.0, 1.0 - share) * log.duration
            yield worn(rng, log.slice(begin, begin + share * log.duration)), drawn.model


def worn(rng: np.random.Generator, log: dft.Log) -> dft.Log:
    """Some logs miss samples, some have a tachometer without a sign."""
    if rng.random() < 0.3:
        share = rng.uniform(0.02, 0.2)
        log = log.replaced(
            measured={
                name: np.where(rng.random(v.size) < share, np.nan, v)
                for name, v in log.measured.items()
            }
        )
    if "speed" in log.measured and rng.random() < 0.3:
        measured = {**log.measured, "speed": np.abs(log.measured["speed"])}
        log = log.replaced(measured=measured, unsigned=frozenset({"speed"}))
    return log


def false_alarms(root: Path, count: int, seed: int = 0) -> tuple[list[str], int]:
    """One line for each of so many sound logs that is doubted; half are measured."""
    rng = np.random.default_rng(seed)
    sources = (parts(root, rng), simulated(rng))
    lines = []
    for k in range(count):
        log, model = next(sources[k % 2])
        found = unknown(dft.soundness.doubts(log, model))
        if found:
            span = f"{log.time[0]:.1f} to {log.time[-1]:.1f} s"
            lines.append(f"{log.name} ({span}): " + " / ".join(map(str, found)))
    return lines, count


def false_alarms_of_sets(root: Path, count: int, seed: int = 0) -> tuple[list[str], int]:
    """The same for so many sets of three to six logs of one system, held against each other."""
    rng = np.random.default_rng(seed)
    logs = {name: measured.logs(root, name) for name in ("ngs_thruster", "blueboat", "esso_osaka")}
    names, lines = tuple(logs), []
    for k in range(count):
        if k % 2:
            drawn = draw(KINDS[k // 2 % len(KINDS)], int(rng.integers(1 << 30)))
            chosen, model = [worn(rng, log) for log in (*drawn.train, drawn.unseen)], drawn.model
        else:
            name = names[k // 2 % 3]
            picked = rng.choice(len(logs[name]), int(rng.integers(3, 7)), replace=False)
            begins = rng.uniform(0.0, 0.4, picked.size)
            whole = [logs[name][i] for i in picked]
            chosen = [
                log.slice(b * log.duration, (b + 0.6) * log.duration)
                for log, b in zip(whole, begins, strict=True)
            ]
            model = MODELS[name]
        found = unknown(dft.soundness.doubts(chosen, model))
        if found:
            lines.append(f"{', '.join(log.name for log in chosen)}: {' / '.join(map(str, found))}")
    return lines, count


def real_defects(root: Path) -> list[str]:
    """What is told of the logs as they were published."""
    lines = []
    for name, model in MODELS.items():
        for log in measured.logs(root, name):
            lines += [f"{log.name}: {d}" for d in dft.soundness.doubts(log, model)]
    for path in sorted((root / "blueboat").glob("*.csv")):
        log = measured.blueboat(path, mended=False)
        lines += [f"{log.name}: {d}" for d in dft.soundness.doubts(log, MODELS["blueboat"])]
    return lines
