"""Effects between the water and the hull."""

from collections.abc import Collection
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.effects._forms import from_zero
from diffthrust.models._base.component import Component, registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Signal, Signals


@registered
class Buoyancy(Effect):
    """Buoyancy and weight do not balance: a constant force along a vertical axis.

    Acts on the net force [N]: force + excess, with ``excess`` the buoyancy less the weight where
    the axis counts upwards, the weight less the buoyancy where it counts down. Null: excess = 0.
    Beside a measured thrust it is the same as the zero of that sensor: record the thrust at rest
    out of the water. Source: Fossen 2011, section 4.1 (W - B in heave).

    Example:
        >>> model = dft.AxisVehicle() + dft.effects.Buoyancy(excess=6)
        >>> model.parameters["buoyancy.excess"].range_text()
        '(-inf, inf) N'
    """

    name = "buoyancy"
    in_words = "buoyancy and weight leave {excess} along the axis"
    port = "force"
    excess: float = parameter(
        5.0, "N", null=0.0, size=10.0, probes=relative_to("thrust", -0.05, 0.05)
    )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value + self.excess


_NEVER = 1e-3
"""Display: speed [m/s, rad/s] that no vehicle moves below for long; a linear drag that is passed
there is none."""


class _QuadraticDrag(Effect, abstract=True):
    """A resistance that grows with the square of a speed of the hull."""

    _speed: ClassVar[str]
    """The signal of that speed."""
    _linear: ClassVar[tuple[str, str]]
    """The vessel's linear drag by its parameter, and the unit of the speed."""
    drag: float

    def __call__(self, value: Signal, s: Signals) -> Signal:
        speed = getattr(s, self._speed)
        return value - self.drag * speed * jnp.abs(speed)

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        """The speed from which it is more than the linear drag; "" where its number says enough.

        Divided by the propulsion constant A it says nothing: the drag of an Esso Osaka stood as
        "7861 N s^2/m^2/A", as if by the ampere, where it was 386.
        """
        coefficient = self._parameters["drag"]
        if not coefficient.unit.endswith("/A") or not coefficient.value > 0:
            return ""
        words = self.in_words.partition(",")[0]
        linear, unit = self._linear
        speed = getattr(model, linear) / coefficient.value
        if speed < _NEVER:  # a fit from a hull that has no linear drag ended at 1e-16 m/s
            return f"{words}, with no linear part left"
        return f"{words} and passes the linear drag at {speed:.2g} {unit}"


@registered
class QuadraticSurgeDrag(_QuadraticDrag):
    """The resistance ahead grows faster than the speed.

    Acts on the surge force: force - drag * u |u|, with u [m/s] the surge speed through the water.
    ``drag`` is in N s^2/m^2, divided by A where the vessel's parameters are. Null: drag = 0.
    Source: Fossen 2011, section 7.1, nonlinear damping -X_|u|u |u| u.

    Example:
        >>> model = dft.Vessel() + dft.effects.QuadraticSurgeDrag(drag=1)
        >>> model.parameters["quadratic_surge_drag.drag"].range_text()
        '[0, inf) N s^2/m^2/A'
    """

    name = "quadratic_surge_drag"
    in_words = "drag grows with the square of surge, {drag}"
    port = "surge_force"
    _speed, _linear = "surge_through_water", ("d11", "m/s")
    drag: float = from_zero(
        1.0, "N s^2/m^2", size=2.0, probes=relative_to("surge", 0.5, 5.0, power=-1)
    )


@registered
class QuadraticSwayDrag(_QuadraticDrag):
    """The hull resists sideways motion by cross-flow drag.

    Acts on the sway force: force - drag * v |v|, with v [m/s] the sway speed through the water.
    ``drag`` is in N s^2/m^2, divided by A where the vessel's parameters are. Null: drag = 0.
    Source: Fossen 2011, section 7.1, nonlinear damping -Y_|v|v |v| v.

    Example:
        >>> model = dft.Vessel() + dft.effects.QuadraticSwayDrag(drag=2)
        >>> model.parameters["quadratic_sway_drag.drag"].range_text()
        '[0, inf) N s^2/m^2/A'
    """

    name = "quadratic_sway_drag"
    in_words = "drag grows with the square of sway, {drag}"
    port = "sway_force"
    _speed, _linear = "sway_through_water", ("d22", "m/s")
    drag: float = from_zero(
        2.0, "N s^2/m^2", size=5.0, probes=relative_to("sway", 0.5, 5.0, power=-1)
    )


@registered
class QuadraticYawDrag(_QuadraticDrag):
    """The hull resists fast turning by cross-flow drag at its ends.

    Acts on the yaw moment: moment - drag * r |r|, with r [rad/s] the yaw rate. ``drag`` is in
    N m s^2/rad^2, divided by A where the vessel's parameters are. Null: drag = 0.
    Source: Fossen 2011, section 7.1, nonlinear damping -N_|r|r |r| r.

    Example:
        >>> model = dft.Vessel() + dft.effects.QuadraticYawDrag(drag=0.5)
        >>> model.parameters["quadratic_yaw_drag.drag"].range_text()
        '[0, inf) N m s^2/rad^2/A'
    """

    name = "quadratic_yaw_drag"
    in_words = "drag grows with the square of yaw rate, {drag}"
    port = "yaw_moment"
    _speed, _linear = "yaw_rate", ("d33", "rad/s")
    drag: float = from_zero(
        0.5, "N m s^2/rad^2", size=1.0, probes=relative_to("yaw_rate", 0.1, 1.0, power=-1)
    )


_LEAST_DETERMINANT = 0.1
"""Of the masses of sway and yaw, as a share of what it is without their coupling. A rod about its
very end has 0.25. Lower: next to the pole, where any force turns any hull. Higher: of an odd hull
with its origin at the bow the right mass is refused."""


@registered
class SwayYawCoupling(Effect):
    """Sway and yaw act on each other: fore and aft of the vessel are not alike.

    With ``mass`` [kg m] off the diagonal of the mass matrix (centre of gravity or added mass away
    from the origin) and ``damping`` [N s] off that of the damping matrix, both symmetric and
    divided by A where the vessel's parameters are:

        surge force + mass r^2
        m22 v' + mass r' = sway force - damping r
        mass v' + i33 r' = yaw moment - damping v - mass u r

    The last two are solved for v' and r', so the effect acts on forces and accelerations. A
    body has mass^2 well below m22 i33 (three quarters of it for a rod about its very end): beyond
    nine tenths a simulation ends in NaN, and a fit keeps away. Null: mass = 0, damping = 0.
    Source: Fossen 2011, section 7.1 (mass, Coriolis and damping matrices in three degrees of
    freedom).

    Example:
        >>> model = dft.Vessel() + dft.effects.SwayYawCoupling(mass=0.1)
        >>> model.parameters["sway_yaw_coupling.mass"].range_text()
        '(-inf, inf) kg m/A'
    """

    name = "sway_yaw_coupling"
    in_words = "sway and yaw act on each other"
    ports = ("surge_force", "sway_force", "yaw_moment", "sway_acceleration", "yaw_acceleration")
    mass: float = parameter(0.1, "kg m", null=0.0, size=0.5, probes=(-0.3, 0.3))
    damping: float = parameter(0.1, "N s", null=0.0, size=0.5, probes=(-0.5, 0.5))

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        """Forces with the off-diagonal terms, then accelerations by the coupled masses."""
        u, v, r = s.surge_through_water, s.sway_through_water, s.yaw_rate
        if port == "surge_force":
            return value + self.mass * r * r
        if port == "sway_force":
            return value - self.damping * r
        if port == "yaw_moment":
            return value - self.damping * v - self.mass * u * r
        sway, yaw = self.mass / s.m22, self.mass / s.i33
        v_alone, r_alone = s.sway_alone, s.yaw_alone
        determinant = 1.0 - sway * yaw
        # a fit of a boat on a lake, with a learned curve beside it, had stepped over the pole here,
        # or ended next to it, with a mass that no body has
        determinant = jnp.where(determinant > _LEAST_DETERMINANT, determinant, jnp.nan)
        if port == "sway_acceleration":
            return value + sway * (yaw * v_alone - r_alone) / determinant
        return value + yaw * (sway * r_alone - v_alone) / determinant
