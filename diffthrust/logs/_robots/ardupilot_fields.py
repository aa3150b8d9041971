"""All fields of the messages of ArduPilot's logs: DataFlash (.bin) and telemetry (.tlog)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from diffthrust.logs._robots.ardupilot_files import telemetry
from diffthrust.logs._robots.dataflash import (
    Dataflash,
    Message,
    instance_of,
    open_dataflash,
    stamps,
    values_of,
)
from diffthrust.logs._robots.gathered import LONGEST, Gathered
from diffthrust.logs._robots.series import lacking
from diffthrust.logs._tables.table import damaged
from diffthrust.logs._units import unit_in

# What describes the log or sets it up, and is no signal.
_ABOUT = {"FMT", "FMTU", "UNIT", "MULT", "PARM", "FILE", "MSG", "CMD", "PARAM_VALUE", "STATUSTEXT"}


def dataflash_fields(path: Path) -> tuple[list[Gathered], list[str]]:
    """Read all numbers of a DataFlash log, message by message at once.

    Returns:
        The messages, several of one kind named ``ESC[0]``, and sentences on what is damaged.

    Raises:
        InputError: the file is damaged.
    """
    gathered = []
    try:
        log = open_dataflash(path)
        for message in log.messages.values():
            if message.name not in _ABOUT:
                gathered += _messages(message, log)
    except Exception as error:  # a damaged log raises whatever the reader came across
        raise damaged(path, "DataFlash", error) from None
    return gathered, _told(log.damages)


def _messages(message: Message, log: Dataflash) -> list[Gathered]:
    """The messages of one kind, by instance where there are several."""
    try:
        records = log.records(message)
    except ValueError as error:  # one format that is none is not the log
        log.damages.append(str(error))
        return []
    ticks = stamps(records)
    if ticks is None or not ticks.size:
        return []
    records, ticks = records[ticks >= 0], ticks[ticks >= 0]
    about = {"TimeUS", "TimeMS", message.instance}
    fields = {
        name: values
        for name in message.columns
        if name not in about and (values := values_of(message, records, name)).dtype.kind == "f"
    }
    fields = {name: values for name, values in fields.items() if values.ndim == 1}
    which = records[message.instance] if message.instance else np.zeros(records.size, np.uint8)
    keys = np.unique(which)
    out = []
    for key in keys:
        part = which == key
        name = message.name if len(keys) == 1 else f"{message.name}[{instance_of(key)}]"
        columns = {field: values[part] for field, values in fields.items()}
        out.append(Gathered(name, ticks[part], columns, message.units))
    return out


def telemetry_fields(path: Path) -> tuple[list[Gathered], list[str]]:
    """Read all numbers of a telemetry log.

    Returns:
        The messages, named ``1/1/ATTITUDE`` where several systems send one and ``ESC[0]`` where it
        has several instances, and sentences on what is damaged.

    Raises:
        InputError: pymavlink is not installed, or the file is damaged.
    """
    found: dict[tuple[str, tuple[int, ...], str], Gathered] = {}
    try:
        with telemetry(path, None) as recording:
            for message in recording.messages:
                if message.name in _ABOUT:
                    continue
                key = (message.name, message.source, message.instance)
                one = found.setdefault(key, Gathered(message.name))
                values = {}
                for field in message.fields:
                    value = message.get(field)
                    if isinstance(value, int | float):
                        values[field] = value
                    elif isinstance(value, list | tuple) and len(value) <= LONGEST:
                        values |= {f"{field}[{k}]": v for k, v in enumerate(value)}
                if not one.values:
                    one.values.update({name: [] for name in values})
                    units = {n: message.units.get(n.split("[")[0], "") for n in values}
                    one.units = {n: unit_in(f"[{unit}]") for n, unit in units.items() if unit}
                one.ticks.append(message.stamp)
                for name, held in one.values.items():
                    held.append(values.get(name, np.nan))
            damages = list(recording.damages)
    except ImportError as error:
        raise lacking(path.name, "pymavlink", "ardupilot", error) from None
    except Exception as error:  # a damaged log raises whatever the reader came across
        raise damaged(path, "telemetry", error) from None
    for (name, source, instance), one in found.items():
        senders = {of for kind, of, _ in found if kind == name}
        instances = {which for kind, of, which in found if kind == name and of == source}
        if len(instances) > 1:
            one.name += f"[{instance}]"
        if len(senders) > 1:
            one.name = "/".join(map(str, source)) + f"/{one.name}"
    return list(found.values()), _told(damages)


def _told(damages: list[str]) -> list[str]:
    if not damages:
        return []
    places = f"{len(damages)} place{'s' if len(damages) > 1 else ''}"
    return [f"the file is damaged in {places} ({damages[0]})."]
