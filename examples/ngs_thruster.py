"""The basic thruster against a real one: bench runs of a small ROV thruster in a tank.

The model is fitted to every sine and ramp run and tried on every step run, which it has not seen.
The tachometer of these runs gives no sign (``unsigned=True``), and the files are read as they are.
The basic model fails here, and the comparison shows where: out come the errors on the unseen runs
by channel, how much of the settled speed and thrust the model reaches in each direction, how much
of the error falls just after a step, and a figure of the worst unseen run. Data: J. Boehm, MSc
thesis, University of Maryland, 2019.

    python examples/ngs_thruster.py [FOLDER FOR THE FIGURE]
"""

import numpy as np
from _data import data_folder, output_folder

import diffthrust as dft
from diffthrust import Column


def read(kind: str) -> list[dft.Log]:
    return [
        dft.read_log(
            path,
            time="time_s",
            inputs={"command": Column("command_V", unit="V")},
            measured={
                "speed": Column("tach_rad_s", unit="rad/s", unsigned=True),
                "thrust": Column("thrust_N", unit="N"),
            },
        )
        for path in sorted(data_folder("ngs_thruster").glob(f"CL*{kind}.csv"))
    ]


def just_switched(log: dft.Log) -> np.ndarray:
    """Samples less than half a second after the start or after a jump of the command."""
    jumps = np.abs(np.diff(log.inputs["command"], prepend=np.inf)) > 1.0
    times = log.time[jumps]
    return log.time - times[np.searchsorted(times, log.time, side="right") - 1] < 0.5


train, unseen = read("Sine") + read("Ramp"), read("Step")
fit = dft.fit(dft.Thruster(), train, holdout=unseen)
print(fit.report())
comparison = dft.compare(fit, unseen)

command = np.concatenate([log.inputs["command"] for log in unseen])
early = np.concatenate([just_switched(log) for log in unseen])
print("Where the basic model fails on the unseen runs:")
for name in ("speed", "thrust"):
    traces = [run.channels[name] for run in comparison.runs]
    measured = np.concatenate([trace.measured for trace in traces])
    modelled = np.concatenate([trace.modelled for trace in traces])
    reached = [
        np.nanmean(modelled[side & ~early]) / np.nanmean(measured[side & ~early])
        for side in (command > 0, command < 0)
    ]
    squares = (measured - modelled) ** 2
    share = np.nansum(squares[early]) / np.nansum(squares)
    error = comparison.errors.channels[name]
    print(
        f"- {name}: RMSE {error.rmse:.1f} {traces[0].unit}, NRMSE {error.nrmse:.2f}. Settled, it "
        f"reaches {reached[0]:.0%} of the measured {name} forwards and {reached[1]:.0%} backwards; "
        f"{share:.0%} of the squared error falls in the {early.mean():.0%} of the samples just "
        "after a step."
    )
worst = max(comparison.runs, key=lambda run: run.errors.nrmse)
print(f"The worst run is {worst.name}, with an NRMSE of {worst.errors.nrmse:.2f}.")
figure = output_folder() / "ngs_unseen.png"
comparison.plot([worst.name]).savefig(figure, dpi=100)
print(f"Figure: {figure}")
