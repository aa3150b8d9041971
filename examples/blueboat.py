"""The basic vessel against a real one: a BlueBoat with two thrusters, driven by hand on a lake.

The vessel is fitted to runs 216 to 226 and tried on runs 228, 230 and 232, which it has not seen.
The files are read as they are: the clock is in milliseconds, the forces come from a static map of
the thrusters, and the speeds of one run end before its clock does. The basic model fails here, and
the comparison shows it: the errors by channel, and that one channel does not mean what its header
says. The diagnosis then tries what the comparison suspects, and what a hull has beside: out come
its report as text and as a page, and the error on the unseen runs stage by stage. Takes some
minutes. Data: J. Kristiansen, BlueBoatSystemIdentification.

    python examples/blueboat.py [FOLDER FOR REPORT AND FIGURE]
"""

from pathlib import Path

from _data import data_folder, output_folder

import diffthrust as dft
from diffthrust import Column


def read(path: Path) -> dft.Log:
    return dft.read_log(
        path,
        time=Column("original_timestamp", unit="ms"),
        inputs={name: Column(name, unit="N") for name in ("left_force", "right_force")},
        measured={
            "surge": Column("surge", unit="m/s"),
            "sway": Column("sway", unit="m/s"),
            "yaw_rate": Column("yaw_rate", unit="rad/s"),
        },
    )


files = sorted(data_folder("blueboat").glob("run_*.csv"))
train = [read(path) for path in files if path.stem <= "run_226"]
unseen = [read(path) for path in files if path.stem > "run_226"]

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

print("What does not fit together:")
for hint in comparison.hints:
    print(f"- {hint}")

suspects = ["swapped_thrusters", "quadratic_yaw_drag", "quadratic_surge_drag"]
diag = dft.diagnose(fit, train, holdout=unseen, candidates=suspects, experiment=False)
print(diag.report())
print("The error on the unseen runs as the diagnosis went on:")
for stage in diag.stages:
    errors = ", ".join(f"{name} {e.nrmse:.2f}" for name, e in stage.holdout.channels.items())
    print(f"- {' + '.join(['basic model', *stage.effects])}: NRMSE {errors}")
diag.save(output_folder() / "blueboat_diagnosis.html")
diag.plot().savefig(output_folder() / "blueboat_stages.png", dpi=80)
print(f"Report and figure: {output_folder()}")
