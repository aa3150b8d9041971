"""Esso Osaka: a 3 m model of a tanker, free running on a pond."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from diffthrust.datasets._fetch import DataFile, DataSet, Runs, loaded
from diffthrust.logs._columns import Column
from diffthrust.logs._read import read_log

# The files have not changed in their repository; each is pinned to a commit that holds it.
_PINS = {
    "af348ce5db533f0c45cf3999cd5a8f4f17c873cd": """
        berthing_12-Nov-2020_11_07_23 berthing_12-Nov-2020_11_14_47 random_06-Aug-2020_16_24_25_4
        turn_14-Oct-2020_14_39_54 turn_14-Oct-2020_14_56_07 turn_14-Sep-2020_13_51_45
        turn_14-Sep-2020_14_16_04 turn_14-Sep-2020_15_58_08 turn_cut_14-Sep-2020_15_58_08
        turn_cut_14-Sep-2020_16_09_02 zigzag_31-Jul-2020_13_29_19 zigzag_31-Jul-2020_13_50_28
        zigzag_31-Jul-2020_14_03_39
    """,
    "28435ac114f287fc72d10f49690793f0dae8a7ad": """
        berthing_12-Nov-2020_11_21_46 random_06-Aug-2020_16_24_25_1 random_06-Aug-2020_16_24_25_5
        random_06-Aug-2020_16_24_25_6 turn_14-Oct-2020_14_08_51 turn_14-Oct-2020_14_17_39
        turn_14-Oct-2020_14_29_49 turn_14-Oct-2020_15_21_57 turn_14-Sep-2020_13_39_32
        turn_14-Sep-2020_15_47_33 zigzag_31-Jul-2020_13_04_24 zigzag_31-Jul-2020_13_14_21
        zigzag_31-Jul-2020_13_22_52 zigzag_31-Jul-2020_13_57_45
    """,
}
_FOLDERS = {"berthing": "berthing", "random": "random", "turn": "turning", "zigzag": "zigzag"}
_FILES = {
    name: DataFile(f"{name}.csv", f"data/{_FOLDERS[name.partition('_')[0]]}/{name}.csv", commit)
    for commit, names in _PINS.items()
    for name in names.split()
}
_NAMES = tuple(sorted(_FILES))


def _named(begin: str) -> tuple[str, ...]:
    return tuple(name for name in _NAMES if name.startswith(begin))


_TRAIN = (*_named("zigzag")[:5], *_named("turn_cut"), *_named("turn_14-Sep")[:2])
_UNSEEN = (*_named("zigzag")[5:], *_named("turn_14-Oct")[:4])

ESSO_OSAKA = DataSet(
    name="esso_osaka",
    title="a 3 m model of a tanker, one propeller and one rudder, on a pond (27 runs, 10 Hz)",
    licence="CC BY-NC-SA 4.0 (not for commercial use; name the authors, share alike)",
    citation=(
        "Miyauchi et al. 2022, doi 10.1007/s00773-022-00889-3, and Wakita et al. 2022, "
        "doi 10.1007/s00773-021-00867-1"
    ),
    homepage="https://github.com/NAOE-5thLab/FRT-DS-ESSO",
    files=tuple(_FILES[name] for name in _NAMES),
    defects=(
        "Their positive rudder angle pushes the stern to port; its sign is changed here.",
        "The true wind is computed from a sensor on board.",
        "The speeds are smooth, and their errors last from sample to sample.",
        "turn_cut_* are parts of longer runs, such as turn_14-Sep-2020_15_58_08.",
    ),
    address="https://raw.githubusercontent.com/NAOE-5thLab/FRT-DS-ESSO/{commit}/{path}",
)


def esso_osaka(names: str | Sequence[str] | None = None, *, stop: float | None = 150.0) -> Runs:
    """Logs of a 3 m model of the tanker Esso Osaka: zigzag, turning, random and berthing runs.

    Inputs ``propeller_speed`` [rev/s], ``rudder_angle`` [rad, positive as in `Vessel`], and as
    measured ``wind_speed`` [m/s], ``wind_direction``, ``heading`` [rad]; measured ``surge``,
    ``sway`` [m/s] and ``yaw_rate`` [rad/s]; 10 Hz. Length between perpendiculars 3.0 m, breadth
    0.489 m, draft 0.201 m, propeller 0.084 m, mass 244.6 kg, centre of gravity 0.094 m before
    midships, rudder area 0.0106 m^2, windage 0.135 m^2 ahead and 0.520 m^2 abeam.

    Training logs: the first five zigzags, both ``turn_cut_*``, the first two turns of September;
    unseen: the remaining two zigzags and the first four turns of October. The random and berthing
    runs, in which the propeller is reversed, belong to neither. The repository has more runs.

    Known defects: their positive rudder angle pushes the stern to port, so the column is read with
    ``scale=-1``; the wind is computed from a sensor on board; the speeds are smooth, and their
    errors last from sample to sample (means over five samples hold as much information);
    ``turn_cut_*`` are parts of longer runs.

    Source: github.com/NAOE-5thLab/FRT-DS-ESSO, licence CC BY-NC-SA 4.0. Cite Miyauchi et al. 2022,
    doi 10.1007/s00773-022-00889-3, and Wakita et al. 2022, doi 10.1007/s00773-021-00867-1. The
    repository's files and copies with rounded numbers are both read.

    Args:
        names: logs to read, such as ``"zigzag*"``; all where not given.
        stop: end of every log [s]; None for whole runs.

    Raises:
        InputError: a file is missing, cannot be downloaded or has changed, or a name is unknown.

    Example:
        >>> try:  # "zigzag*" would take the zigzags
        ...     runs = dft.datasets.esso_osaka("no such run")
        ... except dft.InputError as error:
        ...     print(type(error).__name__)
        InputError
    """
    read = partial(
        read_log,
        time=Column("t [s]", unit="s"),
        inputs={
            "propeller_speed": Column("n_prop [rps]", unit="rps"),
            "rudder_angle": Column("delta_rudder [rad]", unit="rad", scale=-1),
            "wind_speed": Column("wind_velo_true [m/s]", unit="m/s"),
            "wind_direction": Column("wind_dir_true [rad]", unit="rad"),
            # An input here: the wind acts by its angle to the ship, and the measured heading is
            # good to a degree.
            "heading": Column("psi_hat [rad]", unit="rad"),
        },
        measured={
            "surge": Column("u_velo [m/s]", unit="m/s"),
            "sway": Column("vm_velo [m/s]", unit="m/s"),
            "yaw_rate": Column("r_angvelo [rad/s]", unit="rad/s"),
        },
        stop=stop,
    )
    return loaded(ESSO_OSAKA, names, read, _TRAIN, _UNSEEN)
