"""What pushes a craft besides the thrusters of `dft.models`: one per file.

An actuator is a model with an output ``thrust`` [N], along its axis, and where it also pushes
across, ``side_thrust`` [N]: to starboard, where it points ahead. A new one is one class with
`registered` in a file of its own, and its line here.
"""

from diffthrust.actuators._azimuth import Azimuth as Azimuth
from diffthrust.actuators._hinged_propeller import HingedPropeller as HingedPropeller
from diffthrust.actuators._rudder import RudderPropeller as RudderPropeller
from diffthrust.actuators._static_thruster import StaticThruster as StaticThruster
from diffthrust.models._base.actuator import ACTUATORS as ACTUATORS
