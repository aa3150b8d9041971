"""Gains by gradient
=================

Gains by gradient: a lead compensator and its position loop, tuned through the simulation.

The lead network of Yoerger, Cooke & Slotine 1990, section V B, was placed by hand for commands
near 1 V. Here its zero and pole and the bandwidth of the position loop are tuned for one sinusoid,
with a computational delay, sensor noise and a price on the command; derivatives are carried forward
through the whole loop. Out come the gains and the cost, the tracking errors on the amplitude that
was tuned for and on a third of it, and a figure of both.

    python examples/tune_lead.py [FOLDER FOR THE FIGURE]
"""

import math

from _data import output_folder
from matplotlib.figure import Figure

import diffthrust as dft
from diffthrust import control as dc

thruster = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022)
pole = dft.Parameter(6.5, bounds=(0.1, 60.0), transform="log")  # not beyond what 50 Hz can do
loop = dc.Loop(
    thruster=thruster,
    vehicle=dft.AxisVehicle(mass=340.0, drag=67.0),
    controller=dc.PositionController(bandwidth=1.0),
    compensator=dc.Lead.of(thruster, pole=pole),
    rate=50.0,
    delay=0.02,
    noise={"position": 1e-4, "velocity": 5e-4},
)


def there_and_back(amplitude: float) -> dc.Sinusoid:
    return dc.Sinusoid(amplitude, 0.6 * math.pi, offset=amplitude, phase=-math.pi / 2)


gains = ["controller.bandwidth", "compensator.zero", "compensator.pole"]
cost = dc.Effort(price=1e-3, start=5.0)
tuned = dc.tune(loop, there_and_back(0.05), 25.0, gains, cost=cost)
print(tuned.report())

figure = Figure(figsize=(7.0, 5.4), layout="constrained")
for axes, amplitude in zip(figure.subplots(2), (0.05, 0.015), strict=True):
    runs = {
        name: one.simulate(there_and_back(amplitude), 15.0, seed=1)
        for name, one in (("by hand", loop), ("tuned", tuned.loop))
    }
    errors = {name: 100 * run.tracking(start=5.0).relative for name, run in runs.items()}
    print(f"Amplitude {amplitude:g} m: error {errors['by hand']:.1f} % by hand, "
          f"{errors['tuned']:.1f} % tuned.")  # fmt: skip
    axes.plot(
        runs["tuned"].time, runs["tuned"]["reference"], color="0.6", lw=2.4, label="reference"
    )
    for colour, (name, run) in zip(("#0072B2", "#D55E00"), runs.items(), strict=True):
        axes.plot(run.time, run["position"], color=colour, label=name)
    axes.set(xlabel="time [s]", ylabel="position [m]")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, fontsize=8, frameon=False)
    axes.grid(True, color="0.9")
figure.savefig(output_folder() / "tune_lead.png", dpi=80)
