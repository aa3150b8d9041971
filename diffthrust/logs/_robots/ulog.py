"""Read fields of PX4's ULog files (.ulg)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._robots.gathered import LONGEST, Gathered, RobotContents
from diffthrust.logs._robots.series import (
    Series,
    column_place,
    lacking,
    no_field,
    no_message,
    series_of,
    split_column,
)
from diffthrust.logs._tables.table import damaged

_MESSAGE = re.compile(r"(\w+)(?:\[(\d+)\])?")
_ELEMENT = re.compile(r"(.*)\[(\d+)\]")


def read_ulog(path: Path, wanted: Sequence[str], missing: Sequence[float]) -> dict[str, Series]:
    """Read fields of a ULog file; time stamps count from the autopilot's power-up.

    Columns are such as ``"actuator_outputs.output[0]"``, or with an instance
    ``"esc_status[1].esc[0].esc_rpm"``.
    """
    targets = {}
    for column in wanted:
        message, key = split_column(path.name, column)
        match = _MESSAGE.fullmatch(message)
        if match is None:
            raise InputError.at(
                column_place(path.name, column),
                "expected a message and one of its fields.",
                "write it as 'actuator_outputs.output[0]' or 'esc_status[1].esc[0].esc_rpm'.",
            )
        targets[column] = (match[1], None if match[2] is None else int(match[2]), key)
    # pyulog parses only the named messages: a flight log has many more.
    log = _load(path, [name for name, _, _ in targets.values()])
    datasets = {column: _dataset(path, log, column, *t[:2]) for column, t in targets.items()}
    origin = min(int(data.data["timestamp"].min()) for data in datasets.values())
    series = {}
    for column, data in datasets.items():
        key = targets[column][2]
        if key not in data.data or key == "timestamp":
            names = [name for name in data.data if name != "timestamp"]
            raise no_field(path.name, column, key, names)
        ticks = (data.data["timestamp"].astype(np.int64) * 1_000).tolist()
        values = data.data[key].astype(np.float64)
        series[column] = series_of(path.name, column, ticks, values, origin * 1_000, missing)
    first = series[wanted[0]]
    series[wanted[0]] = replace(first, notes=(*first.notes, *(n[:-1] for n in _damages(log))))
    return series


def ulog_fields(path: Path) -> RobotContents:
    """Read all numbers of a ULog file; of several instances they are ``esc_status[1]``, ..."""
    log = _load(path, None)
    names = [data.name for data in log.data_list]
    gathered = []
    for data in log.data_list:
        columns = {
            key: values.astype(np.float64)
            for key, values in data.data.items()
            if key != "timestamp" and values.dtype.kind in "biuf" and not _is_long(key, data.data)
        }
        several = names.count(data.name) > 1
        name = f"{data.name}[{data.multi_id}]" if several else data.name
        gathered.append(Gathered(name, data.data["timestamp"].astype(np.int64) * 1_000, columns))
    # those that were changed while it recorded: stamp, name, value
    changed = {name: value for _, name, value in log.changed_parameters}
    parameters = {n: float(v) for n, v in {**log.initial_parameters, **changed}.items()}
    return RobotContents(gathered, _damages(log), parameters)


def _is_long(key: str, data: dict[str, Any]) -> bool:
    """Whether a field is an element of an array too long to be channels."""
    match = _ELEMENT.fullmatch(key)
    return match is not None and f"{match[1]}[{LONGEST}]" in data


def _load(path: Path, names: list[str] | None) -> Any:
    try:
        from pyulog import ULog
    except ImportError as error:
        raise lacking(path.name, "pyulog", "px4", error) from None
    try:
        printed = StringIO()
        # pyulog prints what it skips, and given a path it leaves a damaged file open.
        with path.open("rb") as stream, redirect_stdout(printed), redirect_stderr(printed):
            log = ULog(stream, names)
    except Exception as error:  # a damaged log raises exceptions of any kind
        raise damaged(path, "ULog", error) from None
    # PX4 subscribes to topics that then never publish.
    log.data_list[:] = [d for d in log.data_list if len(d.data.get("timestamp", ()))]
    if names is None and not log.data_list:
        raise damaged(path, "ULog", ValueError("it holds no message"))
    return log


def _dataset(path: Path, log: Any, column: str, name: str, instance: int | None) -> Any:
    same = [data for data in log.data_list if data.name == name]
    if not same:
        # The first pass parsed the named messages only; the error lists all.
        names = {data.name for data in _load(path, None).data_list}
        raise no_message(path.name, column, name, names, "message")
    instances = sorted(data.multi_id for data in same)
    if instance is None and len(same) > 1:
        field = column.partition(".")[2]
        raise InputError.at(
            column_place(path.name, column),
            f"the log has several {name!r}: {', '.join(map(str, instances))}.",
            f"name one, such as {f'{name}[{instances[0]}].{field}'!r}.",
        )
    chosen = [data for data in same if instance in (None, data.multi_id)]
    if not chosen:
        raise InputError.at(
            column_place(path.name, column),
            f"expected an instance {instance} of {name!r}, found {', '.join(map(str, instances))}.",
            "correct the number in the brackets.",
        )
    return chosen[0]


def _damages(log: Any) -> list[str]:
    notes = []
    if log.file_corruption:
        notes.append("the file is damaged; what could be read is used.")
    if log.dropouts:
        total = sum(d.duration for d in log.dropouts) / 1e3
        notes.append(f"the recorder lost messages {len(log.dropouts)} times, {total:.3g} s in all.")
    return notes
