"""What a fit solves, without the fit: logs arranged for a model, costs, searches, checks.

They are held against closed forms, finite differences and SciPy at points that no fit returns.
"""

from diffthrust.estimation import _arguments, _arrange  # private: logs as a search has them
from diffthrust.estimation._arguments import LOSSES, NOISE_MODELS  # private: words become objects
from diffthrust.estimation._arrange import restarts  # private: segments of another length
from diffthrust.estimation._horizons import folds, without  # private: what a choice hides
from diffthrust.estimation._likelihood import (  # private: costs and slopes beside the optimum
    Quadratic,
    errors_at,
    evaluate,
    jacobians,
)
from diffthrust.estimation._noise import linked  # private: which samples a noise links
from diffthrust.estimation._rebuild import problem_of  # private: what a stored fit has solved
from diffthrust.estimation._residuals import SimulationError  # private: with any law and noise
from diffthrust.estimation._solver import solve  # private: from any point, for any budget
from diffthrust.estimation._status import (  # private: the checks of any point
    GRADIENT_LIMIT,
    RANK_LIMIT,
    Local,
    examine,
    failed_over,
    judge,
    marginal_spread,
)
from diffthrust.simulation._record import bind  # private: logs as a model reads them

__all__ = [
    "GRADIENT_LIMIT",
    "LOSSES",
    "NOISE_MODELS",
    "RANK_LIMIT",
    "Local",
    "Quadratic",
    "SimulationError",
    "bind",
    "build",
    "errors_at",
    "evaluate",
    "examine",
    "failed_over",
    "folds",
    "jacobians",
    "judge",
    "likelihood_of",
    "linked",
    "marginal_spread",
    "problem_of",
    "restarts",
    "solve",
    "without",
]


def build(model, logs, **options):
    """The problem of fitting a model to logs."""
    return _arrange.build(model, bind(model, logs), **options)


def likelihood_of(model, logs, **words):
    """The likelihood that the words of a fit mean for a model and its logs."""
    return _arguments.likelihood_of(model, bind(model, logs), **words)
