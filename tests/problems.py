"""What a fit solves, without the fit: logs arranged for a model, costs, searches, checks.

They are held against closed forms, finite differences and SciPy at points that no fit returns. All
imports are of private names: logs as a search has them, words that become objects, costs and slopes
beside the optimum, searches that stopped early, checks of any point.
"""

# ruff: noqa: F401 (tests take these names from here)

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.box import least_in_box
from diffthrust.estimation import _arguments, _arrange
from diffthrust.estimation import _horizons as horizons_module
from diffthrust.estimation import _insensitive as insensitive_module
from diffthrust.estimation import _likelihood as likelihood_module
from diffthrust.estimation import _multistart as multistart_module
from diffthrust.estimation import _optimum as optimum_module
from diffthrust.estimation import _refine as refine_module
from diffthrust.estimation import _solver as solver_module
from diffthrust.estimation import _status as status_module
from diffthrust.estimation import _unexplained as unexplained_module
from diffthrust.estimation._arguments import LOSSES, NOISE_MODELS
from diffthrust.estimation._arrange import restarts
from diffthrust.estimation._horizons import folds, without
from diffthrust.estimation._insensitive import alive, vanished, vanished_notes
from diffthrust.estimation._likelihood import (
    Quadratic,
    errors_at,
    evaluate,
    gram,
    jacobians,
    noise_levels,
)
from diffthrust.estimation._multistart import Search, all_carried_on, carried_on, distinct
from diffthrust.estimation._noise import AR1, RANGE, Gaps, White, linked
from diffthrust.estimation._one_step import nrmse
from diffthrust.estimation._origin import Origin, origin_of
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._refine import polished, rounding_of
from diffthrust.estimation._residuals import Innovations, SimulationError
from diffthrust.estimation._solver import BoundedLevenbergMarquardt, Solved, solve
from diffthrust.estimation._status import (
    GRADIENT_LIMIT,
    RANK_LIMIT,
    Local,
    examine,
    failed_over,
    judge,
    marginal_spread,
    unstable_advice,
)
from diffthrust.estimation._unexplained import farthest_runaway
from diffthrust.simulation._record import bind


def build(model, logs, **options):
    """The problem of fitting a model to logs."""
    return _arrange.build(model, bind(model, logs), **options)


def likelihood_of(model, logs, **words):
    """The likelihood that the words of a fit mean for a model and its logs."""
    return _arguments.likelihood_of(model, bind(model, logs), **words)


def innovations_of(model, logs, loss="gaussian"):
    """The innovations form for a model and its logs."""
    words = {"likelihood": "innovations", "noise_model": "white", "loss": loss}
    return likelihood_of(model, logs, **words)


compiled = jax.jit(evaluate, static_argnums=0)


def evaluated(problem, z):
    """The likelihood at some coordinates, as arrays of NumPy."""
    return jax.tree.map(np.asarray, compiled(problem.layout, problem.numbers, jnp.asarray(z)))
