"""Hidden effects of the thruster: small functions in a table, each with the place where it acts.

A function's keyword defaults are its null values: with them it changes nothing, exactly. To add
an effect, write the function and enter it in ``THRUSTER``; effects at one place act in the order
of the table. Signatures by place (``s`` are the signals of the instant, see ``thruster.Signals``):

    schedule        f(times, values) -> times, values      of the command, before the run
    command         f(command, s) -> command [V]
    drive           f(drive, s) -> drive [rad/s^2]         beta * command
    load            f(load, s) -> load [rad/s^2]           alpha * speed |speed|
    shaft           f(acceleration, s) -> acceleration [rad/s^2]
    friction        f(level, breakaway) -> level, breakaway [rad/s^2]
    thrust          f(thrust, s) -> thrust [N]
    speed_sensor    f(reading, s) -> reading [rad/s]       and thrust_sensor [N]
    speed_time      f(times) -> times at which the reading was true, and thrust_time

An entry with ``state=True`` has a state of its own, at zero when the run begins, and takes it as
its third argument: f(value, s, own) -> value, rate of own. Its first parameter at null drops it.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np


class Effect(NamedTuple):
    """A row of the table."""

    place: str
    function: Callable[..., Any]
    state: bool = False

    @property
    def null(self) -> dict[str, float]:
        """Parameters with their null values, the main one first."""
        found = inspect.signature(self.function).parameters.values()
        return {p.name: p.default for p in found if p.default is not p.empty}

    def sizes(self, given: float | Mapping[str, float]) -> dict[str, float]:
        """All parameters: nulls, overridden by a mapping or by a number for the main one."""
        null = self.null
        if not isinstance(given, Mapping):
            given = {next(iter(null)): given}
        if unknown := set(given) - set(null):
            raise TypeError(f"{self.function.__name__}: expected {list(null)}, found {unknown}")
        return {name: float(value) for name, value in {**null, **given}.items()}


# Command path.


def command_delay(times, values, *, delay=0.0):
    """Transport delay of the command link, ``delay`` [s]."""
    return times + delay, values


def command_rate_limit(times, values, *, rate=math.inf):
    """The controller ramps its command by at most ``rate`` [V/s], once per sample."""
    out = np.array(values, float)
    for k in range(1, len(out)):
        most = rate * (times[k] - times[k - 1])
        out[k] = out[k - 1] + min(max(values[k] - out[k - 1], -most), most)
    return times, out


def command_offset(command, s, *, offset=0.0):
    """The controller adds ``offset`` [V]."""
    return command + offset


def command_deadband(command, s, *, band=0.0):
    """Commands below ``band`` [V] do nothing, and the band is lost from larger ones."""
    return math.copysign(max(abs(command) - band, 0.0), command)


def command_saturation(command, s, *, limit=math.inf):
    """The amplifier gives at most ``limit`` [V]."""
    return min(max(command, -limit), limit)


def reverse_drive_asymmetry(drive, s, *, change=0.0):
    """Beta is larger by the fraction ``change`` for reverse commands."""
    return drive * (1.0 + change) if drive < 0.0 else drive


def supply_voltage_sag(drive, s, *, share=0.0, nominal=24.0):
    """The fraction ``share`` of the drive follows the supply voltage, ``nominal`` [V]."""
    return drive * (1.0 + share * (s.supply_voltage / nominal - 1.0))


def actuator_lag(drive, s, own, *, time_constant=0.0):
    """First-order lag of the current, L/R [s] (Aras 2013, motor equations)."""
    return own, (drive - own) / time_constant


# Shaft.


def linear_damping(acceleration, s, *, rate=0.0):
    """Back-EMF or viscous friction, ``rate`` [1/s]."""
    return acceleration - rate * s.speed


def coulomb_friction(level, breakaway, *, friction=0.0):
    """Dry friction of seals and bearings, ``friction`` [rad/s^2] (Armstrong-Helouvry 1994)."""
    return level + friction, max(breakaway, level + friction)


def static_friction(level, breakaway, *, friction=0.0):
    """Stiction: at rest the shaft bears pushes up to ``friction`` [rad/s^2]."""
    return level, max(breakaway, friction)


def reverse_load_asymmetry(load, s, *, change=0.0):
    """Alpha is larger by the fraction ``change`` in reverse."""
    return load * (1.0 + change) if s.direction < 0 else load


def inflow_load_relief(load, s, *, relief=0.0):
    """The load falls by ``relief`` [1/m] times |speed| times inflow."""
    return load - relief * abs(s.speed) * s.inflow


# Propeller and duct.


def reverse_thrust_asymmetry(thrust, s, *, change=0.0):
    """Ct is larger by the fraction ``change`` in reverse."""
    return thrust * (1.0 + change) if s.speed < 0.0 else thrust


def inflow_thrust_loss(thrust, s, *, loss=0.0):
    """T = ct W|W| - loss |W| ua, ``loss`` [N s^2/(m rad)] (Kim & Chung 2006; Fossen 1994)."""
    return thrust - loss * abs(s.speed) * s.inflow


def axial_flow(thrust, s, own, *, loss=0.0, mass=20.0, linear_drag=1.0, quadratic_drag=10.0):
    """The duct's water moves at up = ``own`` [m/s] (Healey et al. 1995; Fossen & Blanke 2000).

    T = ct W|W| - loss |W| up;  mass up' = T - linear_drag up - quadratic_drag |up| up.
    """
    thrust = thrust - loss * abs(s.speed) * own
    return thrust, (thrust - linear_drag * own - quadratic_drag * abs(own) * own) / mass


def cavitation(thrust, s, *, shortfall=0.0, onset=40.0):
    """Of the thrust gained above the ``onset`` [rad/s] the fraction ``shortfall`` is missing."""
    if abs(s.speed) <= onset:
        return thrust
    return thrust * (1.0 - shortfall * (1.0 - (onset / s.speed) ** 2))


def thrust_degradation(thrust, s, *, fraction=0.0, instant=30.0):
    """Obstruction or ventilation: ``fraction`` of the thrust is lost from ``instant`` [s] on."""
    return thrust * (1.0 - fraction) if s.time >= instant else thrust


def other_power(value, s, *, exponent=2.0, reference=40.0):
    """Of ``exponent`` instead of 2, the same at the ``reference`` speed [rad/s]."""
    return value * (abs(s.speed) / reference) ** (exponent - 2.0) if s.speed else value


# Sensors.


def sensor_scale(reading, s, *, change=0.0):
    """The sensor reads too much by the fraction ``change``."""
    return reading * (1.0 + change)


def sensor_offset(reading, s, *, offset=0.0):
    """The sensor adds ``offset`` (tare)."""
    return reading + offset


def sensor_lag(reading, s, own, *, time_constant=0.0):
    """The sensor is a first-order lag of ``time_constant`` [s]."""
    return own, (reading - own) / time_constant


def sensor_delay(times, *, delay=0.0):
    """The reading is ``delay`` [s] old."""
    return times - delay


THRUSTER: dict[str, Effect] = {
    "command_rate_limit": Effect("schedule", command_rate_limit),
    "command_delay": Effect("schedule", command_delay),
    "command_offset": Effect("command", command_offset),
    "command_deadband": Effect("command", command_deadband),
    "command_saturation": Effect("command", command_saturation),
    "reverse_drive_asymmetry": Effect("drive", reverse_drive_asymmetry),
    "supply_voltage_sag": Effect("drive", supply_voltage_sag),
    "actuator_lag": Effect("drive", actuator_lag, state=True),
    "reverse_load_asymmetry": Effect("load", reverse_load_asymmetry),
    "inflow_load_relief": Effect("load", inflow_load_relief),
    "linear_damping": Effect("shaft", linear_damping),
    "coulomb_friction": Effect("friction", coulomb_friction),
    "static_friction": Effect("friction", static_friction),
    "reverse_thrust_asymmetry": Effect("thrust", reverse_thrust_asymmetry),
    "inflow_thrust_loss": Effect("thrust", inflow_thrust_loss),
    "axial_flow": Effect("thrust", axial_flow, state=True),
    "cavitation": Effect("thrust", cavitation),
    "thrust_degradation": Effect("thrust", thrust_degradation),
    "thrust_exponent": Effect("thrust", other_power),
    "load_exponent": Effect("load", other_power),
    "speed_sensor_scale": Effect("speed_sensor", sensor_scale),
    "speed_sensor_offset": Effect("speed_sensor", sensor_offset),
    "speed_sensor_lag": Effect("speed_sensor", sensor_lag, state=True),
    "speed_sensor_delay": Effect("speed_time", sensor_delay),
    "thrust_sensor_scale": Effect("thrust_sensor", sensor_scale),
    "thrust_sensor_offset": Effect("thrust_sensor", sensor_offset),
    "thrust_sensor_lag": Effect("thrust_sensor", sensor_lag, state=True),
    "thrust_sensor_delay": Effect("thrust_time", sensor_delay),
}


class Chain:
    """The chosen effects of a catalogue, sorted by place."""

    def __init__(
        self,
        catalogue: Mapping[str, Effect],
        chosen: Mapping[str, float | Mapping[str, float]],
    ) -> None:
        """Look every chosen effect up and complete its parameters."""
        if unknown := set(chosen) - set(catalogue):
            raise TypeError(f"no such hidden effect: {sorted(unknown)}")
        self.sizes: dict[str, dict[str, float]] = {}
        self.places: dict[str, list[tuple[Callable[..., Any], dict[str, float], int | None]]] = {}
        self.states = 0
        for name, effect in catalogue.items():
            if name not in chosen:
                continue
            sizes = self.sizes[name] = effect.sizes(chosen[name])
            own = None
            if effect.state:
                main = next(iter(effect.null))
                if sizes[main] == effect.null[main]:
                    continue
                own, self.states = self.states, self.states + 1
            self.places.setdefault(effect.place, []).append((effect.function, sizes, own))

    def apply(self, place: str, *values: Any) -> Any:
        """Pass ``values`` through the stateless effects of a place; one value comes bare."""
        for function, sizes, _ in self.places.get(place, ()):
            result = function(*values, **sizes)
            values = result if isinstance(result, tuple) else (result,)
        return values if len(values) > 1 else values[0]

    def follow(self, place: str, value: Any, s: Any, owns: Any, rates: list[float]) -> Any:
        """Pass ``value`` through the effects of a place, filling in their states' rates."""
        for function, sizes, own in self.places.get(place, ()):
            if own is None:
                value = function(value, s, **sizes)
            else:
                value, rates[own] = function(value, s, owns[own], **sizes)
        return value
