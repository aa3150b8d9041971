"""What a simulation is made from: a log's inputs and starts, a model's forms, the traced run.

`simulate` returns arrays that JAX can neither differentiate nor map, and shows no step before it.
"""

# ruff: noqa: F401 (tests take these names from here)

from diffthrust.simulation import _starts as starts_module  # private: a part alone
from diffthrust.simulation import _step_size as step_size_module
from diffthrust.simulation import _trajectory as trajectory_module
from diffthrust.simulation._commands import (  # private: as a fit calls them
    adopted,
    command_kind,
)
from diffthrust.simulation._errors import (  # private: each alone
    errors,
    unwrapped,
    wrapped,
)
from diffthrust.simulation._integrate import (  # private: integrator and weights alone
    SERIES,
    TURN,
    advance,
    exponential_weights,
    integrate,
    plain_rate,
    with_push,
    within,
)
from diffthrust.simulation._levels import (  # private: each alone
    levels_over,
    levels_when_asked,
    port_readings,
)
from diffthrust.simulation._linearise import (  # private: told by no result
    point_in,
    slopes,
    slopes_at,
    states_behind,  # private: it decides which form runs
)
from diffthrust.simulation._record import (  # private: what a model reads of a log
    are_tables,
    bind,
    bridged,  # private: the time base alone
    input_ranges,
    measured_outputs,
)
from diffthrust.simulation._runs import (  # private: as a fit; the sentences alone
    overflow,
    pooled_errors,
    runs_over,
    too_large,
    with_steps,
)
from diffthrust.simulation._runs import (  # private: as a fit
    step_choice as runs_step_choice,
)
from diffthrust.simulation._starts import (  # private: each alone
    felt,
    following,
    unknown_starts,
)
from diffthrust.simulation._step_size import (  # private: each alone
    fewest_steps,
    sensor_noise,
)
from diffthrust.simulation._trajectory import (  # private: told by no result
    Grid,
    Key,
    bare,
    checked_initial,
    equations_of,
    starting_point,
    starting_states,
    trajectory,
)


def grid_of(model, log, substeps=1):
    """How a model is integrated over a log."""
    (record,) = bind(model, [log])
    return Grid(record.holds(record.inputs_for(model)), substeps)
