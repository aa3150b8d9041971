"""Users with a model class of their own: a gear motor, two tanks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from reference import whole_runs as wr

import diffthrust as dft
from diffthrust import Column

from .made import Array, Hidden, UserSet, integrate, read, steps, wander


class GearMotor(dft.Model):
    """A motor with a gear that turns an arm: torque by the voltage, less what rubs."""

    name = "gear_motor"
    inputs: ClassVar[Mapping[str, str]] = {"voltage": "V"}
    states: ClassVar[Mapping[str, str]] = {"angle": "rad", "rate": "rad/s"}
    outputs: ClassVar[Mapping[str, str]] = {"angle": "rad", "rate": "rad/s"}
    ports: ClassVar[Mapping[str, str]] = {"torque": "net torque by the inertia [rad/s^2]"}
    gain: float = dft.parameter(10.0, "rad/(V s^2)", bounds=(0, None))
    friction: float = dft.parameter(2.0, "1/s", bounds=(0, None))

    def equations(self, s: Any, port: Any) -> Any:
        """Rates of angle and speed."""
        net = port("torque", self.gain * s.voltage - self.friction * s.rate)
        return {"angle": s.rate, "rate": net}, {"angle": s.angle, "rate": s.rate}


def gear_motor(seed: int) -> UserSet:
    """The arm is out of balance: gravity pulls with the sine of its angle."""
    rng = np.random.default_rng([877, seed])
    gain, friction = rng.uniform(8.0, 14.0), rng.uniform(1.5, 3.0)
    pull, phase = rng.uniform(5.0, 9.0), rng.uniform(-math.pi, math.pi)
    tables = []
    for _ in range(3):
        t = np.arange(0.0, 40.0, 0.02)
        volts = np.round(steps(rng, t, -6.0, 6.0, 1.5), 2)

        def rates(s: float, x: Array, volts: Array = volts) -> Array:
            k = min(int(s / 0.02 + 1e-6), len(volts) - 1)
            net = gain * volts[k] - friction * x[1] - pull * math.sin(x[0] + phase)
            return np.array([x[1], net])

        x = integrate(rates, (0.0, 0.0), t, 0.01)
        shaken = wander(rng, t, 0.01, 0.05)
        n = rng.standard_normal((len(t), 2))
        tables.append(
            {
                "time": t,
                "motor_V": volts,
                "arm_deg": np.degrees(x[:, 0] + 0.003 * n[:, 0]),
                "arm_deg_s": np.degrees(x[:, 1] + 0.05 * n[:, 1] + shaken),
            }
        )
    logs, files = read(
        tables,
        {"time": 2},
        time="time",
        inputs={"voltage": Column("motor_V", "V")},
        measured={"angle": Column("arm_deg", "deg"), "rate": Column("arm_deg_s", "deg/s")},
    )

    def system(imbalance: bool) -> wr.System:
        parameters = {"gain": wr.Range(10.0, 0.1, 1e3), "friction": wr.Range(2.0, 0.0, 1e2)}
        if imbalance:
            parameters |= {"sine": wr.Range(0.0, -50.0, 50.0), "cosine": wr.Range(0.0, -50.0, 50.0)}

        def flow(x: wr.Signals, u: wr.Signals, q: wr.Signals) -> wr.Signals:
            net = q["gain"] * u["voltage"] - q["friction"] * x["rate"]
            if imbalance:
                net = net - q["sine"] * np.sin(x["angle"]) - q["cosine"] * np.cos(x["angle"])
            return {"angle": x["rate"], "rate": net}

        return wr.System(
            ("angle", "rate"), flow, lambda x, u, q: x, parameters, lambda q: q["friction"] + 5.0
        )

    hidden = (
        Hidden(
            "imbalance",
            ports=frozenset({"torque"}),
            signals=(r"angle, repeating every 6\.[0-6]", r"(sin|cos)\(.*angle"),
            parameters={"wavelength": 2 * math.pi},
        ),
    )
    return UserSet(
        "gear_motor",
        seed,
        tuple(logs[:2]),
        (logs[2],),
        GearMotor(),
        hidden,
        (system(False), system(True)),
        {
            "gain": gain,
            "friction": friction,
            "sine": pull * math.cos(phase),
            "cosine": pull * math.sin(phase),
        },
        {"angle": 0.003, "rate": math.hypot(0.05, 0.01)},
        ({"angle": 0.0, "rate": 0.0},) * 3,
        files,
        never=(r"how it was recorded",),
        close=1.15,
    )


class Tanks(dft.Model):
    """Two tanks, one above the other, which run out by Torricelli's law; the lower is measured."""

    name = "tanks"
    inputs: ClassVar[Mapping[str, str]] = {"pump": "V"}
    states: ClassVar[Mapping[str, str]] = {"upper": "cm", "lower": "cm"}
    outputs: ClassVar[Mapping[str, str]] = {"lower": "cm"}
    ports: ClassVar[Mapping[str, str]] = {
        "inflow": "into the upper tank [cm/s]",
        "between": "from the upper tank into the lower one [cm/s]",
        "outflow": "out of the lower tank [cm/s]",
    }
    k1: float = dft.parameter(0.05, "cm/(V s)", bounds=(0, 1))
    k2: float = dft.parameter(0.05, "cm^0.5/s", bounds=(0, 1))
    k3: float = dft.parameter(0.05, "cm^0.5/s", bounds=(0, 1))

    def equations(self, s: Any, port: Any) -> Any:
        """Rates of both levels, and the lower one."""
        inflow = port("inflow", self.k1 * s.pump)
        between = port("between", self.k2 * _root(s.upper))
        outflow = port("outflow", self.k3 * _root(s.lower))
        return {"upper": inflow - between, "lower": between - outflow}, {"lower": s.lower}


def _root(level: Any) -> Any:
    return level / jnp.sqrt(jnp.abs(level) + 1e-3)


def tanks(seed: int) -> UserSet:
    """Flows in proportion to the levels beside the roots, and a rim; both tanks begin empty."""
    rng = np.random.default_rng([881, seed])
    p = {
        "pump": rng.uniform(0.055, 0.07),
        "upper_outlet": rng.uniform(0.03, 0.045),
        "lower_outlet": rng.uniform(0.03, 0.045),
        "upper_linear": rng.uniform(0.008, 0.015),
        "lower_linear": rng.uniform(0.008, 0.015),
        "rate": rng.uniform(0.15, 0.4),
        "rim": rng.uniform(5.0, 6.5),
        "caught": rng.uniform(0.2, 0.6),
    }
    tables = []
    for _ in range(2):
        t = 4.0 * np.arange(1024)
        volts = np.clip(steps(rng, t, 1.0, 5.5, 110.0) + wander(rng, t, 0.3, 30.0), 0.5, 7.0)
        volts = np.round(volts, 3)

        def rates(s: float, x: Array, volts: Array = volts) -> Array:
            k = min(int(s / 4.0 + 1e-6), len(volts) - 1)
            upper, lower = max(x[0], 0.0), max(x[1], 0.0)
            through = p["upper_outlet"] * math.sqrt(upper) + p["upper_linear"] * upper
            out = p["lower_outlet"] * math.sqrt(lower) + p["lower_linear"] * lower
            spill = p["rate"] * max(upper - p["rim"], 0.0)
            return np.array(
                [p["pump"] * volts[k] - through - spill, through + p["caught"] * spill - out]
            )

        x = integrate(rates, (0.0, 0.0), t, 0.5)
        tables.append({"t_s": t, "u_V": volts, "h2_cm": x[:, 1] + 0.03 * rng.standard_normal(1024)})
    logs, files = read(
        tables,
        {"t_s": 0, "u_V": 3, "h2_cm": 3},
        time="t_s",
        inputs={"pump": Column("u_V", "V")},
        measured={"lower": Column("h2_cm", "cm")},
    )

    def named(run: wr.Run) -> wr.Run:
        level = {"lower": 100.0 * run.measured["lower"]}
        return wr.replace(run, inputs={"voltage": run.inputs["pump"]}, measured=level)

    ports = frozenset({"inflow", "between", "outflow"})
    hidden = (
        Hidden("overflow", ports=ports, signals=(r"\bupper\b",)),
        Hidden(
            "flows in proportion to levels", ports=ports, signals=(r"upper|lower",), required=False
        ),
    )
    systems = wr.two_tanks(), wr.two_tanks(overflow=True, linear=True)
    return UserSet(
        "tanks",
        seed,
        (logs[0],),
        (logs[1],),
        Tanks(),
        hidden,
        systems,
        p,
        {"lower": 0.03},
        ({"upper": 0.0, "lower": 0.0},) * 2,
        files,
        close=1.15,
        blanked=named,
    )
