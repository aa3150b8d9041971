"""Sampling the posterior of a fit."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.saved_file import encoded
from diffthrust._support.validation import whole_number
from diffthrust._support.words import number, percent
from diffthrust.estimation._arguments import listed
from diffthrust.estimation._origin import origin_of
from diffthrust.estimation._rebuild import mark_of
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.models._base.parameter import Parameter
from diffthrust.uncertainty._profile import optimum_at
from diffthrust.uncertainty._profile_walk import DeeperError, ParameterLine, walk
from diffthrust.uncertainty._sampling.convergence import convergence
from diffthrust.uncertainty._sampling.posterior import Posterior, posterior_of

_MOST_DRAWS = 1_000_000
_MOST_CHAINS = 10_000
"""Also of walkers."""


@progressing
def sample(
    fit: Fit,
    logs: Log | Sequence[Log],
    *,
    method: Literal["emcee", "nuts"] = "emcee",
    draws: int = 2000,
    warmup: int = 1000,
    walkers: int | None = None,
    chains: int = 4,
    seed: int = 0,
    file: str | os.PathLike[str] | None = None,
    progress: ProgressOption = None,
) -> Any:
    """Draw from the posterior of a fit.

    The likelihood is that of the fit, with the same noise law, segments, and treatment of initial
    states. A `Normal` prior is a density in the parameter's value; without one the prior is flat
    between the bounds, in the value or, for a "log" parameter, in its logarithm. An unknown noise
    level has the prior 1 / level. Parameters that differ by log are drawn with their means, about
    which they have the width of the fit.

    Args:
        fit: a fit whose status is ok.
        logs: its training logs, in their order.
        method: "emcee", an ensemble of walkers that start and move by the fit's covariance; or
            "nuts", which follows the gradient (BlackJAX; ``pip install 'diffthrust[nuts]'``), for
            ten parameters and more.
        draws: draws per walker or chain after the warmup. Walkers are thinned if successive steps
            are strongly correlated (``attrs["thin"]``).
        warmup: warmup steps, which are not returned.
        walkers: number of walkers, even; by default 32 or twice the coordinates.
        chains: number of NUTS chains.
        seed: equal seeds give equal draws.
        file: an HDF5 file that "emcee" saves every few seconds, readable by
            `emcee.backends.HDFBackend`; its coordinates are logarithms of "log" parameters, and
            others over their scale. A killed run resumes from the last save and gives exactly the
            same file; with more ``draws`` a finished run is continued.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        `arviz.InferenceData` with the groups ``posterior`` (variables by full parameter name,
        dimensions ``chain`` and ``draw``, ``attrs["unit"]`` each), ``sample_stats`` and
        ``observed_data``. ``attrs["status"]`` and ``attrs["message"]`` say whether the chains
        converged; see `convergence`. "improper" means that no posterior exists: a parameter has a
        flat prior without a bound, and the logs exclude no value however large (or small); the
        message has the line that adds a prior.

    Raises:
        InputError: the fit did not converge, the logs are not its own, a prior excludes the fit,
            the likelihood is not finite there, the file belongs to another problem or cannot be
            written, or an argument is out of range.

    Example:
        >>> short = dft.sample(fit, log, draws=400, warmup=200)
        >>> dict(short.posterior.sizes)["draw"] > 0, "alpha" in short.posterior
        (True, True)
    """
    # slow to import, as ArviZ is
    from diffthrust.uncertainty._sampling import ensemble, nuts
    from diffthrust.uncertainty._sampling.arviz import inference_data

    check_sampling(method, draws, warmup, chains, seed, walkers, file)
    if not isinstance(fit, Fit):
        raise InputError(
            f"Expected a fit, found {type(fit).__name__}.", "Give what dft.fit returns."
        )
    if method == "nuts":
        nuts.available()
    report = reporter(progress)
    logs = listed(logs)
    posterior = posterior_of(fit, logs)
    sizes: Any = {"draws": draws, "warmup": warmup, "seed": seed}
    if method == "nuts":
        drawn = nuts.run_nuts(posterior, report, chains=chains, **sizes)
    else:
        count = ensemble.walkers_for(posterior, walkers)
        path = Path(file) if file is not None else None
        drawn = ensemble.run_ensemble(posterior, report, path, walkers=count, **sizes)
    attrs = {
        "method": method,
        "seed": seed,
        "warmup": warmup,
        "model": fit.model.name,
        "effects": ", ".join(effect.name for effect in fit.model.effects),
        "likelihood": fit.likelihood,
        "loss": fit.loss,
        "fit": mark_of(fit),
        "origin": json.dumps(encoded(origin_of(logs, spec=fit.origin and fit.origin.spec), {})),
        "doubts": "\n".join(fit.correlation),
        "improper": _improper_message(posterior, drawn.points),
        **drawn.attrs,
    }
    post = inference_data(posterior, drawn, attrs)
    judged = convergence(post)
    for group in (post, post.posterior):
        group.attrs.update({"status": judged.status.value, "message": judged.message})
    report("done", 1.0)
    return post


def check_sampling(
    method: str, draws: Any, warmup: Any, chains: Any, seed: Any, walkers: Any, file: Any
) -> None:
    """Raise `InputError` for an invalid argument."""
    if method not in ("emcee", "nuts"):
        raise InputError(
            f"method: expected one of emcee, nuts, found {method!r}.", "Correct the method."
        )
    if method == "nuts" and file is not None:
        raise InputError(
            "file: NUTS keeps no file, its runs cannot be resumed.",
            "Leave the file out, or sample with method='emcee'.",
        )
    if file is not None and not isinstance(file, str | os.PathLike):
        raise InputError(f"file: expected the name of a file, found {file!r}.", "Correct it.")
    if method == "nuts" and walkers is not None:
        raise InputError("walkers: only emcee has walkers.", "Give chains instead.")
    numbers: list[tuple[str, Any, int, int]] = [
        ("draws", draws, 10, _MOST_DRAWS),
        ("warmup", warmup, 20 if method == "nuts" else 0, _MOST_DRAWS),
        ("chains", chains, 1, _MOST_CHAINS),
        # the limit of numpy's RandomState, which emcee draws from
        ("seed", seed, 0, 2**32 - 1),
    ]
    if walkers is not None:
        numbers.append(("walkers", walkers, 4, _MOST_CHAINS))
    for what, value, least, most in numbers:
        whole_number(what, value, least, most, f"Correct {what}.")


_REACH = math.sqrt(2.0 * 20.0)
"""A profile that falls by 20 in log-likelihood has ended: e^-20 over the 35 e-foldings of a
logarithm is 1e-4 of a peak as narrow as a thousandth."""
_SHARE = 1e-4
"""A side is open if this share of the density lies in the outer half of its range."""


class OpenEnd(NamedTuple):
    """One side of a parameter on which its posterior is not integrable."""

    name: str
    upper: bool
    fall: float
    """Of the log-likelihood from its maximum to the far end."""
    far: float
    """The value halfway (in the coordinate) to the numerical end."""
    drawn: float
    """Share of the draws beyond that."""

    def __str__(self) -> str:
        side = "above" if self.upper else "below"
        drawn = f" {percent(self.drawn)} of the draws lie beyond." if self.drawn else ""
        return (
            f"'{self.name}' has a flat prior without a bound {side}, and its log-likelihood falls "
            f"by {self.fall:.2g} on that side, then no more: {number(self.far)} is as good a value "
            f"as one beyond it.{drawn}"
        )


def open_ends(posterior: Posterior, points: np.ndarray) -> tuple[OpenEnd, ...]:
    """Sides on which a flat prior is unbounded and the likelihood does not fall off.

    The density is integrated along the profile of the parameter up to the numerical end of the
    coordinate. If the likelihood levels off at a finite value, this integral grows without limit:
    the posterior is improper, however well the chains agree. For example, chains agreed on a mean
    mass of 1e14 kg. If it levels off so low that no draw would ever notice, that does not matter;
    the limit is 1 in 10 000 in the outer half of the range. ``points`` are draws, ``(..., d)``.

    Source: Gelman et al. 2013, Bayesian Data Analysis, section 2.8 (improper priors); Raue et al.
    2009, Bioinformatics 25, 1923 (profiles that flatten out).
    """
    problem = posterior.problem
    best = optimum_at(problem, posterior.base)
    ends = []
    for column, place in enumerate(posterior.moved):
        if place >= len(problem.own):
            break
        name = problem.free[place]
        drawn = points[..., column].ravel()
        for upper in _endless(problem.named[name]):
            limit = float((posterior.high if upper else posterior.low)[column])
            end = _far_out(ParameterLine(problem, name, best), upper, limit, drawn)
            if end is not None:
                ends.append(end)
    return tuple(ends)


def _endless(p: Parameter) -> Iterator[bool]:
    """The sides without bound or prior: lower (False) and upper (True)."""
    if p.prior is None:
        low, high = p.limits
        if low == -math.inf or (p.transform == "log" and low <= 0.0):
            yield False
        if high == math.inf:
            yield True


def _far_out(line: ParameterLine, upper: bool, limit: float, drawn: np.ndarray) -> OpenEnd | None:
    """The open end on one side, if it is open."""
    sign = 1.0 if upper else -1.0
    try:
        side = walk(line, sign, _REACH)
    except DeeperError:  # a better optimum, which the fit missed: not a matter of propriety
        return None
    # only a walk that ends without a fall of 20 leaves the side open
    if side.why not in ("bound", "flat"):
        return None
    x = np.array([point.x for point in side.points])
    fall = np.array([point.cost for point in side.points]) - side.points[0].cost
    span = sign * ((limit if math.isfinite(limit) else x[-1]) - x[0])
    grid = np.linspace(0.0, span, 20_001)
    # the root of the fall is interpolated, since it is nearly linear between points
    density = np.exp(-(np.interp(grid, sign * (x - x[0]), np.sqrt(np.maximum(fall, 0.0))) ** 2))
    share = float(np.sum(density[grid > 0.5 * span]) / np.sum(density))
    beyond = float(np.mean(sign * (drawn - x[0]) > 0.5 * span))
    if max(share, beyond) < _SHARE:
        return None
    far = line.value(x[0] + sign * 0.5 * span)
    return OpenEnd(line.name, upper, float(fall[-1]), far, beyond)


def _improper_message(posterior: Posterior, points: np.ndarray) -> str:
    """The result of `open_ends` in words, with lines that add priors; empty if proper."""
    ends = open_ends(posterior, points)
    if not ends:
        return ""
    names = list(dict.fromkeys(end.name for end in ends))
    return "\n".join(["There is no posterior.", *map(str, ends), _mend(posterior, names)])


def _mend(posterior: Posterior, names: list[str]) -> str:
    """Lines that add weakly informative priors: the first guess with its magnitude as deviation."""
    problem, priors, lines = posterior.problem, [], []
    for name in names:
        value = problem.values(posterior.base)[name]
        mean = posterior.fit.guess.get(name, value)
        std = max(abs(mean), abs(value - mean)) or problem.named[name].scale
        numbers = f"mean={mean:.3g}, std={std:.3g}"
        priors.append(f'"{name}": {{"prior": dft.models.Normal({numbers})}}')
        key = f'"{name}"' if "." in name else name
        lines.append(f"{key} = {{ prior = {{ {numbers.replace('=', ' = ')} }} }}")
    return (
        "Give a prior of what you know. A weak one is the first guess, as uncertain as itself:\n"
        f"fit = dft.fit(fit.model.replace({{{', '.join(priors)}}}), logs)\n"
        "or, below [parameters] of the spec:\n" + "\n".join(lines)
    )
