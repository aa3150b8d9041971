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
Sets = tuple[str, ...]


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
    sets: Sets
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


def shifted(log: dft.Log) -> dft.Log:
    return changed(log, thrust=lambda v: v + 0.7 * np.ptp(v))


def noise_only(v: np.ndarray) -> np.ndarray:
    return np.std(v) * np.random.default_rng(3).standard_normal(v.size)


PI, KGF = np.pi, 9.80665


def sign(name: str, channel: str, sets: Sets, *others: str) -> Mistake:
    return Mistake(name, "sign", (channel, *others), scaled(channel, -1), sets)


def swap(first: str, second: str, sets: Sets, name: str = "") -> Mistake:
    name = name or f"{first} and {second} exchanged"
    return Mistake(name, "exchanged", (first, second), exchanged(first, second), sets)


def unit(name: str, channel: str, factor: float, sets: Sets, column: str = "") -> Mistake:
    """Numbers of another unit; of a column, whose name may tell that."""
    alter = scaled(channel, factor)
    alter = both(alter, named(channel, column)) if column else alter
    return Mistake(name, "unit", (channel,), alter, sets)


def bad(name: str, kind: str, change: Callable[[np.ndarray], np.ndarray]) -> Mistake:
    """A sensor that reads wrong, whichever stands for its set."""
    return Mistake(name, kind, tuple(SENSOR.values()), sensor(change), EACH)


def of_four(name: str, kind: str, channel: str, alter: Alter) -> Mistake:
    return Mistake(f"one log of four: {name}", kind, (channel,), alter, T, companions=True)


MISTAKES = (
    sign("thrust negated", "thrust", T, "command"),
    sign("command negated", "command", T, "thrust"),
    sign("force of the axis negated", "force", A),
    sign("yaw rate negated", "yaw_rate", B),
    sign("heading negated", "heading", E),
    sign("surge negated", "surge", B),
    sign("sway negated (port positive)", "sway", E),
    sign("rudder negated", "rudder_angle", E),
    sign("east negated", "east", B),
    swap("speed", "thrust", T),
    swap("command", "speed", T),
    swap("left_force", "right_force", B, "left and right exchanged"),
    swap("north", "east", E),
    swap("surge", "sway", E),
    swap("position", "velocity", A),
    unit("speed: rpm called rad/s", "speed", 30 / PI, T),
    unit("speed: Hz called rad/s", "speed", 0.5 / PI, T),
    unit("thrust: kgf called N", "thrust", 1 / KGF, T),
    unit("thrust: kgf called N, and thrust_kgf by its column", "thrust", 1 / KGF, T, "thrust_kgf"),
    unit("speed: rpm called rad/s, and rpm by its column", "speed", 30 / PI, T, "rpm"),
    unit("yaw rate: deg/s called rad/s", "yaw_rate", 180 / PI, E),
    unit("yaw rate: rad/s called deg/s", "yaw_rate", PI / 180, B),
    unit("heading: deg called rad", "heading", 180 / PI, B),
    unit("rudder: deg called rad", "rudder_angle", 57.3, E),
    unit("rudder: rad called deg", "rudder_angle", PI / 180, E),
    unit("surge: knots called m/s", "surge", 1.943844, B),
    unit("position: mm called m", "position", 1000.0, A),
    unit("command: mV called V", "command", 1000.0, T),
    unit("command: V called mV", "command", 0.001, T),
    Mistake("time: ms called s", "time_base", ("time",), clock(1000.0), EACH),
    Mistake("time: s called ms", "time_base", ("time",), clock(0.001), EACH),
    Mistake("time: ms called s, of an axis", "time_base", ("time",), clock(1000.0), A),
    Mistake("time: twice as fast", "time_base", ("time",), clock(0.5), B),
    Mistake("thrust 0.6 s late", "lag", ("thrust",), late(0.6, "thrust"), T),
    Mistake("thrust 0.6 s early", "lag", ("speed", "command"), late(-0.6, "thrust"), T),
    Mistake("yaw rate 2.5 s late", "lag", ("yaw_rate",), late(2.5, "yaw_rate"), B),
    Mistake("heading 4 s late", "lag", ("heading",), late(4.0, "heading"), E),
    bad("sensor stuck for a sixth", "stuck", stuck),
    bad("sensor clipped to half its range", "saturated", clipped),
    bad("sensor of 8 steps", "stuck", coarse),
    bad("sensor held for 8 samples", "stuck", held),
    bad("missing written as -999", "sentinel", coded(-999.0)),
    bad("missing written as 0", "sentinel", coded(0.0, 0.03)),
    bad("missing written as 65535", "sentinel", coded(65535.0)),
    bad("outliers, 0.5 %", "outliers", spiked),
    Mistake("a third of the log lost", "gap", ("time",), gapped, EACH),
    bad("dead sensor, constant", "silent", lambda v: 0 * v + 0.1),
    bad("dead sensor, noise", "silent", noise_only),
    of_four("thrust in kgf", "unit", "thrust", scaled("thrust", 1 / KGF)),
    of_four("speed in rpm", "unit", "speed", scaled("speed", 30 / PI)),
    of_four("thrust tripled", "odd_log", "thrust", scaled("thrust", 3.0)),
    of_four("tare off by 0.7 of the range", "odd_log", "thrust", shifted),
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
