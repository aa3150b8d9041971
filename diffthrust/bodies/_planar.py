"""A body in surge, sway and yaw."""

from collections.abc import Mapping
from typing import ClassVar

from diffthrust.bodies import _horizontal
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.six import Six
from diffthrust.models._planar_motion import STATES


@registered
class Planar(Body):
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
    states: ClassVar[Mapping[str, str]] = STATES
    outputs: ClassVar[Mapping[str, str]] = STATES
    optional_inputs: ClassVar[Mapping[str, str]] = {"wind_speed": "m/s", "wind_direction": "rad"}
    ports: ClassVar[Mapping[str, str]] = _horizontal.PORTS
    angles: ClassVar[tuple[str, ...]] = ("heading",)
    time_scales: ClassVar[tuple[float, float]] = (0.05, 20.0)
    horizon: ClassVar[float | None] = 20.0

    m11: float = parameter(38.0, "kg", bounds=(0, None), doc="mass in surge")
    m22: float = parameter(60.0, "kg", bounds=(0, None), doc="mass in sway")
    i33: float = parameter(6.0, "kg m^2", bounds=(0, None), doc="inertia in yaw")
    d11: float = parameter(20.0, "N s/m", bounds=(0, None), doc="damping in surge")
    d22: float = parameter(80.0, "N s/m", bounds=(0, None), doc="damping in sway")
    d33: float = parameter(12.0, "N m s/rad", bounds=(0, None), doc="damping in yaw")
    x_g: float = parameter(0.0, "m", fixed=True, size=0.1, doc="centre of mass")
    x_d: float = parameter(0.0, "m", fixed=True, size=0.1, doc="centre of resistance to sway")

    def motion(self, s: Signals, port: Ports) -> Six:
        """In the plane."""
        return _horizontal.motion(s, port)

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """Fossen 2021, equation 6.1 in three degrees of freedom."""
        inertia = _horizontal.Inertia(self.m11, self.m22, self.i33, self.x_g)
        damping = _horizontal.Damping(self.d11, self.d22, self.d33, self.x_d)
        rates = _horizontal.rates(s, port, water, forces, inertia, damping)
        return rates, {name: s[name] for name in self.outputs}
