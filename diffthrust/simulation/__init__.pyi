from ._runs import SimulationFailedWarning as SimulationFailedWarning
from ._runs import simulate as simulate
from ._step_size import CoarseStepWarning as CoarseStepWarning
from ._step_size import choose_substeps as choose_substeps
from ._step_size import step_error as step_error
