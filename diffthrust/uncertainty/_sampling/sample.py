"""Sampling the posterior of a fit."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from diffthrust._support.errors import InputError
from diffthrust._support.lossless import encoded
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.validation import whole_number
from diffthrust.estimation._arguments import listed
from diffthrust.estimation._origin import origin_of
from diffthrust.estimation._rebuild import mark_of
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.uncertainty._sampling.convergence import convergence
from diffthrust.uncertainty._sampling.posterior import posterior_of
from diffthrust.uncertainty._sampling.propriety import improper_message

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
        "improper": improper_message(posterior, drawn.points),
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
    whole_number("draws", draws, 10, _MOST_DRAWS)
    whole_number("warmup", warmup, 20 if method == "nuts" else 0, _MOST_DRAWS)
    whole_number("chains", chains, 1, _MOST_CHAINS)
    whole_number("seed", seed, 0, 2**32 - 1)  # of numpy's RandomState, which emcee draws from
    if walkers is not None:
        whole_number("walkers", walkers, 4, _MOST_CHAINS)
