"""How large a hidden effect is: its parameters from one number that is 0 at the null.

Sizes are fractions of the plant's own scale (command, speed, drive torque, thrust at the top of
the range) or seconds, so that they mean the same for every plant. They are calibrated with
`visibility`: the log-likelihood ratio (twice the difference) of the truth against the basic model
refitted, by an optimal filter that knows the noise.

    clear   the basic model's error exceeds the noise at least 1.5 times in some channel
    faint   the ratio is some 30 to 60: invisible to the eye, sure to an optimal test; the size in
            the table is typical, that of each set follows from its own plant and inputs
    field   under process noise and bad sensors the ratio is above 40, so larger than clear
    limit   a tenth of faint: a ratio near 0.5, which no test can see
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

Scale = Mapping[str, float]
STEP = 0.05


class Size(NamedTuple):
    """A row of the table: three sizes, parameters from size and scale, and whether signs vary."""

    clear: float
    faint: float | None
    field: float
    parameters: Callable[[float, Scale], dict[str, float]]
    signed: bool = False


THRUSTER: dict[str, Size] = {
    "command_deadband": Size(0.03, 0.001, 0.05, lambda x, k: {"band": x * k["command"]}),
    "command_saturation": Size(0.12, 0.003, 0.3, lambda x, k: {"limit": (1.0 - x) * k["command"]}),
    # At the null the largest step, from end to end of the range, just passes in one sample.
    "command_rate_limit": Size(
        0.7, 0.06, 0.85, lambda x, k: {"rate": 2.0 * k["command"] * (1.0 - x) / STEP}
    ),
    "command_delay": Size(0.08, 0.0016, 0.15, lambda x, k: {"delay": x}),
    "command_offset": Size(0.01, 0.0003, 0.04, lambda x, k: {"offset": x * k["command"]}, True),
    "actuator_lag": Size(0.08, 0.0013, 0.2, lambda x, k: {"time_constant": x}),
    "reverse_drive_asymmetry": Size(0.08, 0.0022, 0.15, lambda x, k: {"change": x}, True),
    "supply_voltage_sag": Size(0.7, 0.027, 0.8, lambda x, k: {"share": x}),
    "linear_damping": Size(0.15, 0.004, 0.15, lambda x, k: {"rate": x * k["alpha"] * k["speed"]}),
    "coulomb_friction": Size(0.015, 0.0006, 0.05, lambda x, k: {"friction": x * k["drive"]}),
    "static_friction": Size(0.1, 0.03, 0.12, lambda x, k: {"friction": x * k["drive"]}),
    "reverse_load_asymmetry": Size(0.09, 0.0027, 0.15, lambda x, k: {"change": x}, True),
    "inflow_load_relief": Size(
        0.05, 0.0023, 0.3, lambda x, k: {"relief": x * k["alpha"] * k["speed"]}
    ),
    "reverse_thrust_asymmetry": Size(0.07, 0.0035, 0.15, lambda x, k: {"change": x}, True),
    "inflow_thrust_loss": Size(0.07, 0.0021, 0.3, lambda x, k: {"loss": x * k["ct"] * k["speed"]}),
    "axial_flow": Size(
        0.25,
        0.0065,
        0.4,
        # The water in the duct settles within a second or two at 1.5 m/s.
        lambda x, k: {
            "loss": x * k["ct"] * k["speed"] / 1.5,
            "mass": k["thrust"] / 1.5,
            "linear_drag": 0.1 * k["thrust"] / 1.5,
            "quadratic_drag": 0.9 * k["thrust"] / 1.5**2,
        },
    ),
    "cavitation": Size(0.15, 0.009, 0.3, lambda x, k: {"shortfall": x, "onset": 0.65 * k["speed"]}),
    "thrust_degradation": Size(0.07, 0.0037, 0.15, lambda x, k: {"fraction": x, "instant": 55.0}),
    "speed_sensor_offset": Size(0.015, 0.0009, 0.04, lambda x, k: {"offset": x * k["speed"]}, True),
    "thrust_sensor_offset": Size(
        0.015, 0.0008, 0.04, lambda x, k: {"offset": x * k["thrust"]}, True
    ),
    "thrust_sensor_lag": Size(0.06, 0.0018, 0.2, lambda x, k: {"time_constant": x}),
    "thrust_sensor_delay": Size(0.06, 0.0013, 0.15, lambda x, k: {"delay": x}),
    "thrust_exponent": Size(
        0.12, 0.007, 0.3, lambda x, k: {"exponent": 2.0 - x, "reference": 0.6 * k["speed"]}, True
    ),
    "load_exponent": Size(
        0.12, 0.006, 0.3, lambda x, k: {"exponent": 2.0 - x, "reference": 0.6 * k["speed"]}, True
    ),
}

#: Exactly the same as other values of the free base parameters: nothing can find these.
REDUNDANT: dict[str, Size] = {
    "speed_sensor_scale": Size(0.1, None, 0.1, lambda x, k: {"change": x}, True),
    "thrust_sensor_scale": Size(0.1, None, 0.1, lambda x, k: {"change": x}, True),
}

OUTSIDE: dict[str, Size] = {
    "command_play": Size(0.1, None, 0.1, lambda x, k: {"play": x * k["command"]}),
    "motor_heating": Size(0.6, None, 0.6, lambda x, k: {"loss": x, "warm": k["drive"]}),
    "load_hump": Size(
        0.15, None, 0.15, lambda x, k: {"height": x * k["drive"], **_bump(0.55, 0.12, k["speed"])}
    ),
    "load_memory": Size(0.4, None, 0.4, lambda x, k: {"relief": x * k["alpha"]}),
    "brush_loss": Size(
        0.15, None, 0.15, lambda x, k: {"loss": x * k["beta"], "rest": 0.1 * k["speed"]}
    ),
    "thrust_hollow": Size(
        0.3, None, 0.3, lambda x, k: {"depth": x, **_bump(0.55, 0.12, k["speed"])}
    ),
    "reverse_stall": Size(
        0.3,
        None,
        0.3,
        lambda x, k: {"depth": x, **_bump(0.5, 0.05, k["speed"])},
    ),
}

VESSEL: dict[str, Size] = {
    "swapped_thrusters": Size(1.0, None, 1.0, lambda x, k: {"swapped": x}),
    "differential_gain": Size(0.02, 0.0005, 0.15, lambda x, k: {"gain": x}, True),
    "rudder_rate_limit": Size(
        0.8, 0.06, 0.97, lambda x, k: {"rate": np.radians(48.0) * (1.0 - x) / 0.1}
    ),
    "propeller_lag": Size(0.25, 0.0053, 1.0, lambda x, k: {"time_constant": x}),
    "rudder_lag": Size(0.15, 0.0032, 0.6, lambda x, k: {"time_constant": x}),
    "rudder_offset": Size(0.01, 0.00025, 0.06, lambda x, k: {"offset": x}, True),
    "reverse_propeller_asymmetry": Size(0.1, 0.003, 0.3, lambda x, k: {"change": -x}),
    "propeller_inflow": Size(0.3, 0.008, 0.4, lambda x, k: {"loss": x / k["surge"]}),
    "rudder_inflow": Size(0.15, 0.0045, 0.6, lambda x, k: {"gain": x / k["surge"]}),
    "propeller_walk": Size(0.01, 0.00025, 0.05, lambda x, k: {"fraction": x}, True),
    "quadratic_surge_drag": Size(
        0.8, 0.04, 0.8, lambda x, k: {"drag": x * k["force"] / k["surge"] ** 2}
    ),
    "quadratic_sway_drag": Size(
        0.7, 0.04, 0.7, lambda x, k: {"drag": x * k["force"] / k["surge"] ** 2}
    ),
    "quadratic_yaw_drag": Size(
        0.2, 0.007, 0.6, lambda x, k: {"drag": x * k["moment"] / k["yaw_rate"] ** 2}
    ),
    "wind": Size(
        0.005,
        0.0001,
        0.05,
        lambda x, k: {
            "along": x * k["force"] / 16.0,
            "across": 1.5 * x * k["force"] / 16.0,
            "turning": 0.3 * x * k["force"] / 16.0,
        },
    ),
    "water_current": Size(
        0.02,
        0.0004,
        0.15,
        lambda x, k: {"to_north": x * k["surge"], "to_east": -0.7 * x * k["surge"]},
    ),
    "sway_yaw_coupling": Size(0.2, 0.0037, 0.6, lambda x, k: {"mass": x, "damping": x}),
    "force_exponent": Size(
        0.06, 0.003, 0.1, lambda x, k: {"exponent": 1.0 + x, "reference": 0.6 * k["force"]}, True
    ),
}

VESSEL_OUTSIDE: dict[str, Size] = {
    "resistance_hump": Size(
        0.25,
        None,
        0.25,
        lambda x, k: {"height": x * k["force"], **_bump(0.75, 0.12, k["surge"])},
    ),
    "bow_wave_turning": Size(
        0.3,
        None,
        0.3,
        lambda x, k: {"moment": x * k["moment"], **_bump(0.75, 0.12, k["surge"])},
    ),
    "heading_ripple": Size(
        0.15, None, 0.15, lambda x, k: {"moment": x * k["moment"], "waves": 5.0}
    ),
}


def _bump(middle: float, width: float, top: float) -> dict[str, float]:
    return {"middle": middle * top, "width": width * top}


ALL = {**THRUSTER, **REDUNDANT, **OUTSIDE, **VESSEL, **VESSEL_OUTSIDE}


def drawn(name: str, size: float, rng: np.random.Generator) -> float:
    """About a size (within a tenth), of either sign where the effect has one."""
    sign = rng.choice([-1.0, 1.0]) if ALL[name].signed else 1.0
    return float(size * rng.uniform(0.9, 1.1) * sign)


def hidden(chosen: Mapping[str, float], scale: Scale) -> dict[str, dict[str, float]]:
    """Parameters of effects of these sizes, for the reference simulator."""
    return {name: ALL[name].parameters(size, scale) for name, size in chosen.items()}
