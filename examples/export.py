"""A fitted thruster in C, Python and simulators
=============================================

Take it with you: a fitted thruster as plain Python, C, a table and parts of three simulators.

The log is that of the Jason thruster that diffthrust demo fits; the fit gets a dead band in its
command, so that there is something that simulators cannot express. Out come the files, what each
target leaves out, and how far the module of plain Python is from `simulate`.

    python examples/export.py [FOLDER FOR THE FILES]
"""

import importlib.util
from pathlib import Path

import numpy as np
from _data import output_folder

import diffthrust as dft

fits = Path(__file__).parents[1] / "fits"
log = dft.specs.load_spec(fits / "jason_thruster").holdout_logs()[0]
band = dft.effects.CommandDeadband(half_width=dft.Parameter(0.2, fixed=True))
fit = dft.fit(dft.Thruster() + band, dft.specs.load_spec(fits / "jason_thruster").train_logs())

folder = output_folder()
files = ["jason.py", "jason.h", "jason.csv", "jason.sdf", "jason.xacro", "jason.scn"]
for target, name in zip(dft.export.TARGETS, files, strict=True):
    exported = fit.export(target, folder / name)
    print(f"{target}: {exported.path.name}, {len(exported.text.splitlines())} lines")
    for note in exported.notes:
        print(f"    {note}")

spec = importlib.util.spec_from_file_location("jason", folder / "jason.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
twin, command = module.Jason(), log.values("command", "V")
rows = [twin.reset(command[0], time=log.time[0])]
rows += [twin.step(gap, now) for gap, now in zip(np.diff(log.time), command[1:], strict=True)]
wanted = dft.simulate(fit.model, log, initial={"speed": 0.0}, substeps=fit.substeps)
thrust = np.array([row["thrust"] for row in rows])
off = np.max(np.abs(thrust - wanted["thrust"])) / np.ptp(wanted["thrust"])
print(f"The module is within {off:.0e} of simulate, over {log.duration:.0f} s of an unseen log.")

force, volts = np.loadtxt(folder / "jason.csv", delimiter=",", skiprows=1).T
print(f"20 N need {np.interp(20.0, force, volts):.2f} V, 1 N needs "
      f"{np.interp(1.0, force, volts):.2f} V.")  # fmt: skip
