"""What a simulation is made from: a log's inputs and starts, a model's forms, the traced run.

`simulate` returns arrays that JAX can neither differentiate nor map, and shows no step before it.
"""

from diffthrust.simulation._dependence import states_behind  # private: it decides which form runs
from diffthrust.simulation._fixed_step import starting_states  # private: no run returns its start
from diffthrust.simulation._gaps import bridged  # private: the time base alone
from diffthrust.simulation._record import bind  # private: what a model reads of a log
from diffthrust.simulation._trajectory import (  # private: the traced part alone
    Grid,
    Key,
    equations_of,
    starting_point,
    trajectory,
)

__all__ = [
    "Grid",
    "Key",
    "bind",
    "bridged",
    "equations_of",
    "grid_of",
    "starting_point",
    "starting_states",
    "states_behind",
    "trajectory",
]


def grid_of(model, log, substeps=1):
    """How a model is integrated over a log."""
    (record,) = bind(model, [log])
    return Grid(record.holds(record.inputs_for(model)), substeps)
