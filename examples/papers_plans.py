"""Test plans as files for the rig
===============================

Test plans of the papers' methods: files for the rig, and what a check says of a poor record.

For each method the inputs, durations and levels follow from a model, as it is believed to be, and
from the limits of the rig. The plans are written as CSV files, one for each run, with time and
inputs. Then two records are made as a rig might return them: a static test that was cut short, and
a black-box record that was played at half its pace; out comes what is missing in each.

    python examples/papers_plans.py [FOLDER FOR THE FILES]
"""

import numpy as np
from _data import output_folder

import diffthrust as dft
from diffthrust import plans
from diffthrust.papers import aras

THRUSTER, VESSEL = dft.Thruster(), dft.Vessel()
MOTOR = aras.thruster(load=aras.load_from(280.4))
SENSOR = dft.LinearSensor(slope=0.16, offset=1.6)
ANGLES = np.radians([-24.0, -16.0, 8.0, 16.0, 24.0])

PLANS = {
    "Yoerger, static test": plans.static_test(THRUSTER, limits=(-5, 5)),
    "Yoerger, dynamic test": plans.dynamic_test(THRUSTER, limits=(-5, 5)),
    "Siramdasu, both scenarios": plans.sequential(VESSEL, speeds=[69.2, 98, 120], angles=ANGLES),
    "Aras, depth sensor": plans.depth_calibration((0, 3.6576), sensor=SENSOR, readable=(0.2, 4.9)),
    "Aras, steady map": plans.steady_map(MOTOR, limits=(-13, 13)),
    "Aras, speed loop": plans.speed_steps(aras.speed_loop(MOTOR), limits=(-180, 180)),
    "Aras, black box, sequence": plans.black_box(aras.plant(), limits=(-13, 13)),
    "Aras, black box, sines": plans.black_box(MOTOR, limits=(-13, 13), signal="multisine"),
}


def answered(run: dft.Log, model: dft.Model) -> dft.Log:
    result = dft.simulate(model, run)
    return dft.Log(run.time, run.inputs, dict(result), {**run.units, **model.outputs})


def main() -> None:
    folder = output_folder()
    for name, plan in PLANS.items():
        files = plan.save(folder)
        band = f", {plan.band[0]:.3g} to {plan.band[1]:.3g} Hz" if plan.band else ""
        held = f"{len(plan.levels)} levels, {plan.settle:.3g} s to settle"
        held = held if plan.levels else "moving"
        print(f"{name}: {len(files)} files, {plan.duration:.0f} s, {held}{band}")

    static = PLANS["Yoerger, static test"]
    (run,) = static.runs.values()
    short = answered(run, THRUSTER).slice(0, 60)
    print(f"\nA static test that was cut short\n{static.check(short).report()}")
    moving = PLANS["Aras, black box, sines"]
    (run,) = moving.runs.values()
    slow = dft.Log(2.0 * run.time, run.inputs, units=run.units)
    print(f"\nA black-box record at half its pace\n{moving.check(slow).report()}")


if __name__ == "__main__":
    main()
