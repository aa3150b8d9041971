"""A surface vessel in three degrees of freedom."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import jax.numpy as jnp

from diffthrust._errors import InputError
from diffthrust._model import Model
from diffthrust._parameters import Parameter, parameter
from diffthrust._signals import Ports, Signals


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

    Axes: x forward, y to starboard, heading clockwise from north. A stern propeller that pushes
    the stern to starboard (a > 0) turns the bow to port: the sign of equations (15) and (16), not
    that of (3) and (8), of the paper. The optional ``wind_speed`` and ``wind_direction`` are there
    for effects; these equations do not read them.

    Source: Siramdasu & Fahimi 2013, section 2; the defaults are their results at n = 98 rev/s. The
    lever arm is not printed there; measure it on the vessel (it is fixed by default).

    Args:
        drive: "propeller" or "twin".
        **parameters: values by name.

    Example:
        >>> vessel = dft.Vessel(drive="twin").replace(lever_arm=0.285)
    """

    name = "vessel"
    options = ("drive",)
    states = {
        "surge": "m/s",
        "sway": "m/s",
        "yaw_rate": "rad/s",
        "north": "m",
        "east": "m",
        "heading": "rad",
    }
    outputs = states
    ports = {
        "surge_force": "force along x, in units of A",
        "sway_force": "force along y, in units of A",
        "yaw_moment": "moment about z, in units of A m",
    }
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
    inputs: Mapping[str, str]  # pyright: ignore[reportIncompatibleVariableOverride]
    optional_inputs = {"wind_speed": "m/s", "wind_direction": "rad"}

    def __init__(
        self, drive: Literal["propeller", "twin"] = "propeller", **parameters: float | Parameter
    ) -> None:
        if drive not in _INPUTS:
            raise InputError(
                f"Vessel: expected drive 'propeller' or 'twin', found {drive!r}.", "Correct it."
            )
        self._set(drive=drive, inputs=_INPUTS[drive])
        super().__init__(**parameters)
        described = self._parameters
        if drive == "twin":  # forces are given: no power law is left to estimate
            described = {**described, "exponent": Parameter(1.0, fixed=True)}
            self._set(exponent=1.0)
        else:
            ratios = ("m11", "m22", "i33", "d11", "d22", "d33")
            units = {k: replace(described[k], unit=f"{described[k].unit}/A") for k in ratios}
            described = {**described, **units}
        self._set(_parameters=described)

    @property
    def forces(self) -> Any:
        """The function from signals to the forces of the drive, before the ports."""
        return self._propeller if self.drive == "propeller" else self._twin

    def _propeller(self, s: Signals) -> tuple[Any, Any, Any]:
        n = s.propeller_speed
        turning = n != 0
        strength = jnp.sign(n) * jnp.where(turning, jnp.abs(n), 1.0) ** self.exponent
        force = jnp.where(turning, strength, 0.0)
        side = force * jnp.sin(s.rudder_angle)
        return force * jnp.cos(s.rudder_angle), side, -self.lever_arm * side

    def _twin(self, s: Signals) -> tuple[Any, Any, Any]:
        total = s.left_force + s.right_force
        return total, 0.0 * total, self.lever_arm * (s.left_force - s.right_force)

    def equations(self, s: Signals, port: Ports) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Siramdasu & Fahimi 2013, equations (1) to (5), (15) and (16)."""
        u, v, r = s.surge, s.sway, s.yaw_rate
        surge, sway, yaw = self.forces(s)
        surge = port("surge_force", surge + self.m22 * v * r - self.d11 * u)
        sway = port("sway_force", sway - self.m11 * u * r - self.d22 * v)
        yaw = port("yaw_moment", yaw - (self.m22 - self.m11) * u * v - self.d33 * r)
        cos, sin = jnp.cos(s.heading), jnp.sin(s.heading)
        rates = {
            "surge": surge / self.m11,
            "sway": sway / self.m22,
            "yaw_rate": yaw / self.i33,
            "north": u * cos - v * sin,
            "east": u * sin + v * cos,
            "heading": r,
        }
        return rates, {name: s[name] for name in self.outputs}


_INPUTS = {
    "propeller": {"propeller_speed": "rev/s", "rudder_angle": "rad"},
    "twin": {"left_force": "N", "right_force": "N"},
}
