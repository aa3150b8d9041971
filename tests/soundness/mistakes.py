"""What is named of mistakes made in measured logs, and how often sound logs are doubted.

Run as ``python -m soundness.mistakes`` from ``tests``; prints one table.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import diffthrust as dft
from diffthrust.logs import Written

from . import measured
from .measured import MODELS, changed

Alter = Callable[[dft.Log], dft.Log]


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes:
        name: for people.
        kind: of the doubt that names it.
        channels: any of which it may name (of a pair that no log tells apart, both).
        alter: makes the mistake in a log.
        sets: data sets whose logs are altered; three logs of one, or one of three.
        companions: the altered log stands among sound ones of its set.
    """

    name: str
    kind: str
    channels: tuple[str, ...]
    alter: Alter
    sets: tuple[str, ...]
    companions: bool = False


THREE = {
    "ngs_thruster": ("CL1stateRamp", "CL2stateKF2Sine", "CLLookupStep"),
    "blueboat": ("run_216", "run_224", "run_232"),
    "esso_osaka": (
        "zigzag_31-Jul-2020_13_04_24",
        "random_06-Aug-2020_16_24_25_1",
        "turn_14-Sep-2020_13_51_45",
    ),
    "emps": ("DATA_EMPS_SC", "DATA_EMPS_PULSES_SC", "DATA_EMPS_SC:2"),
}
OTHERS = {
    "ngs_thruster": ("CLLookupRamp", "CL1stateSine", "CL2stateKF2Step"),
    "blueboat": ("run_220", "run_226", "run_225"),
    "esso_osaka": (
        "zigzag_31-Jul-2020_13_50_28",
        "berthing_12-Nov-2020_11_14_47",
        "turn_14-Oct-2020_14_08_51",
    ),
    "emps": ("DATA_EMPS_SC:1", "DATA_EMPS_PULSES_SC:1", "DATA_EMPS_PULSES_SC:2"),
}
"""Logs that no threshold was chosen by."""
T, B, E, A = ("ngs_thruster",), ("blueboat",), ("esso_osaka",), ("emps",)
SENSOR = {
    "ngs_thruster": "thrust",
    "blueboat": "surge",
    "esso_osaka": "yaw_rate",
    "emps": "velocity",
}
EACH = ("ngs_thruster", "blueboat", "esso_osaka")


def scaled(channel: str, factor: float) -> Alter:
    return lambda log: changed(log, **{channel: lambda v: factor * v})


def exchanged(one: str, two: str) -> Alter:
    def alter(log: dft.Log) -> dft.Log:
        both = {**log.inputs, **log.measured}
        return changed(log, **{one: lambda _: both[two], two: lambda _: both[one]})

    return alter


def clock(factor: float) -> Alter:
    return lambda log: changed(log, time=lambda t: factor * t)


def late(seconds: float, *channels: str) -> Alter:
    def alter(log: dft.Log) -> dft.Log:
        def shift(v):
            angle = np.unwrap(v) if channels == ("heading",) else v
            return np.interp(log.time - seconds, log.time, angle)

        altered = changed(log, **dict.fromkeys(channels, shift))
        return altered.slice(abs(seconds), log.duration - abs(seconds))

    return alter


def sensor(change: Callable[[np.ndarray], np.ndarray]) -> Alter:
    """A change of the sensor that stands for its set."""

    def alter(log: dft.Log) -> dft.Log:
        name = next(n for n in SENSOR.values() if n in log.measured)
        return changed(log, **{name: change})

    return alter


def stuck(v: np.ndarray) -> np.ndarray:
    """From where it moves most on, for a sixth of the log."""
    n = v.size // 6
    begin = max(range(0, v.size - n, max(1, n // 8)), key=lambda k: np.std(v[k : k + n]))
    v[begin : begin + n] = v[begin]
    return v


def clipped(v: np.ndarray) -> np.ndarray:
    low, high = np.min(v), np.max(v)
    return np.clip(v, low + 0.25 * (high - low), high - 0.25 * (high - low))


def coarse(v: np.ndarray) -> np.ndarray:
    step = np.ptp(v) / 8
    return np.round(v / step) * step


def held(v: np.ndarray) -> np.ndarray:
    return v[np.arange(v.size) // 8 * 8]


def coded(code: float, share: float = 0.01) -> Callable[[np.ndarray], np.ndarray]:
    def change(v: np.ndarray) -> np.ndarray:
        hit = np.random.default_rng(1).random(v.size) < max(share, 4 / v.size)
        return np.where(hit, code, v)

    return change


def spiked(v: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(2)
    hit = rng.random(v.size) < max(0.005, 5 / v.size)
    return v + hit * rng.choice([-1.0, 1.0], v.size) * rng.uniform(1.5, 4.0, v.size) * np.ptp(v)


def named(channel: str, column: str) -> Alter:
    """The numbers of another unit, whose column says so, under the unit of before."""

    def alter(log: dft.Log) -> dft.Log:
        written = Written(log.units[channel], column)
        return log.replaced(written={**log.written, channel: written})

    return alter


def both(*alters: Alter) -> Alter:
    def alter(log: dft.Log) -> dft.Log:
        for one in alters:
            log = one(log)
        return log

    return alter


def gapped(log: dft.Log) -> dft.Log:
    """A third of the log was lost."""
    n = len(log)
    keep = np.r_[0 : n // 3, 2 * n // 3 : n]
    return log.replaced(
        time=log.time[keep],
        inputs={k: v[keep] for k, v in log.inputs.items()},
        measured={k: v[keep] for k, v in log.measured.items()},
    )


def noise_only(v: np.ndarray) -> np.ndarray:
    return np.std(v) * np.random.default_rng(3).standard_normal(v.size)


TRACK = ("north", "east")
MOTION = ("surge", "sway", "yaw_rate")
PI = np.pi
ALL_SENSORS = tuple(SENSOR.values())

MISTAKES = (
    Mistake("thrust negated", "sign", ("thrust", "command"), scaled("thrust", -1), T),
    Mistake("command negated", "sign", ("thrust", "command"), scaled("command", -1), T),
    Mistake("force of the axis negated", "sign", ("force",), scaled("force", -1), A),
    Mistake("yaw rate negated", "sign", ("yaw_rate",), scaled("yaw_rate", -1), B),
    Mistake("heading negated", "sign", ("heading",), scaled("heading", -1), E),
    Mistake("surge negated", "sign", ("surge",), scaled("surge", -1), B),
    Mistake("sway negated (port positive)", "sign", ("sway",), scaled("sway", -1), E),
    Mistake("rudder negated", "sign", ("rudder_angle",), scaled("rudder_angle", -1), E),
    Mistake("east negated", "sign", ("east",), scaled("east", -1), B),
    Mistake(
        "speed and thrust exchanged",
        "exchanged",
        ("speed", "thrust"),
        exchanged("speed", "thrust"),
        T,
    ),
    Mistake(
        "command and speed exchanged",
        "exchanged",
        ("command", "speed"),
        exchanged("command", "speed"),
        T,
    ),
    Mistake(
        "left and right exchanged",
        "exchanged",
        ("left_force", "right_force"),
        exchanged("left_force", "right_force"),
        B,
    ),
    Mistake("north and east exchanged", "exchanged", TRACK, exchanged(*TRACK), E),
    Mistake("surge and sway exchanged", "exchanged", MOTION[:2], exchanged(*MOTION[:2]), E),
    Mistake(
        "position and velocity exchanged",
        "exchanged",
        ("position", "velocity"),
        exchanged("position", "velocity"),
        A,
    ),
    Mistake("speed: rpm called rad/s", "unit", ("speed",), scaled("speed", 30 / PI), T),
    Mistake("speed: Hz called rad/s", "unit", ("speed",), scaled("speed", 0.5 / PI), T),
    Mistake("thrust: kgf called N", "unit", ("thrust",), scaled("thrust", 1 / 9.80665), T),
    Mistake(
        "thrust: kgf called N, the column is called thrust_kgf",
        "unit",
        ("thrust",),
        both(scaled("thrust", 1 / 9.80665), named("thrust", "thrust_kgf")),
        T,
    ),
    Mistake(
        "speed: rpm called rad/s, the column is called rpm",
        "unit",
        ("speed",),
        both(scaled("speed", 30 / PI), named("speed", "rpm")),
        T,
    ),
    Mistake("yaw rate: deg/s called rad/s", "unit", ("yaw_rate",), scaled("yaw_rate", 180 / PI), E),
    Mistake("yaw rate: rad/s called deg/s", "unit", ("yaw_rate",), scaled("yaw_rate", PI / 180), B),
    Mistake("heading: deg called rad", "unit", ("heading",), scaled("heading", 180 / PI), B),
    Mistake("rudder: deg called rad", "unit", ("rudder_angle",), scaled("rudder_angle", 57.3), E),
    Mistake(
        "rudder: rad called deg", "unit", ("rudder_angle",), scaled("rudder_angle", PI / 180), E
    ),
    Mistake("surge: knots called m/s", "unit", ("surge",), scaled("surge", 1.943844), B),
    Mistake("position: mm called m", "unit", ("position",), scaled("position", 1000.0), A),
    Mistake("command: mV called V", "unit", ("command",), scaled("command", 1000.0), T),
    Mistake("command: V called mV", "unit", ("command",), scaled("command", 0.001), T),
    Mistake("time: ms called s", "time_base", ("time",), clock(1000.0), EACH),
    Mistake("time: s called ms", "time_base", ("time",), clock(0.001), EACH),
    Mistake("time: ms called s, of an axis", "time_base", ("time",), clock(1000.0), A),
    Mistake("time: twice as fast", "time_base", ("time",), clock(0.5), B),
    Mistake("thrust 0.6 s late", "lag", ("thrust",), late(0.6, "thrust"), T),
    Mistake("thrust 0.6 s early", "lag", ("speed", "command"), late(-0.6, "thrust"), T),
    Mistake("yaw rate 2.5 s late", "lag", ("yaw_rate",), late(2.5, "yaw_rate"), B),
    Mistake("heading 4 s late", "lag", ("heading",), late(4.0, "heading"), E),
    Mistake("sensor stuck for a sixth", "stuck", ALL_SENSORS, sensor(stuck), EACH),
    Mistake("sensor clipped to half its range", "saturated", ALL_SENSORS, sensor(clipped), EACH),
    Mistake("sensor of 8 steps", "stuck", ALL_SENSORS, sensor(coarse), EACH),
    Mistake("sensor held for 8 samples", "stuck", ALL_SENSORS, sensor(held), EACH),
    Mistake("missing written as -999", "sentinel", ALL_SENSORS, sensor(coded(-999.0)), EACH),
    Mistake("missing written as 0", "sentinel", ALL_SENSORS, sensor(coded(0.0, 0.03)), EACH),
    Mistake("missing written as 65535", "sentinel", ALL_SENSORS, sensor(coded(65535.0)), EACH),
    Mistake("outliers, 0.5 %", "outliers", ALL_SENSORS, sensor(spiked), EACH),
    Mistake("a third of the log lost", "gap", ("time",), gapped, EACH),
    Mistake("dead sensor, constant", "silent", ALL_SENSORS, sensor(lambda v: 0 * v + 0.1), EACH),
    Mistake("dead sensor, noise", "silent", ALL_SENSORS, sensor(noise_only), EACH),
    Mistake(
        "one log of four: thrust in kgf",
        "unit",
        ("thrust",),
        scaled("thrust", 1 / 9.80665),
        T,
        companions=True,
    ),
    Mistake(
        "one log of four: speed in rpm",
        "unit",
        ("speed",),
        scaled("speed", 30 / PI),
        T,
        companions=True,
    ),
    Mistake(
        "one log of four: thrust tripled",
        "odd_log",
        ("thrust",),
        scaled("thrust", 3.0),
        T,
        companions=True,
    ),
    Mistake(
        "one log of four: tare off by 0.7 of the range",
        "odd_log",
        ("thrust",),
        lambda log: changed(log, thrust=lambda v: v + 0.7 * np.ptp(v)),
        T,
        companions=True,
    ),
)


@dataclass
class Tally:
    """What became of one mistake."""

    named: int = 0
    other: list[str] = field(default_factory=list)
    missed: int = 0
    beside: list[str] = field(default_factory=list)


def originals(root: Path, name: str, names: dict[str, tuple[str, ...]]) -> list[dft.Log]:
    """The three logs of a set that are altered; ``:1`` and ``:2`` are halves."""
    out = []
    for word in names[name]:
        pattern, _, part = word.partition(":")
        (log,) = measured.logs(root, name, pattern)
        half = log.duration / 2
        out.append({"": log, "1": log.slice(None, half), "2": log.slice(half, None)}[part])
    return out


def told(logs: Sequence[dft.Log] | dft.Log, name: str) -> tuple[dft.soundness.Doubt, ...]:
    return dft.soundness.doubts(logs, MODELS[name])


def study(
    root: Path,
    mistakes: Sequence[Mistake] = MISTAKES,
    names: dict[str, tuple[str, ...]] = THREE,
) -> dict[str, Tally]:
    """Make each mistake in three logs, and see what is told that was not told before."""
    sets = {name: originals(root, name, names) for name in {s for m in mistakes for s in m.sets}}
    tallies = {}
    for mistake in mistakes:
        tally = tallies[mistake.name] = Tally()
        one = len(mistake.sets) == 1
        cases = [
            (name, log)
            for k, name in enumerate(mistake.sets)
            for log in (sets[name] if one else sets[name][k : k + 1])
        ]
        for name, log in cases:
            beside = []
            if mistake.companions:
                kind = next(k for k in ("Ramp", "Sine", "Step") if k in log.name)
                beside = [o for o in measured.logs(root, name, f"CL*{kind}") if o.name != log.name]
            before = {(d.channel, d.kind) for d in told([log, *beside[:3]], name)}
            after = [
                d
                for d in told([mistake.alter(log), *beside[:3]], name)
                if (d.channel, d.kind) not in before
            ]
            right = [d for d in after if d.kind == mistake.kind and d.channel in mistake.channels]
            wrong = [f"{d.channel} {d.kind}" for d in after if d not in right]
            if right:
                tally.named += 1
                tally.beside += wrong
            elif wrong:
                tally.other += wrong
            else:
                tally.missed += 1
    return tallies


def table(tallies: dict[str, Tally]) -> str:
    rows = ["| mistake | named | told as another | missed | told beside it |", "|" + " --- |" * 5]
    for name, t in tallies.items():
        other = ", ".join(sorted(set(t.other)))
        beside = ", ".join(sorted(set(t.beside)))
        others = 3 - t.named - t.missed
        rows.append(
            f"| {name} | {t.named} | {others}{f' ({other})' if other else ''} | {t.missed} "
            f"| {beside} |"
        )
    totals = [sum(t.named for t in tallies.values()), sum(t.missed for t in tallies.values())]
    count = 3 * len(tallies)
    rows.append(f"| all | {totals[0]} of {count} | {count - sum(totals)} | {totals[1]} | |")
    return "\n".join(rows)


def main() -> None:
    from .sound import false_alarms, false_alarms_of_sets, real_defects

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("DIFFTHRUST_DATA", "")))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sound", type=int, default=100, help="number of sound logs")
    chosen = parser.parse_args()
    print(table(study(chosen.data)), "\n\nThe same in logs that no threshold was chosen by:\n")
    print(table(study(chosen.data, names=OTHERS)))
    alarms, count = false_alarms(chosen.data, chosen.sound, chosen.seed)
    print(f"\nSound logs: {count}, with false alarms: {len(alarms)}")
    for line in alarms:
        print(f"  {line}")
    alarms, count = false_alarms_of_sets(chosen.data, chosen.sound // 2, chosen.seed)
    print(f"\nSets of sound logs: {count}, with false alarms: {len(alarms)}")
    for line in alarms:
        print(f"  {line}")
    print("\nReal defects of the logs as published:")
    for line in real_defects(chosen.data):
        print(f"  {line}")


if __name__ == "__main__":
    main()
