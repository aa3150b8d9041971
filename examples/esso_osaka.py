"""A model of the tanker Esso Osaka
================================

The basic vessel against a real one: a 3 m model of the tanker Esso Osaka on a pond.

The vessel is fitted to zigzag and turning runs and tried on others that it has not seen; every run
is cut at 150 s, and errors are those of one simulation over the whole run from its first state.
The diagnosis then tries what the basic vessel may lack; a wind was measured, and the
logs give it as an input. Out come where the model fails, what it lacks, the error on the unseen
runs stage by stage, and the report as a page. The tanker moves slowly and its log is smooth: means
over half a second tell as much as all samples. Takes six minutes of processor time. Data: Miyauchi
et al. 2022, doi 10.1007/s00773-022-00889-3, and Wakita et al. 2022, doi 10.1007/s00773-021-00867-1.

    python examples/esso_osaka.py [FOLDER FOR REPORT AND FIGURE]
"""

from _data import output_folder, runs_of

import diffthrust as dft

runs = runs_of(dft.datasets.esso_osaka, "zigzag*", "turn*")
train, unseen = ([log.averaged(5) for log in logs] for logs in (runs.train, runs.unseen))

# the lever arm (half the length) is fixed: it cannot be told from the yaw inertia and damping
fit = dft.fit(dft.Vessel(lever_arm=1.5), train, holdout=unseen)
print(fit.report())
diag = dft.diagnose(fit, train, holdout=unseen, experiment=False)
print(diag.report())

print("The error on the unseen runs as the diagnosis went on:")
for stage in diag.stages:
    errors = ", ".join(f"{name} {e.nrmse:.3f}" for name, e in stage.holdout.channels.items())
    effects = " + ".join(["basic model", *stage.effects])
    print(f"- {effects}: NRMSE {stage.holdout.nrmse:.3f} ({errors})")
diag.save(output_folder() / "esso_diagnosis.html")
diag.plot().savefig(output_folder() / "esso_stages.png", dpi=100)
print(f"Report and figure: {output_folder()}")
