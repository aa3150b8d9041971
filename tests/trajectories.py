"""What a simulation is made from: a log's inputs and starts, a model's forms, the traced run.

`simulate` returns arrays that JAX can neither differentiate nor map, and shows no step before it.
"""

from diffthrust.simulation._dependence import states_behind  # private: it decides which form runs
from diffthrust.simulation._fixed_step import starting_states  # private: no run returns its start
from diffthrust.simulation._inputs import (  # private: what a Grid is made from
    bridged,
    hold_of,
    inputs_of,
    measured_start,
)
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
    "bridged",
    "equations_of",
    "hold_of",
    "inputs_of",
    "measured_start",
    "starting_point",
    "starting_states",
    "states_behind",
    "trajectory",
]
