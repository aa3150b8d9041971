"""Compensators of a thruster's lag in a position loop: figures 15 to 21 of a paper, and a table.

One axis of the vehicle Jason Jr. follows a sinusoid under a position controller that takes its
thruster for ideal, with five ways to make up for what the thruster is (Yoerger, Cooke & Slotine
1990, section V). The paper prints the vehicle, the compensators, and the amplitude and frequency of
figure 20; the other amplitudes, the controller's bandwidth and the obstruction are chosen here.

Out come the tracking errors for large and small amplitudes, with the duct free and obstructed from
8 s on, as a share of the reference's standard deviation, and a figure for each of the paper's.

    python examples/compensators.py [FOLDER FOR THE FIGURES]
"""

import math

from _data import output_folder
from matplotlib.figure import Figure

import diffthrust as dft
from diffthrust import control as dc

THRUSTER = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022)
LARGE, SMALL = 0.05, 0.01
COLOURS = ["0.6", "#D55E00", "#0072B2"]
KINDS = {
    "none": dc.NoCompensator.of(THRUSTER),
    "lead": dc.Lead.of(THRUSTER),
    "pole cancellation": dc.PoleCancellation.of(THRUSTER, floor=0.3),
    "sliding": dc.Sliding.of(THRUSTER, floor=0.3),
    "adaptive sliding": dc.AdaptiveSliding.of(THRUSTER, floor=0.3),
    "adaptive from zero": dc.AdaptiveSliding(thrust_coefficient=0.022, gain=1.5, floor=5.0),
}
FIGURES = {  # number in the paper: kinds, amplitudes, obstructed
    15: (["none", "lead"], [LARGE], False),
    16: (["lead"], [SMALL], False),
    17: (["pole cancellation"], [SMALL, LARGE], False),
    18: (["pole cancellation"], [LARGE], True),
    19: (["adaptive sliding"], [SMALL, LARGE], False),
    21: (["adaptive sliding"], [LARGE], True),
}


def run(kind: str, reference: dc.Sinusoid, obstructed: bool = False) -> dc.LoopRun:
    naive = dc.PositionController(bandwidth=1.0)  # knows the vehicle: 340 kg, 67 N s^2/m^2
    faults = [dc.duct_obstruction(at=8.0)] if obstructed else []
    loop = dc.Loop(thruster=THRUSTER, vehicle=dft.AxisVehicle(), controller=naive, rate=200.0,
                   compensator=KINDS[kind], faults=faults)  # fmt: skip
    return loop.simulate(reference, 30.0)


def there_and_back(amplitude: float) -> dc.Sinusoid:
    """From rest, between zero and twice the amplitude, at 0.3 Hz."""
    return dc.Sinusoid(amplitude, 0.6 * math.pi, offset=amplitude, phase=-math.pi / 2)


def draw(panels: list, number: int) -> None:
    """One panel for each list of lines (label, run, signal), up to a time."""
    figure = Figure(figsize=(7.0, 0.6 + 2.4 * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), squeeze=False)[:, 0]
    for axes, (title, until, lines) in zip(rows, panels, strict=True):
        for i, (label, made, signal) in enumerate(lines):
            axes.plot(made.time, made[signal], color=COLOURS[i], label=label)
        axes.set_title(title, loc="left", fontsize=9)
        axes.set_xlim(0.0, until)
        axes.set(xlabel="time [s]", ylabel=f"{signal.split('.')[-1]} [{made.units[signal]}]")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, fontsize=8, frameon=False)
    figure.savefig(output_folder() / f"yoerger_figure_{number}.png", dpi=80)


for number, (kinds, amplitudes, obstructed) in FIGURES.items():
    panels = []
    for a in amplitudes:
        runs = {kind: run(kind, there_and_back(a), obstructed) for kind in kinds}
        lines = [("reference", runs[kinds[0]], "reference")]
        lines += [(kind, made, "position") for kind, made in runs.items()]
        title = f"amplitude {a:g} m{', duct obstructed from 8 s on' * obstructed}"
        panels.append((title, 30.0 if obstructed else 12.0, lines))
    draw(panels, number)

learning = run("adaptive from zero", there_and_back(0.2))
estimates = ["compensator.load_estimate", "compensator.inertia_estimate"]
draw([("", 30.0, [("from zero", learning, n)]) for n in estimates], 20)
cases = [(o, a) for o in (False, True) for a in (LARGE, SMALL)]
print("error from 15 to 30 s [%] " + "".join(
    f"{f'{a * 100:g} cm' + ', obstructed' * o:>18}" for o, a in cases))  # fmt: skip
for kind in list(KINDS)[:5]:
    runs = [run(kind, there_and_back(a), o) for o, a in cases]
    print(f"{kind:26}" + "".join(f"{100 * r.tracking(start=15.0).relative:18.1f}" for r in runs))
last = learning.time[abs(learning["compensator.sliding_error"]) > 4.0][-1]
print(f"The estimates that begin at zero rest from {last:.1f} s on.")
for name, truth in zip(estimates, (0.037 / 42.0, 1.0 / 42.0), strict=True):
    print(f"{name}: {learning[name][-1]:.3g}, true value {truth:.3g}")
