"""What a simulation is made from: a log's inputs and starts, a model's forms, the traced run.

`simulate` returns arrays that JAX can neither differentiate nor map, and shows no step before it.
"""

from diffthrust.simulation import (  # private: a part alone
    _fixed_step as fixed_step_module,
)
from diffthrust.simulation import _starts as starts_module
from diffthrust.simulation import _step_size as step_size_module
from diffthrust.simulation import _trajectory as trajectory_module
from diffthrust.simulation._commands import (  # private: as a fit calls them
    adopted,
    command_kind,
)
from diffthrust.simulation._dependence import states_behind  # private: it decides which form runs
from diffthrust.simulation._errors import (  # private: each alone
    errors,
    unwrapped,
    wrapped,
)
from diffthrust.simulation._fixed_step import (  # private: no run returns its start
    checked_initial,
    starting_states,
)
from diffthrust.simulation._integrate import (  # private: the integrator alone
    integrate,
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
)
from diffthrust.simulation._record import (  # private: what a model reads of a log
    are_tables,
    bind,
    bridged,  # private: the time base alone
    input_ranges,
    measured_outputs,
)
from diffthrust.simulation._runge_kutta import (  # private: the weights alone
    SERIES,
    TURN,
    advance,
    exponential_weights,
    plain_rate,
    with_push,
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
    equations_of,
    starting_point,
    trajectory,
)

__all__ = [
    "SERIES",
    "TURN",
    "Grid",
    "Key",
    "adopted",
    "advance",
    "are_tables",
    "bare",
    "bind",
    "bridged",
    "checked_initial",
    "command_kind",
    "equations_of",
    "errors",
    "exponential_weights",
    "felt",
    "fewest_steps",
    "fixed_step_module",
    "following",
    "grid_of",
    "input_ranges",
    "integrate",
    "levels_over",
    "levels_when_asked",
    "measured_outputs",
    "overflow",
    "plain_rate",
    "point_in",
    "pooled_errors",
    "port_readings",
    "runs_over",
    "runs_step_choice",
    "sensor_noise",
    "slopes",
    "slopes_at",
    "starting_point",
    "starting_states",
    "starts_module",
    "states_behind",
    "step_size_module",
    "too_large",
    "trajectory",
    "trajectory_module",
    "unknown_starts",
    "unwrapped",
    "with_push",
    "with_steps",
    "within",
    "wrapped",
]


def grid_of(model, log, substeps=1):
    """How a model is integrated over a log."""
    (record,) = bind(model, [log])
    return Grid(record.holds(record.inputs_for(model)), substeps)
