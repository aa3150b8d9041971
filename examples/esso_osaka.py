"""The basic vessel against a real one: a 3 m model of the tanker Esso Osaka on a pond.

The vessel is fitted to zigzag and turning runs and tried on others that it has not seen; every run
is cut at 150 s, and errors are those of one simulation over the whole run from its first state.
Their positive rudder angle pushes the stern to port, ours to starboard, so the column is read with
``scale=-1``. Out come the errors of surge, sway and yaw rate, where the model fails, and a figure
of the worst unseen run. Data: Miyauchi et al. 2022, doi 10.1007/s00773-022-00889-3, and Wakita et
al. 2022, doi 10.1007/s00773-021-00867-1.

    python examples/esso_osaka.py [FOLDER FOR THE FIGURE]
"""

from pathlib import Path

import numpy as np
from _data import data_folder, output_folder

import diffthrust as dft
from diffthrust import Column


def read(path: Path) -> dft.Log:
    return dft.read_log(
        path,
        time=Column("t [s]", unit="s"),
        inputs={
            "propeller_speed": Column("n_prop [rps]", unit="rps"),
            "rudder_angle": Column("delta_rudder [rad]", unit="rad", scale=-1),
        },
        measured={
            "surge": Column("u_velo [m/s]", unit="m/s"),
            "sway": Column("vm_velo [m/s]", unit="m/s"),
            "yaw_rate": Column("r_angvelo [rad/s]", unit="rad/s"),
        },
        stop=150.0,
    )


files = sorted(data_folder("esso_osaka").glob("*.csv"))
zigzag = [path for path in files if path.name.startswith("zigzag")]
cut, september, october = (
    [path for path in files if path.name.startswith(word)]
    for word in ("turn_cut", "turn_14-Sep", "turn_14-Oct")
)
train = [read(path) for path in [*zigzag[:5], *cut, *september[:2]]]
unseen = [read(path) for path in [*zigzag[5:], *october[:4]]]

# the lever arm (half the length) is fixed: it cannot be told from the yaw inertia and damping
fit = dft.fit(dft.Vessel(lever_arm=1.5), train, holdout=unseen)
print(fit.report())
comparison = dft.compare(fit, unseen)

print("Where the basic model fails on the unseen runs:")
for name, error in comparison.errors.channels.items():
    traces = [run.channels[name] for run in comparison.runs]
    early, late = (
        np.concatenate([np.array_split(trace.residual, 2)[half] for trace in traces])
        for half in (0, 1)
    )
    worst = max(comparison.runs, key=lambda run: run.errors.channels[name].rmse)
    print(
        f"- {name}: NRMSE {error.nrmse:.3f}. RMSE {error.rmse:.2g} {traces[0].unit}: "
        f"{np.sqrt(np.nanmean(early**2)):.2g} in the first halves of the runs, "
        f"{np.sqrt(np.nanmean(late**2)):.2g} in the second. Worst in {worst.name}, where the model "
        f"explains {worst.errors.channels[name].fit_percent:.0f} %."
    )
worst = max(comparison.runs, key=lambda run: run.errors.channels["sway"].rmse)
figure = output_folder() / "esso_unseen.png"
comparison.plot([worst.name]).savefig(figure, dpi=100)
print(f"Figure: {figure} ({worst.name}, the run with the largest error of sway)")
