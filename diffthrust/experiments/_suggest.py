"""Find the experiment that best discriminates rival models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter
from diffthrust._support.words import number
from diffthrust.estimation._arguments import listed
from diffthrust.estimation._result import Fit
from diffthrust.experiments import _request as asked
from diffthrust.experiments._designs import KINDS, Design, Space, design_key, grid
from diffthrust.experiments._request import Request
from diffthrust.experiments._result import Experiment, Trial
from diffthrust.experiments._separation import (
    Conditions,
    imitated_from_afar,
    outputs_of,
    pairs_of,
    separations,
)
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.model import Model

_DECISIVE = 9.0
"""Separation above which a test is decisive: the log-likelihood ratio then has the wrong sign with
probability 1/15, the normal tail beyond half its square root."""
_ROUNDS = (1.5, 1.25, 1.12)
_LEADERS = 4


@progressing
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
    progress: ProgressOption = None,
) -> Experiment:
    """Find the command sequence that best separates the predictions of rival models.

    Steps, reversals, pulses, staircases, ramps, chirps and multisines of several sizes and speeds
    are tried, and the best are refined. The criterion is the remaining difference between two
    rivals after one has imitated the other as well as its parameters allow, given the logs so far;
    for the worst separated pair.

    Source of the criterion: Atkinson & Fedorov 1975, Biometrika 62, 57 (two rivals) and 289
    (several).

    Args:
        rivals: two or more models or fits. How far parameters may move is given by the covariance
            of a fit, or by priors and logs of a model.
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
        rest: time at zero (or the nearest limit) at the start and the end [s].
        correlation_time: time after which the noise's correlation has fallen to 1/e [s], if it is
            not white. It reduces the weight of slow differences, as process noise would.
        seed: of the random sequences; the result is the same for the same arguments.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        An `Experiment`; read ``sentence`` first.

    Raises:
        InputError: fewer than two rivals, an input without limits or value, no noise level, or
            an argument out of range.

    Example:
        >>> rivals = [dft.Thruster(), dft.Thruster() + dft.effects.CommandDeadband(half_width=0.4)]
        >>> test = dft.suggest_experiment(
        ...     rivals,
        ...     limits={"command": (-2, 2)},
        ...     duration=6.0,
        ...     step=0.1,
        ...     noise={"speed": 0.3, "thrust": 0.2},
        ... )
        >>> test.decisive, test.time.shape
        (True, (61,))
    """
    runs = listed(logs) if logs is not None else ()
    models = asked.models_of(rivals)
    asked.check_numbers(duration, step, rest, correlation_time, seed)
    moved, constant = asked.moved_and_held(models, limits, held, runs)
    rates = asked.checked_rates(rate_limits, moved)
    sigma = asked.noise_levels(rivals, models, noise)
    time = np.round(np.arange(round(duration / step) + 1) * step, 9)
    space = Space(time, moved, rates, rest, seed)
    conditions = Conditions(
        time=time,
        noise=sigma,
        unsigned=frozenset(name for log in runs for name in log.unsigned if name in sigma),
        substeps=asked.enough_substeps(models, space, constant, sigma),
        correlation=math.exp(-step / correlation_time) if correlation_time else 0.0,
    )
    fitted = [rival.written for rival in rivals if isinstance(rival, Fit)]
    request = Request(
        tuple(asked.rival_of(r, model, runs) for r, model in zip(rivals, models, strict=True)),
        asked.names_of(models),
        space,
        conditions,
        constant,
        asked.units_of(models, runs),
        ShownUnits([*fitted, *(log.written for log in runs)]).written,
    )
    return _search(request, reporter(progress))


def _search(request: Request, report: Progress) -> Experiment:
    """The best design of the families, refined, and verified against the best imitation."""
    tried: dict[tuple[object, ...], tuple[float, Design]] = {}
    report("trying commands", 0.0)
    _try(grid(request.space), request, tried)
    for k, factor in enumerate(_ROUNDS):
        report("refining the best", 0.4 + 0.3 * k / len(_ROUNDS))
        around = [
            design.changed(faster, larger, request.space)
            for _, design in _best(tried)[:_LEADERS]
            for faster, larger in ((factor, 1), (1 / factor, 1), (1, factor), (1, 1 / factor))
        ]
        _try(around, request, tried)
    checked = 0
    while True:  # verify against the best imitation from several starts
        report("seeking the best imitation", 1.0 - 0.3 * 0.7**checked)
        checked += 1
        worth, design = _best(tried)[0]
        verified = _verified(design, request)
        # more starts can only lower a separation: the first design that keeps its rank is the best
        if verified.worth >= worth * (1 - 1e-6):
            report("done", 1.0)
            return _result(request, _best(tried), verified)
        tried[design_key(design)] = (verified.worth, design)


def _try(designs: Sequence[Design], request: Request, tried: dict[tuple[object, ...], Any]) -> None:
    """Add the separation of new designs, for the worst pair; zero where a simulation failed."""
    new = {design_key(d): d for d in designs if design_key(d) not in tried}
    if not new:
        return
    pairs = separations(request.rivals, request.conditions, request.inputs(list(new.values())))
    # a failed simulation promises nothing: zero, so that no design is chosen for it
    worst = np.min([np.nan_to_num(pair) for pair in pairs.values()], axis=0)
    for (key, design), value in zip(new.items(), worst, strict=True):
        tried[key] = (float(value), design)


def _best(tried: Mapping[Any, tuple[float, Design]]) -> list[tuple[float, Design]]:
    return sorted(tried.values(), key=lambda pair: -pair[0])


class _Verified(NamedTuple):
    """A design verified by imitations from several starts."""

    inputs: dict[str, np.ndarray]
    pairs: dict[tuple[int, int], float]
    truth: int
    imitator: int
    outputs: list[np.ndarray]

    @property
    def worth(self) -> float:
        return self.pairs[self.truth, self.imitator]


def _verified(design: Design, request: Request) -> _Verified:
    inputs, rivals, conditions = request.inputs([design]), request.rivals, request.conditions
    outputs = [outputs_of(rival, conditions, inputs) for rival in rivals]
    imitations = {
        (i, j): imitated_from_afar(rivals[j], conditions, inputs, outputs[i], request.space.seed)
        for i, j in pairs_of(rivals)
    }
    worth = {k: float(np.nan_to_num(each.separation[0])) for k, each in imitations.items()}
    truth, imitator = min(worth, key=lambda pair: worth[pair])
    for (i, j), imitation in imitations.items():
        if i == truth:
            outputs[j] = imitation.outputs
    series = {name: rows[0] for name, rows in inputs.items()}
    return _Verified(series, worth, truth, imitator, [rows[0] for rows in outputs])


def _result(
    request: Request, ranked: Sequence[tuple[float, Design]], verified: _Verified
) -> Experiment:
    space, conditions, names = request.space, request.conditions, request.names
    predictions = {
        name: dict(zip(conditions.noise, rows, strict=True))
        for name, rows in zip(names, verified.outputs, strict=True)
    }
    words = in_words(ranked[0][1], request)
    test = Experiment(
        sentence="",
        time=conditions.time,
        inputs={name: verified.inputs[name] for name in space.limits},
        log_inputs=verified.inputs,
        ranking=tuple(_trial(value, tried, request) for value, tried in ranked),
        rivals=names,
        separation=verified.worth,
        separations={(names[i], names[j]): value for (i, j), value in verified.pairs.items()},
        decisive=verified.worth >= _DECISIVE,
        truth=names[verified.truth],
        predictions=predictions,
        noise=conditions.noise,
        units=request.units,
        written=request.written,
    )
    return replace(test, sentence=promise_in_words(words, test, names[verified.imitator]))


def _trial(separation: float, design: Design, request: Request) -> Trial:
    space = request.space
    ranges = {name: design.levels(name, space) for name in space.limits}
    parameters = {**ranges, "share": design.share, "hold": design.hold}
    return Trial(design.kind, parameters, separation, in_words(design, request))


def promise_in_words(words: str, test: Experiment, imitator: str) -> str:
    """The channel in which the difference stands out most from the noise, and what follows."""
    apart = {name: test.difference(name, test.truth, imitator) for name in test.noise}
    peaks = {name: float(np.max(np.abs(np.nan_to_num(d)))) for name, d in apart.items()}
    channel = max(peaks, key=lambda name: peaks[name] / test.noise[name])
    shown = ShownUnits((test.written,)).size(channel, peaks[channel], test.units[channel])
    size = f"{number(shown.value, 2)} {shown.unit}".rstrip()
    size = f"{size} ({peaks[channel] / test.noise[channel]:.2g} x the noise)"
    ratio = f"expected log-likelihood ratio {test.expected_log_likelihood_ratio:.3g}"
    pair = " and ".join(f"'{name}'" for name in test.rivals if name in (test.truth, imitator))
    if not test.decisive:
        return (
            f"No test within the limits tells {pair} apart: the best that was tried "
            f"({words[0].lower()}{words[1:]}) makes {channel} differ by at most {size}; {ratio}."
        )
    between = f" between {pair}" if len(test.rivals) > 2 else ""
    return f"{words}: {channel} differs{between} by up to {size}; {ratio}."


def in_words(design: Design, request: Request) -> str:
    """A design in words, such as "Staircase of command between -2 V and 2 V", as logs write it."""
    space, units = request.space, request.units
    shown = ShownUnits((request.written,))
    levels = {
        n: [
            f"{_number(float(level))} {shown.unit(n, units[n])}".rstrip()
            for level in shown.values(n, design.levels(n, space), units[n])
        ]
        for n in space.limits
    }
    between = {"step up": "from {0} to {1}", "step down": "from {1} to {0}"}
    span = between.get(design.kind, "between {0} and {1}")
    joined = " and of ".join(f"{n} {span.format(*levels[n])}" for n in design.moved)
    if len(set(design.moved.values())) > 1:
        joined += " in opposite senses"
    family = KINDS[design.kind]
    hold = design.hold
    times = {"hold": hold, "way": 2 * hold, "cycle": 4 * hold}  # [s]
    tempo = family.tempo.format(**times, first=1 / space.active, last=0.5 / hold)
    text = f"{family.words} of {joined}{tempo}"
    held = [n for n in space.limits if n not in design.moved]
    values = [f"{n} at {levels[n][0]}" for n in held]
    return f"{text}, with {' and '.join(values)}" if values else text


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value + 0.0:.3g}"
