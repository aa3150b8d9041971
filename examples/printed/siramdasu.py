"""The figures that Siramdasu & Fahimi 2013 print, beside what follows from their own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from printed.printed import Printed

from diffthrust import Log, Vessel, simulate
from diffthrust.papers.siramdasu import sensitivity

_SPEEDS, _CIRCLING = (69.2, 98.0, 120.0), 98.0
_ANGLES = (-24.0, -16.0, 8.0, 16.0, 24.0)
_UNITS = {"propeller_speed": "rev/s", "rudder_angle": "rad"}
_MEASURED = {"surge": "m/s", "sway": "m/s", "yaw_rate": "rad/s"}
_SETTLE = 9.0
_WRONG = 0.05
"""What one steady speed is too low by, as a share, for the sensitivity."""


def printed_figures() -> list[Printed]:
    """Every printed figure of the paper.

    The numbers of tables 2 and 3 are lost in the scan, and the distance L of the propeller is not
    printed. What the wind did to the boat of figures 16 to 18 is not either;
    ``examples/path_tracking.py`` runs that test in a wind of its own.

    Example:
        >>> print(printed_table(printed_figures()))
    """
    boat = Vessel()
    straight = [_record(boat, n, 0.0, 15.0) for n in _SPEEDS]
    circles = [_record(boat, _CIRCLING, angle, 20.0) for angle in _ANGLES]
    return [*_ratios(boat), *_speeds(boat, straight),
            *_signs(boat), *_sensitivity(straight, circles)]  # fmt: skip


def _ratios(boat: Vessel) -> list[Printed]:
    names = {"exponent": "C", "d11": "d11/A", "m11": "m11/A", "m22": "m22/A", "d22": "d22/A",
             "d33": "d33/A", "i33": "I33/A"}  # fmt: skip
    units = {"m": "s^(2-C)/m", "d": "s^(1-C)/m"}
    yaw = {"d33": "m s^(1-C)", "i33": "m s^(2-C)"}
    rows = [
        Printed(printed, boat.parameters[name].value, None, yaw.get(name, units.get(name[0], "")),
                "measured; of its runs only figures that cannot be read are printed")
        for name, printed in names.items()
    ]  # fmt: skip
    return [
        *rows,
        Printed("lambda of surge", 1.30, boat.m11 / boat.d11, "s", "m11 / d11"),
        Printed("lambda of yaw", 1.56, boat.i33 / boat.d33, "s",
                f"I33 / d33 as printed; lambda = 1.56 s would take I33/A = {1.56 * boat.d33:.2f}"),
    ]  # fmt: skip


def _speeds(boat: Vessel, straight: list[Log]) -> list[Printed]:
    rest = [float(log.measured["surge"][-1]) for log in straight]
    speeds = ", ".join(f"{u:.3f}" for u in rest)

    def turning(speed: float) -> float:
        return (boat.d11 * speed) ** (1.0 / boat.exponent)

    return [
        Printed("n for 0.8 m/s", 76.4, turning(0.8), "rev/s", "(d11/A 0.8)^(1/C)"),
        Printed("steady speed of the tests", 0.75, rest[_SPEEDS.index(_CIRCLING)], "m/s",
                f"at n = 98, 15 s from rest; all three straight runs lie above it: {speeds} m/s; "
                f"0.75 m/s takes {turning(0.75):.1f} rev/s"),
        Printed("section 5.2, before the turn", 0.8, None, "m/s",
                "section 5.2 prints no n; at the n = 98 of section 5.1 it would be "
                f"{rest[_SPEEDS.index(_CIRCLING)]:.3f} m/s"),
    ]  # fmt: skip


def _signs(boat: Vessel) -> list[Printed]:
    """The equations as printed, at rest in the widest circle of the tests."""
    angle = math.radians(_ANGLES[-1])
    ended = _record(boat, _CIRCLING, _ANGLES[-1], 60.0).measured
    u, v, r = (float(ended[name][-1]) for name in _MEASURED)
    push = _CIRCLING**boat.exponent * math.sin(angle)
    turn, pull = (boat.m22 - boat.m11) * u * v, boat.lever_arm * push
    return [
        Printed("sign of L, equations (3), (8)", 1.0, (turn + boat.d33 * r) / pull, "",
                "that of (15) and (16): a propeller that pushes the stern to starboard turns the "
                "bow to port. L is not printed"),
        Printed("sign of (m22 - m11) u v, (16)", 1.0, (boat.d33 * r + pull) / turn, "",
                "that of (8) and (15): (16) is (8) with the other sign of r, (15) with that of L"),
        Printed("d22/A by equation (14)", boat.d22, (boat.m11 * u * r - push) / v, "s^(1-C)/m",
                "as printed, in a simulated circle: (14) moves d22 v of (7) to the other side and "
                "keeps its sign"),
    ]  # fmt: skip


def _sensitivity(straight: list[Log], circles: list[Log]) -> list[Printed]:
    middle = straight[_SPEEDS.index(_CIRCLING)]
    slow = replace(
        middle, measured={**middle.measured, "surge": (1.0 - _WRONG) * middle.measured["surge"]}
    )
    result = sensitivity([slow if log is middle else log for log in straight], circles,
                        settle=_SETTLE)  # fmt: skip
    exponents = [vessel.exponent for vessel in result.vessels]
    return [
        Printed("figure 11: paths apart within 20 s", 0.4, None, "m",
                "the scatter of figure 3 and table 3 are not legible; from pairs of speeds with "
                f"the middle one {100 * _WRONG:g} % too low, chosen here, it is "
                f"{result.spread:.2f} m, and C from {min(exponents):.2f} to {max(exponents):.2f}"),
    ]  # fmt: skip


def _record(boat: Vessel, n: float, angle: float, duration: float) -> Log:
    """A run from rest; the propeller turns to ``angle`` [deg] at 5 s."""
    time = np.arange(0.0, duration + 1e-9, 0.1)
    inputs = {
        "propeller_speed": np.full(time.size, n),
        "rudder_angle": np.where(time >= 5.0, math.radians(angle), 0.0),
    }
    result = simulate(boat, Log(time, inputs, units=_UNITS))
    measured = {name: result[name] for name in _MEASURED}
    return Log(time, inputs, measured, {**_UNITS, **_MEASURED})
