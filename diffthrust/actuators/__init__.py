"""What pushes a craft besides the thrusters of `dft.models`.

An actuator is a model with an output ``thrust`` [N], along its axis, and where it also pushes
across, ``side_thrust`` [N]: to starboard, where it points ahead. A new one is one class with
`registered` in `_actuators.py`, and its line here.
"""

from diffthrust.actuators._actuators import ACTUATORS as ACTUATORS
from diffthrust.actuators._actuators import Azimuth as Azimuth
from diffthrust.actuators._actuators import HingedPropeller as HingedPropeller
from diffthrust.actuators._actuators import RudderPropeller as RudderPropeller
from diffthrust.actuators._actuators import StaticThruster as StaticThruster
