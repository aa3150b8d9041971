"""Adaptation in an obstructed duct
================================

What adaptation is for: an obstructed duct, and estimates that begin at zero.

Yoerger, Cooke & Slotine (1990, section V E) show an adaptive sliding controller that keeps its
course when the thruster's duct is obstructed at 8 s (figure 21, beside the cancellation of the pole
in figure 18), and one whose estimates begin at zero (figure 20: 0.2 m at 0.3 Hz). How large the
movement of figures 18 and 21 is, what the obstruction changes and the gains are not legible or not
printed; here 5 cm about the middle, twice the load on the shaft, 0.9 of the thrust, and a gain of
1 V, which is less than the obstruction takes: plain sliding with the same gain lacks the rest. The
motor takes 10 V, and the controllers know it: their commands end there, and so does the learning.
What error the adaptive one keeps is the thrust that the speed no longer gives: nobody measures it.

That choice shows adaptation at its best. Inside the boundary layer nothing is learned (section V
E), and there a gain of 1 V keeps small errors: at 1 cm the estimate stays at 1.00 of the free
duct's load, and with 1.5 times the load at 5 cm it stops at 1.08. A larger movement teaches the
load (10 cm: 1.52), as long as the commands do not end at 10 V (three times the load, 10 cm: 3.64).

Out come errors and estimates, for this choice and for others, and figures 20 and 21: what the
controller believes beside what is.

    python examples/papers_yoerger_adaptive.py [FOLDER FOR THE FIGURES]
"""

import math

from _data import output_folder
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import diffthrust as dft
from diffthrust import control as dc

JASON = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022)
LOAD, INERTIA, LIMIT = 0.037 / 42.0, 1.0 / 42.0, 10.0
ESTIMATES = ["compensator.load_estimate", "compensator.inertia_estimate"]
SAME = {"gain": 1.0, "floor": 0.3, "limit": LIMIT}
KINDS = {
    "pole cancellation": (dc.PoleCancellation.of(JASON, floor=0.3), "0.6"),
    "sliding": (dc.Sliding.of(JASON, **SAME), "#D55E00"),
    "adaptive sliding": (dc.AdaptiveSliding.of(JASON, load_rate=1e-7, **SAME), "#0072B2"),
}
UNKNOWING = dc.AdaptiveSliding(thrust_coefficient=0.022, gain=1.5, width=6.0, load_rate=2e-8,
                               inertia_rate=2e-6, floor=5.0, limit=LIMIT)  # fmt: skip


def run(block: dc.Compensator, amplitude: float, load: float, speed: float) -> dc.LoopRun:
    """There and back at 0.3 Hz, the thruster turning at first with ``speed``.

    From 8 s on the duct is obstructed: ``load`` is the factor of what the shaft bears.
    """
    loop = dc.Loop(thruster=JASON + dft.effects.CommandSaturation(limit=LIMIT), rate=200.0,
                   vehicle=dft.AxisVehicle(), compensator=block,
                   faults=[dc.duct_obstruction(at=8.0, load=load)] * (load > 1.0),
                   controller=dc.PositionController(bandwidth=1.0))  # fmt: skip
    reference = dc.Sinusoid(amplitude, 0.6 * math.pi, offset=amplitude, phase=-math.pi / 2)
    return loop.simulate(reference, 30.0, initial={"speed": speed})


def dressed(axes: Axes, label: str, title: str = "") -> None:
    axes.set(ylabel=label, xlim=(0.0, 30.0))
    axes.set_title(title, loc="left", fontsize=10)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)


# the speed of the shaft that gives the wanted thrust at 0 s, over the root of the amplitude
BEGUN = 0.6 * math.pi * math.sqrt(340.0 / 0.022)

figure = Figure(figsize=(9.5, 7.6), layout="constrained")
top, middle, below = figure.subplots(3, sharex=True)
middle.plot([0, 8, 8, 30], [LOAD, LOAD, 2 * LOAD, 2 * LOAD], "k--", linewidth=1.0, label="true")
for name, (block, colour) in KINDS.items():
    free, made = (run(block, 0.05, load, BEGUN * math.sqrt(0.05)) for load in (1.0, 2.0))
    errors = [100.0 * one.tracking(start=15.0).relative for one in (free, made)]
    print(f"{name}: error {errors[0]:.1f} % with the duct free, {errors[1]:.1f} % obstructed")
    top.plot(made.time, 100.0 * made["error"], color=colour, label=name)
    below.plot(made.time, made["motor_command"], color=colour, linewidth=0.8, label=name)
    if ESTIMATES[0] in made.signals:
        share = [one[ESTIMATES[0]][-1] / LOAD for one in (free, made)]
        print(f"load estimate over the true one of the free duct: {share[0]:.2f} with the duct "
              f"free, {share[1]:.2f} obstructed (true: 2)")  # fmt: skip
        middle.plot(made.time, made[ESTIMATES[0]], color=colour, label="estimate")
for load, amplitude in ((2.0, 0.01), (1.5, 0.05), (1.5, 0.1), (3.0, 0.1)):
    made = run(KINDS["adaptive sliding"][0], amplitude, load, BEGUN * math.sqrt(amplitude))
    share = made[ESTIMATES[0]][-1] / LOAD
    print(f"load x {load:g}, {100.0 * amplitude:g} cm: estimate {share:.2f} of the free duct's")
dressed(top, "tracking error [cm]", "Figure 21: 5 cm at 0.3 Hz, the duct obstructed from 8 s on")
dressed(middle, "load [V s²/rad²]")
dressed(below, "command at\nthe motor [V]")
below.set_xlabel("time [s]")
figure.savefig(output_folder() / "yoerger_figure_21.png", dpi=100)

learning = run(UNKNOWING, 0.2, 1.0, 0.0)
figure = Figure(figsize=(9.5, 5.2), layout="constrained")
panels = figure.subplots(2, sharex=True)
for axes, name, truth in zip(panels, ESTIMATES, (LOAD, INERTIA), strict=True):
    axes.plot(learning.time, learning[name], color="#0072B2", label="estimate")
    axes.axhline(truth, color="black", linestyle="--", linewidth=1.0, label="true")
    dressed(axes, f"{name.split('.')[1].split('_')[0]} [{learning.units[name]}]")
    moved = learning.time[1:][abs(learning[name][1:] - learning[name][-1]) > 0.02 * truth]
    print(f"{name}: {learning[name][-1] / truth:.2f} of the true value, within 2 % of its last "
          f"value from {moved[-1]:.1f} s on")  # fmt: skip
panels[0].set_title("Figure 20: estimates from zero, 0.2 m at 0.3 Hz", loc="left", fontsize=10)
panels[1].set_xlabel("time [s]")
figure.savefig(output_folder() / "yoerger_figure_20.png", dpi=100)
