"""What closed forms ask of a thruster: a torque by the command against a quadratic load."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

SQUARED_SINE = 8.0 / (3.0 * math.pi)
"""Fundamental of sin |sin|: what quadratic drag comes to under a sinusoid, per amplitude."""


@dataclass(frozen=True)
class QuadraticLoad:
    """A propeller driven by a torque that follows the command.

        d(speed)/dt = drive_gain * command - load * speed |speed|
        thrust      = thrust_gain * speed |speed|

    `Model.quadratic_load` gives it where a model without its effects obeys these equations.
    Formulas of the torque-driven thruster take their numbers from here and not from parameters by
    name; a test holds it against the equations of every model.

    Args:
        drive_gain: acceleration of the shaft per unit of the command.
        load: deceleration of the shaft per speed |speed| [1/rad].
        thrust_gain: thrust per speed |speed| [N s^2/rad^2].

    Numbers, or arrays of one shape: of a model that is bound to draws of its parameters, or traced.

    Example:
        >>> load = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022).quadratic_load
        >>> load.load, round(load.thrust_per_command, 2), round(load.sine_load, 4)
        (0.037, 24.97, 0.0314)
        >>> round(load.acceleration(1.0, 10.0), 2), round(load.thrust(-10.0), 2)
        (38.3, -2.2)
    """

    drive_gain: Any
    load: Any
    thrust_gain: Any

    @staticmethod
    def terms(command: Any, speed: Any) -> tuple[Any, Any]:
        """What ``drive_gain`` and ``load`` multiply in the acceleration of the shaft.

        Example:
            >>> [float(term) for term in dft.models.QuadraticLoad.terms(2.0, -3.0)]
            [2.0, 9.0]
        """
        return command, -speed * abs(speed)

    def acceleration(self, command: Any, speed: Any) -> Any:
        """Of the shaft [rad/s^2]."""
        drive, load = self.terms(command, speed)
        return self.drive_gain * drive + self.load * load

    def thrust(self, speed: Any) -> Any:
        """Of the propeller [N]."""
        return self.thrust_gain * speed * abs(speed)

    @property
    def thrust_per_command(self) -> Any:
        """Steady thrust per unit of the command."""
        return self.thrust_gain * self.drive_gain / self.load

    @property
    def sine_load(self) -> Any:
        """Load in proportion to speed per amplitude, where the speed is a sinusoid [1/rad].

        Times the amplitude [rad/s] it is the break frequency of the quasi-linear lag [rad/s].
        Source: Yoerger, Cooke & Slotine 1990, section IV, where it is called gamma.
        """
        return SQUARED_SINE * self.load
