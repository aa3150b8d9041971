"""A first fit
===========

Quick start: fit a thruster to a log, and try it on one that it has not seen.

The logs under ``fits/jason_thruster`` are simulated: a thruster like that of the vehicle Jason
under a random command (for the fit) and under steps both ways (unseen), with the noise and the
resolution of real sensors. So this is what a model looks like that lacks nothing. Out come the
parameters with their standard errors, the errors on both logs, and a figure of the unseen one.

    python examples/fit_thruster.py [FOLDER FOR THE FIGURE]
"""

from pathlib import Path

from _data import output_folder

import diffthrust as dft
from diffthrust import Column

FOLDER = Path(__file__).resolve().parents[1] / "fits" / "jason_thruster"


def read(name: str) -> dft.Log:
    return dft.read_log(
        FOLDER / name,
        time="t",
        inputs={"command": Column("u", unit="V")},
        measured={"speed": Column("rpm", unit="rpm"), "thrust": Column("thrust", unit="N")},
    )


train, unseen = read("train.csv"), read("holdout.csv")
fit = dft.fit(dft.Thruster(), train, holdout=unseen)
print(fit.report())

figure = output_folder() / "jason_unseen.png"
dft.compare(fit, unseen).plot().savefig(figure, dpi=70)

assert fit.holdout is not None
worst = max(fit.holdout.channels.values(), key=lambda error: error.nrmse)
steady = fit.parameters["beta"].value / fit.parameters["alpha"].value
print(
    f"On the log it has not seen, the model explains {worst.fit_percent:.1f} % or more of each "
    f"channel. In steady state the speed squared is {steady:.0f} rad^2/(V s^2) times the command."
)
print(f"Figure: {figure}")
