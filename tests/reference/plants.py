"""The equations of boats, thrusters and an axis for `compiled`, with what was named on real logs.

The boat is that of Siramdasu & Fahimi 2013, the thruster that of Yoerger, Cooke & Slotine 1990,
each with the terms of the sources that its parameters name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
from scipy.signal import lfilter

from . import whole_runs as wr
from .compiled import Parameter, Plant

Array = np.ndarray
_ALWAYS = float("nan")
"""The null of a parameter that no plant lacks."""


def _always(start: float, low: float = 0.0, high: float = 1e4) -> Parameter:
    return Parameter(start, low, high, _ALWAYS)


# --------------------------------------------------------------------------- boats

HULL = ("m11", "m22", "d11", "d22", "d33")
_BOAT = {
    "m11": _always(20.0, 0.01),
    "m22": _always(20.0, 0.01),
    "i33": _always(1.7, 1e-3),
    "d11": _always(30.0),
    "d22": _always(30.0),
    "d33": _always(5.0),
    "lever_arm": _always(0.285),
    "exponent": _always(1.0, 0.05, 4.0),
    "q_surge": Parameter(1.0, 0.0, 1e4),
    "q_sway": Parameter(1.0, 0.0, 1e4),
    "q_yaw": Parameter(1.0, 0.0, 1e4),
    "to_north": Parameter(0.1, -2.0, 2.0),
    "to_east": Parameter(0.1, -2.0, 2.0),
    "gain": Parameter(0.05, -1.0, 1.0),  # left (1 + gain), right (1 - gain)
    "share": Parameter(0.9, 0.0, 1.0),  # of each force that acts on the other side
    "power": Parameter(1.2, 0.3, 3.0, 1.0),  # of a force about the reference
    "reference": _always(10.0),
    "loss": Parameter(0.1, 0.0, 10.0),  # of thrust by surge, propeller inflow
    "astern": Parameter(-0.2, -1.0, 10.0),  # change of thrust astern
    "m23": Parameter(0.1, -1e3, 1e3),
    "d23": Parameter(0.1, -1e4, 1e4),
    "walk": Parameter(0.05, -1.0, 1.0),
    "rudder_gain": Parameter(0.3, -100.0, 100.0),  # of the side force by surge, rudder inflow
    "rudder_offset": Parameter(0.05, -0.8, 0.8),
    "along": Parameter(0.01, 0.0, 1e3),
    "across": Parameter(0.02, 0.0, 1e3),
    "turning": Parameter(0.005, -1e3, 1e3),
    "direction": Parameter(0.0, -np.pi, np.pi),
    "wind_speed_held": _always(5.0),
}
_AT = {name: k for k, name in enumerate(_BOAT)}
(_M11, _M22, _I33, _D11, _D22, _D33, _ARM, _EXPONENT, _Q1, _Q2, _Q3, _NORTH, _EAST, _GAIN, _SHARE,
 _POWER, _REFERENCE, _LOSS, _ASTERN, _M23, _D23, _WALK, _INFLOW, _OFFSET, _ALONG, _ACROSS, _TURNING,
 _DIRECTION, _WIND) = range(len(_BOAT))  # fmt: skip
_INPUTS = ("left_force", "right_force", "propeller_speed", "rudder_angle", "wind_speed",
           "wind_direction", "heading", "measured")  # fmt: skip


@numba.njit
def _boat_rates(x, u, p, dx):  # pragma: no cover - compiled
    """Fossen 2011, sections 7.1, 8.1 and 8.3, about the equations of the paper."""
    heading = x[5] if u[7] < 2.0 else u[6]
    cos, sin, r = np.cos(heading), np.sin(heading), x[2]
    ahead = p[_NORTH] * cos + p[_EAST] * sin
    aside = p[_EAST] * cos - p[_NORTH] * sin
    ur, vr = x[0] - ahead, x[1] - aside
    left, right = u[0] * (1.0 + p[_GAIN]), u[1] * (1.0 - p[_GAIN])
    moved = p[_SHARE] * (right - left)
    left, right = left + moved, right - moved
    if p[_POWER] != 1.0:
        left *= max(abs(left) / p[_REFERENCE], 0.02) ** (p[_POWER] - 1.0)
        right *= max(abs(right) / p[_REFERENCE], 0.02) ** (p[_POWER] - 1.0)
    thrust = left + right + np.sign(u[2]) * abs(u[2]) ** p[_EXPONENT]
    thrust -= p[_LOSS] * abs(thrust) * ur
    if thrust < 0.0:
        thrust *= 1.0 + p[_ASTERN]
    angle = u[3] + p[_OFFSET]
    side = 0.0
    if u[2] != 0.0:
        side = thrust * np.sin(angle) * (1.0 + p[_INFLOW] * ur) + p[_WALK] * thrust
        surge = thrust * np.cos(angle)
    else:
        surge = thrust
    n = p[_ARM] * (left - right - side)
    fx = surge - p[_D11] * ur + p[_M22] * vr * r - p[_Q1] * ur * abs(ur) + p[_M23] * r * r
    fy = side - p[_D22] * vr - p[_M11] * ur * r - p[_Q2] * vr * abs(vr) - p[_D23] * r
    n -= p[_D33] * r + (p[_M22] - p[_M11]) * ur * vr + p[_Q3] * r * abs(r)
    n -= p[_D23] * vr + p[_M23] * ur * r
    if p[_ALONG] != 0.0 or p[_ACROSS] != 0.0 or p[_TURNING] != 0.0:
        speed, origin = p[_WIND], p[_DIRECTION]
        if u[7] == 1.0 or u[7] == 3.0:
            speed, origin = u[4], origin + u[5]
        a = -speed * np.cos(origin - heading) - x[0]
        b = -speed * np.sin(origin - heading) - x[1]
        length = np.sqrt(a * a + b * b)
        fx += p[_ALONG] * a * length
        fy += p[_ACROSS] * b * length
        n += p[_TURNING] * b * length
    whole = p[_M22] * p[_I33] - p[_M23] ** 2
    dx[0] = fx / p[_M11] + r * aside
    dx[1] = (p[_I33] * fy - p[_M23] * n) / whole - r * ahead
    dx[2] = (p[_M22] * n - p[_M23] * fy) / whole
    dx[3] = x[0] * cos - x[1] * sin
    dx[4] = x[0] * sin + x[1] * cos
    dx[5] = r


def _boat_inputs(run: wr.Run, p: Mapping[str, float]) -> dict[str, Array]:
    """What the run has: 1 for a measured wind, 2 for a heading among the inputs."""
    code = 1.0 * ("wind_speed" in run.inputs) + 2.0 * ("heading" in run.inputs)
    return {"measured": np.full(len(run.time), code)}


def _boat_fastest(p: Mapping[str, float]) -> float:
    alone = max(p["d11"] / p["m11"], p["d22"] / p["m22"], p["d33"] / p["i33"])
    coupled = max(1.0 - p["m23"] ** 2 / (p["m22"] * p["i33"]), 0.05)
    quadratic = 3.0 * p["q_surge"] / p["m11"] + p["q_sway"] / p["m22"] + 2.0 * p["q_yaw"] / p["i33"]
    return 1.0 + alone / coupled + quadratic


BOAT = Plant(
    ("surge", "sway", "yaw_rate", "north", "east", "heading"),
    _INPUTS,
    _BOAT,
    _boat_rates,
    _boat_fastest,
    lambda x, u, p: x,
    _boat_inputs,
    angles=frozenset(["heading"]),
)

# --------------------------------------------------------------------------- thrusters

_THRUSTER = {
    "alpha": _always(0.037, 1e-6, 1e3),
    "beta": _always(42.0, 1e-6, 1e7),
    "ct": _always(0.019, 1e-9, 1e2),
    "linear": Parameter(1.0, 0.0, 1e4),
    "coulomb": Parameter(1.0, 0.0, 1e4),
    "width": _always(0.2),
    "band": Parameter(0.05, 0.0, 10.0),
    "restored": Parameter(0.0, 0.0, 1.0),
    "command_offset": Parameter(0.01, -10.0, 10.0),
    "limit": Parameter(2.0, 0.05, 1e3, 1e9),
    "sag": Parameter(0.5, 0.0, 1.0),
    "nominal": _always(16.0),
    "drive_astern": Parameter(-0.1, -1.0, 10.0),
    "load_astern": Parameter(-0.1, -1.0, 10.0),
    "thrust_astern": Parameter(-0.1, -1.0, 10.0),
    "load_power": Parameter(2.0, 0.5, 4.0, 2.0),
    "load_reference": _always(40.0),
    "thrust_power": Parameter(2.0, 0.5, 4.0, 2.0),
    "thrust_reference": _always(40.0),
    "shortfall": Parameter(0.2, 0.0, 1.0),
    "onset": _always(40.0),
    "drive_lag": Parameter(0.05, 1e-3, 5.0),
    "delay": Parameter(0.02, 0.0, 1.0),
    "thrust_offset": Parameter(0.1, -100.0, 100.0),
    "thrust_lag": Parameter(0.05, 0.0, 5.0),
    "thrust_delay": Parameter(0.05, 0.0, 1.0),
    "speed_offset": Parameter(0.1, -100.0, 100.0),
    "flow_loss": Parameter(0.1, 0.0, 1e3),
    "flow_mass": _always(20.0, 1e-4, 1e6),
}
(_ALPHA, _BETA, _CT, _LINEAR, _COULOMB, _WIDTH, _BAND, _RESTORED, _ZERO, _LIMIT, _SAG, _NOMINAL,
 _DRIVE_A, _LOAD_A, _THRUST_A, _LOAD_P, _LOAD_R, _THRUST_P, _THRUST_R, _SHORT, _ONSET, _LAG,
 _DELAY, _T_OFFSET, _T_LAG, _T_DELAY, _S_OFFSET, _FLOW_LOSS, _FLOW_MASS,
 ) = range(len(_THRUSTER))  # fmt: skip


@numba.njit
def _thrust(w, p):  # pragma: no cover - compiled
    """Thrust of a shaft speed, without the flow."""
    t = p[_CT] * w * abs(w)
    if p[_THRUST_P] != 2.0:
        t *= max(abs(w) / p[_THRUST_R], 0.02) ** (p[_THRUST_P] - 2.0)
    if w < 0.0:
        t *= 1.0 + p[_THRUST_A]
    onset = p[_ONSET] ** 2
    return t * (1.0 - p[_SHORT] * (1.0 - onset / max(w * w, onset + 1e-12)))


@numba.njit
def _thruster_rates(x, u, p, dx):  # pragma: no cover - compiled
    """The command is conditioned before; states: speed, lagged drive, flow."""
    w = x[0]
    drive = p[_BETA] * u[0]
    if u[1] != 0.0:
        drive *= 1.0 + p[_SAG] * (u[1] / p[_NOMINAL] - 1.0)
    if drive < 0.0:
        drive *= 1.0 + p[_DRIVE_A]
    if p[_LAG] > 0.0:
        dx[1] = (drive - x[1]) / p[_LAG]
        drive = x[1]
    else:
        dx[1] = 0.0
    load = p[_ALPHA] * w * abs(w)
    if p[_LOAD_P] != 2.0:
        load *= max(abs(w) / p[_LOAD_R], 0.02) ** (p[_LOAD_P] - 2.0)
    if w < 0.0:
        load *= 1.0 + p[_LOAD_A]
    dx[0] = drive - load - p[_LINEAR] * w - p[_COULOMB] * np.tanh(w / p[_WIDTH])
    left = _thrust(w, p) - p[_FLOW_LOSS] * abs(w) * x[2]
    dx[2] = (left - (1.0 + 10.0 * abs(x[2])) * x[2]) / p[_FLOW_MASS] if p[_FLOW_LOSS] else 0.0


def _command(run: wr.Run, p: Mapping[str, float]) -> dict[str, Array]:
    """The command that the motor sees: late, clipped, without its dead band."""
    c = run.inputs["command"]
    c = np.interp(run.time - p["delay"], run.time, c) if p["delay"] else c
    c = np.clip(c + p["command_offset"], -p["limit"], p["limit"])
    beyond = np.maximum(np.abs(c) - p["band"], 0.0)
    edge = np.clip(0.5 + (np.abs(c) - p["band"]) / (0.1 * p["band"] + 1e-12), 0.0, 1.0)
    return {"command": np.sign(c) * (beyond + p["restored"] * p["band"] * edge)}


def _settled(x: Mapping[str, float], u: Array, p: Mapping[str, float]) -> dict[str, float]:
    """Lag and flow as they settle at the first command and speed."""
    values = np.array([p[n] for n in _THRUSTER])
    drive = p["beta"] * u[0] * (1.0 + p["sag"] * (u[1] / p["nominal"] - 1.0) if u[1] else 1.0)
    drive *= 1.0 + p["drive_astern"] * (drive < 0)
    t, b = _thrust(x["speed"], values), 1.0 + p["flow_loss"] * abs(x["speed"])
    flow = 2.0 * t / (b + np.sqrt(b * b + 40.0 * abs(t)))
    return {"speed": x["speed"], "drive": drive, "flow": flow}


def _thruster_outputs(x: Any, u: Any, p: Mapping[str, float]) -> dict[str, Array]:
    values = np.array([p[n] for n in _THRUSTER])
    thrust = np.array([_thrust(w, values) for w in x["speed"]])
    thrust = thrust - p["flow_loss"] * np.abs(x["speed"]) * x["flow"] + p["thrust_offset"]
    time = u["time"]
    if p["thrust_lag"]:  # exact for what is linear between samples
        h = float(np.median(np.diff(time)))
        e = np.exp(-h / p["thrust_lag"])
        g = p["thrust_lag"] * (1.0 - e) / h
        thrust = lfilter([1.0 - g, g - e], [1.0, -e], thrust, zi=[g * thrust[0]])[0]
    if p["thrust_delay"]:
        thrust = np.interp(time - p["thrust_delay"], time, thrust)
    return {"speed": x["speed"] + p["speed_offset"], "thrust": thrust}


def _thruster_fastest(p: Mapping[str, float]) -> float:
    most = 16.0 if p["nominal"] == 16.0 else 5.0
    rate = 2.0 * np.sqrt(p["alpha"] * p["beta"] * most) + p["linear"]
    rate += 1.0 / p["drive_lag"] if p["drive_lag"] else 0.0
    if p["flow_loss"]:  # without it fits with a strong axial flow overflow
        w = np.sqrt(p["beta"] * most / p["alpha"])
        flow = 1.0 + p["flow_loss"] * w + 20.0 * np.sqrt(0.1 * p["ct"]) * w
        rate += flow / p["flow_mass"]
    return rate + (p["coulomb"] / p["width"] if p["coulomb"] else 0.0)


THRUSTER = Plant(
    ("speed", "drive", "flow"),
    ("command", "supply_voltage"),
    _THRUSTER,
    _thruster_rates,
    _thruster_fastest,
    _thruster_outputs,
    _command,
    _settled,
)
