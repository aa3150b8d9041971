"""T200: the static map of a thruster that many small vehicles have."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.extras import extra
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust.datasets._fetch import DataFile, DataSet, Runs, located, wanted
from diffthrust.logs._log import Log

_FILE = "T200-Public-Performance-Data-10-20V-September-2019.xlsx"
_SHEETS = {f"{volts}V": f"{volts} V" for volts in (10, 12, 14, 16, 18, 20)}
_COLUMNS = {  # as in the sheets, whose headers begin with a blank in some
    "pulse_width": ("PWM (µs)", "us"),
    "supply_voltage": ("Voltage (V)", "V"),
    "speed": ("RPM", "rpm"),
    "current": ("Current (A)", "A"),
    "power": ("Power (W)", "W"),
    "thrust": ("Force (Kg f)", "kgf"),
}
_INPUTS = ("pulse_width", "supply_voltage")
_STOP, _FULL = 1500e-6, 400e-6
"""Pulse width at rest, and from there to full drive [s]."""
_NOMINAL = 16.0
"""Command at full drive [V]."""

T200 = DataSet(
    name="t200",
    title="the static map of the T200 thruster at six supply voltages (201 points each)",
    licence="none in the file; published by the maker as public performance data",
    citation="Blue Robotics, T200 public performance data 10-20 V, September 2019",
    homepage="https://bluerobotics.com",
    files=(DataFile(_FILE),),
    defects=(
        "A static map: it does not contain a time constant.",
        "The speed has no sign.",
        "No uncertainty is given.",
        "At 12 V a column 'Force (N)' takes 1 kgf as 10 N; it is not read.",
    ),
    local_only=(
        "read from a local folder only: the maker's page has the file, but no lasting address"
    ),
)


def t200(names: str | Sequence[str] | None = None, *, held: float | None = None) -> Runs:
    """The static map of the T200 thruster at 10, 12, 14, 16, 18 and 20 V.

    Each log is a table and not a record: its samples are points of the map, from full astern to
    full ahead in steps of 4 us, counted 0, 1, 2, ... in place of seconds. Inputs ``pulse_width``
    [us, 1500 is stop] and ``supply_voltage`` [V]; measured ``speed`` [rad/s, no sign], ``current``
    [A], ``power`` [W] and ``thrust`` [N]. There is no usual split.

    With ``held`` each log is a record that `Thruster` takes: a staircase that begins settled at
    full astern, holds every point for that long and measures it at its end, so that a model that
    settles faster passes through the map. Its inputs are ``command`` [V], the drive's share of the
    pulse width (-1 to 1 for 1100 to 1900 us) times 16 V, and ``supply_voltage``; ``speed`` has the
    sign of the command, ``current`` and ``power`` are left out. Such records do not show how fast
    the thruster settles: hold ``alpha`` fixed.

    Known defects: it does not contain a time constant; the speed has no sign; no uncertainty is
    given; around 1500 us lies a dead zone of 52 us at 20 V to 80 us at 10 V; the sheet of 12 V
    has a column 'Force (N)' that takes 1 kgf as 10 N (it is not read).

    Source: Blue Robotics, public performance data; the file names no licence. It is read from the
    folder that ``DIFFTHRUST_DATA`` names.

    Args:
        names: logs to read, such as ``"16V"``; all six where not given.
        held: how long each point is held [s]; the table as it is where not given.

    Raises:
        InputError: ``DIFFTHRUST_DATA`` is not set, the file is missing there or has other sheets
            or columns, a name is unknown, or ``held`` is not positive.

    Example:
        >>> try:  # "16V" would take the map at 16 V
        ...     runs = dft.datasets.t200("no such run")
        ... except dft.InputError as error:
        ...     print(type(error).__name__)
        InputError
    """
    if held is not None:
        finite("t200, held", held, lambda x: x > 0, "seconds, more than zero")
    chosen = wanted(T200, tuple(_SHEETS), names)
    path = located(T200)[_FILE]
    sheets = _sheets(path)
    logs = {name: _log(sheets, _SHEETS[name], name) for name in chosen}
    if held is not None:
        logs = {name: _staircase(log, held) for name, log in logs.items()}
    return Runs(MappingProxyType(logs), train=(), unseen=(), about=T200)


def _staircase(table: Log, held: float) -> Log:
    """A log that holds every point of a table for a while, and measures it at the end."""
    drive = (table.inputs["pulse_width"] - _STOP) / _FULL
    inputs = {"command": _NOMINAL * drive, "supply_voltage": table.inputs["supply_voltage"]}
    measured = {
        # Rounded: 1500 us is 1500e-6 only up to the last bit, and a stop must have the sign zero.
        "speed": np.sign(np.round(drive, 9)) * table.measured["speed"],
        "thrust": table.measured["thrust"],
    }
    return Log(
        # One sample more than points: each measurement stands at the end of its hold, the first
        # point's also at time zero, as if settled.
        time=held * np.arange(len(table) + 1),
        inputs={name: np.append(values, values[-1]) for name, values in inputs.items()},
        measured={name: np.append(values[0], values) for name, values in measured.items()},
        units={"command": "V", "supply_voltage": "V", "speed": "rad/s", "thrust": "N"},
        name=table.name,
        notes=[f"a static table: each of its points is held for {held:g} s."],
        static=True,
    )


def _sheets(path: Path) -> dict[str, Any]:
    import pandas as pd

    with extra("excel", f"{path.name}: reading a spreadsheet"):
        import openpyxl  # noqa: F401
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # openpyxl leaves out the drawings, and says so
            return pd.read_excel(path, sheet_name=None, engine="openpyxl")
    except Exception as error:  # a damaged file raises whatever the reader came across
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(
            f"{path}: expected a spreadsheet, found something that cannot be read ({reason}).",
            "Get the file again from the maker's page.",
        ) from None


def _log(sheets: dict[str, Any], title: str, name: str) -> Log:
    if title not in sheets:
        raise InputError(
            f"{_FILE}: expected a sheet {title!r}, found {listing(map(str, sheets))}.",
            "Get the file of September 2019.",
        )
    sheet = sheets[title].rename(columns=lambda word: str(word).strip())
    for column, _ in _COLUMNS.values():
        if column not in sheet:
            raise InputError(
                f"{_FILE}, sheet {title!r}: expected a column {column!r}, found "
                f"{listing(map(str, sheet.columns))}.",
                "Get the file of September 2019.",
            )
    return Log(
        time=np.arange(len(sheet), dtype=float),
        inputs={key: sheet[_COLUMNS[key][0]] for key in _INPUTS},
        measured={key: sheet[_COLUMNS[key][0]] for key in _COLUMNS if key not in _INPUTS},
        units={key: unit for key, (_, unit) in _COLUMNS.items()},
        unsigned=("speed",),
        name=f"t200 {title}",
        notes=["a static table: its samples are counted, not timed."],
        static=True,
    )
