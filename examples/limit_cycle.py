"""Limit cycle of a position loop
==============================

Why a vehicle does not hold still: the limit cycle of a position control and its thruster.

Yoerger, Cooke & Slotine (1990, section IV) place the poles of one axis of the vehicle Jason Jr. as
if its thruster were ideal. The thruster turns slowly when little is asked of it, so the loop is
unstable near its set point and calm far from it, and ends in a limit cycle between. The script
prints what two formulas, a describing function, a balance of harmonics and a full simulation say
of it beside the paper's figures, and draws its figures 13 (the poles move) and 14 (the course).

    python examples/limit_cycle.py [FOLDER FOR THE FIGURES]
"""

from _data import output_folder

import diffthrust as dft

thruster = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022)

loop = dft.cycles.thruster_loop_cycle(
    thruster, mass=340.0, drag=67.0, natural_frequency=1.0, damping=0.707
)
print(loop.report())

free = dft.cycles.thruster_loop_cycle(
    thruster, mass=340.0, drag=0.0, natural_frequency=1.0, damping=0.707
)
print(f"\nWithout drag:\n{free.report()}")
print(
    f"The paper's 15.7 N is near what the describing function of the thruster itself (the first "
    f"harmonic of its settled answer) gives for a pure inertia: "
    f"{free.newton * free.cycle.amplitude:.2f} N."
)

folder = output_folder()
free.plot_poles().savefig(folder / "yoerger_figure_13.png", dpi=90)
loop.plot(displacement=0.02, duration=50.0).savefig(folder / "yoerger_figure_14.png", dpi=90)

# Any other loop: a saturated amplifier before a plant that is stable only while the gain is high.
# It holds small disturbances and loses large ones: the limit cycle between them is unstable.
plant = ([3.0, 12.0, 12.0], [1.0, 0.0, 0.0, 0.0])
found = dft.cycles.limit_cycles(plant, dft.cycles.Saturation(1.0))
print(f"\n{found.report()}")
found.plot().savefig(folder / "saturation.png", dpi=90)
dft.cycles.plot_pole_motion(plant, dft.cycles.Saturation(1.0)).savefig(
    folder / "saturation_poles.png", dpi=90
)
