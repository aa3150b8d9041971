"""A posterior made from the covariance of a fit, in the form that `sample` gives."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import xarray as xr

import diffthrust as dft


def made_posterior(
    fit: dft.estimation.Fit, chains: int = 4, draws: int = 500, seed: int = 0, **attrs: Any
) -> Any:
    """Independent draws of the Gaussian of a fit, and of its noise level."""
    rng = np.random.default_rng(seed)
    best = [fit.parameters[n].value for n in fit.free]
    drawn = rng.multivariate_normal(best, fit.covariance, (chains, draws))
    variables = {
        n: (("chain", "draw"), drawn[..., i], {"unit": fit.parameters[n].unit})
        for i, n in enumerate(fit.free)
    }
    level = np.array(list(fit.noise.values()))
    sigma = level * (1 + 0.01 * rng.standard_normal((chains, draws, level.size)))
    data = xr.Dataset(
        {**variables, "sigma": (("chain", "draw", "channel"), sigma)},
        coords={"chain": np.arange(chains), "draw": np.arange(draws), "channel": list(fit.noise)},
        attrs=attrs,
    )
    return SimpleNamespace(posterior=data, attrs={})
