"""Effects, grouped by the place where they act; `EFFECTS` finds them by their canonical names.

A new effect is one class in the file of its place, imported here.
"""

from diffthrust._effect import Effect as Effect
from diffthrust.effects._command import CommandDeadband as CommandDeadband
from diffthrust.effects._propeller import ReverseThrustAsymmetry as ReverseThrustAsymmetry
from diffthrust.effects._shaft import ActuatorLag as ActuatorLag

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in list(globals().values())
    if isinstance(effect, type) and issubclass(effect, Effect) and effect is not Effect
}
