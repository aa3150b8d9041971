"""A body in surge, sway, heave and yaw."""

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.bodies import _horizontal
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.six import Six

_QUADRATIC = {"bounds": (0, None), "null": 0.0}


@registered
class FourDegrees(Body):
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
    states: ClassVar[Mapping[str, str]] = {
        "surge": "m/s",
        "sway": "m/s",
        "heave": "m/s",
        "yaw_rate": "rad/s",
        "north": "m",
        "east": "m",
        "depth": "m",
        "heading": "rad",
    }
    outputs: ClassVar[Mapping[str, str]] = states
    ports: ClassVar[Mapping[str, str]] = {
        **_horizontal.PORTS,
        "heave_force": "force along z, downwards [N]",
    }
    angles: ClassVar[tuple[str, ...]] = ("heading",)
    time_scales: ClassVar[tuple[float, float]] = (0.05, 20.0)
    horizon: ClassVar[float | None] = 20.0

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
        """Level, and in heave."""
        return _horizontal.motion(s, port)._replace(heave=s.heave)

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """Fossen 2021, section 8.1."""
        u, v, w, r = water.surge, water.sway, water.heave, water.yaw
        inertia = _horizontal.Inertia(self.m11, self.m22, self.i66, self.x_g)
        damping = _horizontal.Damping(
            self.d11 + self.q11 * jnp.abs(u),
            self.d22 + self.q22 * jnp.abs(v + self.x_d * r),
            self.d66 + self.q66 * jnp.abs(r),
            self.x_d,
        )
        rates = _horizontal.rates(s, port, water, forces, inertia, damping)
        drag = (self.d33 + self.q33 * jnp.abs(w)) * w
        heave = port("heave_force", forces.heave - drag + self.weight - self.buoyancy)
        rates |= {"heave": heave / self.m33, "depth": w}
        return rates, {name: s[name] for name in self.outputs}
