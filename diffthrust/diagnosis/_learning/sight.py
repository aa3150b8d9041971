"""What a trial sees of the logs: at each sample, and as the next one comes.

Between samples an input may be held. So what passes a port behind it is then still what it was at
the sample, and does not run straight to what it will be at the next.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._structure import Observed, observed
from diffthrust.effects._grammar import expression_of
from diffthrust.effects._memory import values_along
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.simulation._levels import port_readings


class Added(NamedTuple):
    """What is added at a port log by log, ``(K, T)``: at the samples, and as the next ones come."""

    now: Sequence[np.ndarray]
    end: Sequence[np.ndarray]


class Sight(NamedTuple):
    """What a trial sees at the samples of the training logs, and as the next ones come."""

    now: Observed
    end: Observed


def sight(trials: CandidateFitter, trial: TrialFit) -> Sight:
    """What a trial sees of the training logs."""
    now = observed(trials, trial)
    paths = [
        {
            name: series if log.hold.get(name) == "zero" else np.append(series[1:], series[-1:])
            for name, series in path.items()
        }
        for log, path in zip(trials.logs, now.paths, strict=True)
    ]
    return Sight(now, Observed(paths, [port_readings(trials.model, path) for path in paths]))


def along(
    expression: str, parameters: Mapping[str, Mapping[str, Any]], regressors: Sight, port: str
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """An expression of signals as an effect at a port reads it, log by log; ``(T,)`` each.

    At the samples, and as the next ones come.
    """
    law = expression_of(expression)
    values = {name: fields["value"] for name, fields in parameters.items()}

    def named(when: Observed, log: int) -> Callable[[str], Any]:
        return {**when.paths[log], ARRIVING: when.ports[log][port], **values}.__getitem__

    now, end = [], []
    for log, path in enumerate(regressors.now.paths):
        current, later = values_along(
            law, named(regressors.now, log), named(regressors.end, log), path["time"]
        )
        now.append(current)
        end.append(later)
    return now, end
