"""EMPS: a carriage on a rail, driven by a motor; a benchmark of nonlinear identification."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from diffthrust.datasets._fetch import DataFile, DataSet, Runs, loaded
from diffthrust.logs._columns import Column
from diffthrust.logs._read import read_log

_COMMIT = "93afc131780fb1d5477472935a18ac8405683890"
_TRAIN, _UNSEEN = "DATA_EMPS_SC", "DATA_EMPS_PULSES_SC"
_SUMS = {
    _TRAIN: "a7d9c26f534dbfe2d9d5fd6f1ffa328c809517397fa43a0e9185b37bd1844daa",
    _UNSEEN: "53d7bc31a2a83a17dd56f2f691964e9f7ce6d602dc26039fa8cb95d8e6de317b",
}

EMPS = DataSet(
    name="emps",
    title="a carriage on a rail, driven by a motor in closed loop (2 runs, 200 Hz)",
    licence="none given; published as a benchmark at nonlinearbenchmark.org",
    citation=(
        "Janot, Gautier & Brunot 2019, Data set and reference models of EMPS, Workshop on "
        "Nonlinear System Identification Benchmarks"
    ),
    homepage="https://github.com/forgi86/sysid-neural-continuous",
    files=tuple(
        DataFile(f"{name}.csv", f"examples/EMPS/data/{name}.csv", _COMMIT, sha256)
        for name, sha256 in _SUMS.items()
    ),
    defects=(
        "Position and speed are scaled: 1 stands for 0.125 m and 0.125 m/s.",
        "The input is the motor's voltage, not a force; 35.15 N/V is the authors' gain.",
        "The speed is an estimate from the position, not a second sensor.",
        "The runs are in closed loop: the voltage depends on the position.",
    ),
    address=("https://raw.githubusercontent.com/forgi86/sysid-neural-continuous/{commit}/{path}"),
)


def emps(names: str | Sequence[str] | None = None) -> Runs:
    """Logs of the EMPS benchmark: a carriage that a motor drives along a rail, 24.8 s at 200 Hz.

    Input ``force`` [N] (the voltage times 35.15 N/V, linear between samples); measured
    ``position`` [m] and ``velocity`` [m/s]. Training log: ``DATA_EMPS_SC``; unseen:
    ``DATA_EMPS_PULSES_SC``, disturbed by pulses of force that its voltage includes. Published
    parameters: mass 95.11 kg, viscous friction 203.5 N s/m, dry friction 20.39 N, offset -3.165 N.

    Known defects: position and speed are written in units of 0.125 m; the speed is an
    estimate from the position, so its errors are not independent of those of the position; the
    runs are in closed loop, so the voltage depends on the position.

    Source: Janot, Gautier & Brunot 2019 (nonlinearbenchmark.org), by way of
    github.com/forgi86/sysid-neural-continuous; no licence is given.

    Args:
        names: logs to read; both where not given.

    Raises:
        InputError: a file is missing, cannot be downloaded or has changed, or a name is unknown.

    Example:
        >>> try:  # names of runs are patterns; None takes all
        ...     runs = dft.datasets.emps("no such run")
        ... except dft.InputError as error:
        ...     print(type(error).__name__)
        InputError
    """
    read = partial(
        read_log,
        time="time_exp",
        inputs={"force": Column("u_in", unit="N", scale=35.15, hold="linear")},
        measured={
            "position": Column("q_meas", unit="m", scale=0.125),
            "velocity": Column("v_est", unit="m/s", scale=0.125),
        },
    )
    return loaded(EMPS, names, read, (_TRAIN,), (_UNSEEN,))
