"""The plan for a vessel: straight runs, and circles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite
from diffthrust.logs._log import Log
from diffthrust.models import Vessel
from diffthrust.plans._checks import settling_time
from diffthrust.plans._plan import Plan

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
