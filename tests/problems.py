"""What a fit solves, without the fit: logs arranged for a model, costs, searches, checks.

They are held against closed forms, finite differences and SciPy at points that no fit returns.
"""

from diffthrust.estimation._ar1 import linked  # private: which samples a noise links
from diffthrust.estimation._arrange import build, restarts  # private: logs as a search has them
from diffthrust.estimation._held_out import parts_of, without  # private: what a choice hides
from diffthrust.estimation._likelihood import (  # private: costs and slopes beside the optimum
    Quadratic,
    errors_at,
    evaluate,
    jacobians,
)
from diffthrust.estimation._rebuild import problem_of  # private: what a stored fit has solved
from diffthrust.estimation._registry import (  # private: words become objects
    LOSSES,
    NOISE_MODELS,
    likelihood_of,
)
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

__all__ = [
    "GRADIENT_LIMIT",
    "LOSSES",
    "NOISE_MODELS",
    "RANK_LIMIT",
    "Local",
    "Quadratic",
    "SimulationError",
    "build",
    "errors_at",
    "evaluate",
    "examine",
    "failed_over",
    "jacobians",
    "judge",
    "likelihood_of",
    "linked",
    "marginal_spread",
    "parts_of",
    "problem_of",
    "restarts",
    "solve",
    "without",
]
