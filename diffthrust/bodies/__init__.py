"""Bodies on which a craft is built, after Fossen 2021.

A new body is one class with `registered` in the file of its kind, and its line here.
"""

from diffthrust.bodies._axes import Axis as Axis
from diffthrust.bodies._axes import Heave as Heave
from diffthrust.bodies._level import FourDegrees as FourDegrees
from diffthrust.bodies._level import Planar as Planar
from diffthrust.bodies._six_degrees import SixDegrees as SixDegrees
from diffthrust.models._craft.body import BODIES as BODIES
from diffthrust.models._craft.body import Body as Body
from diffthrust.models._craft.six import Six as Six
