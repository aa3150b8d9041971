"""A surface vessel in three degrees of freedom, and the motion in the plane that bodies share."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, Self

import jax.numpy as jnp

from diffthrust._support.errors import InputError
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import C, Model
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.signals import Rate, RatesAndOutputs, Signal, Signals, power_law

STATES: Mapping[str, str] = {
    "surge": "m/s",
    "sway": "m/s",
    "yaw_rate": "rad/s",
    "north": "m",
    "east": "m",
    "heading": "rad",
}
WATER_PORTS: Mapping[str, str] = {
    "surge_through_water": "speed through the water along x, which the forces depend on [m/s]",
    "sway_through_water": "speed through the water along y [m/s]",
}
FORCE_PORTS: Mapping[str, str] = {
    "surge_force": "force along x [N]",
    "sway_force": "force along y [N]",
    "yaw_moment": "moment about z [N m]",
    "surge_acceleration": "rate of the speed over ground along x [m/s^2]",
    "sway_acceleration": "rate of the speed over ground along y [m/s^2]",
    "yaw_acceleration": "rate of the yaw rate [rad/s^2]",
}


def through_water(s: Signals, port: Ports) -> tuple[Signal, Signal]:
    """The speeds through the water along x and y."""
    u = port("surge_through_water", s.surge)
    v = port("sway_through_water", s.sway)
    port.tell(surge_through_water=u, sway_through_water=v)
    return u, v


def rates_of(
    s: Signals, port: Ports, surging: Signal, swaying: Signal, yawing: Signal
) -> dict[str, Rate]:
    """The rates of all states from the three accelerations (Fossen 2021, equation 2.41)."""
    # a coupling of sway and yaw needs both accelerations as they are without it
    port.tell(sway_alone=swaying, yaw_alone=yawing)
    cos, sin = jnp.cos(s.heading), jnp.sin(s.heading)
    return {
        "surge": port("surge_acceleration", surging),
        "sway": port("sway_acceleration", swaying),
        "yaw_rate": port("yaw_acceleration", yawing),
        "north": s.surge * cos - s.sway * sin,
        "east": s.surge * sin + s.sway * cos,
        "heading": s.yaw_rate,
    }


_INPUTS = {
    "propeller": {"propeller_speed": "rev/s", "rudder_angle": "rad"},
    "twin": {"left_force": "N", "right_force": "N"},
}
_COMMANDED = {"propeller": ("propeller_speed",), "twin": ("left_force", "right_force")}
_PORTS = {
    **WATER_PORTS,
    "revolutions": "speed at which the propeller turns [rev/s]",
    "rudder": "angle at which the propeller or rudder stands [rad]",
    "propulsion": "force of the drive along its axis (twin: the sum) [N]",
    "steering": "force of the drive across, at the lever arm behind [N]",
    **FORCE_PORTS,
}
_OF_FORCE = ("N", "kg")
"""What the units of masses, dampings and forces begin with: all that is divided by A."""
_HINGED = ("revolutions", "rudder", "steering")
"""Ports that a vessel with two fixed thrusters does not have."""


@registered
class Vessel(Model):
    """Surge, sway and yaw of a small surface vessel, in the ratios to the propulsion constant A.

        m11 u' - m22 v r + d11 u         = surge_force
        m22 v' + m11 u r + d22 v         = sway_force
        i33 r' + (m22 - m11) u v + d33 r = yaw_moment

    With ``drive="propeller"`` the inputs are ``propeller_speed`` n [rev/s] and ``rudder_angle`` a
    of a propeller (or of the jet behind it) at the distance ``lever_arm`` behind the centre of
    gravity: surge_force = |n|^exponent sgn(n) cos a, sway_force the same with sin a, and
    yaw_moment = -lever_arm * sway_force. All masses and dampings are then divided by A.
    With ``drive="twin"`` the inputs are ``left_force`` and ``right_force`` [N]: surge_force is
    their sum, yaw_moment = lever_arm (left - right), and the parameters are in kg, kg m^2, ...
    With ``command="effort"`` the propeller, or the two thrusters, are given as shares of their full
    command (of PWM widths, per cent, duty): a force is A |effort|^exponent sgn(effort), where A is
    that of one propeller at full effort, and masses and dampings are divided by A either way.

    Axes: x forward, y to starboard, heading clockwise from north. A stern propeller that pushes
    the stern to starboard (a > 0) turns the bow to port: the sign of equations (15) and (16), not
    that of (3) and (8), of the paper. The optional ``wind_speed`` and ``wind_direction`` are there
    for effects; these equations do not read them.

    Source: Siramdasu & Fahimi 2013, section 2; the defaults are their results at n = 98 rev/s. The
    lever arm is not printed there; measure it on the vessel (it is fixed by default).

    Args:
        drive: "propeller" or "twin".
        command: "effort", or what the inputs are else: "rev/s" of a propeller, "N" of two forces.
        **parameters: values by name.

    Raises:
        InputError: another drive, a unit in which it is not commanded, a parameter that it does
            not have, or a value outside its bounds.

    Example:
        >>> vessel = dft.Vessel(drive="twin").replace(lever_arm=0.285)
        >>> vessel.inputs
        {'left_force': 'N', 'right_force': 'N'}
    """

    name = "vessel"
    options = ("drive", "command")
    states = outputs = STATES
    ports = _PORTS
    angles = ("heading",)
    time_scales = (0.05, 20.0)
    horizon = 20.0

    m11: float = parameter(5.23, "kg", bounds=(0, None), doc="mass in surge, to A")
    m22: float = parameter(5.93, "kg", bounds=(0, None), doc="mass in sway, to A")
    i33: float = parameter(1.25, "kg m^2", bounds=(0, None), doc="inertia in yaw, to A")
    d11: float = parameter(4.03, "N s/m", bounds=(0, None), doc="damping in surge, to A")
    d22: float = parameter(5.48, "N s/m", bounds=(0, None), doc="damping in sway, to A")
    d33: float = parameter(1.13, "N m s/rad", bounds=(0, None), doc="damping in yaw, to A")
    exponent: float = parameter(0.27, bounds=(0.05, 4.0), transform="log", doc="of n in the force")
    lever_arm: float = parameter(0.5, "m", bounds=(0, None), fixed=True)

    drive: Literal["propeller", "twin"]
    optional_inputs = {"wind_speed": "m/s", "wind_direction": "rad"}

    def __init__(
        self,
        drive: Literal["propeller", "twin"] = "propeller",
        *,
        command: str = "",
        **parameters: float | Parameter,
    ) -> None:
        if drive not in _INPUTS:
            raise InputError(
                f"Vessel: expected drive 'propeller' or 'twin', found {drive!r}.", "Correct it."
            )
        inputs, commanded = _INPUTS[drive], _COMMANDED[drive]
        commands = (inputs[commanded[0]], "effort")
        self._set(drive=drive, inputs=inputs, commands=commands, commanded=commanded)
        if drive == "twin":  # near enough for most maps from effort to force
            parameters.setdefault("exponent", 1.0)
        super().__init__(command=command, **parameters)

    def commanded_in(self, unit: str) -> Self:
        converted = super().commanded_in(unit)
        forces = converted._in_forces
        absent = _HINGED if self.drive == "twin" else ()
        ports = {
            name: text if forces else re.sub(r" \[N( m)?\]$", r", in units of A\1", text)
            for name, text in _PORTS.items()
            if name not in absent
        }
        described = dict(converted._parameters)
        if self.drive == "twin" and forces:  # no power law is left to estimate
            described["exponent"] = Parameter(1.0, fixed=True)
        elif self.drive == "twin" and described["exponent"].fixed:
            described["exponent"] = replace(self.declared["exponent"], value=1.0)
        exponent = described["exponent"].value
        return converted._copy(ports=ports, _parameters=described, exponent=exponent)

    @property
    def _in_forces(self) -> bool:
        """Whether the drive is given in newtons; all that is a force is in units of A else."""
        return self.command == "N"

    def _with_its_units(self, component: C) -> C:
        """Masses, dampings and forces, of an effect too, divided by A where the drive is no force.

        A cross-flow drag of 390 N s^2/m^2 stood as 7861 beside masses in kg/A.
        """
        per = "" if self._in_forces else "/A"
        component = super()._with_its_units(component)
        described = {
            name: replace(p, unit=p.unit.removesuffix("/A") + per)
            if p.unit.startswith(_OF_FORCE)
            else p
            for name, p in component._parameters.items()
        }
        return component._copy(_parameters=described)

    def _propeller(self, s: Signals, port: Ports) -> tuple[Any, Any, Any]:
        n = port("revolutions", s.propeller_speed)
        angle = port("rudder", s.rudder_angle)
        thrust = port("propulsion", power_law(n, self.exponent))
        port.tell(propulsion=thrust)
        side = port("steering", thrust * jnp.sin(angle))
        return thrust * jnp.cos(angle), side, -self.lever_arm * side

    def _twin(self, s: Signals, port: Ports) -> tuple[Any, Any, Any]:
        left, right = s.left_force, s.right_force
        if self.command == "effort":
            left, right = (power_law(force, self.exponent) for force in (left, right))
        thrust = port("propulsion", left + right)
        # 0.0 * thrust and not 0.0: outputs of a whole log have its shape
        return thrust, 0.0 * thrust, self.lever_arm * (left - right)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        (u, v), r = through_water(s, port), s.yaw_rate
        port.tell(m22=self.m22, i33=self.i33)
        surge, sway, yaw = (self._propeller if self.drive == "propeller" else self._twin)(s, port)
        surge = port("surge_force", surge + self.m22 * v * r - self.d11 * u)
        sway = port("sway_force", sway - self.m11 * u * r - self.d22 * v)
        yaw = port("yaw_moment", yaw - (self.m22 - self.m11) * u * v - self.d33 * r)
        rates = rates_of(s, port, surge / self.m11, sway / self.m22, yaw / self.i33)
        return rates, {name: s[name] for name in self.outputs}
