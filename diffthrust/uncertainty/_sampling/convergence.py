"""Convergence diagnostics of a posterior's chains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.uncertainty._prediction.draws import posterior_data

_R_HAT = 1.01
"""Chains with a larger R-hat have not mixed (Vehtari et al. 2021, section 4)."""
_SAMPLES = 400.0
"""Effective samples needed for quantiles and their errors (same source)."""
_DIVERGENCES = 0.001
"""Above this share of divergent draws, NUTS has missed a region of the posterior."""


class Mixing(Enum):
    """What may be claimed of a posterior's draws; ``.value`` is the name used in files."""

    CONVERGED = "converged"
    TOO_SHORT = "too_short"
    NOT_MIXED = "not_mixed"
    DIVERGENT = "divergent"
    IMPROPER = "improper"

    def __str__(self) -> str:
        return self.value

    @property
    def ok(self) -> bool:
        """Whether means, errors and intervals can be used as they are."""
        return self is Mixing.CONVERGED


@dataclass(frozen=True)
class Convergence:
    """How well chains have mixed, by parameter.

    Args:
        status: what may be claimed; ``message`` says why in a sentence.
        message: the sentence, with the mend where one is needed.
        r_hat: rank-normalised split R-hat; 1 where the chains agree.
        ess_bulk: effective samples for means.
        ess_tail: effective samples for the ends of 90 % intervals.
        autocorrelation: integrated autocorrelation time, in draws.
        divergences: draws at which the NUTS trajectory diverged; zero for emcee.
        draws: draws of all chains.

    Example:
        >>> mixing = dft.uncertainty.convergence(post)
        >>> mixing.status.value, sorted(mixing.r_hat)[:3]
        ('converged', ['alpha', 'beta', 'ct'])
    """

    status: Mixing
    message: str
    r_hat: Mapping[str, float]
    ess_bulk: Mapping[str, float]
    ess_tail: Mapping[str, float]
    autocorrelation: Mapping[str, float]
    divergences: int
    draws: int


def convergence(post: Any) -> Convergence:
    """Judge the chains of a posterior.

    Rank-normalised split R-hat and the effective samples of bulk and tails (Vehtari et al. 2021),
    the integrated autocorrelation time (Goodman & Weare 2010, as in emcee), and divergences. Chains
    of an improper posterior may agree like any others: if `sample` found an improper posterior, the
    status is "improper" whatever the chains show.

    Args:
        post: the result of `sample`, or other ArviZ data with a posterior.

    Returns:
        A `Convergence`. Check ``status`` first.

    Raises:
        InputError: there is no posterior.

    Example:
        >>> mixing = dft.uncertainty.convergence(post)
        >>> mixing.draws > 0
        True
    """
    from emcee.autocorr import integrated_time

    from diffthrust.uncertainty._sampling.arviz import arviz

    posterior = posterior_data(post)
    az = arviz()
    if posterior.sizes["draw"] < 4:
        raise InputError(
            f"{posterior.sizes['draw']} draws by chain are too few to judge.", "Draw at least 100."
        )
    r_hat, bulk, tail = (
        {name: float(value) for name, value in _scalars(statistic).items()}
        for statistic in (
            az.rhat(_several(posterior), method="rank"),
            az.ess(posterior, method="bulk"),
            az.ess(posterior, method="tail"),
        )
    )
    with np.errstate(invalid="ignore", divide="ignore"):  # chains that never moved
        memory = {
            name: float(integrated_time(values.T, tol=0, quiet=True, has_walkers=True)[0])
            for name, values in _scalars(posterior).items()
        }
    stats = getattr(post, "sample_stats", None)
    lost = int(stats["diverging"].sum()) if stats is not None and "diverging" in stats else 0
    total = posterior.sizes["chain"] * posterior.sizes["draw"]
    improper = str(posterior.attrs.get("improper", ""))
    judged = Convergence(Mixing.IMPROPER, improper, r_hat, bulk, tail, memory, lost, total)
    if improper:
        return judged
    status, message = _judged(judged, emcee=post.attrs.get("method") == "emcee")
    return replace(judged, status=status, message=message)


def _judged(c: Convergence, emcee: bool) -> tuple[Mixing, str]:
    r_hat, bulk, tail, lost, total = c.r_hat, c.ess_bulk, c.ess_tail, c.divergences, c.draws
    stuck = [name for name, value in r_hat.items() if not math.isfinite(value)]
    if stuck:
        return Mixing.NOT_MIXED, (
            f"The chains of {', '.join(stuck)} never moved: nothing can be said. "
            "Look at the bounds and priors, or try the other method."
        )
    # the R-hat comes before the effective samples: these mean nothing while chains disagree
    least = min(min(bulk.values()), min(tail.values()))
    worst = max(r_hat, key=lambda name: r_hat[name])
    if r_hat[worst] > _R_HAT:
        # chains that have not mixed give no reliable count: between four and ten times as many
        times = min(max(math.ceil(_SAMPLES / least), 4), 10)
        alternative = " or sample with method='nuts'" if emcee else ""
        return Mixing.NOT_MIXED, (
            f"R-hat of {worst} {r_hat[worst]:.3f} (allowed {_R_HAT}): the chains have not found "
            f"the same distribution. Draw {times} times as many with a longer warmup{alternative}."
        )
    if least < _SAMPLES:
        scarce = min(bulk, key=lambda name: min(bulk[name], tail[name]))
        times = math.ceil(1.2 * _SAMPLES / least)
        return Mixing.TOO_SHORT, (
            f"The chains agree, but {total} draws of {scarce} are worth only {least:.0f} "
            f"independent ones (wanted {_SAMPLES:.0f}). Draw {max(times, 2)} times as many."
        )
    if lost > _DIVERGENCES * total:
        return Mixing.DIVERGENT, (
            f"{lost} of {total} draws diverged: a part of the posterior is too sharply bent to be "
            "followed, and may be missing. Give priors, or sample with method='emcee'."
        )
    divergent = f" ({lost} of them diverged)" if lost else ""
    return Mixing.CONVERGED, (
        f"{total} draws{divergent} are worth at least {least:.0f} independent ones of "
        f"every parameter, and the chains agree (R-hat at most {max(r_hat[worst], 1.0):.3f})."
    )


def _several(posterior: Any) -> Any:
    """Split a single chain into halves, which must agree like chains."""
    if posterior.sizes["chain"] > 1:
        return posterior
    import xarray as xr

    half = posterior.sizes["draw"] // 2
    halves = (posterior.isel(draw=slice(i * half, (i + 1) * half)) for i in (0, 1))
    relabelled = [h.assign_coords(chain=[i], draw=range(half)) for i, h in enumerate(halves)]
    return xr.concat(relabelled, dim="chain")


def _scalars(data: Any) -> dict[str, Any]:
    """Each scalar of a data set by name, ``(chains, draws)`` where it has these."""
    out = {}
    for name, variable in data.data_vars.items():
        values = variable.transpose(..., "chain", "draw", missing_dims="ignore").values
        dims = [dim for dim in variable.dims if dim not in ("chain", "draw")]
        for place in np.ndindex(*(variable.sizes[dim] for dim in dims)):
            at = ", ".join(str(variable[d].values[i]) for d, i in zip(dims, place, strict=True))
            out[f"{name}[{at}]" if dims else str(name)] = values[place]
    return out
