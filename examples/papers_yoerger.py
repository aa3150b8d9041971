"""Static and dynamic test of a thruster
=====================================

The static and the dynamic test of a thruster, and what a fit of the whole record adds.

Yoerger, Cooke & Slotine (1990, section III) find ct and beta/alpha from steady levels (figures 8
and 9) and alpha and beta from a random command through a low-pass of 1 Hz (figure 10). Here both
tests are run on records of a simulated thruster with the paper's values, and the second is repeated
with fresh noise beside `dft.fit` of the same records: bias and spread of both, for three levels of
noise in the measured speed.

    python examples/papers_yoerger.py [FOLDER FOR THE FIGURES]
"""

import numpy as np
from _data import output_folder
from rich.console import Console
from rich.table import Table

import diffthrust as dft
from diffthrust.papers import lowpass_noise, staircase, yoerger

JASON = dft.Thruster(alpha=0.037, beta=42.0, ct=0.019)  # the paper's dynamic test
STEP = 0.02
REPEATS = 20
UNITS = {"command": "V", "speed": "rad/s", "thrust": "N"}


def record(time: np.ndarray, command: np.ndarray, noise: float, seed: int) -> dft.Log:
    rng = np.random.default_rng(seed)
    found = dft.simulate(JASON, dft.Log(time, {"command": command}, units={"command": "V"}))
    measured = {name: found[name] + size * rng.standard_normal(time.size)
                for name, size in (("speed", noise), ("thrust", 0.5))}  # fmt: skip
    return dft.Log(time, {"command": command}, measured, UNITS)


def main() -> None:
    folder, console = output_folder(), Console(width=100)

    levels = record(*staircase([0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4], 12.0, STEP), noise=0.5, seed=0)
    static = yoerger.static_test(levels, settle=8.0)
    static.plot().savefig(folder / "yoerger_figures_8_9.png", dpi=120)
    # another seed than the command's: the same one would draw the same numbers
    moving = record(*lowpass_noise(40.0, STEP, peak=4.0, seed=1), noise=0.5, seed=2)
    dynamic = yoerger.dynamic_test(moving)
    dynamic.plot().savefig(folder / "yoerger_figure_10.png", dpi=120)

    table = Table(
        "", "paper", "here", "remark", title="The paper's numbers, from simulated records"
    )
    ratio = dynamic.beta.value / dynamic.alpha.value
    for name, paper, ours, remark in (
        ("ct, static (N s^2)", "0.022", f"{static.ct.value:.4f}", "the record was made with 0.019"),
        ("beta/alpha, static", "1.0e3", f"{static.ratio.value:.4g}", "42 / 0.037 = 1135"),
        ("alpha, dynamic (1/rad)", "0.037", f"{dynamic.alpha.value:.4f}", ""),
        ("beta, dynamic", "42", f"{dynamic.beta.value:.2f}", ""),
        ("beta/alpha, dynamic", "1.1e3", f"{ratio:.4g}", ""),
        (
            "ct, dynamic (N s^2)",
            "0.019",
            f"{dynamic.ct.value:.4f}",
            "the paper's two differ by 14 %",
        ),
    ):
        table.add_row(name, paper, ours, remark)
    console.print(table)

    table = Table("noise (rad/s)", "", "alpha: bias (%)", "spread (%)", "beta: bias (%)",
                  "spread (%)", title=f"{REPEATS} records of 40 s each")  # fmt: skip
    for noise in (0.2, 1.0, 3.0):
        rows = {"least squares": [], "fit": []}
        for seed in range(REPEATS):
            log = record(*lowpass_noise(40.0, STEP, peak=4.0, seed=100 + seed), noise, seed)
            linear, fit = yoerger.dynamic_test(log), dft.fit(dft.Thruster(), log)
            rows["least squares"].append([linear.alpha.value, linear.beta.value])
            rows["fit"].append([fit.parameters[name].value for name in ("alpha", "beta")])
        for name, values in rows.items():
            share = 100.0 * (np.array(values) / [JASON.alpha, JASON.beta] - 1.0)
            bias, spread = share.mean(axis=0), share.std(axis=0)
            numbers = (f"{bias[0]:+.2f}", f"{spread[0]:.2f}", f"{bias[1]:+.2f}", f"{spread[1]:.2f}")
            table.add_row(f"{noise}", name, *numbers)
        table.add_section()
    console.print(table)


if __name__ == "__main__":
    main()
