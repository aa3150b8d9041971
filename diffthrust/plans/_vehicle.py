"""Plans for a vehicle: straight runs and circles, and the calibration of its depth sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite
from diffthrust.logs._log import Log
from diffthrust.models import LinearSensor, Vessel
from diffthrust.papers._commands import staircase
from diffthrust.plans._plan import Plan
from diffthrust.plans._settling import checked_limits, settling_time

_SPEEDS = ("surge", "sway", "yaw_rate")
_UNITS = {"propeller_speed": "rev/s", "rudder_angle": "rad"}


def sequential(
    model: Vessel,
    *,
    speeds: Sequence[float] | np.ndarray,
    angles: Sequence[float] | np.ndarray,
    circling: float | None = None,
    straight: float = 5.0,
    hold: float = 5.0,
    step: float = 0.1,
    settle: float | None = None,
) -> Plan:
    """Straight runs from rest at several propeller speeds; circles at one of them, by angle.

    A circle begins with a straight stretch. Every run lasts until the speeds have settled, and
    ``hold`` seconds more.

    Args:
        model: a vessel with a propeller, as it is believed to be.
        speeds: of the propeller [rev/s], two or more.
        angles: of the propeller or rudder [rad], to both sides.
        circling: propeller speed of the circles [rev/s]; the middle one of ``speeds`` where not
            given.
        straight: the straight stretch of a circle [s].
        hold: how long to measure [s].
        step: time between samples [s].
        settle: how long to wait [s]; by the model where not given.

    Raises:
        InputError: no vessel with a propeller, fewer than two speeds, angles to one side only or
            beyond a right angle, a model that does not settle.

    Source: Siramdasu & Fahimi 2013, sections 3.1 and 3.2.

    Example:
        >>> angles = np.radians([-24, 24])
        >>> plan = dft.plans.sequential(dft.Vessel(), speeds=[69.2, 98], angles=angles)
        >>> list(plan.runs)
        ['straight_69.2', 'straight_98', 'circle_-24', 'circle_+24']
    """
    if not isinstance(model, Vessel) or model.drive != "propeller":
        raise InputError(
            f"sequential: expected a vessel with a propeller, found {model!s}.",
            "Give dft.Vessel().",
        )
    ahead = sorted({finite("sequential, speeds", n, lambda x: x > 0, "rev/s, above zero")
                    for n in speeds})  # fmt: skip
    turned = sorted({finite("sequential, angles", a, lambda x: abs(x) < 0.5 * math.pi,
                            "rad, less than a right angle") for a in angles} - {0.0})  # fmt: skip
    if len(ahead) < 2 or not turned or turned[0] > 0 or turned[-1] < 0:
        raise InputError(
            f"sequential: expected two or more propeller speeds and angles to both sides, found "
            f"{ahead} rev/s and {turned} rad.",
            "Give speeds=[69.2, 98, 120] and angles=np.radians([-24, -8, 8, 24]).",
        )
    around = ahead[len(ahead) // 2] if circling is None else circling
    if settle is None:
        # The slowest of each kind: the lowest speed straight ahead, and the tightest circle, whose
        # sway and yaw settle with each other.
        widest = max(abs(a) for a in turned)
        settle = max(
            settling_time(model, ("surge",), {"propeller_speed": ahead[0], "rudder_angle": 0.0}),
            settling_time(model, _SPEEDS, {"propeller_speed": around, "rudder_angle": widest}),
        )
    runs = {f"straight_{n:g}": _run(n, 0.0, 0.0, settle + hold, step) for n in ahead}
    runs |= {
        f"circle_{math.degrees(a):+.0f}": _run(around, a, straight, settle + hold, step)
        for a in turned
    }
    return Plan(
        name="sequential",
        source="Siramdasu & Fahimi 2013, sections 3.1 and 3.2",
        runs=runs,
        settle=settle,
        measure=_SPEEDS,
        note="Start every run at rest; leave out runs with gusts.",
    )


def _run(n: float, angle: float, ahead: float, behind: float, step: float) -> Log:
    time = step * np.arange(round((ahead + behind) / step) + 1)
    turned = np.where(time >= ahead - 1e-9, angle, 0.0)
    return Log(
        time, {"propeller_speed": np.full(time.size, n), "rudder_angle": turned}, units=_UNITS
    )


def depth_calibration(
    limits: tuple[float, float],
    *,
    sensor: LinearSensor | None = None,
    readable: tuple[float, float] | None = None,
    levels: int = 13,
    readings: int = 3,
    time_constant: float = 1.0,
    hold: float = 5.0,
    step: float = 0.1,
) -> Plan:
    """Depths held one after the other, several times, alternately downward and upward.

    The way back separates drift and hysteresis of the sensor from its line. At each depth the
    reading first settles to a hundredth, which takes 4.6 time constants.

    Args:
        limits: least and greatest depth [m].
        sensor: the sensor as expected, to check the range of its readings; by default the
            datasheet's line.
        readable: lowest and highest reading that the sensor and the converter can give [V].
        levels: number of depths, evenly spaced, including both limits.
        readings: number of passes.
        time_constant: of the sensor's filter, or of the device that moves it [s].
        hold: time to measure at each depth [s].
        step: time between samples [s].

    Raises:
        InputError: limits without a range or above the water, fewer than three levels, readings
            beyond what is readable.

    Source: Aras et al. 2013, section 4.2 and table 4 (13 depths from 0 to 12 feet, three times).

    Example:
        >>> sensor = dft.LinearSensor(slope=0.16, offset=1.6)
        >>> plan = dft.plans.depth_calibration((0, 3.6576), sensor=sensor, readable=(0.2, 4.9))
        >>> plan.measure
        ('reading',)
    """
    low, high = checked_limits("depth_calibration", limits, "depth")
    finite("depth_calibration, limits", low, lambda x: x >= 0, "a least depth [m], zero or more")
    finite("depth_calibration, time_constant", time_constant, lambda x: x > 0,
           "seconds, above zero")  # fmt: skip
    count = int(finite("depth_calibration, levels", levels, lambda x: x >= 3, "3 or more"))
    times = int(finite("depth_calibration, readings", readings, lambda x: x >= 1, "1 or more"))
    line = LinearSensor() if sensor is None else sensor
    ends = sorted(line.slope * x + line.offset for x in (low, high))
    if readable and not readable[0] <= ends[0] <= ends[1] <= readable[1]:
        raise InputError(
            f"depth_calibration: {low:g} to {high:g} m would read {ends[0]:.3g} to {ends[1]:.3g} "
            f"V, beyond the {readable[0]:g} to {readable[1]:g} V that can be read.",
            "Narrow the limits, or give the sensor's own slope and offset: sensor=LinearSensor().",
        )
    settle, down = np.log(100.0) * time_constant, np.linspace(low, high, count)
    runs = {}
    for i in range(times):
        time, depth = staircase((down[::-1] if i % 2 else down).tolist(), settle + hold, step)
        name = f"reading_{i + 1}_{'up' if i % 2 else 'down'}"
        runs[name] = Log(time, {"depth": depth}, units={"depth": "m"})
    return Plan(
        name="depth_calibration",
        source="Aras et al. 2013, section 4.2",
        runs=runs,
        settle=float(settle),
        measure=("reading",),
        note="Note the reading in air: the sensor measures absolute pressure.",
    )
