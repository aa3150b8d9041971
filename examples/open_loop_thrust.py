"""Thrust that overshoots and kicks back
=====================================

Thrust that overshoots and kicks back: open-loop runs of a thruster, speed as the input.

A voltage is switched on and off again; the thrust overshoots at the run-up and turns negative at
the stop, which a law of the speed alone cannot do. The measured speed drives the model, so that
only the thrust is on trial; the file name tells the sign of the speed, and the load cell's tare is
taken from the rest before the start. From one sample to the next the diagnosis is sure of axial
flow, which makes overshoot and kick; over whole runs it removes nothing that surely matters: the
verdict is "undecided", with the record that would decide. Out come the report and a figure of the
stages. Data: J. Boehm, MSc thesis, University of Maryland, 2019.

    python examples/open_loop_thrust.py [FOLDER FOR REPORT AND FIGURE]
"""

import numpy as np
from _data import output_folder, runs_of

import diffthrust as dft

TRAIN = ("plus15V", "plus3V", "minus2V", "minus25V")
UNSEEN = ("plus2V", "plus25V", "minus15V", "minus3V")


def tared(name: str) -> dft.Log:
    log = runs[f"open_loop_{name}"].averaged(8)
    speed, thrust = log.inputs["speed"], log.measured["thrust"]
    tare = np.median(thrust[np.abs(speed) < 1.0])
    inputs = {"speed": speed, "command": np.zeros_like(speed)}  # what drove it was not logged
    return dft.Log(log.time, inputs, {"thrust": thrust - tare}, hold="linear", name=name)


runs = runs_of(dft.datasets.ngs_thruster, "open_loop*")
train, unseen = [tared(name) for name in TRAIN], [tared(name) for name in UNSEEN]
fit = dft.fit(dft.Thruster(), train, holdout=unseen)
diag = dft.diagnose(fit, train, holdout=unseen, experiment=False)
print(diag.report())
diag.save(output_folder() / "open_loop_diagnosis.html")
diag.plot().savefig(output_folder() / "open_loop_stages.png", dpi=100)
print(f"Report and figure: {output_folder()}")
