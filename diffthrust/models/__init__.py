"""Systems; `MODELS` finds them by the names that spec files use.

A new model is one class with `registered` in the file of its kind, and its line here.
"""

from diffthrust.models._base.effect import Effect as Effect
from diffthrust.models._base.effect import Ports as Ports
from diffthrust.models._base.model import MODELS as MODELS
from diffthrust.models._base.model import Model as Model
from diffthrust.models._base.parameter import Normal as Normal
from diffthrust.models._base.parameter import Parameter as Parameter
from diffthrust.models._base.parameter import parameter as parameter
from diffthrust.models._base.parameter import relative_to as relative_to
from diffthrust.models._base.quadratic_load import QuadraticLoad as QuadraticLoad
from diffthrust.models._base.signals import Relaxing as Relaxing
from diffthrust.models._base.signals import Signals as Signals

# in the order in which they are listed to people
# isort: off
from diffthrust.models._thrusters import Thruster as Thruster
from diffthrust.models._thrusters import SpeedLoopThruster as SpeedLoopThruster
from diffthrust.models._thrusters import DuctedThruster as DuctedThruster
from diffthrust.models._vessel import Vessel as Vessel
from diffthrust.models._thrusters import DCMotorThruster as DCMotorThruster
from diffthrust.models._one_axis import AxisVehicle as AxisVehicle
from diffthrust.models._one_axis import LinearSensor as LinearSensor
