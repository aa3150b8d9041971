"""BlueBoat: a surface vessel with two thrusters, driven by hand on a lake."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from diffthrust.datasets._fetch import DataFile, DataSet, Runs, loaded
from diffthrust.logs._columns import Column
from diffthrust.logs._read import read_log

_RUNS = (216, 218, 220, 221, 222, 223, 224, 225, 226, 228, 230, 232)
_TRAIN, _UNSEEN = ([f"run_{run}" for run in runs] for runs in (_RUNS[:9], _RUNS[9:]))
_COMMIT = "fd6d9f37ae138a96b7f99f836894aee28e0684a8"

BLUEBOAT = DataSet(
    name="blueboat",
    title="a surface vessel with two thrusters, driven by hand on a lake (12 runs, 10 Hz)",
    licence="none given: look at it and test with it, do not pass it on",
    citation="J. Kristiansen, BlueBoatSystemIdentification",
    homepage="https://github.com/jankristia/BlueBoatSystemIdentification",
    files=tuple(
        DataFile(f"run_{run}.csv", f"sorted_data/fixed_{run:08d}.csv", _COMMIT) for run in _RUNS
    ),
    defects=(
        "The yaw rate moves opposite to what the forces do: one of the two has the wrong sign, or "
        "left and right are exchanged.",
        "Forces come from a static map of the pulse widths, not from a measurement.",
        "The speeds of run 216 end 12 samples before its clock.",
        "Current and wind are not measured.",
    ),
    address=(
        "https://raw.githubusercontent.com/jankristia/BlueBoatSystemIdentification/{commit}/{path}"
    ),
)


def blueboat(names: str | Sequence[str] | None = None) -> Runs:
    """Logs of a BlueBoat, a surface vessel of 15 kg with two thrusters, on a lake.

    Inputs ``left_force`` and ``right_force`` [N]; measured ``surge``, ``sway`` [m/s] and
    ``yaw_rate`` [rad/s]; 10 Hz, 45 to 310 s. The files hold position, heading and pulse widths
    besides. The authors give a mass of 15 kg, thrusters 0.285 m from the middle line, and a yaw
    inertia of 1.7 kg m^2. Training logs: runs 216 to 226; unseen: 228, 230 and 232.

    Known defects: the yaw rate moves opposite to the forces (one of the two has the wrong
    sign, or left and right are exchanged: ``dft.compare`` reports it; the logs are not
    changed); the forces come from a static map of the pulse widths; the speeds of run 216 end 12
    samples before its clock; current and wind are not measured.

    Source: J. Kristiansen, github.com/jankristia/BlueBoatSystemIdentification, which gives no
    licence. The repository's files and copies with rounded numbers are both read.

    Args:
        names: logs to read, such as ``"run_216"`` or ``"run_22*"``; all where not given.

    Raises:
        InputError: a file is missing, cannot be downloaded or has changed, or a name is unknown.

    Example:
        >>> about = dft.datasets.list()[1]
        >>> about.title
        'a surface vessel with two thrusters, driven by hand on a lake (12 runs, 10 Hz)'
        >>> try:  # the files are fetched where they are not at hand
        ...     runs = dft.datasets.blueboat("no such run")
        ... except dft.InputError as error:
        ...     print(type(error).__name__)
        InputError
    """
    read = partial(
        read_log,
        time=Column("original_timestamp", unit="ms"),
        inputs={side: Column(side, unit="N") for side in ("left_force", "right_force")},
        measured={
            "surge": Column("surge", unit="m/s"),
            "sway": Column("sway", unit="m/s"),
            # The sign is left as published: correcting it here would hide the defect that
            # `soundness` must find.
            "yaw_rate": Column("yaw_rate", unit="rad/s"),
        },
    )
    return loaded(BLUEBOAT, names, read, _TRAIN, _UNSEEN)
