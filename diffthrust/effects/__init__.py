"""Effects, grouped by the place where they act; `EFFECTS` finds them by their canonical names.

A new effect is one class with `registered` in the file of its place, and its line here.
"""

from diffthrust.effects import _finite
from diffthrust.effects._command import CommandDeadband as CommandDeadband
from diffthrust.effects._command import CommandDelay as CommandDelay
from diffthrust.effects._command import CommandOffset as CommandOffset
from diffthrust.effects._command import CommandRateLimit as CommandRateLimit
from diffthrust.effects._command import CommandSaturation as CommandSaturation
from diffthrust.effects._curve import Curve as Curve
from diffthrust.effects._curves import LoadExponent as LoadExponent
from diffthrust.effects._curves import ThrustExponent as ThrustExponent
from diffthrust.effects._drive import DifferentialGain as DifferentialGain
from diffthrust.effects._drive import ForceExponent as ForceExponent
from diffthrust.effects._drive import PropellerInflow as PropellerInflow
from diffthrust.effects._drive import PropellerLag as PropellerLag
from diffthrust.effects._drive import PropellerWalk as PropellerWalk
from diffthrust.effects._drive import ReversePropellerAsymmetry as ReversePropellerAsymmetry
from diffthrust.effects._drive import RudderInflow as RudderInflow
from diffthrust.effects._drive import RudderLag as RudderLag
from diffthrust.effects._drive import RudderOffset as RudderOffset
from diffthrust.effects._drive import RudderRateLimit as RudderRateLimit
from diffthrust.effects._drive import SwappedThrusters as SwappedThrusters
from diffthrust.effects._environment import WaterCurrent as WaterCurrent
from diffthrust.effects._environment import Wind as Wind
from diffthrust.effects._formula import Formula as Formula
from diffthrust.effects._hull import Buoyancy as Buoyancy
from diffthrust.effects._hull import QuadraticSurgeDrag as QuadraticSurgeDrag
from diffthrust.effects._hull import QuadraticSwayDrag as QuadraticSwayDrag
from diffthrust.effects._hull import QuadraticYawDrag as QuadraticYawDrag
from diffthrust.effects._hull import SwayYawCoupling as SwayYawCoupling
from diffthrust.effects._periodic import PeriodicForce as PeriodicForce
from diffthrust.effects._propeller import AxialFlow as AxialFlow
from diffthrust.effects._propeller import Cavitation as Cavitation
from diffthrust.effects._propeller import InflowThrustLoss as InflowThrustLoss
from diffthrust.effects._propeller import ReverseThrustAsymmetry as ReverseThrustAsymmetry
from diffthrust.effects._propeller import ThrustDegradation as ThrustDegradation
from diffthrust.effects._sensor import SpeedSensorOffset as SpeedSensorOffset
from diffthrust.effects._sensor import SpeedSensorScale as SpeedSensorScale
from diffthrust.effects._sensor import ThrustSensorDelay as ThrustSensorDelay
from diffthrust.effects._sensor import ThrustSensorLag as ThrustSensorLag
from diffthrust.effects._sensor import ThrustSensorOffset as ThrustSensorOffset
from diffthrust.effects._sensor import ThrustSensorScale as ThrustSensorScale
from diffthrust.effects._shaft import ActuatorLag as ActuatorLag
from diffthrust.effects._shaft import CoulombFriction as CoulombFriction
from diffthrust.effects._shaft import InflowLoadRelief as InflowLoadRelief
from diffthrust.effects._shaft import LinearDamping as LinearDamping
from diffthrust.effects._shaft import ReverseDriveAsymmetry as ReverseDriveAsymmetry
from diffthrust.effects._shaft import ReverseLoadAsymmetry as ReverseLoadAsymmetry
from diffthrust.effects._shaft import SlewLimit as SlewLimit
from diffthrust.effects._shaft import StaticFriction as StaticFriction
from diffthrust.effects._shaft import SupplyVoltageSag as SupplyVoltageSag
from diffthrust.models._base.effect import EFFECTS as EFFECTS
from diffthrust.models._base.effect import Effect as Effect

finite = _finite
