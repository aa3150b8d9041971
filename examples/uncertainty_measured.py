"""Do posteriors of real runs foresee runs that they have not seen? A thruster and a tanker model.

Both are models with effects that a diagnosis has found (`ngs_thruster.py` and `esso_osaka.py` in
this folder). Each is fitted and sampled, and its predictive band is held against unseen runs: out
come the intervals of the parameters side by side, the share of unseen samples inside the 95 % band
by channel, and figures. What is missing from a model makes its band too narrow, and the figures say
where. Data: J. Boehm, MSc thesis, University of Maryland, 2019; Miyauchi et al. 2022, doi
10.1007/s00773-022-00889-3. Takes some minutes.

    python examples/uncertainty_measured.py [FOLDER FOR FIGURES]
"""

from pathlib import Path

from _data import data_folder, output_folder

import diffthrust as dft
from diffthrust import Column


def bench_run(path: Path) -> dft.Log:
    return dft.read_log(
        path,
        time="time_s",
        inputs={"command": Column("command_V", unit="V")},
        measured={
            "speed": Column("tach_rad_s", unit="rad/s", unsigned=True),
            "thrust": Column("thrust_N", unit="N"),
        },
    )


def tanker_run(path: Path) -> dft.Log:
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


def told(name: str, fit: dft.Fit, logs: list[dft.Log], unseen: list[dft.Log]) -> None:
    print(fit.report())
    print(dft.compare(fit, logs).noise_advice.sentence)
    post = dft.sample(fit, logs, draws=1000, warmup=1000)
    print(post.attrs["message"])
    print(dft.intervals(fit, logs, post).report())
    bands = [dft.predict(post, fit, log) for log in unseen]
    for band in bands:
        print(f"{name}, unseen: {band.sentence}")
    bands[0].plot().savefig(output_folder() / f"{name}_band.png", dpi=90)
    dft.plot_corner(post, fit).savefig(output_folder() / f"{name}_corner.png", dpi=90)


files = sorted(data_folder("ngs_thruster").glob("CL*.csv"))
train = [bench_run(path) for path in files if not path.stem.endswith("Step")]
unseen = [bench_run(path) for path in files if path.stem.endswith("Step")]
thruster = dft.Thruster() + "linear_damping" + "command_deadband" + "axial_flow"
# beside the linear damping nothing is left of the quadratic load, which would run to zero; the
# search begins where the diagnosis ended
thruster = thruster.replace(
    {
        "alpha": {"value": 1e-4, "fixed": True},
        "beta": 700.0,
        "ct": 0.04,
        "linear_damping.rate": 14.0,
        "command_deadband.width": 0.8,
        "axial_flow.loss": 4.0,
        "axial_flow.mass": 2.2,
    }
)
fit = dft.fit(thruster, train, holdout=unseen, loss="student_t", initial="measured", starts=16)
told("ngs", fit, train, unseen)

zigzag = [tanker_run(path) for path in sorted(data_folder("esso_osaka").glob("zigzag*.csv"))]
vessel = dft.Vessel(lever_arm=1.5) + "wind"
fit = dft.fit(vessel, zigzag[:5], holdout=zigzag[5:])
told("esso", fit, zigzag[:5], zigzag[5:])
print(f"Figures: {output_folder()}")
