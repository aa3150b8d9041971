"""A small boat in gusts, identified step by step
==============================================

The identification of a small boat, one parameter after the other and all at once, in gusts.

Siramdasu & Fahimi (2013, section 3) read the ratios of a boat from straight runs and circles, each
value entering the next line. Here a simulated boat with their values makes these runs in gusts
that nobody measures (a wind that wanders about 1.5 m/s, in any direction), and both ways are
compared on many such days: the sequence, and `dft.fit` of all runs together. Both are judged on an
unseen zigzag of the same boat in calm water, and by the spread of the parameters.

    python examples/papers_siramdasu.py [FOLDER FOR THE FIGURES] [DAYS]
"""

import sys

import numpy as np
from _data import output_folder
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.signal import lfilter

import diffthrust as dft
from diffthrust.papers import siramdasu

BOAT = dft.Vessel()
GUSTY = BOAT + dft.effects.Wind(along=0.02, across=0.04, turning=0.005, direction=0.0)
SPEEDS, ANGLES = (69.2, 98.0, 120.0), np.radians([-24.0, -16.0, 8.0, 16.0, 24.0])
NOISE = {"surge": 0.01, "sway": 0.01, "yaw_rate": 0.01}
UNITS = {"propeller_speed": "rev/s", "rudder_angle": "rad"}
STEP = 0.1


def run(n: float, angle: np.ndarray, rng: np.random.Generator, gusty: bool = True) -> dft.Log:
    """One run from rest; the wind, if any, is not in its log."""
    time = STEP * np.arange(angle.size)
    inputs = {"propeller_speed": np.full(time.size, n), "rudder_angle": angle}
    white = rng.standard_normal(time.size + 200)
    slow = lfilter([np.sqrt(1 - 0.97**2)], [1, -0.97], white)[200:]  # remembers 3 s
    wind = {"wind_speed": gusty * np.abs(1.5 + 0.75 * slow),
            "wind_direction": np.full(time.size, rng.uniform(-np.pi, np.pi))}  # fmt: skip
    units = {**UNITS, "wind_speed": "m/s", "wind_direction": "rad"}
    result = dft.simulate(GUSTY if gusty else BOAT, dft.Log(time, {**inputs, **wind}, units=units))
    measured = {c: result[c] + s * rng.standard_normal(time.size) for c, s in NOISE.items()}
    units = {**UNITS, "surge": "m/s", "sway": "m/s", "yaw_rate": "rad/s"}
    return dft.Log(time, inputs, measured, units)


def day(rng: np.random.Generator) -> tuple[list[dft.Log], list[dft.Log]]:
    straight = [run(n, np.zeros(151), rng) for n in SPEEDS]
    turned = (np.arange(201) >= 50).astype(float)
    return straight, [run(98.0, a * turned, rng) for a in ANGLES]


def main() -> None:
    folder, console = output_folder(), Console(width=120)
    days = int(sys.argv[2]) if len(sys.argv) > 2 else 50
    zigzag = run(98.0, np.radians(20.0) * np.sign(np.sin(0.5 * STEP * np.arange(400))),
                 np.random.default_rng(0), gusty=False)  # fmt: skip
    names = [name for name, p in BOAT.parameters.items() if not p.fixed]
    errors, values = {"sequence": [], "fit": []}, {"sequence": [], "fit": []}
    for seed in track(range(days), "days", console=console, disable=not console.is_terminal):
        straight, circles = day(np.random.default_rng(1 + seed))
        try:
            result = siramdasu.sequential(straight, circles)
        except dft.InputError:  # a gust has turned a line round
            continue
        fit = dft.fit(BOAT, [*straight, *circles])
        for way, vessel in (("sequence", result.vessel), ("fit", fit.model)):
            errors[way].append(dft.compare(vessel, zigzag).errors.nrmse)
            values[way].append([vessel.parameters[name].value for name in names])
        if seed == 0:
            result.plot().savefig(folder / "siramdasu_sequence.png", dpi=120)

    table = Table("", "median NRMSE", "worst", *(f"{name} (%)" for name in names),
                  title="On an unseen zigzag; spread of the parameters over the days")  # fmt: skip
    truth = np.array([BOAT.parameters[name].value for name in names])
    for way, nrmse in errors.items():
        spread = 100.0 * np.std(np.array(values[way]) / truth, axis=0)
        table.add_row(way, f"{np.median(nrmse):.4f}", f"{np.max(nrmse):.4f}",
                      *(f"{x:.1f}" for x in spread))  # fmt: skip
    console.print(table)
    print(f"The sequence gave an answer on {len(errors['sequence'])} of {days} days.")
    calm = siramdasu.sensitivity(*day(np.random.default_rng(1)))
    print(f"Pairs of speeds move the simulated path by {calm.spread:.2f} m in 20 s (paper: 0.4 m).")


if __name__ == "__main__":
    main()
