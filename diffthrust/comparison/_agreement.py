"""What does not fit together: channels that mean something else, and runs that stand out.

A model with wrong parameters still moves to the right side. Where a channel moves to the other
side, its sign is not what its name says, or that of an input is not, or two inputs are exchanged.
A simulation with changed inputs shows which changes would mend it, and the kinematics of the log (a
heading must turn at the yaw rate) whether the channel itself is to blame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.words import percent
from diffthrust.comparison._residual_tests import cross_correlation
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run
from diffthrust.simulation._trajectory import simulate_fixed

Pair = tuple[np.ndarray, np.ndarray]

# Correlation above which two series move together (and below minus which they oppose each other),
# above which they do so firmly, and the ratio of swings from which on a scale is doubted.
_TOGETHER, _FIRMLY, _SCALE = 0.5, 0.8, 2.5
_BORNE_OUT = {
    "yaw_rate": "'heading'",
    "surge": "'north', 'east' and 'heading'",
    "sway": "'north', 'east' and 'heading'",
}
"""What a log must measure for its kinematics to tell of a channel."""


@dataclass(frozen=True)
class Agreement:
    """How a measured channel follows the modelled one, over all runs.

    Args:
        channel: name of the channel.
        correlation: of measured and modelled, about their means.
        band: unrelated series of the same correlation in time stay within plus or minus this in
            95 % of cases.
        gain: slope of the measured on the modelled.
        lag: by how much the measured one follows the modelled one [s] where they agree best.
        runs: number of runs.
    """

    channel: str
    correlation: float
    band: float
    gain: float
    lag: float
    runs: int

    @property
    def opposed(self) -> bool:
        """Whether the measurement moves opposite to the model."""
        return self.correlation < -max(_TOGETHER, 1.5 * self.band)

    @property
    def sentence(self) -> str:
        """What is odd, in plain words; empty where nothing is."""
        runs = "1 run" if self.runs == 1 else f"{self.runs} runs"
        evidence = f"(correlation {self.correlation:+.2f} over {runs})"
        if self.opposed:
            return f"{self.channel}: the measurement moves opposite to the model {evidence}."
        if self.correlation > _FIRMLY and not 1 / _SCALE < self.gain < _SCALE:
            return (
                f"{self.channel}: the measurement moves with the model, but {self.gain:.2g} times "
                f"as far {evidence}: the unit or scale of the channel or of an input may not be "
                "what its name says."
            )
        return ""

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "opposed": self.opposed}


def agreement(model: Model, runs: Sequence[Run], channel: str) -> Agreement | None:
    """Hold a measured channel against the modelled one; ``None`` where either does not move."""
    having = [run for run in runs if _is_measured(run, channel)]
    if not having or not all(np.isfinite(run.signals[channel]).all() for run in having):
        return None
    pairs = [_pair(model, run, channel, run.signals[channel]) for run in having]
    together, gain = _together(pairs)
    if not np.isfinite(together):
        return None
    step = float(np.median(np.concatenate([np.diff(run.time) for run in having])))
    measured, modelled = zip(*pairs, strict=True)
    reach = max(1, min(max(x.size for x in measured) // 4, 200))
    crossed = cross_correlation(channel, measured, modelled, reach, step)
    return Agreement(channel, together, crossed.band, gain, crossed.lag, len(having))


def hints(model: Model, runs: Sequence[Run], agreements: Iterable[Agreement]) -> tuple[str, ...]:
    """Sentences on channels that may not mean what their names say.

    For each channel that opposes the model: which changes of the inputs would make it agree, and
    what the kinematics of the log say of the channel itself.
    """
    agreements = tuple(agreements)
    opposed = [a.channel for a in agreements if a.opposed]
    kinematic = _kinematics(runs)
    sentences = [a.sentence for a in agreements if a.sentence]
    if opposed:
        agreeing = [a.channel for a in agreements if a.correlation > _FIRMLY]
        sentences += _mends(model, runs, opposed, agreeing)
    for channel, (words, together) in kinematic.items():
        evidence = f"{words} of the same log (correlation {together:+.2f})"
        if together < -_TOGETHER:
            sentences.append(
                f"{channel}: it opposes {evidence}: the sign of one of them is not what its name "
                "says."
            )
        elif together > _TOGETHER and channel in opposed:
            sentences.append(
                f"{channel}: it agrees with {evidence}, so not this channel but an input is the "
                "odd one."
            )
    sentences += [
        f"{name}: whether this channel or an input is the odd one, a measured {_BORNE_OUT[name]} "
        "would tell."
        for name in opposed
        if name not in kinematic and name in _BORNE_OUT
    ]
    return tuple(sentences)


def _mends(
    model: Model, runs: Sequence[Run], opposed: Sequence[str], agreeing: Sequence[str]
) -> list[str]:
    """The changes of inputs that make opposed channels agree and spoil no other, best first."""
    mends = []
    for words, sources in _changes(model, runs):
        after = _after(model, runs, sources, [*opposed, *agreeing])
        # a change that mends one channel and spoils another is no explanation
        if all(value > _TOGETHER for value in after.values()):
            listed = ", ".join(f"{name} {after[name]:+.2f}" for name in opposed)
            sentence = f"{words} turns the correlation positive: {listed}."
            mends.append((-min(after.values()), sentence))
    return [sentence for _, sentence in sorted(mends)]


_Sources = Mapping[str, tuple[int, str]]
"""Inputs that become plus or minus another one of the same unit."""


def _changes(model: Model, runs: Sequence[Run]) -> Iterator[tuple[str, _Sources]]:
    names = [name for name in model.inputs if all(name in run.record.inputs for run in runs)]
    for first, second in combinations(names, 2):
        if model.inputs[first] == model.inputs[second]:
            exchanged = {first: (1, second), second: (1, first)}
            yield f"Exchanging the inputs {first} and {second}", exchanged
    for name in names:
        yield f"Reversing the sign of the input {name}", {name: (-1, name)}


def _after(
    model: Model, runs: Sequence[Run], sources: _Sources, channels: Iterable[str]
) -> dict[str, float]:
    """Correlation of each channel with a simulation over changed inputs."""
    pairs: dict[str, list[Pair]] = {name: [] for name in channels}
    for run in runs:
        inputs, hold = {**run.record.inputs}, {**run.record.hold}
        for name, (sign, source) in sources.items():
            inputs[name] = sign * run.record.inputs[source]
            hold[name] = run.record.hold[source]
        changed = replace(run.record, inputs=inputs, hold=hold)
        modelled = simulate_fixed(model, changed, run.start, run.substeps)
        for name in pairs:
            if _is_measured(run, name):
                pairs[name].append(_pair(model, run, name, modelled[name]))
    return {name: _together(pair)[0] for name, pair in pairs.items()}


def _is_measured(run: Run, channel: str) -> bool:
    return channel in run.channels and bool(np.isfinite(run.channels[channel].measured).any())


def _pair(model: Model, run: Run, channel: str, modelled: np.ndarray) -> Pair:
    """Measured, NaN where missing, and modelled, as they are to be held against each other."""
    measured = run.channels[channel].measured
    if channel in model.angles:  # whole turns and the start are not what is compared
        ours = np.unwrap(modelled)
        return measured - np.nanmean(measured), ours - ours.mean()
    return measured, np.abs(modelled) if channel in run.record.unsigned else modelled


def _together(pairs: Sequence[Pair]) -> tuple[float, float]:
    """Correlation, and slope of the first on the second; NaN where one does not move."""
    first, second = (np.concatenate(x) for x in zip(*pairs, strict=True))
    finite = np.isfinite(first) & np.isfinite(second)
    first, second = first[finite], second[finite]
    if first.size < 10 or not (np.ptp(first) > 0 and np.ptp(second) > 0):
        return np.nan, np.nan
    correlation = float(np.corrcoef(first, second)[0, 1])
    return correlation, correlation * float(np.std(first) / np.std(second))


def _kinematics(runs: Sequence[Run]) -> dict[str, tuple[str, float]]:
    """What a velocity channel must equal by geometry alone, and its correlation with that."""
    pairs: dict[str, list[Pair]] = {}
    for run in runs:
        measured = {name: trace.measured for name, trace in run.channels.items()}
        if "heading" not in measured:
            continue
        due = {"yaw_rate": _over_a_second(run.time, measured["heading"])}
        if "north" in measured and "east" in measured:
            north, east = (_over_a_second(run.time, measured[name]) for name in ("north", "east"))
            cos, sin = np.cos(measured["heading"]), np.sin(measured["heading"])
            due |= {"surge": north * cos + east * sin, "sway": east * cos - north * sin}
        for name, moved in due.items():
            if name in measured:
                pairs.setdefault(name, []).append((measured[name], moved))
    words = {"yaw_rate": "the rate of the measured heading"}
    along = "the motion of the measured position"
    return {name: (words.get(name, along), _together(pair)[0]) for name, pair in pairs.items()}


def _over_a_second(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Rate of change over about a second about each sample, NaN at the ends and at gaps."""
    # differences from sample to sample are mostly noise: a GPS position of 1 m at 10 Hz gives 14
    # m/s
    half = max(1, round(0.5 / float(np.median(np.diff(time)))))
    rate = np.full(values.size, np.nan)
    if values.size > 2 * half:
        rise = values[2 * half :] - values[: -2 * half]
        rate[half:-half] = rise / (time[2 * half :] - time[: -2 * half])
    return rate


_OUTSTANDING = 3.0
"""A run stands out where its error is this multiple of the median run's, both absolute and as a
share of what varies in the run: neither a larger manoeuvre nor a smaller one makes it odd."""


class Outstanding(NamedTuple):
    """The error of one run beside those of the others, in one channel.

    ``place`` is that of the run among those that were given, ``ratio`` its RMSE over that of the
    median run, ``share`` that of the squared error of all runs, and ``size`` the RMSE in words.
    """

    place: int
    run: str
    channel: str
    ratio: float
    share: float
    size: str

    @property
    def sentence(self) -> str:
        """In plain words."""
        return (
            f"{self.run}: its {self.channel} error (RMSE {self.size}) is {self.ratio:.2g} times "
            f"that of the median run and makes up {percent(self.share)} of the squared error of "
            "all runs."
        )


def beside_others(runs: Sequence[Run], channel: str) -> list[Outstanding]:
    """The error of every run that has a channel, beside that of the median run."""
    errors = [run.errors.channels for run in runs]
    # a channel of which a run has no reading has no error
    by_run = {i: by_name[channel] for i, by_name in enumerate(errors) if channel in by_name}
    usual = float(np.median([e.rmse for e in by_run.values()])) if by_run else np.nan
    total = sum(e.rmse**2 * e.samples for e in by_run.values())
    return [
        Outstanding(
            place=i,
            run=runs[i].name,
            channel=channel,
            ratio=e.rmse / usual if usual > 0 else 1.0,
            share=e.rmse**2 * e.samples / total if total > 0 else 0.0,
            size=f"{e.shown[0]:.3g} {e.shown[1]}".rstrip(),
        )
        for i, e in by_run.items()
    ]


def outstanding(runs: Sequence[Run]) -> list[Outstanding]:
    """The runs whose errors stand out, channel by channel; none of fewer than three."""
    standing_out = []
    for name in dict.fromkeys(name for run in runs for name in run.channels):
        by_run = beside_others(runs, name)
        if len(by_run) < 3:
            continue  # of two runs the median lies between both: neither is three times as large
        relative = [runs[entry.place].errors.channels[name].nrmse for entry in by_run]
        most = _OUTSTANDING * float(np.median(relative))
        for entry, nrmse in zip(by_run, relative, strict=True):
            if _OUTSTANDING < entry.ratio < np.inf and nrmse > most:
                standing_out.append(entry)
    return standing_out
