"""The checked arguments of an experiment: rivals, limits and noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import finite, whole_number
from diffthrust.estimation._arguments import by_input
from diffthrust.estimation._arrange import build
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import examine
from diffthrust.experiments._designs import Design, Space, sequence
from diffthrust.experiments._separation import Conditions, Rival
from diffthrust.logs._log import Log
from diffthrust.logs._written import Written
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import bind
from diffthrust.simulation._step_size import choose_substeps


@dataclass(frozen=True)
class Request:
    """A checked request."""

    rivals: tuple[Rival, ...]
    names: tuple[str, ...]  # of the rivals
    space: Space
    conditions: Conditions
    held: Mapping[str, float]  # values of the inputs that stay constant
    units: Mapping[str, str]  # of all inputs and channels
    written: Mapping[str, Written]  # how the fits' logs, or else the logs, wrote them

    def inputs(self, designs: Sequence[Design]) -> dict[str, np.ndarray]:
        """All input series under some designs, ``(D, T)`` each."""
        rows = [sequence(design, self.space) for design in designs]
        moved = {name: np.stack([row[name] for row in rows]) for name in self.space.limits}
        shape = (len(designs), self.space.time.size)
        return {**moved, **{name: np.full(shape, value) for name, value in self.held.items()}}


def models_of(rivals: Any) -> tuple[Model, ...]:
    """The models among models and fits."""
    if not isinstance(rivals, Sequence) or len(rivals) < 2:
        count = f"{len(rivals)}" if isinstance(rivals, Sequence) else repr(rivals)
        raise InputError(
            f"rivals: expected two models or fits at least, found {count}.",
            "Give a list such as [lag, delay].",
        )
    if strange := [rival for rival in rivals if not isinstance(rival, Model | Fit)]:
        raise InputError(
            f"rivals: expected models or fits, found {strange[0]!r}.",
            "Give instances, such as dft.Thruster() or the result of dft.fit.",
        )
    return tuple(rival.model if isinstance(rival, Fit) else rival for rival in rivals)


def names_of(models: Sequence[Model]) -> tuple[str, ...]:
    """Names of the models; duplicates are numbered."""
    names = [str(model) for model in models]
    return tuple(
        f"{name} ({names[: i + 1].count(name)})" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    )


def rival_of(source: Model | Fit, model: Model, logs: Sequence[Log]) -> Rival:
    """A model with prior knowledge from its fit, the logs, or its priors."""
    free = tuple(name for name, p in model.parameters.items() if not p.fixed)
    if isinstance(source, Fit):
        return Rival(model, free, _precision(model, free, source.free, source.covariance))
    if logs and free:
        problem = build(model, bind(model, logs))
        z = problem.start()
        local = examine(problem, z, solve(problem, z, budget=1).quadratic)
        return Rival(model, free, _precision(model, free, problem.free, local.covariance))
    stds = {n: p.std for n in free if (p := model.parameters[n].prior) is not None}
    variances = np.diag([std**2 for std in stds.values()])
    return Rival(model, free, _precision(model, free, list(stds), variances))


def _precision(
    model: Model, free: Sequence[str], names: Sequence[str], covariance: np.ndarray
) -> np.ndarray:
    """Inverse covariance in the optimiser's coordinates; zero without knowledge."""
    out = np.zeros((len(free), len(free)))
    spread = np.sqrt(np.diagonal(covariance)) if len(names) else np.zeros(0)
    kept = [i for i, name in enumerate(names) if name in free and 0 < spread[i] < math.inf]
    if not kept:
        return out
    described = [model.parameters[names[i]] for i in kept]
    size = spread[kept]
    # d(value)/d(coordinate)
    slopes = [p.value if p.transform == "log" else p.scale for p in described]
    # the inverse is taken of the correlation: units of 1e3 between parameters would fall below
    # rcond
    correlation = covariance[np.ix_(kept, kept)] / np.outer(size, size)
    weight = np.array(slopes) / size
    # directions that the logs do not determine get no weight: the rival may move along them freely
    inverse = np.linalg.pinv(correlation, rcond=1e-13, hermitian=True)
    where = [list(free).index(names[i]) for i in kept]
    out[np.ix_(where, where)] = inverse * np.outer(weight, weight)
    return out


def check_numbers(
    duration: Any, step: Any, rest_duration: Any, correlation_time: Any, seed: Any
) -> None:
    seconds = "a positive number of seconds"
    for what, value in (("duration", duration), ("step", step)):
        finite(what, value, lambda x: x > 0, seconds)
    if not (
        _number(rest_duration) and rest_duration >= 0 and duration - 2 * rest_duration >= 20 * step
    ):
        raise InputError(
            f"rest: a test of {duration:g} s with a rest of {rest_duration!r} s at either end and "
            f"a step of {step:g} s leaves fewer than 20 samples to move in.",
            "Lengthen the duration, or shorten the rest or the step.",
        )
    if correlation_time is not None:
        mend = "Leave it out where the noise is white."
        finite("correlation_time", correlation_time, lambda x: x > 0, seconds, mend)
    whole_number("seed", seed, 0)


def _number(value: Any) -> bool:
    real = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return real and math.isfinite(value)


def moved_and_held(
    models: Sequence[Model], limits: Any, held: Any, logs: Sequence[Log]
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Limits of moved inputs, and values of held inputs."""
    limits = by_input("limits", limits, models[0], "(low, high)")
    held = by_input("held", held, models[0], "0.0")
    available = _unique(
        name
        for model in models
        for name in [*model.inputs, *model.optional_inputs, *model.states, *_needs(model)]
    )
    for what, named in (("limits", limits), ("held", held)):
        _check_names(what, named, available, "no rival reads this input")
    both = [name for name in limits if name in held]
    if both:
        raise InputError(
            f"The input {listing(both)} has limits and is held.", "Give one or the other."
        )
    named = {**limits, **held}
    needed = _unique(
        name
        for model in models
        for name in [*(() if {*model.states} & {*named} else model.inputs), *_needs(model)]
    )
    moving = {name for model in models for name in model.inputs}
    recorded = {name for log in logs for name in log.inputs}
    for name in [*needed, *(n for n in available if n in recorded and n not in needed)]:
        if name in named or name not in recorded:
            continue
        unit = units_of(models, ())[name]
        series = np.concatenate([lg.values(name, unit) for lg in logs if name in lg.inputs])
        if name in moving and name in needed and not limits:
            limits[name] = (float(series.min()), float(series.max()))
        elif name not in {s for model in models for s in model.states}:
            held[name] = float(np.median(series))
    missing = [name for name in needed if name not in limits and name not in held]
    if missing:
        pairs = ", ".join(f"'{name}': (low, high)" for name in missing)
        raise InputError(
            f"The rivals read the input {listing(missing)}, for which there are neither limits, "
            "nor a constant value, nor logs.",
            f"Give limits={{{pairs}}} to move it, or held={{'{missing[0]}': value}}.",
        )
    limits = {name: checked_limits(name, pair) for name, pair in limits.items()}
    for name, value in held.items():
        finite("held", value, lambda x: True, f"a number for '{name}'", "Give one.")
    if not limits:
        raise InputError(
            "Every input is held: there is nothing to move.",
            f"Give limits for one of {listing(needed)}.",
        )
    return limits, held


def _needs(model: Model) -> list[str]:
    return [name for effect in model.effects for name in effect.needs]


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _check_names(what: str, names: Iterable[str], available: Sequence[str], why: str) -> None:
    for name in names:
        if name not in available:
            near = nearest(name, available)
            raise InputError(
                f"{what}: '{name}': {why}{f'; {near}' if near else ''}.",
                f"Use one of {listing(available)}.",
            )


def checked_limits(name: str, pair: Any) -> tuple[float, float]:
    """Lowest and highest value of an input."""
    with suppress(TypeError, ValueError):
        low, high = pair
        if _number(low) and _number(high) and low < high:
            return float(low), float(high)
    raise InputError(
        f"limits: expected a lower and a higher number for '{name}', found {pair!r}.",
        f"Write limits={{'{name}': (low, high)}}.",
    )


def checked_rates(wanted: Any, moved: Mapping[str, Any]) -> dict[str, float]:
    """Largest changes per second of moved inputs."""
    rates = dict(wanted or {})
    _check_names("rate_limits", rates, list(moved), "this input is not moved")
    mend = "Leave it out where the input may jump."
    for name, rate in rates.items():
        expected = f"a positive change per second for '{name}'"
        rates[name] = finite("rate_limits", rate, lambda x: x > 0, expected, mend)
    return rates


def noise_levels(rivals: Sequence[Any], models: Sequence[Model], wanted: Any) -> dict[str, float]:
    """Noise of the channels: the smallest of the fits, since misfit increases the estimate."""
    shared = [n for n in models[0].outputs if all(n in model.outputs for model in models)]
    if wanted is not None:
        _check_names("noise", wanted, shared, "not an output of every rival")
        noise = dict(wanted)
    else:
        fits = [fit for fit in rivals if isinstance(fit, Fit)]
        levels = {name: [f.noise[name] for f in fits if name in f.noise] for name in shared}
        noise = {name: min(each) for name, each in levels.items() if each}
    if not noise:
        raise InputError(
            f"No noise level is known for any of the channels {listing(shared)}.",
            f"Give noise={{'{shared[0] if shared else 'channel'}': standard deviation}} for each "
            "channel that the test will measure.",
        )
    mend = "Give it in the unit of the model's output."
    for name, sigma in noise.items():
        expected = f"a positive standard deviation for '{name}'"
        noise[name] = finite("noise", sigma, lambda x: x > 0, expected, mend)
    return {name: noise[name] for name in shared if name in noise}


def units_of(models: Sequence[Model], logs: Sequence[Log]) -> dict[str, str]:
    """Units of all inputs and channels; those that only effects need are known from logs."""
    needs = {name: "" for model in models for name in _needs(model)}
    recorded = {name: log.units[name] for log in logs for name in needs if name in log.inputs}
    units = {**needs, **recorded}
    for model in models:
        units |= {**model.states, **model.optional_inputs, **model.inputs, **model.outputs}
    return units


def enough_substeps(
    models: Sequence[Model], space: Space, held: Mapping[str, float], noise: Mapping[str, float]
) -> int:
    """Integrator steps per sample needed by the hardest sequence, full reversals."""
    names = tuple(space.limits)
    hold = max(2, round(space.active / space.step / 40)) * space.step
    probe = sequence(Design("reversals", dict.fromkeys(names, 1), 1.0, hold), space)
    constant = {name: np.full(space.time.size, value) for name, value in held.items()}
    log = Log(
        time=space.time,
        inputs={**probe, **constant},
        measured={name: np.zeros(space.time.size) for name in noise},
        noise=noise,
        name="the test",
    )
    return max(choose_substeps(model, log, tolerance=0.05) for model in models)
