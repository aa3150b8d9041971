"""Bodies in surge, sway and yaw, and in heave besides."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Rate, RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.six import Six, Triple
from diffthrust.models._vessel import FORCE_PORTS, STATES, WATER_PORTS, rates_of, through_water

_PORTS: Mapping[str, str] = {
    **WATER_PORTS,
    "propulsion": "force of all actuators along x [N]",
    **FORCE_PORTS,
}
_QUADRATIC = {"bounds": (0, None), "null": 0.0}


class _Level(Body):
    """A body that stays level: surge, sway and yaw, with masses m11 and m22 and two centres.

    In axes through the centre of mass the mass matrix is diagonal: it is positive definite for any
    ``x_g``, Coriolis forces do no work, and the damping is dissipative for any ``x_d``.
    Source: Fossen 2021, sections 6.3 to 6.5, equations 3.46 and 6.1 in three degrees of freedom.
    """

    angles = ("heading",)
    time_scales = (0.05, 20.0)
    horizon = 20.0

    m11: float
    m22: float
    x_g: float
    x_d: float

    def motion(self, s: Signals, port: Ports) -> Six:
        u, v = through_water(s, port)
        return Six(surge=u, sway=v, yaw=s.yaw_rate)

    def _level_rates(
        self, s: Signals, port: Ports, water: Six, forces: Six, i33: Any, damping: Triple
    ) -> dict[str, Rate]:
        """Rates of the velocities and of the place over ground.

        The damping is that of surge, of sway, which acts at ``x_d``, and of yaw, per velocity.
        """
        m11, m22, x_g, x_d = self.m11, self.m22, self.x_g, self.x_d
        d11, d22, d33 = damping
        u, v, r = water.surge, water.sway, water.yaw
        port.tell(m22=m22, i33=i33)
        # 0.0 * r and not 0.0: outputs of a whole log have its shape
        ahead = port("propulsion", forces.surge + 0.0 * r)
        port.tell(propulsion=ahead)
        v_mass, v_damping = v + x_g * r, v + x_d * r
        drag = d22 * v_damping
        across = forces.sway + 0.0 * r
        about = forces.yaw - x_g * across - (x_d - x_g) * drag - d33 * r
        surge = port("surge_force", ahead + m22 * v_mass * r - d11 * u)
        sway = port("sway_force", across - m11 * u * r - drag)
        yaw = port("yaw_moment", about - (m22 - m11) * u * v_mass)
        yawing = yaw / i33
        surging, swaying = surge / m11, sway / m22 - x_g * yawing
        return rates_of(s, port, surging, swaying, yawing)


@registered
class Planar(_Level):
    """Surge, sway and yaw of a surface vessel, with linear damping.

    At rest about the axes of the mass, with v_g = v + x_g r and v_d = v + x_d r:

        m11 u'   = surge force + m22 v_g r - d11 u
        m22 v_g' = sway force - m11 u r - d22 v_d
        i33 r'   = yaw moment about x_g - (m22 - m11) u v_g - (x_d - x_g) d22 v_d - d33 r

    Masses include added masses. ``x_g`` [m] is where the mass in sway is centred, ahead of the
    origin, and ``x_d`` where the resistance to sway is; both are held at 0 by default. Mass and
    damping matrices stay positive definite for any of their values. Axes: x forward, y to
    starboard, heading clockwise from north. Effects of a vessel act on it: quadratic damping,
    `water_current`, `wind`.
    Source: Fossen 2021, section 6.5; the equations of `Vessel` where x_g = x_d = 0. The defaults
    are of a boat of 1.3 m and 35 kg.

    Example:
        >>> boat = dft.Craft(
        ...     dft.bodies.Planar(m11=40.0),
        ...     port=dft.SpeedLoopThruster().at((-0.4, -0.3, 0)),
        ...     starboard=dft.SpeedLoopThruster().at((-0.4, 0.3, 0)),
        ... )
        >>> boat.m11
        40.0
    """

    name = "planar"
    states = outputs = STATES
    optional_inputs = {"wind_speed": "m/s", "wind_direction": "rad"}
    ports = _PORTS

    m11: float = parameter(38.0, "kg", bounds=(0, None), doc="mass in surge")
    m22: float = parameter(60.0, "kg", bounds=(0, None), doc="mass in sway")
    i33: float = parameter(6.0, "kg m^2", bounds=(0, None), doc="inertia in yaw")
    d11: float = parameter(20.0, "N s/m", bounds=(0, None), doc="damping in surge")
    d22: float = parameter(80.0, "N s/m", bounds=(0, None), doc="damping in sway")
    d33: float = parameter(12.0, "N m s/rad", bounds=(0, None), doc="damping in yaw")
    x_g: float = parameter(0.0, "m", fixed=True, size=0.1, doc="centre of mass")
    x_d: float = parameter(0.0, "m", fixed=True, size=0.1, doc="centre of resistance to sway")

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        damping = (self.d11, self.d22, self.d33)
        rates = self._level_rates(s, port, water, forces, self.i33, damping)
        return rates, {name: s[name] for name in self.outputs}


@registered
class FourDegrees(_Level):
    """Surge, sway, heave and yaw of an underwater vehicle that its righting moment keeps level.

    Surge, sway and yaw are those of `Planar`, heave that of `Heave`, each with linear damping
    ``d`` and quadratic damping ``q`` [N s^2/m^2, N m s^2/rad^2]:

        m11 u'   = surge force + m22 v_g r - (d11 + q11 |u|) u
        m22 v_g' = sway force - m11 u r - (d22 + q22 |v_d|) v_d
        m33 w'   = heave force - (d33 + q33 |w|) w + weight - buoyancy
        i66 r'   = yaw moment about x_g - (m22 - m11) u v_g - ... - (d66 + q66 |r|) r

    Only the difference of weight and buoyancy acts: the weight is held. Source: Fossen 2021,
    section 8.1; the defaults have the size of a vehicle of 11 kg.

    Example:
        >>> vehicle = dft.Craft(dft.bodies.FourDegrees())
        >>> list(vehicle.states)[:4]
        ['surge', 'sway', 'heave', 'yaw_rate']
    """

    name = "four_degrees"
    states = {
        "surge": "m/s",
        "sway": "m/s",
        "heave": "m/s",
        "yaw_rate": "rad/s",
        "north": "m",
        "east": "m",
        "depth": "m",
        "heading": "rad",
    }
    outputs = states
    ports = {
        **_PORTS,
        "heave_force": "force along z, downwards [N]",
    }

    m11: float = parameter(17.0, "kg", bounds=(0, None), doc="mass in surge")
    m22: float = parameter(24.0, "kg", bounds=(0, None), doc="mass in sway")
    m33: float = parameter(26.0, "kg", bounds=(0, None), doc="mass in heave")
    i66: float = parameter(0.28, "kg m^2", bounds=(0, None), doc="inertia in yaw")
    d11: float = parameter(4.0, "N s/m", **_QUADRATIC, size=4.0, doc="damping in surge")
    d22: float = parameter(6.0, "N s/m", **_QUADRATIC, size=6.0, doc="damping in sway")
    d33: float = parameter(5.0, "N s/m", **_QUADRATIC, size=5.0, doc="damping in heave")
    d66: float = parameter(0.07, "N m s/rad", **_QUADRATIC, size=0.1, doc="damping in yaw")
    q11: float = parameter(18.0, "N s^2/m^2", **_QUADRATIC, size=20.0, doc="quadratic, surge")
    q22: float = parameter(22.0, "N s^2/m^2", **_QUADRATIC, size=20.0, doc="quadratic, sway")
    q33: float = parameter(37.0, "N s^2/m^2", **_QUADRATIC, size=40.0, doc="quadratic, heave")
    q66: float = parameter(1.5, "N m s^2/rad^2", **_QUADRATIC, size=1.5, doc="quadratic, yaw")
    weight: float = parameter(
        112.8, "N", bounds=(0, None), fixed=True, transform="linear", size=10.0
    )
    buoyancy: float = parameter(114.8, "N", bounds=(0, None), transform="linear", size=10.0)
    x_g: float = parameter(0.0, "m", fixed=True, size=0.1, doc="centre of mass")
    x_d: float = parameter(0.0, "m", fixed=True, size=0.1, doc="centre of resistance to sway")

    def motion(self, s: Signals, port: Ports) -> Six:
        return super().motion(s, port)._replace(heave=s.heave)

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        u, v, w, r = water.surge, water.sway, water.heave, water.yaw
        damping = (
            self.d11 + self.q11 * jnp.abs(u),
            self.d22 + self.q22 * jnp.abs(v + self.x_d * r),
            self.d66 + self.q66 * jnp.abs(r),
        )
        rates = self._level_rates(s, port, water, forces, self.i66, damping)
        drag = (self.d33 + self.q33 * jnp.abs(w)) * w
        heave = port("heave_force", forces.heave - drag + self.weight - self.buoyancy)
        rates |= {"heave": heave / self.m33, "depth": w}
        return rates, {name: s[name] for name in self.outputs}
