"""What a fit solves, without the fit: logs arranged for a model, costs, searches, checks.

They are held against closed forms, finite differences and SciPy at points that no fit returns.
"""

from diffthrust._support.box import (  # private: the solver alone
    least_in_box,
)
from diffthrust.estimation import (  # private: logs as a search has them
    _arguments,
    _arrange,
)
from diffthrust.estimation import _horizons as horizons_module  # private: two valleys
from diffthrust.estimation import _insensitive as insensitive_module
from diffthrust.estimation import _likelihood as likelihood_module
from diffthrust.estimation import _multistart as multistart_module
from diffthrust.estimation import _optimum as optimum_module  # private: how often it searches
from diffthrust.estimation import _refine as refine_module
from diffthrust.estimation import _solver as solver_module  # private: its budgets
from diffthrust.estimation import _status as status_module
from diffthrust.estimation import _unexplained as unexplained_module
from diffthrust.estimation._arguments import LOSSES, NOISE_MODELS  # private: words become objects
from diffthrust.estimation._arrange import restarts  # private: segments of another length
from diffthrust.estimation._horizons import (  # private: what a choice hides
    folds,
    without,
)
from diffthrust.estimation._insensitive import (  # private: each alone
    alive,
    vanished,
    vanished_notes,
)
from diffthrust.estimation._likelihood import (  # private: costs and slopes beside the optimum
    Quadratic,
    errors_at,
    evaluate,
    gram,
    jacobians,
    noise_levels,
)
from diffthrust.estimation._multistart import (  # private: a search that stopped early
    Search,
    all_carried_on,
    carried_on,
    distinct,
)
from diffthrust.estimation._noise import (  # private: which samples a noise links
    AR1,
    RANGE,
    Gaps,
    White,
    linked,
)
from diffthrust.estimation._one_step import (  # private: as a diagnosis calls it
    nrmse,
)
from diffthrust.estimation._origin import (  # private: the lines alone
    Origin,
    origin_of,
)
from diffthrust.estimation._rebuild import problem_of  # private: what a stored fit has solved
from diffthrust.estimation._refine import (  # private: the end alone
    polished,
    rounding_of,
)
from diffthrust.estimation._residuals import (  # private: with any law and noise
    Innovations,
    SimulationError,
)
from diffthrust.estimation._runaway import farthest_runaway  # private: of a fit
from diffthrust.estimation._solver import (  # private: from any point, for any budget
    BoundedLevenbergMarquardt,
    Solved,
    solve,
)
from diffthrust.estimation._status import (  # private: the checks of any point
    GRADIENT_LIMIT,
    RANK_LIMIT,
    Local,
    examine,
    failed_over,
    judge,
    marginal_spread,
    unstable_advice,
)
from diffthrust.simulation._record import bind  # private: logs as a model reads them

__all__ = [
    "AR1",
    "GRADIENT_LIMIT",
    "LOSSES",
    "NOISE_MODELS",
    "RANGE",
    "RANK_LIMIT",
    "BoundedLevenbergMarquardt",
    "Gaps",
    "Innovations",
    "Local",
    "Origin",
    "Quadratic",
    "Search",
    "SimulationError",
    "Solved",
    "White",
    "alive",
    "all_carried_on",
    "bind",
    "build",
    "carried_on",
    "distinct",
    "errors_at",
    "evaluate",
    "examine",
    "failed_over",
    "farthest_runaway",
    "folds",
    "gram",
    "horizons_module",
    "insensitive_module",
    "jacobians",
    "judge",
    "least_in_box",
    "likelihood_module",
    "likelihood_of",
    "linked",
    "marginal_spread",
    "multistart_module",
    "noise_levels",
    "nrmse",
    "optimum_module",
    "origin_of",
    "polished",
    "problem_of",
    "refine_module",
    "restarts",
    "rounding_of",
    "solve",
    "solver_module",
    "status_module",
    "unexplained_module",
    "unstable_advice",
    "vanished",
    "vanished_notes",
    "without",
]


def build(model, logs, **options):
    """The problem of fitting a model to logs."""
    return _arrange.build(model, bind(model, logs), **options)


def likelihood_of(model, logs, **words):
    """The likelihood that the words of a fit mean for a model and its logs."""
    return _arguments.likelihood_of(model, bind(model, logs), **words)
