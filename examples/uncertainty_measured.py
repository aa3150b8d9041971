"""Do posteriors foresee unseen runs
=================================

Do posteriors of real runs foresee runs that they have not seen? A thruster and a tanker model.

Both are models with effects that a diagnosis has found (`ngs_thruster.py` and `esso_osaka.py` in
this folder). Each is fitted and sampled, and its predictive band is held against unseen runs: out
come the intervals of the parameters side by side, the share of unseen samples inside the 95 % band
by channel, and figures. What is missing from a model makes its band too narrow, and the figures say
where. Data: J. Boehm, MSc thesis, University of Maryland, 2019; Miyauchi et al. 2022, doi
10.1007/s00773-022-00889-3. Takes some minutes.

    python examples/uncertainty_measured.py [FOLDER FOR FIGURES]
"""

from collections.abc import Sequence

from _data import output_folder, runs_of

import diffthrust as dft


def told(
    name: str, fit: dft.estimation.Fit, logs: Sequence[dft.Log], unseen: Sequence[dft.Log]
) -> None:
    print(fit.report())
    print(dft.compare(fit, logs).noise_advice.sentence)
    post = dft.sample(fit, logs, draws=1000, warmup=1000)
    print(post.attrs["message"])
    print(dft.intervals(fit, logs, post).report())
    bands = [dft.predict(post, fit, log) for log in unseen]
    for band in bands:
        print(f"{name}, unseen: {band.sentence}")
    bands[0].plot().savefig(output_folder() / f"{name}_band.png", dpi=90)
    dft.uncertainty.plot_corner(post, fit).savefig(output_folder() / f"{name}_corner.png", dpi=90)


runs = runs_of(dft.datasets.ngs_thruster, "CL*")
thruster = dft.Thruster() + "linear_damping" + "command_deadband" + "axial_flow"
# beside the linear damping nothing is left of the quadratic load, which would run to zero; the
# search begins where the diagnosis ended
thruster = thruster.replace(
    {
        "alpha": {"value": 1e-4, "fixed": True},
        "beta": 700.0,
        "ct": 0.04,
        "linear_damping.rate": 14.0,
        "command_deadband.half_width": 0.8,
        "axial_flow.loss": 4.0,
        "axial_flow.mass": 2.2,
    }
)
train, unseen = runs.train, runs.unseen
fit = dft.fit(thruster, train, holdout=unseen, loss="student_t", initial="measured", starts=16)
told("ngs", fit, train, unseen)

runs = runs_of(dft.datasets.esso_osaka, "zigzag*")
train, unseen = ([log.averaged(5) for log in logs] for logs in (runs.train, runs.unseen))
vessel = dft.Vessel(lever_arm=1.5) + "wind"
fit = dft.fit(vessel, train, holdout=unseen)
told("esso", fit, train, unseen)
print(f"Figures: {output_folder()}")
