"""A BlueBoat on a lake
====================

The basic vessel against a real one: a BlueBoat with two thrusters, driven by hand on a lake.

The vessel is fitted to runs 216 to 226 and tried on runs 228, 230 and 232, which it has not seen.
The files are read as they are: the forces come from a static map of the thrusters, and the speeds
of one run end before its clock does. The basic model fails here, and
the comparison shows it: out come the errors by channel, how far the modelled motion follows the
measured one, that one channel does not mean what its header says, and a figure of the unseen runs.
With ``--diagnose`` a diagnosis follows, on means over half a second, in about a minute. It searches
for no effect: the logs are to be mended first, by the sign of the yaw rate or by an exchange of the
two forces, either of which explains how it turns.
Data: J. Kristiansen, BlueBoatSystemIdentification.

    python examples/blueboat.py [FOLDER FOR THE FIGURE] [--diagnose]
"""

import sys

import numpy as np
from _data import output_folder, runs_of

import diffthrust as dft

runs = runs_of(dft.datasets.blueboat)
train, unseen = runs.train, runs.unseen

# what is known beforehand: the authors give mass (to which water only adds) and yaw inertia, and no
# boat of this size stops turning in less than about a tenth of a second
vessel = dft.Vessel(drive="twin", lever_arm=0.285).replace(
    m11={"value": 20.0, "bounds": (15.0, None)},
    m22={"value": 20.0, "bounds": (15.0, None)},
    i33={"value": 1.7, "fixed": True},
    d11=30.0,
    d22=30.0,
    d33={"value": 5.0, "bounds": (0.0, 20.0)},
)
fit = dft.fit(vessel, train, holdout=unseen)
print(fit.report())
comparison = dft.compare(fit, unseen)

print("Where the basic model fails on the unseen runs:")
for name, error in comparison.errors.channels.items():
    traces = [run.channels[name] for run in comparison.runs]
    measured = np.concatenate([trace.measured for trace in traces])
    modelled = np.concatenate([trace.modelled for trace in traces])
    seen = np.isfinite(measured)
    together = np.corrcoef(measured[seen], modelled[seen])[0, 1]
    swing = np.std(modelled[seen]) / np.std(measured[seen])
    print(
        f"- {name}: RMSE {error.rmse:.2g} {traces[0].unit}, NRMSE {error.nrmse:.2f}, where 1 is no "
        f"better than a constant. The model swings {swing:.0%} as far as the vessel; the "
        f"correlation of the two is {together:+.2f}."
    )
print("What does not fit together:")
for hint in comparison.hints:
    print(f"- {hint}")
stuck = [name for name, estimate in fit.parameters.items() if estimate.at_bound]
print(f"Parameters that these logs push against a bound: {', '.join(stuck) or 'none'}.")
figure = output_folder() / "blueboat_unseen.png"
comparison.plot().savefig(figure, dpi=80)
print(f"Figure: {figure}")

if "--diagnose" in sys.argv:
    train, unseen = ([log.averaged(5) for log in logs] for logs in (train, unseen))
    fit = dft.fit(vessel, train, holdout=unseen)
    diag = dft.diagnose(fit, train, holdout=unseen, experiment=False)
    print(diag.report())
    diag.save(output_folder() / "blueboat_diagnosis.html")
