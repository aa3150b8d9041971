from ._result import Experiment as Experiment
from ._suggest import suggest_experiment as suggest_experiment
