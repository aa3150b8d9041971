"""Path following under predictive control
=======================================

A small boat follows a path under predictive control, in wind and current that it does not know.

The boat is that of Siramdasu & Fahimi 2013 with their identified model; the limits of the hinged
propeller are theirs (24 degrees), and so are the speed of 0.8 m/s and the errors at the start
(figures 16 to 18). How hard the wind pushes their boat and how fast it was at the start are not
printed; chosen here: a wind of 4 m/s, within the gusts of their day (5 to 10 mph), on some 0.2 m^2
from the side, and 0.7 m/s.

Three controllers are compared: a plain one that knows nothing of the disturbance, as in the paper;
one that estimates it from its own errors of one sample; and one whose model was fitted to the
record of the plain one, with the effect that was missing. Two more plain ones show what else can be
asked: the bow on the path rather than the centre of gravity (figure 1; how far ahead the paper's
control point lies is not printed), and a gentle helm: 0.2 rad/s of rudder and of turn at most. Out
come the errors, how long a sample takes to solve, and a figure of each plain run.

    python examples/path_tracking.py [FOLDER FOR THE FIGURE]
"""

import math

from _data import output_folder
from rich.console import Console
from rich.table import Table

import diffthrust as dft
from diffthrust import control as dc

BOAT = dft.Vessel()
EAST = math.pi / 2
RUDDER = math.radians(24.0)
LIMITS = {"propeller_speed": (0.0, 150.0), "rudder_angle": (-RUDDER, RUDDER)}
START = {"north": -0.75, "east": -0.2, "surge": 0.7}
NOISE = {"surge": 0.01, "sway": 0.01, "yaw_rate": 0.01, "north": 0.02, "east": 0.02,
         "heading": 0.005}  # fmt: skip
PATHS = {
    "straight": dc.StraightPath(0.8, course=EAST),
    "harmonic": dc.HarmonicPath(0.8, amplitude=1.5, wavelength=15.0, course=EAST),
}
DISTURBANCES = {  # what pushes the boat to the south, and the effect before its size is known
    "wind": (
        dft.effects.Wind(along=0.05, across=0.08, turning=0.0, direction=0.0, speed=4.0),
        dft.effects.Wind(speed=4.0),
    ),
    "current": (
        dft.effects.WaterCurrent(to_north=-0.15, to_east=0.0),
        dft.effects.WaterCurrent(),
    ),
}


def run(truth: dft.Model, path: dc.Path, **controller) -> dc.TrackRun:
    mpc = dc.MPC(**{"model": BOAT, "limits": LIMITS, **controller})
    loop = dc.VesselLoop(vessel=truth, controller=mpc, noise=NOISE)
    return loop.simulate(path, 60.0, initial=START)


def main() -> None:
    folder = output_folder()
    table = Table("disturbance", "path", "controller", "along, largest (m)", "across, mean (m)",
                  "across, largest (m)", "rudder, largest (deg)", "turn, largest (rad/s)",
                  title="Errors from 20 s to 60 s, in wind or current from north")  # fmt: skip
    for disturbance, (effect, unknown) in DISTURBANCES.items():
        for name, path in PATHS.items():
            runs = {"plain": run(BOAT + effect, path)}
            runs["estimating"] = run(BOAT + effect, path, disturbance=2.0)
            runs["bow"] = run(BOAT + effect, path, point=0.4)
            runs["gentle"] = run(BOAT + effect, path, slew={"rudder_angle": 0.2},
                                 limits={**LIMITS, "yaw_rate": (-0.2, 0.2)})  # fmt: skip
            ratios = [p for p, described in BOAT.parameters.items() if not described.fixed]
            fit = dft.fit(BOAT.fix(*ratios) + unknown, runs["plain"].log)
            runs["fitted"] = run(BOAT + effect, path, model=fit.model)
            for controller, found in runs.items():
                along, across = found.along(20.0), found.across(20.0)
                rudder = math.degrees(abs(found["rudder_angle"]).max())
                turn = abs(found["yaw_rate"]).max()
                numbers = (along.largest, across.mean, across.largest, rudder, turn)
                table.add_row(disturbance, name, controller, *(f"{x:.2f}" for x in numbers))
            table.add_section()
            figure = runs["plain"].plot()
            figure.savefig(folder / f"path_tracking_{name}_{effect.name}.png", dpi=120)
            print(f"{disturbance}, {name}: {runs['plain'].solve_time}")
    Console(width=110).print(table)
    print("The paper, straight line: along within 0.3 m, across near 0.45 m, rudder up to 24 deg.")


if __name__ == "__main__":
    main()
