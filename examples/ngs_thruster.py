"""What a real thruster lacks
==========================

What does a real thruster have that the basic model lacks? Bench runs of a small ROV thruster.

The model is fitted to every sine and ramp run and tried on every step run, which it has not seen.
The basic thruster is off by some 19 rad/s there. The diagnosis tells where, tries every effect that
these logs can test, adds what helps, and names what is left. Out come its report
as text and as a page, and a figure of the error falling stage by stage. The tachometer of these
runs gives no sign (``unsigned=True``), and the files are read as they are. Data: J. Boehm, MSc
thesis, University of Maryland, 2019. Takes some 200 s of processor time.

    python examples/ngs_thruster.py [FOLDER FOR REPORT AND FIGURE]
"""

from _data import output_folder, runs_of

import diffthrust as dft

runs = runs_of(dft.datasets.ngs_thruster, "CL*")
train, unseen = runs.train, runs.unseen
fit = dft.fit(dft.Thruster(), train, holdout=unseen)
diag = dft.diagnose(fit, train, holdout=unseen, experiment=False)
print(diag.report())

print("The error on the unseen runs as the diagnosis went on:")
for stage in diag.stages:
    errors = ", ".join(f"{n} {e.rmse:.3g}" for n, e in stage.holdout.channels.items())
    print(f"- {' + '.join(['basic model', *stage.effects])}: RMSE {errors}")
diag.save(output_folder() / "ngs_diagnosis.html")
diag.plot().savefig(output_folder() / "ngs_stages.png", dpi=100)
print(f"Report and figure: {output_folder()}")
