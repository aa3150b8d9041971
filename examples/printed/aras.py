"""The figures that Aras et al. 2013 print, beside what their own numbers give."""

from __future__ import annotations

import math

import numpy as np
from printed.printed import Printed
from printed.table_4 import table_4
from printed.transfer import linear_loop

from diffthrust.papers.aras import Calibration, Datasheet, calibrate, plant

_SURFACE = 1.848
"""Reading in air that section 4.2 prints [V]."""
_GRAVITY = 9.81


def printed_figures() -> list[Printed]:
    """Every printed figure of the paper.

    Example:
        >>> print(printed_table(printed_figures()))
    """
    rows = [*_table_4(calibrate(*table_4())), *_sensor(), *_encoder(), *_transfer()]
    order = list(dict.fromkeys(row.what for row in rows))
    return sorted(rows, key=lambda row: order.index(row.what))


def _table_4(c: Calibration) -> list[Printed]:
    d, slope, offset = c.datasheet, c.slope, c.offset
    held = "" if c.fits else "not "
    return [
        Printed("eq. 9, slope", d.slope, slope.value, "V/m",
                f"± {slope.std_error:.2g}, the mean of table 4's readings; eq. 9 is {held}held by "
                f"them: {c.tests['together']}"),
        Printed("eq. 9, offset", d.intercept, offset.value, "V",
                f"± {offset.std_error:.2g}; eq. 9 counts from no pressure at all, table 4 from the "
                "surface"),
        Printed("3 V as a depth", 6.082, c.depth(3.0), "m",
                f"by the line of table 4, whose deepest point is "
                f"{max(float(line.x.max()) for line in c.lines.values()):.4g} m"),
        Printed("0.41 m in a bucket, 1.912 V", 0.41, (1.912 - _SURFACE) / c.together.slope, "m",
                "above the 1.848 V of air, by the slope of table 4"),
    ]  # fmt: skip


def _sensor() -> list[Printed]:
    d = Datasheet()
    water = 1000.0 * _GRAVITY / 1000.0  # kPa/m
    return [
        Printed("3 V as a depth", 6.082, d.depth(3.0), "m", "by eq. 9 as printed"),
        Printed("3 V as a depth", 6.082, d.depth(3.0, surface=_SURFACE), "m",
                "by eq. 9 less the 1.848 V of air (10.2 m of water): so the paper seems to count"),
        Printed("deepest reading, 5 V", 16.57, d.depth(5.0, surface=_SURFACE), "m",
                "by eq. 9 less the 1.848 V of air"),
        Printed("depth range, 4.9 V", 26.0, d.depth(4.9), "m",
                "by eq. 9 with the atmosphere in it; section 4.3 has 70 m and 16.57 m"),
        Printed("deepest by the datasheet", 70.0, (250.0 - 101.325) / water, "m",
                "250 kPa absolute end the sensor's range"),
        Printed("0.41 m in a bucket, 1.912 V", 0.41, d.depth(1.912, surface=_SURFACE), "m",
                "above the 1.848 V of air, by the slope of eq. 9"),
        Printed("eq. 9, slope", 0.1901, 0.020 * water, "V/m",
                "by table 2, 20 mV/kPa, in fresh water"),
        Printed("output at 250 kPa", 4.9, 0.2 + 0.020 * 230.0, "V", "0.2 V at 20 kPa, 20 mV/kPa"),
        Printed("250 kPa", 36.3, 250.0 / 6.894757, "psi", ""),
        Printed("table 4, 12 feet", 3.6576, 12 * 0.3048, "m", ""),
        Printed("table 5, 1 hp", 746.0, 550 * 0.3048 * 0.45359237 * 9.80665, "W", ""),
    ]  # fmt: skip


def _encoder() -> list[Printed]:
    return [
        Printed("encoder, 14020 / 50", 280.4, 14020 / 50, "1/s", "called rad/s"),
        Printed("encoder's speed", 280.4, 280.4 * 2 * math.pi / 2000, "rad/s",
                "with the paper's own 2π/2000 rad a count, which it leaves out"),
        Printed("the same in km/h", 0.19, 1121.6 * 3.6, "km/h",
                "of 1121.6 m/s, itself 4 m x 280.4 1/s; no radius gives both"),
    ]  # fmt: skip


def _transfer() -> list[Printed]:
    g = plant()
    names = ("numerator, s", "numerator, 1", "denominator, s", "denominator, 1")
    printed = (*g.num, *g.den[1:])
    rows = [
        Printed(f"G(s), {name}", float(paper), None, "1/s" if name[-1] == "s" else "1/s²",
                "identified from a record that is not printed")
        for name, paper in zip(names, printed, strict=True)
    ]  # fmt: skip
    loop = linear_loop(1.0)
    poles = ", ".join(f"{pole:.3g}" for pole in np.sort(np.real(loop.poles)))
    return [
        *rows,
        Printed("set point reached, gain 1", 1.0, float(np.real(loop(0.0))), "",
                f"stable with eq. 12 (poles {poles} 1/s), but at rest half of the way is left"),
        Printed("command at rest, set point 13 V", 13.1, 13.0 * (1.0 - float(np.real(loop(0.0)))),
                "V", "by eq. 12 and gain 1; 13 V less the sensor's 3 V would be 10 V"),
    ]  # fmt: skip
