"""Profile likelihood: intervals of parameters and derived quantities without a quadratic."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.names import listing, nearest
from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter
from diffthrust._support.report import Report, Section
from diffthrust._support.results import Result
from diffthrust._support.words import number
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.logs._log import Log
from diffthrust.uncertainty._prediction.draws import check_level
from diffthrust.uncertainty._prediction.physical import Quantity, derived
from diffthrust.uncertainty._profile_walk import (
    DeeperError,
    Function,
    Line,
    ParameterLine,
    ProfilePoint,
    QuantityLine,
    Side,
    walk,
)
from diffthrust.uncertainty._sandwich import converged, quantile
from diffthrust.uncertainty._tables import profile_rows
from diffthrust.uncertainty._values import Profile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROUNDS = 3
"""Most restarts of all profiles from a lower cost found by a walk."""


class Better(NamedTuple):
    """A better optimum found by a walk: all parameters, and the gain in log-likelihood."""

    values: Mapping[str, float]
    gain: float


@dataclass(frozen=True, eq=False, repr=False)
class Profiles(Result):
    """Profiles by the name of the parameter or quantity: ``profiles["alpha"].low``.

    Args:
        profiles: by name.
        level: of their intervals.
        better: a better optimum found on the way, which the profiles then belong to, or ``None``.

    Example:
        >>> result = dft.uncertainty.profile(fit, log, "alpha")
        >>> result["alpha"].level, len(result.sentences), list(result.to_json())
        (0.95, 1, ['schema', 'level', 'profiles', 'better'])
        >>> figure = result.plot()
    """

    profiles: Mapping[str, Profile]
    level: float
    better: Better | None = None

    def __getitem__(self, name: str) -> Profile:
        return self.profiles[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.profiles)

    def __len__(self) -> int:
        return len(self.profiles)

    @property
    def sentences(self) -> list[str]:
        """One for each profile, and one on a better optimum."""
        sentences = [p.sentence for p in self.profiles.values()]
        if self.better is not None:
            values = ", ".join(f"{n} = {number(v)}" for n, v in self.better.values.items())
            sentences.append(
                f"A better optimum than the fit's was found on the way, by {self.better.gain:.3g} "
                f"in log-likelihood, and the profiles belong to it: {values}. Fit again from there."
            )
        return sentences

    def _report(self) -> Report:
        rows = profile_rows(self.profiles.values(), self.level)
        return Report(Section("", rows), Section("", *self.sentences))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "schema": 1,
            "level": self.level,
            "profiles": {name: p.to_json() for name, p in self.profiles.items()},
            "better": self.better and self.better._asdict(),
        }

    @showing
    def plot(self) -> Figure:
        """Plot each profile with the quadratic of the covariance, the threshold and the ends."""
        from diffthrust.uncertainty._figures import profile_figure

        return profile_figure(list(self.profiles.values()))

    def _line(self) -> str:
        return f"{100 * self.level:g} %: {', '.join(self.profiles)}"


@progressing
def profile(
    fit: Fit,
    logs: Log | Sequence[Log],
    names: str | Sequence[str] | None = None,
    *,
    quantities: Function | None = None,
    units: Mapping[str, str] | None = None,
    level: float = 0.95,
    progress: ProgressOption = None,
) -> Profiles:
    """Intervals from the profile likelihood: fix one parameter and fit all others.

    The interval of a parameter contains every value at which the best fit of all others is not
    significantly worse: twice the drop of the log-likelihood stays below the quantile of the
    chi-square distribution with one degree of freedom (Venzon & Moolgavkar 1988). It is invariant
    to transforms of the parameter, may be asymmetric, and is open if the data set no limit. With
    estimated noise levels the F distribution is used, exact for one channel and a linear model;
    under autocorrelated noise it counts independent samples. On long logs all of them agree.

    The likelihood is that of the fit: if residuals are correlated but the fit assumed white noise,
    the interval is too short. `intervals` recommends which to use.

    Args:
        fit: a converged fit with any likelihood, loss and noise model.
        logs: its training logs, in order.
        names: free parameters, by full name; ``None`` for all.
        quantities: function from parameter values by full name to quantities by name, written in
            `jax.numpy`, as for `derived`. It is compiled once; profiles of parameters need no
            compilation beyond the fit.
        units: the unit of each quantity.
        level: of the intervals.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        `Profiles`, by name, the parameters first.

    Raises:
        InputError: the fit failed or did not converge, the logs are not its own, a name is not a
            free parameter, or the level is outside (0, 1).

    Source: Venzon & Moolgavkar 1988, Applied Statistics 37, 87; Raue et al. 2009, Bioinformatics
    25, 1923.

    Example:
        >>> result = dft.uncertainty.profile(fit, log, "alpha")
        >>> result["alpha"].low < fit.parameters["alpha"].value
        True
    """
    converged(fit, "profile")
    check_level(level, "profile, level")
    wanted = _wanted(fit, names)
    if quantities is not None and not callable(quantities):
        raise InputError(
            f"profile, quantities: expected a function, found {type(quantities).__name__}.",
            "Write quantities=lambda p: {'gain': p['beta'] / p['alpha']}.",
        )
    problem, z = problem_of(fit, logs)
    report = reporter(progress)
    return profiles_of(fit, problem, z, wanted, quantities, units or {}, level, report)


def profiles_of(
    fit: Fit,
    problem: Problem,
    z: np.ndarray,
    names: Sequence[str],
    quantities: Function | None,
    units: Mapping[str, str],
    level: float,
    report: Progress,
) -> Profiles:
    """Profiles of a problem whose optimum is known."""
    threshold = threshold_of(problem, z, level)
    first = best = optimum_at(problem, z)
    for _ in range(_ROUNDS):
        try:
            profiles = []
            # what is profiled, with what the fit's covariance says of it
            lines: list[tuple[Line, Estimate | Quantity]] = [
                (ParameterLine(problem, name, best), fit.parameters[name]) for name in names
            ]
            if quantities is not None:
                for index, (name, quantity) in enumerate(derived(fit, quantities, units).items()):
                    lines.append((QuantityLine(problem, name, quantities, index, best), quantity))
            for index, (line, estimate) in enumerate(lines):
                report(f"profile of {line.name}", index / len(lines))
                profiles.append(_profile(line, estimate, threshold, level))
            break
        # all profiles belong to one optimum: they start again from the deeper one
        except DeeperError as deeper:
            best = optimum_at(problem, deeper.point.z)
    else:
        raise InputError(
            f"profile: {_ROUNDS} times a lower cost than the best so far was found: the fit is not "
            "at a deep optimum.",
            "Fit again with more starts.",
        )
    deeper = best is not first
    better = Better(problem.values(best.z), first.cost - best.cost) if deeper else None
    return Profiles({p.name: p for p in profiles}, level, better)


def optimum_at(problem: Problem, z: np.ndarray) -> ProfilePoint:
    """The optimum next to given coordinates, where profiles start."""
    solved = solve(problem, z)
    cost = float(solved.quadratic.cost)
    return ProfilePoint(math.nan, cost, solved.z, solved.quadratic, math.nan)


def _wanted(fit: Fit, names: str | Sequence[str] | None) -> tuple[str, ...]:
    if names is None:
        return fit.free
    wanted = (names,) if isinstance(names, str) else tuple(names)
    for name in wanted:
        if name not in fit.free:
            held = name in fit.parameters
            near = None if held else nearest(name, fit.free)
            raise InputError(
                f"profile: '{name}' is {'held' if held else 'no parameter'} in this fit; its free "
                f"parameters are {listing(fit.free)}.",
                "Free it and fit again." if held else f"Did you mean {near}?" if near else "",
            )
    return wanted


def threshold_of(problem: Problem, z: np.ndarray, confidence: float) -> float:
    """Threshold of twice the drop of the log-likelihood.

    Under autocorrelated noise, n independent samples give a noise level with n / 2 degrees of
    freedom, because the correlation is estimated as well: the long-run variance has the relative
    variance 4 / n (see the sandwich).
    """
    noise = problem.layout.likelihood.noise
    if noise.lasts:
        channels = problem.layout.channels
        samples = noise.independent(channels, problem.numbers, problem.values(z))
        degrees = max(samples - len(problem.own) - problem.local, 1.0)
        return quantile(confidence, 0.5 * samples) ** 2 * samples / degrees
    degrees = degrees_of(problem, z)
    square = quantile(confidence, degrees) ** 2
    if math.isinf(degrees):
        return square
    # with the level profiled out, twice the drop is n log(1 + t^2 / degrees), exactly so for a
    # linear model (Bates & Watts 1988, section 6.1)
    return (degrees + z.size) * math.log1p(square / degrees)


def degrees_of(problem: Problem, z: np.ndarray) -> float:
    """Degrees of freedom of white noise levels; infinite where they are not estimated."""
    degrees = float(np.sum(problem.numbers.counts)) - z.size
    estimated = problem.layout.likelihood.law.closed and not any(problem.layout.known_noise)
    return degrees if estimated and degrees >= 1 else math.inf


def _profile(line: Line, estimate: Estimate | Quantity, threshold: float, level: float) -> Profile:
    start = line.start()
    down, up = (walk(line, sign, math.sqrt(threshold)) for sign in (-1.0, 1.0))
    points = [*reversed(down.points), *up.points[1:]]
    limits: tuple[float, float] = (-math.inf, math.inf)
    more: dict[str, Any] = {"quantity": True}
    if isinstance(estimate, Estimate):
        limits = line.problem.named[line.name].limits
        more = {"per": estimate.per, "shown_unit": estimate.shown_unit}
    low, high = (None if side.end is None else line.value(side.end) for side in (down, up))
    open_low, bottom = _open_end(line, down, limits[0], "less")
    open_high, top = _open_end(line, up, limits[1], "more")
    return Profile(
        name=line.name,
        unit=estimate.unit,
        value=line.value(start.x),
        low=low,
        high=high,
        open_low=open_low,
        open_high=open_high,
        level=level,
        threshold=threshold,
        grid=np.array([line.value(p.x) for p in points]),
        drop=np.array([p.cost - start.cost for p in points]),
        std_error=estimate.std_error,
        bounds=(bottom, top),
        **more,
    )


def _open_end(line: Line, side: Side, limit: float, more: str) -> tuple[str | None, float | None]:
    """Why a side is open, in words, and the bound of the parameter that it reaches."""
    last = line.value(side.points[-1].x)
    if side.why == "bound" and math.isfinite(limit):
        return f"reaches the bound {limit:g}", last
    words = {
        None: None,
        "stuck": f"the bounds of the parameters allow no {more}: {last:.4g}",
        "fails": f"beyond {last:.4g} the simulation fails",
    }
    return words.get(side.why, "the likelihood never falls far enough"), None
