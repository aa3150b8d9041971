"""Boats with two thrusters: a current and a weak thruster; a sway that drifts."""

from __future__ import annotations

import math

import numpy as np
from reference import whole_runs as wr

import diffthrust as dft
from diffthrust import Column

from .made import Array, Hidden, UserSet, integrate, read, steps, wander

PWM = {"stop": 1500, "full": 1900, "reverse": 1100}
DIGITS = {"t_ms": 0, "pwm_l": 0, "pwm_r": 0, "x_m": 3, "y_m": 3, "heading_deg": 1, "gyro_deg_s": 2}
ARM = 0.3
STATES = ("surge", "sway", "yaw_rate", "north", "east", "heading")


def boat(seed: int, speeds: bool = False) -> UserSet:
    """Four logs with PWM widths, positions (5 Hz), compass (10 Hz) and gyro (50 Hz).

    The boat lies at a quay until a log begins, so it starts at rest over ground.
    """
    rng = np.random.default_rng([811, seed])
    full = rng.uniform(30.0, 50.0)
    p = {
        "m11": rng.uniform(25.0, 40.0),
        "i33": rng.uniform(3.0, 6.0),
        "d11": rng.uniform(6.0, 12.0),
        "q11": rng.uniform(12.0, 22.0),
        "d22": rng.uniform(30.0, 60.0),
        "d33": rng.uniform(3.0, 6.0),
        "q33": rng.uniform(4.0, 8.0),
        "exponent": rng.uniform(1.4, 2.2),
        "left": full,
        "right": full,
        "arm": ARM,
    }
    p["m22"] = p["m11"] * rng.uniform(1.2, 1.6)
    weak = "right" if rng.random() < 0.5 else "left"
    p[weak] *= 0.8
    speed, toward = rng.uniform(0.15, 0.25), rng.uniform(0.0, 2 * math.pi)
    north, east = speed * math.cos(toward), speed * math.sin(toward)
    tables, starts = [], []
    for _ in range(4):
        t = np.arange(0.0, 80.0, 0.02)
        # the autopilot sends ten times a second: the means that the least squares takes are exact
        sent = t[::5]
        mean, turn = steps(rng, sent, 0.25, 0.8, 9.0), steps(rng, sent, -0.3, 0.3, 5.0)
        mean, turn = np.repeat(mean, 5), np.repeat(turn, 5)
        left, right = np.clip(mean + turn, -1, 1), np.clip(mean - turn, -1, 1)
        pwm_l, pwm_r = np.round(1500 + 400 * left), np.round(1500 + 400 * right)
        start = (0.0, 0.0, 0.0, 0.0, 0.0, rng.uniform(0.0, 2 * math.pi))
        starts.append(dict(zip(STATES, start, strict=True)))
        x = _sail(p, (pwm_l, pwm_r), t, start, (north, east))
        table = {"t_ms": 1e3 * t, "pwm_l": pwm_l, "pwm_r": pwm_r}
        n = rng.standard_normal((len(t), 4))
        if speeds:
            over_ground = np.hypot(x[:, 0], x[:, 1])
            table["sog_m_s"] = _every(over_ground + 0.02 * n[:, 0], 10)
        else:
            table["x_m"] = _every(x[:, 3] + 0.03 * n[:, 0], 10)
            table["y_m"] = _every(x[:, 4] + 0.03 * n[:, 1], 10)
        table["heading_deg"] = _every(np.degrees(x[:, 5] + 0.01 * n[:, 2]) % 360.0, 5)
        table["gyro_deg_s"] = np.degrees(x[:, 2] + 0.01 * n[:, 3])
        tables.append(table)
    place = (
        {"surge": Column("sog_m_s", "m/s")}
        if speeds
        else {"north": Column("x_m", "m"), "east": Column("y_m", "m")}
    )
    logs, files = read(
        tables,
        DIGITS,
        time=Column("t_ms", unit="ms"),
        inputs={"left_force": Column("pwm_l", pwm=PWM), "right_force": Column("pwm_r", pwm=PWM)},
        measured={
            **place,
            "heading": Column("heading_deg", unit="deg"),
            "yaw_rate": Column("gyro_deg_s", unit="deg/s"),
        },
    )
    gain = (p["left"] ** (1 / p["exponent"]) - p["right"] ** (1 / p["exponent"])) / (
        p["left"] ** (1 / p["exponent"]) + p["right"] ** (1 / p["exponent"])
    )
    hidden = (
        Hidden(
            "a steady current",
            frozenset({"water_current"}),
            parameters={"to_north": north, "to_east": east},
        ),
        Hidden(
            f"the {weak} thruster a fifth weaker",
            frozenset({"differential_gain"}),
            parameters={"gain": gain},
        ),
        Hidden("quadratic surge drag", frozenset({"quadratic_surge_drag"}), required=False),
        Hidden("quadratic yaw drag", frozenset({"quadratic_yaw_drag"}), required=False),
    )
    ranges = {  # divided by the force of one thruster at full command
        "m11": (1.0, 0.01, 100.0),
        "m22": (1.5, 0.01, 100.0),
        "i33": (0.15, 1e-3, 10.0),
        "d11": (0.5, 0.0, 50.0),
        "d22": (1.5, 0.0, 50.0),
        "d33": (0.2, 0.0, 20.0),
        "exponent": (1.0, 0.3, 4.0),
    }
    base = wr.twin_boat(effort=True, positions=True).ranged(**ranges).fixed(lever_arm=ARM)
    true = wr.twin_boat(effort=True, positions=True, current=True, gain=True, drag=("surge", "yaw"))
    true = true.ranged(**ranges, q_surge=(0.3, 0.0, 50.0), q_yaw=(0.1, 0.0, 50.0))
    true = true.fixed(lever_arm=ARM)
    if speeds:  # what is called surge is the speed over ground, without direction
        base, true = (_over_ground(s) for s in (base, true))
    model = dft.Vessel(drive="twin", command="effort", lever_arm=ARM)
    strength = 0.5 * (p["left"] + p["right"])
    truth = {n: p[n] / strength for n in ("m11", "m22", "i33", "d11", "d22", "d33")}
    truth |= {"q_surge": p["q11"] / strength, "q_yaw": p["q33"] / strength}
    truth |= {"exponent": p["exponent"], "lever_arm": ARM, "to_north": north, "to_east": east}
    truth["gain"] = (p["left"] - p["right"]) / (2.0 * strength)
    noise = {"heading": 0.01, "yaw_rate": 0.01}
    noise |= {"surge": 0.02} if speeds else {"north": 0.03, "east": 0.03}
    says = (r"speed over ground|no sign|unsigned|sway",) if speeds else ()
    return UserSet(
        "boat_speeds" if speeds else "boat",
        seed,
        tuple(logs[:3]),
        (logs[3],),
        model,
        hidden,
        (base, true),
        truth,
        noise,
        tuple(starts),
        files,
        says=says,
        blanked=_thinned,
        rate=10.0,  # a boat that turns in seconds: at 50 Hz the same, in five times the time
    )


def _thinned(run: wr.Run, every: int = 5) -> wr.Run:
    """Means of the inputs over ``every`` samples and the readings between: enough for a boat."""
    count = len(run.time) // every * every
    inputs = {n: x[:count].reshape(-1, every).mean(axis=1) for n, x in run.inputs.items()}
    measured = {n: x[:count:every] for n, x in run.measured.items()}
    return wr.Run(run.time[:count:every], inputs, measured, run.initial, run.name)


def _over_ground(system: wr.System) -> wr.System:
    def outputs(x: wr.Signals, u: wr.Signals, p: wr.Signals) -> wr.Signals:
        return {**x, "surge": np.hypot(x["surge"], x["sway"])}

    return wr.replace(system, outputs=outputs)


def _every(values: Array, count: int) -> Array:
    out = np.full(len(values), np.nan)
    out[::count] = values[::count]
    return out


def _sail(
    p: dict[str, float],
    pwm: tuple[Array, Array],
    time: Array,
    start: tuple[float, ...],
    current: tuple[float, float],
) -> Array:
    """Surge, sway and yaw rate over ground, north, east, heading; efforts held between samples."""
    step = time[1] - time[0]
    forces = [
        p[side] * np.sign(e) * np.abs(e) ** p["exponent"]
        for side, e in (("left", (pwm[0] - 1500) / 400), ("right", (pwm[1] - 1500) / 400))
    ]
    north, east = current

    def rates(t: float, x: Array) -> Array:
        u, v, r, _, _, psi = x
        k = min(int((t - time[0]) / step + 1e-6), len(time) - 1)
        cos, sin = math.cos(psi), math.sin(psi)
        ahead, across = north * cos + east * sin, east * cos - north * sin
        ur, vr = u - ahead, v - across
        left, right = forces[0][k], forces[1][k]
        fx = left + right + p["m22"] * vr * r - p["d11"] * ur - p["q11"] * ur * abs(ur)
        fy = -p["m11"] * ur * r - p["d22"] * vr
        n = p["arm"] * (left - right) - (p["m22"] - p["m11"]) * ur * vr - p["d33"] * r
        n -= p["q33"] * r * abs(r)
        # over ground: the water's velocity is constant, and turns against the boat's axes
        du, dv = fx / p["m11"] + r * across, fy / p["m22"] - r * ahead
        return np.array([du, dv, n / p["i33"], u * cos - v * sin, u * sin + v * cos, r])

    return integrate(rates, start, time, 0.02)


def dominating_channel(seed: int) -> UserSet:
    """Three speeds at 10 Hz in newtons; a wandering error rules what is read as sway.

    The compass by which the satellite's velocity is turned into the boat's axes drifts by some
    tens of degrees: far more than the boat's own sway, and of no account for surge and yaw.
    """
    rng = np.random.default_rng([829, seed])
    p = {
        "m11": rng.uniform(18.0, 24.0),
        "i33": 1.7,
        "d11": rng.uniform(4.0, 8.0),
        "q11": rng.uniform(14.0, 22.0),
        "d22": rng.uniform(25.0, 50.0),
        "d33": rng.uniform(4.0, 8.0),
        "q33": 0.0,
        "exponent": 1.0,
        "left": 400.0,
        "right": 400.0,
        "arm": 0.285,
    }
    p["m22"] = p["m11"] * rng.uniform(1.2, 1.6)
    tables = []
    for _ in range(4):
        t = np.arange(0.0, 120.0, 0.1)
        mean, turn = steps(rng, t, 3.0, 30.0, 12.0), steps(rng, t, -4.0, 4.0, 6.0)
        left, right = np.round(mean + turn, 2), np.round(mean - turn, 2)
        x = _sail(p, (1500 + left, 1500 + right), t, (0.0,) * 6, (0.0, 0.0))
        # of a memory that no log holds twice
        drift = wander(rng, t, rng.uniform(0.2, 0.35), rng.uniform(6.0, 12.0))
        n = rng.standard_normal((len(t), 3))
        tables.append(
            {
                "t": t,
                "left_N": left,
                "right_N": right,
                "u": x[:, 0] + 0.01 * n[:, 0],
                "v": x[:, 1] + drift + 0.01 * n[:, 1],
                "r": x[:, 2] + 0.01 * n[:, 2],
            }
        )
    logs, files = read(
        tables,
        {"t": 2},
        time="t",
        inputs={"left_force": Column("left_N", "N"), "right_force": Column("right_N", "N")},
        measured={
            "surge": Column("u", "m/s"),
            "sway": Column("v", "m/s"),
            "yaw_rate": Column("r", "rad/s"),
        },
    )
    model = dft.Vessel(drive="twin", lever_arm=0.285).replace(
        m11=20.0, m22=25.0, i33={"value": 1.7, "fixed": True}, d11=20.0, d22=30.0, d33=5.0
    )
    base = wr.twin_boat().fixed(i33=1.7)
    true = wr.twin_boat(drag=("surge",)).fixed(i33=1.7).ranged(q_surge=(10.0, 0.0, 1e3))
    hidden = (Hidden("quadratic surge drag", frozenset({"quadratic_surge_drag"})),)
    return UserSet(
        "dominating_channel",
        seed,
        tuple(logs[:3]),
        (logs[3],),
        model,
        hidden,
        (base, true),
        {
            **{n: p[n] for n in ("m11", "m22", "i33", "d11", "d22", "d33", "exponent")},
            "q_surge": p["q11"],
            "lever_arm": p["arm"],
        },
        {"surge": 0.01, "sway": 0.01, "yaw_rate": 0.01},
        (dict.fromkeys(STATES, 0.0),) * 4,
        files,
        says=(r"sway",),
        ruled=frozenset({"sway"}),
    )
