"""The experiment that best tells rival models apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from diffthrust._support.files import write_whole
from diffthrust.estimation._result import Fit
from diffthrust.experiments._designs import Design, grid, identity
from diffthrust.experiments._request import Request, requested
from diffthrust.experiments._separation import (
    Imitation,
    imitated_from_afar,
    outputs_of,
    pairs_of,
    separations,
)
from diffthrust.experiments._words import described, promise
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DECISIVE = 9.0
"""Separation from which a test decides: the log-likelihood ratio is then wrong in its sign in at
most one case of fifteen, the normal probability beyond half of its square root."""
_ROUNDS = (1.5, 1.25, 1.12)
_LEADERS = 4


class Trial(NamedTuple):
    """A design that was tried.

    Args:
        kind: the family, such as "staircase".
        parameters: lowest and highest value of each input, ``share`` of the way to the limits, and
            ``hold`` [s], the time per level or half the shortest period.
        separation: the criterion, for the two rivals that it separates worst.
        words: the design in words.
    """

    kind: str
    parameters: dict[str, Any]
    separation: float
    words: str


@dataclass(frozen=True)
class Experiment:
    """A test that separates rival models, and what is to be expected of it.

    Args:
        sentence: the test and its promise in words.
        time: sample instants [s], ``(T,)``.
        inputs: the series to send to the vehicle, ``(T,)`` each, each value held to the next.
        log_inputs: these and the inputs taken as constant: the inputs of the log to come.
        ranking: all designs that were tried, the best first.
        rivals: names of the models.
        separation: the criterion for the two rivals that are separated worst: the sum of squared
            differences over the noise after one has imitated the other as well as it can. Half of
            it is the expected log-likelihood ratio, with a standard deviation of its square root.
            It rests on the best of 16 searches for an imitation, so it is an upper bound: of large
            models with little known of their parameters it may be too high by a factor of two.
        separations: the same for every pair ``(truth, imitator)``; of a model and the same with
            more effects only with the larger one as the truth: the smaller is its special case.
        decisive: whether the test can be expected to tell the rivals apart.
        truth: the rival that, if it holds, is hardest to tell from another.
        predictions: outputs by rival and channel, ``(T,)`` each: of ``truth`` as it is, of the
            others as they imitate it.
        noise: standard deviation of each channel's noise.
        units: of inputs and channels.
    """

    sentence: str
    time: np.ndarray = field(repr=False)
    inputs: Mapping[str, np.ndarray] = field(repr=False)
    log_inputs: Mapping[str, np.ndarray] = field(repr=False)
    ranking: tuple[Trial, ...] = field(repr=False)
    rivals: tuple[str, ...]
    separation: float
    separations: Mapping[tuple[str, str], float]
    decisive: bool
    truth: str
    predictions: Mapping[str, Mapping[str, np.ndarray]] = field(repr=False)
    noise: Mapping[str, float]
    units: Mapping[str, str] = field(repr=False)

    @property
    def expected_log_likelihood_ratio(self) -> float:
        """Expected gain of the right rival over the wrong one, for the worst pair."""
        return 0.5 * self.separation

    def difference(self, channel: str, one: str, other: str) -> np.ndarray:
        """The prediction of one rival less that of another, ``(T,)``."""
        return self.predictions[one][channel] - self.predictions[other][channel]

    def plot(self) -> Figure:
        """The inputs, what the rivals predict with its noise, and the difference."""
        from diffthrust.experiments._figure import experiment_figure

        return experiment_figure(self)

    def to_csv(self, path: str | Path) -> None:
        """Write time and inputs as a table for the controller, every digit kept.

        Raises:
            InputError: the file cannot be written.
        """
        rows = zip(self.time, *self.inputs.values(), strict=True)
        lines = [",".join(["time", *self.inputs])]
        lines += [",".join(repr(float(value) + 0.0) for value in row) for row in rows]
        write_whole(Path(path), ("\n".join(lines) + "\n").encode())


def suggest_experiment(
    rivals: Sequence[Model | Fit],
    *,
    duration: float,
    step: float,
    limits: Mapping[str, tuple[float, float]] | None = None,
    logs: Log | Sequence[Log] | None = None,
    noise: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
    rate_limits: Mapping[str, float] | None = None,
    rest: float = 1.0,
    correlation_time: float | None = None,
    seed: int = 0,
) -> Experiment:
    """Find the command sequence that best separates the predictions of rival models.

    Steps, reversals, pulses, staircases, ramps, chirps and multisines of several sizes and speeds
    are tried, and the best are refined. The worth of a test is what remains of the difference
    between two rivals after one has imitated the other as well as its parameters allow, given what
    the logs so far say of them; for the pair that is separated worst.

    Source of the criterion: Atkinson & Fedorov 1975, Biometrika 62, 57 (two rivals) and 289
    (several).

    Args:
        rivals: two or more models or fits. Of a fit, the covariance says how far its parameters may
            move; of a model, its priors and the logs do.
        duration: length of the test [s].
        step: time between samples [s].
        limits: lowest and highest value of each input that may be moved, in the model's unit; by
            default the range of the model's inputs in ``logs``.
        logs: the logs so far.
        noise: standard deviation of each channel that the test will measure, in the model's unit;
            by default that of the fits, the smallest for each channel.
        held: values of inputs that stay constant (inflow, supply voltage); by default their medians
            in ``logs``.
        rate_limits: largest change of an input per second.
        rest: the inputs are at zero (or the nearest limit) for so long at the start and the end
            [s].
        correlation_time: of the noise [s], where it is not white: after this time its correlation
            has fallen to 1/e. Process noise makes differences that last count for less.
        seed: of the random sequences; the result is the same for the same arguments.

    Returns:
        An `Experiment`; look at ``sentence`` first.

    Raises:
        InputError: fewer than two rivals, an input without limits or value, no noise level, or
            an argument out of range.

    Example:
        >>> lag = dft.fit(dft.Thruster() + dft.effects.ActuatorLag(), logs)
        >>> damped = dft.fit(dft.Thruster() + ViscousFriction(), logs)
        >>> test = dft.suggest_experiment(
        ...     [lag, damped], limits={"command": (-5, 5)}, duration=40.0, step=0.05
        ... )
        >>> test.to_csv("test.csv")
    """
    request = requested(
        rivals,
        duration=duration,
        step=step,
        limits=limits,
        logs=logs,
        noise=noise,
        held=held,
        rate_limits=rate_limits,
        rest=rest,
        correlation_time=correlation_time,
        seed=seed,
    )
    space = request.space
    tried: dict[tuple[object, ...], tuple[float, Design]] = {}
    _try(grid(space), request, tried)
    for factor in _ROUNDS:
        around = [
            design.changed(faster, larger, space)
            for _, design in _best(tried)[:_LEADERS]
            for faster, larger in ((factor, 1), (1 / factor, 1), (1, factor), (1, 1 / factor))
        ]
        _try(around, request, tried)
    while True:  # a promise must hold against the best imitation found, not only the first
        worth, design = _best(tried)[0]
        found = _Verified.of(design, request)
        if found.worth >= worth * (1 - 1e-6):
            return _result(request, _best(tried), found)
        tried[identity(design)] = (found.worth, design)


def _try(designs: Sequence[Design], request: Request, tried: dict[tuple[object, ...], Any]) -> None:
    """Add the separation of new designs, for the worst pair; zero where a simulation failed."""
    new = {identity(d): d for d in designs if identity(d) not in tried}
    if not new:
        return
    pairs = separations(request.rivals, request.setting, request.inputs(list(new.values())))
    worst = np.min([np.nan_to_num(pair) for pair in pairs.values()], axis=0)
    for (key, design), value in zip(new.items(), worst, strict=True):
        tried[key] = (float(value), design)


def _best(tried: Mapping[Any, tuple[float, Design]]) -> list[tuple[float, Design]]:
    return sorted(tried.values(), key=lambda pair: -pair[0])


class _Verified(NamedTuple):
    """A design whose imitations were sought from several starts."""

    inputs: dict[str, np.ndarray]
    pairs: dict[tuple[int, int], float]
    truth: int
    imitator: int
    outputs: list[np.ndarray]

    @property
    def worth(self) -> float:
        return self.pairs[self.truth, self.imitator]

    @classmethod
    def of(cls, design: Design, request: Request) -> _Verified:
        inputs, rivals, setting = request.inputs([design]), request.rivals, request.setting
        outputs = [outputs_of(rival, setting, inputs) for rival in rivals]

        def found(i: int, j: int) -> Imitation:
            return imitated_from_afar(rivals[j], setting, inputs, outputs[i], request.space.seed)

        pairs = {pair: found(*pair) for pair in pairs_of(rivals)}
        worth = {k: float(np.nan_to_num(pair.separation[0])) for k, pair in pairs.items()}
        truth, imitator = min(worth, key=lambda pair: worth[pair])
        shown = [
            pairs[truth, j].outputs if (truth, j) in pairs else own for j, own in enumerate(outputs)
        ]
        series = {name: rows[0] for name, rows in inputs.items()}
        return cls(series, worth, truth, imitator, [rows[0] for rows in shown])


def _result(
    request: Request, ranked: Sequence[tuple[float, Design]], found: _Verified
) -> Experiment:
    space, setting, names = request.space, request.setting, request.names
    predictions = {
        name: dict(zip(setting.noise, rows, strict=True))
        for name, rows in zip(names, found.outputs, strict=True)
    }
    words = described(ranked[0][1], space, request.units)
    test = Experiment(
        sentence="",
        time=setting.time,
        inputs={name: found.inputs[name] for name in space.limits},
        log_inputs=found.inputs,
        ranking=tuple(_trial(value, tried, request) for value, tried in ranked),
        rivals=names,
        separation=found.worth,
        separations={(names[i], names[j]): value for (i, j), value in found.pairs.items()},
        decisive=found.worth >= DECISIVE,
        truth=names[found.truth],
        predictions=predictions,
        noise=setting.noise,
        units=request.units,
    )
    return replace(test, sentence=promise(words, test, names[found.imitator]))


def _trial(separation: float, design: Design, request: Request) -> Trial:
    space = request.space
    ranges = {name: design.levels(name, space) for name in space.limits}
    parameters = {**ranges, "share": design.share, "hold": design.hold}
    return Trial(design.kind, parameters, separation, described(design, space, request.units))
