"""Compensators of a thruster's lag
================================

Compensators of a thruster's lag in a position loop: figures 15 to 19 of a paper, and a table.

One axis of the vehicle Jason Jr. follows a sinusoid under a position controller that takes its
thruster for ideal, with five ways to make up for what the thruster is (Yoerger, Cooke & Slotine
1990, section V). The paper prints the vehicle and the compensators; amplitudes, the controller's
bandwidth and the obstruction are chosen here. The motor takes 10 V, and no command goes beyond; the
thruster turns at the start as the reference asks for. Figures 20 and 21, where the adaptation comes
in, are those of ``papers_yoerger_adaptive.py``.

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
LARGE, SMALL, LIMIT = 0.05, 0.01, 10.0
SAME = {"gain": 1.0, "floor": 0.3, "limit": LIMIT}
COLOURS = ["0.6", "#D55E00", "#0072B2"]
KINDS = {
    "none": dc.NoCompensator.of(THRUSTER),
    "lead": dc.Lead.of(THRUSTER),
    "pole cancellation": dc.PoleCancellation.of(THRUSTER, floor=0.3),
    "sliding": dc.Sliding.of(THRUSTER, **SAME),
    "adaptive sliding": dc.AdaptiveSliding.of(THRUSTER, load_rate=1e-7, **SAME),
}
FIGURES = {  # number in the paper: kinds, amplitudes, obstructed
    15: (["none", "lead"], [LARGE], False),
    16: (["lead"], [SMALL], False),
    17: (["pole cancellation"], [SMALL, LARGE], False),
    18: (["pole cancellation"], [LARGE], True),
    19: (["adaptive sliding"], [SMALL, LARGE], False),
}


def run(kind: str, amplitude: float, obstructed: bool = False) -> dc.LoopRun:
    """From rest, between zero and twice the amplitude, at 0.3 Hz."""
    naive = dc.PositionController(bandwidth=1.0)  # knows the vehicle: 340 kg, 67 N s^2/m^2
    faults = [dc.duct_obstruction(at=8.0)] if obstructed else []
    loop = dc.Loop(thruster=THRUSTER + dft.effects.CommandSaturation(limit=LIMIT), faults=faults,
                   vehicle=dft.AxisVehicle(), controller=naive, rate=200.0,
                   compensator=KINDS[kind])  # fmt: skip
    frequency = 0.6 * math.pi
    reference = dc.Sinusoid(amplitude, frequency, offset=amplitude, phase=-math.pi / 2)
    speed = math.sqrt(340.0 * amplitude * frequency**2 / 0.022)  # of the wanted thrust at 0 s
    return loop.simulate(reference, 30.0, initial={"speed": speed})


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
        runs = {kind: run(kind, a, obstructed) for kind in kinds}
        lines = [("reference", runs[kinds[0]], "reference")]
        lines += [(kind, made, "position") for kind, made in runs.items()]
        title = f"amplitude {a:g} m{', duct obstructed from 8 s on' * obstructed}"
        panels.append((title, 30.0 if obstructed else 12.0, lines))
    draw(panels, number)

cases = [(o, a) for o in (False, True) for a in (LARGE, SMALL)]
print("error from 15 to 30 s [%] " + "".join(
    f"{f'{a * 100:g} cm' + ', obstructed' * o:>18}" for o, a in cases))  # fmt: skip
for kind in KINDS:
    runs = [run(kind, a, o) for o, a in cases]
    print(f"{kind:26}" + "".join(f"{100 * r.tracking(start=15.0).relative:18.1f}" for r in runs))
