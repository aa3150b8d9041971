"""The basic vessel against a real one: a 3 m model of the tanker Esso Osaka on a pond.

The vessel is fitted to zigzag and turning runs and tried on others that it has not seen; every run
is cut at 150 s, and errors are those of one simulation over the whole run from its first state.
Their positive rudder angle pushes the stern to port, ours to starboard, so the column is read with
``scale=-1``. The diagnosis then tries what the basic vessel may lack; a wind was measured, and the
logs give it as an input. Out come where the model fails, what it lacks, the error on the unseen
runs stage by stage, and the report as a page. The tanker moves slowly and its log is smooth: means
over half a second tell as much as all samples. Takes some minutes. Data: Miyauchi et al. 2022, doi
10.1007/s00773-022-00889-3, and Wakita et al. 2022, doi 10.1007/s00773-021-00867-1.

    python examples/esso_osaka.py [FOLDER FOR REPORT AND FIGURE]
"""

from pathlib import Path

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
            "wind_speed": Column("wind_velo_true [m/s]", unit="m/s"),
            "wind_direction": Column("wind_dir_true [rad]", unit="rad"),
            "heading": Column("psi_hat [rad]", unit="rad"),
        },
        measured={
            "surge": Column("u_velo [m/s]", unit="m/s"),
            "sway": Column("vm_velo [m/s]", unit="m/s"),
            "yaw_rate": Column("r_angvelo [rad/s]", unit="rad/s"),
        },
        stop=150.0,
    ).averaged(5)


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
