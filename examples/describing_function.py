"""Gain and phase of a thruster
============================

A thruster under a sinusoid: slower for small commands than for large ones.

Reproduces two figures of Yoerger, Cooke & Slotine 1990 for the Jason thruster. Figure 6: thrust
after steps of several sizes, over its end. Figure 12: the break frequency of the first-order lag
that the thruster resembles, over amplitude and frequency, by the paper's formula, by the
consistent one and by simulation. Then the same map for a thruster whose controller ignores small
commands, of which no formula knows.

    python examples/describing_function.py [FOLDER FOR FIGURES]
"""

import matplotlib.figure
import numpy as np
from _data import output_folder

import diffthrust as dft
from diffthrust import effects

jason = dft.Thruster()  # the paper's dynamic test, figure 10
folder = output_folder()
time = np.linspace(0, 4, 401)

figure = matplotlib.figure.Figure(figsize=(6, 4), layout="constrained")
axes = figure.subplots()
for size, look in ((4.0, "-"), (2.0, "--"), (1.0, "-."), (0.5, ":")):
    step = dft.Log(time, {"command": np.full(time.size, size)}, {})
    thrust = dft.simulate(jason, step, initial={"speed": 0.0})["thrust"]
    share = thrust / (jason.ct * jason.beta / jason.alpha * size)
    axes.plot(time, share, look, color="#0072B2", label=f"{size:g} V")
    print(f"Step of {size:g} V: 63 % of the thrust after {time[np.argmax(share > 0.632)]:.2f} s")
axes.set(xlabel="time [s]", ylabel="thrust over its end", title="Steps (figure 6)")
axes.legend(title="step")
figure.savefig(folder / "figure_6.png", dpi=100)

volts, pace = np.geomspace(0.05, 4, 32), np.geomspace(0.1, 10, 32)
for method in ("paper", "consistent", "simulation"):
    result = dft.describing_function(jason, volts, pace, method=method)
    fastest = np.nanmax(result.break_frequency)
    print(f"{method}: break frequency up to {fastest:.2f} rad/s at commands up to 4 V")
    result.plot_break().savefig(folder / f"figure_12_{method}.png", dpi=100)

dead = dft.describing_function(jason + effects.CommandDeadband(half_width=0.3), volts, pace)
print(dead.report())
dead.plot().savefig(folder / "map_with_deadband.png", dpi=100)
print(f"Figures: {folder}")
