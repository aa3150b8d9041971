"""How much of an error recurs where logs repeat their inputs: physics does, a disturbance does not.

Of two runs with the same inputs the errors of a model have a part in common, which the inputs make,
and a part of their own. The share of the common part is the correlation within pairs (Fisher 1925,
Statistical Methods for Research Workers, section 38), with an interval as that of any share of the
squared error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run

_FEWEST = 100
"""Numerics: samples in common from which two runs are compared; fewer give no mean square."""


def recurring_shares(model: Model, runs: Sequence[Run]) -> dict[str, Worth]:
    """The share of each channel's squared error that recurs, from all runs that repeat others.

    Args:
        model: whose inputs are compared.
        runs: over whole logs, by one fit.

    Returns:
        By channel; empty where no two logs have the same inputs.
    """
    repeats = [(a, b, n) for a, b in combinations(runs, 2) if (n := _common(model, a, b))]
    channels = dict.fromkeys(name for a, _, _ in repeats for name in a.channels)
    shares = {}
    for name in channels:
        pairs = [
            {name: pair}
            for a, b, n in repeats
            if name in a.channels and name in b.channels
            for pair in _halved(a, b, name, n)
        ]
        if pairs:
            shares[name] = explained_share(pairs)
    return shares


def _common(model: Model, first: Run, second: Run) -> int:
    """The number of samples over which two runs have the same inputs; 0 if they have not."""
    size = min(first.time.size, second.time.size)
    steps = [np.median(np.diff(run.time)) for run in (first, second)]
    if size < _FEWEST or not np.isclose(*steps, rtol=1e-2):
        return 0
    for name in model.inputs:
        a, b = (run.signals[name][:size] for run in (first, second))
        if not np.std(a - b) <= SETTINGS.verdict.repeated_input * np.std(a):
            return 0
    return size


def _halved(first: Run, second: Run, name: str, size: int) -> Iterator[BeforeAfter]:
    """The errors of two runs, and half their difference's square: what does not recur."""
    errors = [run.channels[name].residual[:size] for run in (first, second)]
    both = np.isfinite(errors[0]) & np.isfinite(errors[1])
    if np.count_nonzero(both) < _FEWEST:
        return
    measured = np.where(both, first.channels[name].measured[:size], np.nan)
    mean = np.sqrt(0.5 * (errors[0] ** 2 + errors[1] ** 2))
    yield BeforeAfter(measured, mean, (errors[0] - errors[1]) / np.sqrt(2.0))
