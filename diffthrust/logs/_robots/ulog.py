"""Read PX4's ULog files (.ulg)."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._robots.messages import Gathered, RobotContents
from diffthrust.logs._robots.series import lacking
from diffthrust.logs._tables.table import damaged


def read_ulog(path: Path, names: Collection[str] | None) -> RobotContents:
    """Read the messages of some names, or all; time stamps count from the autopilot's power-up."""
    # pyulog parses only the named messages: a flight log has many more.
    log = _load(path, names)
    present = {data.name for data in log.data_list}
    if names is not None and not set(names) <= present:  # for the message, which lists all
        present = {data.name for data in _load(path, None).data_list}
    gathered = []
    for data in log.data_list:
        values = {key: values for key, values in data.data.items() if key != "timestamp"}
        ticks = data.data["timestamp"].astype(np.int64) * 1_000
        gathered.append(Gathered(data.name, ticks, values, instance=str(data.multi_id)))
    # those that were changed while it recorded: stamp, name, value
    changed = {name: value for _, name, value in log.changed_parameters}
    parameters = {n: float(v) for n, v in {**log.initial_parameters, **changed}.items()}
    return RobotContents(gathered, _damages(log), parameters, present)


def _load(path: Path, names: Collection[str] | None) -> Any:
    try:
        from pyulog import ULog
    except ImportError as error:
        raise lacking(path.name, "pyulog", "px4", error) from None
    try:
        printed = StringIO()
        # pyulog prints what it skips, and given a path it leaves a damaged file open.
        with path.open("rb") as stream, redirect_stdout(printed), redirect_stderr(printed):
            log = ULog(stream, None if names is None else list(names))
    except Exception as error:  # a damaged log raises exceptions of any kind
        raise damaged(path, "ULog", error) from None
    # PX4 subscribes to topics that then never publish.
    log.data_list[:] = [d for d in log.data_list if len(d.data.get("timestamp", ()))]
    if names is None and not log.data_list:
        raise damaged(path, "ULog", ValueError("it holds no message"))
    return log


def _damages(log: Any) -> list[str]:
    notes = []
    if log.file_corruption:
        notes.append("the file is damaged; what could be read is used.")
    if log.dropouts:
        total = sum(d.duration for d in log.dropouts) / 1e3
        notes.append(f"the recorder lost messages {len(log.dropouts)} times, {total:.3g} s in all.")
    return notes
