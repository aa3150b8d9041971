"""The figures that Yoerger, Cooke & Slotine 1990 print, beside what follows from their own."""

from __future__ import annotations

import math

import numpy as np
from printed.printed import Printed

from diffthrust import Log, Thruster, describing_function, simulate
from diffthrust.control import PoleCancellation
from diffthrust.cycles import thruster_loop_cycle
from diffthrust.uncertainty._prediction.physical import duct_quantities  # `physical` without a fit

_STATIC_CT, _DYNAMIC_CT = 0.022, 0.019
_PITCH, _AREA, _DENSITY = 0.101, 0.0527, 1000.0
_FULL = 10.0
"""Largest command [V], section II A."""
_HORSEPOWER = 745.7
_ZERO, _POLE, _DAMPING = 2.43, 6.5, 0.707
"""Of the lead network and of its loop, section V B."""
_UNITS = {"command": "V", "speed": "rad/s", "thrust": "N"}


def printed_figures() -> list[Printed]:
    """Every printed figure of the paper.

    Figures 15 to 21 have no numbers that the scan lets one read; ``examples/compensators.py`` and
    ``examples/papers_yoerger_adaptive.py`` run what they show. The vehicles of figures 1 and 2 are
    not described.

    Example:
        >>> print(printed_table(printed_figures()))
    """
    dynamic = Thruster(alpha=0.037, beta=42.0, ct=_DYNAMIC_CT)
    jason = dynamic.replace(ct=_STATIC_CT)
    return [*_tests(), *_sizes(jason, dynamic), *_lags(jason), *_cycle(jason, dynamic)]


def _tests() -> list[Printed]:
    measured = "measured; the record of figure 10 is not printed"
    return [
        Printed("figure 8, static test: ct", _STATIC_CT, _DYNAMIC_CT, "N s²",
                "by the dynamic test: the paper's two tests of one thruster differ"),
        Printed("figure 9, static test: beta/alpha", 1.0e3, 42.0 / 0.037, "1/(V s²)",
                "likewise; the paper calls this a match"),
        Printed("dynamic test: beta/alpha", 1.1e3, 42.0 / 0.037, "1/(V s²)",
                "42 / 0.037 is 1135: rounded in print"),
        Printed("dynamic test: alpha", 0.037, None, "1/rad", measured),
        Printed("dynamic test: beta", 42.0, None, "1/(V s²)", measured),
        Printed("dynamic test: ct", _DYNAMIC_CT, None, "N s²", measured),
    ]  # fmt: skip


def _sizes(jason: Thruster, dynamic: Thruster) -> list[Printed]:
    eta = 0.22
    implied = jason.replace(ct=_DENSITY * _AREA * (eta * _PITCH) ** 2)
    by_static, by_dynamic, by_eta = (_physical(model) for model in (jason, dynamic, implied))

    def power(physical: dict[str, float]) -> float:
        top = math.sqrt(jason.beta / jason.alpha * _FULL)
        return physical["torque_constant"] * _FULL * top / _HORSEPOWER

    return [
        Printed("efficiency", eta, by_static["efficiency"], "", "by the static ct, 0.022"),
        Printed("efficiency", eta, by_dynamic["efficiency"], "", "by the dynamic ct, 0.019"),
        Printed("figure 8, static test: ct", _STATIC_CT, implied.ct, "N s²",
                "what an efficiency of 0.22 stands for"),
        Printed("involved volume V", 0.016, by_eta["volume"], "m³", "with an efficiency of 0.22"),
        Printed("involved volume V", 0.016, by_static["volume"], "m³",
                "with the efficiency of the static ct: V and ct do not go with one efficiency"),
        Printed("motor of 1/3 hp", 1.0 / 3.0, power(by_static), "hp",
                "power at 10 V with the efficiency of the static ct; with an efficiency of 0.22 it "
                f"is {power(by_eta):.2f} hp"),
        Printed("figure 6, smallest step", 0.25, by_static["torque_constant"], "N m",
                "1 V as a torque: figure 6 is read at 1 V, and its smallest step is of 1/4 N m"),
    ]  # fmt: skip


def _lags(jason: Thruster) -> list[Printed]:
    best = _first_order(jason)
    cancel = PoleCancellation()
    follows = PoleCancellation.of(jason)
    volt = math.sqrt(follows.thrust_per_volt)  # root of the steady thrust at 1 V
    commands = np.linspace(0.5, _FULL, 40)
    pace = describing_function(jason, commands, 0.2, method="paper").break_frequency[:, 0]
    below = follows.thrust_per_volt * float(np.interp(2.0, pace, commands))
    return [
        Printed("time constant at 1 V", 0.75, best["thrust"], "s",
                "the first-order lag nearest to the thrust's step from rest over the 5.5 s of "
                "figure 6"),
        Printed("time constant at 1 V", 0.75, best["speed"], "s", "the same of the speed"),
        Printed("time constant at 1 V", 0.75, 1.0 / (cancel.rate * volt), "s",
                "by the paper's 0.49 √u, u in newtons"),
        Printed("time constant at 1 V", 0.75, 1.0 / cancel.rate, "s",
                "by the paper's 0.49 √u, u in volts: neither unit gives its 0.75 s"),
        Printed("pole cancellation: 0.49", cancel.rate, follows.rate, "1/(s √N)",
                "2 alpha / √ct, the inverse of the model, with u in newtons"),
        Printed("pole cancellation: 0.49", cancel.rate, follows.rate * volt, "1/(s √V)",
                "the same with u in volts: 0.49 goes with newtons"),
        Printed("time constant at 1 V", 0.75, 2.0 / (_DAMPING * math.sqrt(_ZERO * _POLE)), "s",
                "of the lead network: by Ogata's root locus zero times pole is the square of the "
                "wanted frequency, here of poles with twice the lag's attenuation"),
        Printed("lead network: zero", _ZERO, (2.0 / (0.75 * _DAMPING)) ** 2 / _POLE, "1/s",
                "by the same construction from 0.75 s and the printed pole; 2 √(alpha beta), the "
                f"lag of small changes about 1 V, is {follows.rate * volt:.2f} by chance"),
        Printed("figure 12: largest break frequency", 2.0, float(pace[-1]), "rad/s",
                "by the printed formula at the full 10 V and 0.2 rad/s; \"less than 2 for all "
                f"magnitudes\" holds up to {below:.0f} N"),
    ]  # fmt: skip


def _cycle(jason: Thruster, dynamic: Thruster) -> list[Printed]:
    drag, free = thruster_loop_cycle(jason), thruster_loop_cycle(jason, drag=0.0)
    other = thruster_loop_cycle(dynamic, drag=0.0, verify=False)
    predicted, simulated = 15.7, 15.6
    rows = [
        Printed("limit cycle predicted, command", predicted, free.printed, "N",
                f"by the printed formula (6) with ct = 0.022; with 0.019 {other.printed:.1f} N"),
        Printed("limit cycle predicted, command", predicted, free.consistent, "N",
                "by the formula with the fundamental of the thrust taken consistently"),
        Printed("limit cycle predicted, command", predicted, free.newton * free.cycle.amplitude,
                "N", "by the describing function of the simulated thruster, for a pure inertia"),
    ]  # fmt: skip
    for loop, name in ((drag, "with drag"), (free, "without drag")):
        seen = loop.cycle.simulated
        assert seen is not None
        fundamental = loop.newton * seen.amplitude
        rows += [
            Printed("limit cycle simulated, command", simulated, loop.newton * seen.peak, "N",
                    f"peak {name}; its fundamental is {fundamental:.2f} N"),
            Printed("limit cycle simulated, frequency", 1.0, seen.frequency, "rad/s",
                    f"{name}; \"almost exactly\" in print"),
        ]  # fmt: skip
    return rows


def _physical(model: Thruster) -> dict[str, float]:
    quantities = duct_quantities(model.quadratic_load, _PITCH, _AREA, _DENSITY)
    return {name: float(value) for name, value in quantities.items()}


def _first_order(model: Thruster) -> dict[str, float]:
    """Time constants of the lags nearest to the step of 1 V from rest [s]."""
    from scipy.optimize import least_squares

    time = np.arange(0.0, 5.5, 0.01)
    step = _record(model, time, np.ones(time.size)).measured
    end = math.sqrt(model.beta / model.alpha)
    rest = {"speed": end, "thrust": model.ct * end**2}

    def away(lag: np.ndarray, name: str) -> np.ndarray:
        return 1.0 - np.exp(-time / lag) - step[name] / rest[name]

    return {name: float(least_squares(away, [0.5], args=(name,)).x[0]) for name in rest}


def _record(model: Thruster, time: np.ndarray, command: np.ndarray) -> Log:
    result = simulate(model, Log(time, {"command": command}, units={"command": "V"}))
    return Log(time, {"command": command}, {n: result[n] for n in ("speed", "thrust")}, _UNITS)
