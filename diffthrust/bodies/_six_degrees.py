"""A body in six degrees of freedom."""

from collections.abc import Collection, Mapping
from typing import Any

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signals
from diffthrust.models._craft import attitude
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.kinematics import QUATERNION
from diffthrust.models._craft.six import Six, Triple, cross, lessened, scaled, summed

_VELOCITIES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
_STATES = {
    **dict.fromkeys(_VELOCITIES[:3], "m/s"),
    **dict.fromkeys(_VELOCITIES[3:], "rad/s"),
    **dict.fromkeys(("north", "east", "depth"), "m"),
    **dict.fromkeys(QUATERNION, ""),
}
_D = {"bounds": (0, None), "null": 0.0}
_PLACE = {"unit": "m", "fixed": True, "size": 0.02}


@registered
class SixDegrees(Body):
    """A rigid body in the water in six degrees of freedom, its attitude a quaternion.

    With p = (m11 u, m22 v, m33 w) and h = (i44 p, i55 q, i66 r) the momenta about the centre of
    mass, whose velocity is v_g = v + omega x r_g:

        p' = force - omega x p,      h' = moment about r_g - omega x h - v_g x p

    which is M v' + C(v) v with M = H' diag(m11, ..., i66) H: positive definite for any centre
    ``x_g, y_g, z_g``, and C(v) skew. Forces are those of the actuators, damping -(d + q |v|) v for
    each axis at the origin, the weight at the centre of mass and the buoyancy at ``x_b, y_b, z_b``.
    Masses and inertias include those of the water, taken as centred in the same point. The weight
    is held, as weighed, and z_g - z_b is what holds the vehicle upright.

    Logs may measure the attitude as ``roll``, ``pitch`` and ``heading`` or as the quaternion
    ``qw, qx, qy, qz`` from the body's axes to north, east and down.
    Source: Fossen 2021, equations 3.46 (C from M), 4.6 (weight and buoyancy), 2.72 (quaternions);
    the defaults have the size of a vehicle of 11 kg.

    Example:
        >>> rov = dft.Craft(dft.bodies.SixDegrees())
        >>> list(rov.outputs)[-3:]
        ['roll', 'pitch', 'heading']
    """

    name = "six_degrees"
    states = _STATES
    outputs = {
        **_STATES,
        **dict.fromkeys(("roll", "pitch", "heading"), "rad"),
    }
    ports = {
        "surge_through_water": "speed through the water along x [m/s]",
        "sway_through_water": "speed through the water along y [m/s]",
        "heave_through_water": "speed through the water along z [m/s]",
        "propulsion": "force of all actuators along x [N]",
        "surge_force": "force along x [N]",
        "sway_force": "force along y [N]",
        "heave_force": "force along z [N]",
        "roll_moment": "moment about x through the centre of mass [N m]",
        "pitch_moment": "moment about y through the centre of mass [N m]",
        "yaw_moment": "moment about z through the centre of mass [N m]",
    }
    angles = ("roll", "heading")
    time_scales = (0.02, 20.0)
    horizon = 20.0
    quaternions = (QUATERNION,)
    start_outputs = ("roll", "pitch", "heading")

    m11: float = parameter(17.0, "kg", bounds=(0, None), doc="mass in surge")
    m22: float = parameter(24.0, "kg", bounds=(0, None), doc="mass in sway")
    m33: float = parameter(26.0, "kg", bounds=(0, None), doc="mass in heave")
    i44: float = parameter(0.28, "kg m^2", bounds=(0, None), doc="inertia in roll")
    i55: float = parameter(0.28, "kg m^2", bounds=(0, None), doc="inertia in pitch")
    i66: float = parameter(0.28, "kg m^2", bounds=(0, None), doc="inertia in yaw")
    d11: float = parameter(4.0, "N s/m", **_D, size=4.0, doc="damping in surge")
    d22: float = parameter(6.0, "N s/m", **_D, size=6.0, doc="damping in sway")
    d33: float = parameter(5.0, "N s/m", **_D, size=5.0, doc="damping in heave")
    d44: float = parameter(0.1, "N m s/rad", **_D, size=0.1, doc="damping in roll")
    d55: float = parameter(0.1, "N m s/rad", **_D, size=0.1, doc="damping in pitch")
    d66: float = parameter(0.1, "N m s/rad", **_D, size=0.1, doc="damping in yaw")
    q11: float = parameter(18.0, "N s^2/m^2", **_D, size=20.0, doc="quadratic, surge")
    q22: float = parameter(22.0, "N s^2/m^2", **_D, size=20.0, doc="quadratic, sway")
    q33: float = parameter(37.0, "N s^2/m^2", **_D, size=40.0, doc="quadratic, heave")
    q44: float = parameter(1.5, "N m s^2/rad^2", **_D, size=1.5, doc="quadratic, roll")
    q55: float = parameter(1.5, "N m s^2/rad^2", **_D, size=1.5, doc="quadratic, pitch")
    q66: float = parameter(1.5, "N m s^2/rad^2", **_D, size=1.5, doc="quadratic, yaw")
    weight: float = parameter(
        112.8, "N", bounds=(0, None), fixed=True, transform="linear", size=10.0
    )
    buoyancy: float = parameter(114.8, "N", bounds=(0, None), transform="linear", size=10.0)
    x_g: float = parameter(0.0, **_PLACE, doc="centre of mass")
    y_g: float = parameter(0.0, **_PLACE, doc="centre of mass")
    z_g: float = parameter(0.02, **_PLACE, doc="centre of mass")
    x_b: float = parameter(0.0, **_PLACE, doc="centre of buoyancy")
    y_b: float = parameter(0.0, **_PLACE, doc="centre of buoyancy")
    z_b: float = parameter(0.0, **_PLACE, doc="centre of buoyancy")

    def motion(self, s: Signals, port: Ports) -> Six:
        u = port("surge_through_water", s.surge)
        v = port("sway_through_water", s.sway)
        w = port("heave_through_water", s.heave)
        heading = attitude.angles(self._attitude(s))[2]
        port.tell(surge_through_water=u, sway_through_water=v, heading=heading)
        return Six(u, v, w, s.roll_rate, s.pitch_rate, s.yaw_rate)

    @staticmethod
    def _attitude(s: Signals) -> attitude.Quaternion:
        return attitude.unit((s.qw, s.qx, s.qy, s.qz))

    def _triple(self, *names: str) -> Triple:
        x, y, z = (getattr(self, name) for name in names)
        return x, y, z

    def _damping(self, water: Six) -> Six:
        """What the water does against the motion."""
        axes = zip("123456", water, strict=True)
        return Six(
            *(
                -(getattr(self, f"d{k}{k}") + getattr(self, f"q{k}{k}") * jnp.abs(v)) * v
                for k, v in axes
            )
        )

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        centre = self._triple("x_g", "y_g", "z_g")
        omega, velocity = water.angular, water.at(centre)
        momentum = _each(self._triple("m11", "m22", "m33"), velocity)
        spin = _each(self._triple("i44", "i55", "i66"), omega)
        q = self._attitude(s)
        down = attitude.down(q)

        ahead = port("propulsion", forces.surge + 0.0 * s.surge)
        port.tell(propulsion=ahead)
        drag = self._damping(water)
        acting = forces._replace(surge=ahead).pushed(drag.linear, (0.0, 0.0, 0.0), drag.angular)
        acting = acting.pushed(scaled(self.weight, down), centre)
        lift = self._triple("x_b", "y_b", "z_b")
        acting = acting.pushed(scaled(-self.buoyancy, down), lift)
        force = lessened(acting.linear, cross(omega, momentum))
        moment = lessened(acting.angular, cross(centre, acting.linear))
        moment = lessened(moment, summed(cross(omega, spin), cross(velocity, momentum)))
        force = _through(port, ("surge_force", "sway_force", "heave_force"), force)
        moment = _through(port, ("roll_moment", "pitch_moment", "yaw_moment"), moment)
        turning = _over(moment, self._triple("i44", "i55", "i66"))
        moving = _over(force, self._triple("m11", "m22", "m33"))
        moving = lessened(moving, cross(turning, centre))
        over_ground = attitude.to_world(q, (s.surge, s.sway, s.heave))
        rates: dict[str, Any] = dict(zip(_VELOCITIES, (*moving, *turning), strict=True))
        rates |= zip(("north", "east", "depth"), over_ground, strict=True)
        raw = (s.qw, s.qx, s.qy, s.qz)
        rates |= zip(QUATERNION, attitude.rates(raw, omega), strict=True)
        roll, pitch, heading = attitude.angles(q)
        measured = {name: s[name] for name in self.states if name not in QUATERNION}
        measured |= zip(QUATERNION, q, strict=True)
        return rates, {**measured, "roll": roll, "pitch": pitch, "heading": heading}

    def initial(self, s: Signals) -> Mapping[str, float]:
        """Level, the bow to the north."""
        return {"qw": 1.0}

    def start_from(self, first: Mapping[str, Any]) -> Mapping[str, Any]:
        """The quaternion of the first angles; those that no sensor reads are zero."""
        if all(name in first for name in QUATERNION):  # of a sensor, or its own
            return {name: first[name] for name in QUATERNION}
        if not any(name in first for name in self.start_outputs):
            return {}
        q = attitude.from_angles(*(first.get(name, 0.0) for name in self.start_outputs))
        return dict(zip(QUATERNION, q, strict=True))

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """All three angles: later in a run one that is not read is not zero."""
        whole = {*self.start_outputs} <= {*channels}
        # that of a subclass may take numbers only
        return (
            self.start_outputs if whole and type(self).start_from is SixDegrees.start_from else ()
        )


def _through(port: Ports, names: tuple[str, str, str], values: Triple) -> Triple:
    x, y, z = map(port, names, values)
    return x, y, z


def _each(a: Triple, b: Triple) -> Triple:
    x, y, z = (p * q for p, q in zip(a, b, strict=True))
    return x, y, z


def _over(a: Triple, b: Triple) -> Triple:
    x, y, z = (p / q for p, q in zip(a, b, strict=True))
    return x, y, z
