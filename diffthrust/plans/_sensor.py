"""The plan for the calibration of a depth sensor."""

from __future__ import annotations

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite
from diffthrust.logs._log import Log
from diffthrust.models import LinearSensor
from diffthrust.papers._commands import staircase
from diffthrust.plans._checks import checked_limits
from diffthrust.plans._plan import Plan


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
