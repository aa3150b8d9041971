"""NGS thruster: bench runs of a small ROV thruster in a tank."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from diffthrust.datasets._fetch import DataFile, DataSet, Runs, loaded
from diffthrust.logs._columns import Column
from diffthrust.logs._log import Log
from diffthrust.logs._read import read_log

_CONTROLLERS = ("CL1state", "CL2stateKF1", "CL2stateKF2", "CL2stateKFNLO1", "CL2stateNLO1")
_CLOSED = tuple(
    f"{controller}{kind}"
    for controller in (*_CONTROLLERS, "CLLookup")
    for kind in ("Ramp", "Sine", "Step")
)
_OPEN = tuple(
    f"open_loop_{sign}{volt}V" for sign in ("minus", "plus") for volt in ("15", "25", "2", "3")
)
_TRAIN = tuple(name for kind in ("Sine", "Ramp") for name in _CLOSED if name.endswith(kind))
_UNSEEN = tuple(name for name in _CLOSED if name.endswith("Step"))

NGS_THRUSTER = DataSet(
    name="ngs_thruster",
    title="bench runs of a small ROV thruster in a tank (18 runs at 25 Hz, 8 at 200 Hz)",
    licence="none given: look at it and test with it, do not pass it on",
    citation="J. Boehm, MSc thesis, University of Maryland, 2019",
    homepage="https://github.com/NGS-Exploration-Technology/ROV-Thruster-Model",
    files=tuple(DataFile(f"{name}.csv") for name in (*_CLOSED, *_OPEN)),
    defects=(
        "The tachometer gives no sign.",
        "Thrust and speed come from two recorders; they were aligned by correlation, good to "
        "about 40 ms.",
        "The load cell's zero is off by up to 2 N, and drifts.",
        "In the open-loop runs the command was not logged; a ramp of 1.5 s lies inside the "
        "controller.",
    ),
    local_only=(
        "read from a local folder only: the repository holds the two recorders' raw files, "
        "without their alignment"
    ),
)


def ngs_thruster(names: str | Sequence[str] | None = None) -> Runs:
    """Bench runs of a small ROV thruster: a command drives it, speed and thrust are measured.

    ``CL*``, 25 Hz, 10 s: input ``command`` [V], as sent to the motor controller; measured ``speed``
    [rad/s, no sign] and ``thrust`` [N]. `Sine`, `Ramp` and `Step` name the demanded thrust, the
    word before them the controller. ``open_loop_*``, 200 Hz: input ``speed`` [rad/s, signed by the
    file's name, linear between samples]; measured ``thrust`` [N]. The files hold torque, demanded
    thrust and, in some, the flow besides.

    Training logs: every sine and ramp; unseen: every step. The open-loop runs belong to neither.

    Known defects: the tachometer gives no sign; thrust and speed come from two recorders and were
    aligned by correlation, good to about 40 ms, so a delay shorter than that cannot be claimed; the
    load cell's zero is off by up to 2 N and drifts (in the open-loop runs the samples at rest
    before the start show it); in the open-loop runs the command was not logged, and the voltage of
    their names is switched on through a ramp of about 1.5 s inside the controller.

    Source: J. Boehm, MSc thesis, University of Maryland, 2019; the recordings are in
    github.com/NGS-Exploration-Technology/ROV-Thruster-Model, which gives no licence. They cannot be
    downloaded here: the repository holds the load cell's file (1 kHz, without a header) and the
    controller's (MATLAB) separately, and their alignment for some runs only. The aligned files are
    read from the folder that ``DIFFTHRUST_DATA`` names.

    Args:
        names: logs to read, such as ``"CL*Step"`` or ``"open_loop*"``; all where not given.

    Raises:
        InputError: ``DIFFTHRUST_DATA`` is not set, a file is missing there, or a name is unknown.

    Example:
        >>> try:  # "CL*" would take the runs in closed loop
        ...     runs = dft.datasets.ngs_thruster("no such run")
        ... except dft.InputError as error:
        ...     print(type(error).__name__)
        InputError
    """
    return loaded(NGS_THRUSTER, names, _read, _TRAIN, _UNSEEN)


def _read(path: Path) -> Log:
    thrust = Column("thrust_N", unit="N")
    if path.stem in _OPEN:
        sign = -1.0 if "minus" in path.stem else 1.0
        speed = Column("tach_rad_s", unit="rad/s", scale=sign, hold="linear")
        return read_log(path, time="time_s", inputs={"speed": speed}, measured={"thrust": thrust})
    return read_log(
        path,
        time="time_s",
        inputs={"command": Column("command_V", unit="V")},
        measured={"speed": Column("tach_rad_s", unit="rad/s", unsigned=True), "thrust": thrust},
    )
