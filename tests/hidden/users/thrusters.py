"""Thrusters on a bench and in a boat: as logged, with a low battery, held, shaken, astern."""

from __future__ import annotations

import math

import numpy as np
from reference import whole_runs as wr

import diffthrust as dft
from diffthrust import Column

from .made import Array, Hidden, UserSet, integrate, read, steps, wander

RPM = 30.0 / math.pi
KGF = 9.80665
BENCH_DIGITS = {"t_ms": 1, "pwm": 0, "rpm": 0, "thrust_kgf": 3, "vbat": 2}


def _shaft(
    time: Array, torque: Array, p: dict[str, float], extra=lambda t: 0.0, step: float = 0.01
) -> Array:
    """The speed under an acceleration ``torque`` held between samples: W' = a - alpha W|W| + e."""
    index = {"k": 0}

    def rates(t: float, x: Array) -> Array:
        k = index["k"]
        while k < len(time) - 1 and time[k + 1] <= t + 1e-9:
            k += 1
        while k > 0 and time[k] > t + 1e-9:
            k -= 1
        index["k"] = k
        w = x[0]
        return np.array([torque[k] - p["alpha"] * w * abs(w) - p.get("linear", 0.0) * w + extra(t)])

    return integrate(rates, (0.0,), time, step)[:, 0]


def _read_in_si(tables: list[dict[str, Array]]) -> tuple[list[dft.Log], dict[str, str]]:
    """Logs of a bench that writes volts, radians per second and newtons."""
    return read(
        tables,
        {"t": 2},
        time="t",
        inputs={"command": Column("u_V", "V")},
        measured={"speed": Column("w_rad_s", "rad/s"), "thrust": Column("thrust_N", "N")},
    )


def bench(seed: int) -> UserSet:
    """PWM widths, rpm, kgf and battery at 50 Hz with jitter, a twentieth of the rows lost."""
    rng = np.random.default_rng([839, seed])
    p = {"alpha": rng.uniform(0.012, 0.025), "beta": rng.uniform(1800.0, 3000.0)}
    ct, astern = rng.uniform(2.0e-4, 4.0e-4), rng.uniform(0.68, 0.82)
    band, latency, tare = rng.uniform(0.05, 0.09), 0.12, rng.uniform(0.25, 0.5) * KGF
    limit = rng.uniform(0.6, 0.7) if seed % 3 == 2 else math.inf
    tables = []
    for _ in range(4):
        fine = np.arange(0.0, 60.0, 0.002)
        asked = steps(rng, fine, -0.9, 0.9, 2.5) + 0.1 * np.sin(fine * rng.uniform(2.0, 5.0))
        asked = np.clip(np.round(400 * asked) / 400, -1, 1)
        volts = 16.6 - 0.03 * fine - 2.2 * _slow(np.abs(asked) ** 1.5, 0.15, 0.002)
        rows = np.sort(
            np.round(
                (np.arange(0, 59.9, 0.02) + rng.uniform(-3e-3, 3e-3, 2995).clip(-3e-3, 3e-3)).clip(
                    0
                )
                / 0.002
            ).astype(int)
        )
        rows = np.unique(rows)
        # what the logger writes is in force until it writes again
        at = np.searchsorted(rows, np.arange(len(fine)), side="right") - 1
        command = asked[rows][at.clip(0)]
        late = np.concatenate([np.full(60, command[0]), command[:-60]])
        late = np.clip(late, -limit, limit)
        drive = np.sign(late) * np.maximum(np.abs(late) - band, 0.0)
        speed = _shaft(fine, p["beta"] * drive * volts / 16.0, p, step=0.002)
        thrust = ct * speed * np.abs(speed) * np.where(speed < 0, astern, 1.0) + tare
        keep = rows[rng.random(len(rows)) > 0.05]
        n = rng.standard_normal((len(keep), 3))
        tables.append(
            {
                "t_ms": 1e3 * fine[keep],
                "pwm": 1500 + 400 * asked[keep],
                "rpm": RPM * speed[keep] + 12.0 * n[:, 0],
                "thrust_kgf": thrust[keep] / KGF + 0.04 * n[:, 1],
                "vbat": volts[keep] + 0.02 * n[:, 2],
            }
        )
    logs, files = read(
        tables,
        BENCH_DIGITS,
        time=Column("t_ms", unit="ms"),
        inputs={
            "command": Column("pwm", pwm={"stop": 1500, "full": 1900, "reverse": 1100}),
            "supply_voltage": Column("vbat", "V"),
        },
        measured={"speed": Column("rpm", "rpm"), "thrust": Column("thrust_kgf", "kgf")},
    )
    hidden = [
        Hidden("dead band", frozenset({"command_deadband"}), parameters={"half_width": band}),
        Hidden("sag", frozenset({"supply_voltage_sag"}), parameters={"share": 1.0}),
        Hidden("latency", frozenset({"command_delay"}), parameters={"delay": latency}),
        Hidden(
            "reverse thrust",
            frozenset({"reverse_thrust_asymmetry"}),
            parameters={"change": astern - 1.0},
        ),
        Hidden("tare", frozenset({"thrust_sensor_offset"}), parameters={"offset": tare}),
    ]
    if limit < 1:
        hidden.append(
            Hidden("saturation", frozenset({"command_saturation"}), parameters={"limit": limit})
        )
    ranges = {"alpha": (0.02, 1e-4, 1.0), "beta": (2000.0, 10.0, 1e5), "ct": (3e-4, 1e-6, 1e-1)}
    base = wr.yoerger().ranged(**ranges)
    true = wr.yoerger(
        deadband=True, sag=True, delay=True, offset=True, reverse=True, saturation=limit < 1
    ).ranged(**ranges, ct_reverse=(3e-4, 1e-6, 1e-1))
    return UserSet(
        "bench",
        seed,
        tuple(logs[:3]),
        (logs[3],),
        dft.Thruster(command="effort"),
        tuple(hidden),
        (base, true),
        {
            **p,
            "ct": ct,
            "ct_reverse": ct * astern,
            "band": band,
            "share": 1.0,
            "delay": latency,
            "thrust_offset": tare,
            "nominal": 16.0,
            **({"limit": limit} if limit < 1 else {}),
        },
        {"speed": 12.0 / RPM, "thrust": 0.04 * KGF},
        ({"speed": 0.0},) * 4,
        files,
    )


def _slow(x: Array, memory: float, step: float) -> Array:
    out, y = np.empty(len(x)), 0.0
    share = 1.0 - math.exp(-step / memory)
    for k, v in enumerate(x):
        y += share * (v - y)
        out[k] = y
    return out


def battery(seed: int) -> UserSet:
    """A thruster on a battery that runs low: below 14 V thrust is lost in proportion to speed."""
    rng = np.random.default_rng([853, seed])
    p = {"alpha": rng.uniform(0.03, 0.045), "beta": rng.uniform(35.0, 50.0)}
    ct = rng.uniform(0.015, 0.022)
    loss = rng.uniform(0.08, 0.15) * ct * 60.0 * 1.5
    tables = []
    for _ in range(3):
        t = np.arange(0.0, 90.0, 0.05)
        command = np.round(steps(rng, t, -4.0, 4.0, 3.0), 3)
        volts = 15.6 - t * rng.uniform(0.02, 0.03) - 0.9 * _slow(np.abs(command) / 4, 0.4, 0.05)
        volts = volts + wander(rng, t, 0.1, 8.0)
        speed = _shaft(t, p["beta"] * command, p)
        thrust = ct * speed * np.abs(speed) - loss * speed * (volts < 14.0)
        n = rng.standard_normal((len(t), 3))
        tables.append(
            {
                "t": t,
                "u_V": command,
                "vbat": volts,
                "w_rad_s": speed + 0.2 * n[:, 0],
                "thrust_N": thrust + 0.5 * n[:, 1],
            }
        )
    logs, files = read(
        tables,
        {"t": 2, "vbat": 3},
        time="t",
        inputs={"command": Column("u_V", "V"), "supply_voltage": Column("vbat", "V")},
        measured={"speed": Column("w_rad_s", "rad/s"), "thrust": Column("thrust_N", "N")},
    )
    base = wr.yoerger()

    def outputs(x: wr.Signals, u: wr.Signals, q: wr.Signals) -> wr.Signals:
        w = x["speed"]
        low = u["supply_voltage"] < 14.0
        return {"speed": w, "thrust": q["ct"] * w * np.abs(w) - q["loss"] * w * low}

    true = wr.replace(
        base, outputs=outputs, parameters={**base.parameters, "loss": wr.Range(0.05, 0.0, 10.0)}
    )
    hidden = (
        Hidden(
            "thrust lost below 14 V",
            ports=frozenset({"propeller", "thrust"}),
            signals=(r"supply_voltage",),
            parameters={"at": 14.0},
        ),
    )
    return UserSet(
        "battery",
        seed,
        tuple(logs[:2]),
        (logs[2],),
        dft.Thruster(),
        hidden,
        (base, true),
        {**p, "ct": ct, "loss": loss, "nominal": 16.0},
        {"speed": 0.2, "thrust": 0.5},
        ({"speed": 0.0},) * 3,
        files,
        close=1.15,
    )


def held_readings(seed: int) -> UserSet:
    """Speeds of an azimuth motor at 20 Hz; a new reading comes after 0.8 to 2.7 s, repeats between.

    On odd seeds the motor's controller does not go beyond a speed.
    """
    rng = np.random.default_rng([857, seed])
    constant, gain = rng.uniform(0.4, 0.7), rng.uniform(0.9, 1.05)
    limit = rng.uniform(60.0, 75.0) if seed % 2 else math.inf
    tables = []
    for _ in range(4):
        t = np.arange(0.0, 280.0, 0.05)
        command = np.round(steps(rng, t, -90.0, 90.0, 5.0), 2)
        target = gain * np.clip(command, -limit, limit)
        speed = np.zeros(len(t))
        keep = math.exp(-0.05 / constant)
        for k in range(len(t) - 1):
            speed[k + 1] = target[k] + (speed[k] - target[k]) * keep
        arrivals = [0.0]
        while arrivals[-1] < t[-1]:
            arrivals.append(arrivals[-1] + rng.uniform(0.8, 2.7))
        taken = np.searchsorted(t, np.array(arrivals[:-1])).clip(0, len(t) - 1)
        readings = speed[taken] + 0.5 * rng.standard_normal(len(taken))
        last = np.searchsorted(taken, np.arange(len(t)), side="right") - 1
        tables.append({"t": t, "set_rpm": RPM * command, "rpm": RPM * readings[last]})
    logs, files = read(
        tables,
        {"t": 2, "set_rpm": 1, "rpm": 2},
        time="t",
        inputs={"command": Column("set_rpm", "rpm")},
        measured={"speed": Column("rpm", "rpm")},
    )
    base = wr.replace(wr.speed_loop(), outputs=lambda x, u, q: {"speed": x["speed"]})
    base = base.ranged(gain=(1.0, 0.01, 10.0)).fixed(exponent=1.0, ct=1e-4)

    def limited(x: wr.Signals, u: wr.Signals, q: wr.Signals) -> wr.Signals:
        c = np.clip(u["command"], -q["limit"], q["limit"])
        return {"speed": (q["gain"] * c - x["speed"]) / q["time_constant"]}

    true = base
    if limit < math.inf:
        true = wr.replace(
            base, rates=limited, parameters={**base.parameters, "limit": wr.Range(80.0, 1.0, 200.0)}
        )
    hidden = (
        ()
        if limit == math.inf
        else (Hidden("saturation", frozenset({"command_saturation"}), parameters={"limit": limit}),)
    )
    model = dft.SpeedLoopThruster(command="rad/s")
    return UserSet(
        "held_readings",
        seed,
        tuple(logs[:3]),
        (logs[3],),
        model,
        hidden,
        (base, true),
        {
            "gain": gain,
            "time_constant": constant,
            "exponent": 1.0,
            "ct": 1e-4,
            **({"limit": limit} if seed % 2 else {}),
        },
        {"speed": 0.5},
        ({"speed": 0.0},) * 4,
        files,
        says=(r"last reading|repeat (of )?(the|a|their) (last|reading)|held reading",),
        within={"time_constant": (constant, 0.15), "gain": (gain, 0.05)},
        blanked=without_repeats,
    )


def without_repeats(run: wr.Run) -> wr.Run:
    """The run with repeats of a reading left out."""
    measured = {}
    for name, x in run.measured.items():
        fresh = np.r_[True, x[1:] != x[:-1]]
        measured[name] = np.where(fresh, x, np.nan)
    return wr.replace(run, measured=measured)


def periodic_force(seed: int) -> UserSet:
    """A shaft that a machine nearby shakes at a frequency in time; each log has its own phase."""
    rng = np.random.default_rng([859, seed])
    p = {"alpha": rng.uniform(0.03, 0.045), "beta": rng.uniform(35.0, 50.0)}
    ct, frequency, size = rng.uniform(0.015, 0.022), rng.uniform(0.4, 1.2), rng.uniform(18.0, 30.0)
    tables = []
    for _ in range(3):
        t = np.arange(0.0, 60.0, 0.05)
        command = np.round(steps(rng, t, -4.0, 4.0, 3.0), 3)
        phase = rng.uniform(0, 2 * math.pi)
        speed = _shaft(
            t,
            p["beta"] * command,
            p,
            lambda s, f=phase: size * math.sin(2 * math.pi * frequency * s + f),
        )
        n = rng.standard_normal((len(t), 2))
        tables.append(
            {
                "t": t,
                "u_V": command,
                "w_rad_s": speed + 0.2 * n[:, 0],
                "thrust_N": ct * speed * np.abs(speed) + 0.5 * n[:, 1],
            }
        )
    logs, files = _read_in_si(tables)
    base = wr.yoerger()
    true = _shaken(base, frequency)
    hidden = (
        Hidden(
            f"a torque at {frequency:.3f} Hz",
            frozenset({"periodic_force"}),
            ports=frozenset({"shaft", "drive", "load"}),
            signals=(r"periodic|Hz|time, repeating",),
            parameters={"frequency": frequency},
        ),
    )
    return UserSet(
        "periodic_force",
        seed,
        tuple(logs[:2]),
        (logs[2],),
        dft.Thruster(),
        hidden,
        (base, true),
        {
            **p,
            "ct": ct,
            "nominal": 16.0,
            "frequency": frequency,
            "sine": size * math.cos(phase),
            "cosine": size * math.sin(phase),
        },
        {"speed": 0.2, "thrust": 0.5},
        ({"speed": 0.0, "clock": 0.0},) * 3,
        files,
        says=(r"Hz",),
        per_log=True,
    )


def _shaken(base: wr.System, frequency: float) -> wr.System:
    """The thruster with a torque at a frequency; sine and cosine are parameters of a single log."""

    def rates(x: wr.Signals, u: wr.Signals, q: wr.Signals) -> wr.Signals:
        turn = 2 * np.pi * q["frequency"] * x["clock"]
        w = x["speed"]
        shaken = q["sine"] * np.sin(turn) + q["cosine"] * np.cos(turn)
        drive = q["beta"] * u["command"] - q["alpha"] * w * np.abs(w)
        return {"speed": drive + shaken, "clock": 1.0 + 0.0 * w}

    more = {
        "frequency": wr.Range(frequency, 0.1, 3.0),
        "sine": wr.Range(0.0, -200.0, 200.0),
        "cosine": wr.Range(0.0, -200.0, 200.0),
    }
    return wr.replace(
        base, states=("speed", "clock"), rates=rates, parameters={**base.parameters, **more}
    )


def astern_runs(seed: int) -> UserSet:
    """Five training logs run ahead and one astern, as the unseen one does in part; less thrust."""
    rng = np.random.default_rng([863, seed])
    p = {"alpha": rng.uniform(0.03, 0.045), "beta": rng.uniform(35.0, 50.0)}
    ct, share = rng.uniform(0.015, 0.022), rng.uniform(0.6, 0.8)
    ends = [(0.3, 4.0)] * 5 + [(-4.0, -0.3), (-4.0, 4.0)]
    ends[int(rng.integers(5))], ends[5] = ends[5], ends[0]
    tables = []
    for low, high in ends:
        t = np.arange(0.0, 40.0, 0.05)
        command = np.round(steps(rng, t, low, high, 3.0), 3)
        speed = _shaft(t, p["beta"] * command + wander(rng, t, 2.0, 0.5), p)
        thrust = ct * speed * np.abs(speed) * np.where(speed < 0, share, 1.0)
        n = rng.standard_normal((len(t), 2))
        tables.append(
            {
                "t": t,
                "u_V": command,
                "w_rad_s": speed + 0.3 * n[:, 0],
                "thrust_N": thrust + 0.5 * n[:, 1],
            }
        )
    logs, files = _read_in_si(tables)
    hidden = (
        Hidden(
            "less thrust astern",
            frozenset({"reverse_thrust_asymmetry"}),
            parameters={"change": share - 1.0},
        ),
    )
    base, true = wr.yoerger(), wr.yoerger(reverse=True)
    return UserSet(
        "astern_runs",
        seed,
        tuple(logs[:6]),
        (logs[6],),
        dft.Thruster(),
        hidden,
        (base, true),
        {**p, "ct": ct, "ct_reverse": ct * share, "nominal": 16.0},
        {"speed": 0.3, "thrust": 0.5},
        ({"speed": 0.0},) * 7,
        files,
        never=(r"how it was recorded",),
    )
