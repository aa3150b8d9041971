"""Effects of the wind and of a current on a vessel."""

import math
from collections.abc import Collection, Mapping, Sequence

import jax.numpy as jnp

from diffthrust.effects._forms import from_zero
from diffthrust.models._base.component import Component, registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Signal, Signals


@registered
class WaterCurrent(Effect):
    """The water moves over ground with a constant velocity.

    Hull and drive feel the speeds through the water: surge and sway over ground less the current's
    components ahead and to starboard. The states stay speeds over ground, whose accelerations
    gain what the turning axes make of a constant velocity. ``to_north`` and ``to_east`` [m/s] say
    where the water goes. In logs that do not measure the heading it counts from the first sample,
    and north is where the bow points then. Null: to_north = 0, to_east = 0.
    Source: Fossen 2011, section 8.3 (irrotational constant current).

    Example:
        >>> model = dft.Vessel() + dft.effects.WaterCurrent(to_north=0.1)
        >>> model.parameters["water_current.to_north"].range_text()
        '(-inf, inf) m/s'
    """

    name = "water_current"
    ports = ("surge_through_water", "sway_through_water", "surge_acceleration", "sway_acceleration")
    by_log = ("to_north", "to_east")
    to_north: float = parameter(
        0.1, "m/s", null=0.0, size=0.3, probes=relative_to("surge", -0.2, 0.2)
    )
    to_east: float = parameter(
        0.1, "m/s", null=0.0, size=0.3, probes=relative_to("surge", -0.2, 0.2)
    )

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        """How fast the water moves: logs without a heading do not tell where to."""
        return f"the water moves at {math.hypot(self.to_north, self.to_east):.2g} m/s"

    def size_words(self, starts: Sequence[Mapping[str, float]]) -> str:
        speeds = [math.hypot(s["to_north"], s["to_east"]) for s in starts]
        slowest, fastest = f"{min(speeds):.2g}", f"{max(speeds):.2g}"
        if slowest == fastest:
            return f"{slowest} m/s, elsewhere in each log"
        return f"{slowest} to {fastest} m/s, another in each log"

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        cos, sin = jnp.cos(s.heading), jnp.sin(s.heading)
        ahead = self.to_north * cos + self.to_east * sin
        aside = self.to_east * cos - self.to_north * sin
        if port == "surge_through_water":
            return value - ahead
        if port == "sway_through_water":
            return value - aside
        # in the turning axes of the vessel a constant velocity of the water rotates: its rate is -r
        # x current
        return value + s.yaw_rate * (aside if port == "surge_acceleration" else -ahead)


@registered
class Wind(Effect):
    """The wind pushes on what stands above the water.

    With a and b [m/s] the components ahead and to starboard of the velocity of the air relative to
    the vessel, and V their length:

        surge force + along a V,   sway force + across b V,   yaw moment + turning b V

    ``along`` and ``across`` are in N s^2/m^2, ``turning`` in N s^2/m, divided by A where the
    vessel's parameters are. Where the log has ``wind_speed`` [m/s] and ``wind_direction`` [rad]
    (over ground, from where it blows, clockwise from north), ``direction`` is the misalignment of
    the vane. Where it has not, a constant wind of ``speed`` blows from ``direction``; the speed is
    held at its value, because only its square times the other three shows in a log. Directions
    count from the first heading in logs that do not measure it.
    Null: along = 0, across = 0, turning = 0 (the direction then has no influence).
    Source: Fossen 2011, section 8.1.

    Example:
        >>> model = dft.Vessel() + dft.effects.Wind(along=0.01)
        >>> model.parameters["wind.along"].range_text()
        '[0, inf) N s^2/m^2/A'
    """

    name = "wind"
    in_words = "the wind pushes the vessel"
    ports = ("surge_force", "sway_force", "yaw_moment")
    along: float = from_zero(0.01, "N s^2/m^2", size=0.05, probes=relative_to("propulsion", 0.003))
    across: float = from_zero(0.02, "N s^2/m^2", size=0.1, probes=relative_to("propulsion", 0.006))
    turning: float = parameter(
        0.005, "N s^2/m", null=0.0, size=0.05, probes=relative_to("propulsion", 0.001)
    )
    direction: float = parameter(
        0.0, "rad", bounds=(-math.pi, math.pi), size=1.0, probes=(-2.4, -0.8, 0.8, 2.4)
    )
    speed: float = parameter(5.0, "m/s", bounds=(0, None), fixed=True)

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        """From where it blows and how fast it is taken to be; nothing where logs measure it.

        Logs without a heading do not tell from where.
        """
        if "wind_speed" in recorded:
            return ""
        degrees = round(math.degrees(self.direction)) % 360
        origin = f" from {degrees} deg" if "heading" in recorded else ""
        return f"a wind{origin} pushes the vessel, taken as {self.speed:.2g} m/s"

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        measured = "wind_speed" in s
        speed = s.wind_speed if measured else self.speed
        origin = self.direction + (s.wind_direction if measured else 0.0)
        to_north, to_east = -speed * jnp.cos(origin), -speed * jnp.sin(origin)
        cos, sin = jnp.cos(s.heading), jnp.sin(s.heading)
        a = to_north * cos + to_east * sin - s.surge
        b = to_east * cos - to_north * sin - s.sway
        # in a calm the root has no derivative at zero
        length = jnp.sqrt(a * a + b * b + 1e-12)
        if port == "surge_force":
            return value + self.along * a * length
        return value + (self.across if port == "sway_force" else self.turning) * b * length
