"""Bodies on which a craft is built, one per file, after Fossen 2021.

A new body is one class with `registered` in a file of its own, and its line here.
"""

from diffthrust.bodies._axis import Axis as Axis
from diffthrust.bodies._heave import Heave as Heave
from diffthrust.bodies._planar import Planar as Planar

from diffthrust.bodies._four_degrees import FourDegrees as FourDegrees  # isort: skip
from diffthrust.bodies._six_degrees import SixDegrees as SixDegrees  # isort: skip
from diffthrust.models._craft.body import BODIES as BODIES
from diffthrust.models._craft.body import Body as Body
from diffthrust.models._craft.six import Six as Six
