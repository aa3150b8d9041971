"""What the logs want in place of constants that a model holds."""

from __future__ import annotations

import numpy as np

from diffthrust.diagnosis._findings import HeldValue
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.models._base.model import Model


def held_values(model: Model, trial: TrialFit) -> dict[str, HeldValue]:
    """What the logs want in place of the constants that were freed.

    By the innovations form, whose standard errors hold under random forces; whole runs would bend
    a constant to hide what they accumulate.

    Args:
        model: the model as it was given.
        trial: the last trial.
    """
    errors = _standard_errors(trial)
    freed = {n: model.parameters[n] for n in trial.effects if n in model.parameters}
    return {
        name: HeldValue(p.value, trial.values[name], errors[name], p.unit)
        for name, p in freed.items()
    }


def _standard_errors(trial: TrialFit) -> dict[str, float]:
    """Standard errors of the parameters of a trial; infinite where nothing tells of one."""
    q, problem = trial.quadratic, trial.at_values
    length = np.sqrt(np.diagonal(q.information))
    live = length > 0
    scaled = q.information[np.ix_(live, live)] / np.outer(length[live], length[live])
    spread = np.full(length.size, np.inf)
    inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)
    spread[live] = np.sqrt(np.diagonal(inverse)) / length[live]
    spread *= problem.layout.likelihood.law.excess**0.5
    slopes = np.abs(problem.slopes(problem.start()))
    return dict(zip(trial.names, map(float, spread[: len(slopes)] * slopes), strict=True))
