"""All fields of the messages of ArduPilot's logs: DataFlash (.bin) and telemetry (.tlog)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._robots.ardupilot_files import LATEST, indexed, telemetry
from diffthrust.logs._robots.gathered import LONGEST, Gathered
from diffthrust.logs._robots.series import lacking
from diffthrust.logs._tables.table import damaged
from diffthrust.logs._units import unit_in

# What describes the log or sets it up, and is no signal.
_ABOUT = {"FMT", "FMTU", "UNIT", "MULT", "PARM", "FILE", "MSG", "CMD", "PARAM_VALUE", "STATUSTEXT"}
_SPELT = {"degheading": "deg", "ddeg": "deg", "deg/sec": "deg/s", "PWM": "us", "d%": ""}


def dataflash_fields(path: Path) -> tuple[list[Gathered], list[str]]:
    """Read all numbers of a DataFlash log, message by message at once.

    Returns:
        The messages, several of one kind named ``ESC[0]``, and sentences on what is damaged.

    Raises:
        InputError: pymavlink is not installed, or the file is damaged.
    """
    gathered = []
    try:
        with indexed(path) as (log, said):
            data = np.frombuffer(log.data_map[:], np.uint8)
            for number, offsets in enumerate(log.offsets):
                form = log.formats.get(number)
                if form is not None and form.name not in _ABOUT and offsets:
                    gathered += _messages(form, data, np.array(offsets))
            damages = said.getvalue().splitlines()
    except ImportError as error:
        raise lacking(path.name, "pymavlink", "ardupilot", error) from None
    except Exception as error:  # a damaged log raises whatever the reader came across
        raise damaged(path, "DataFlash", error) from None
    return gathered, _told(damages)


def _messages(form: Any, data: np.ndarray, offsets: np.ndarray) -> list[Gathered]:
    """The messages of one format: its bytes as an array of records, one by instance."""
    codes = form.msg_struct[1:]
    kinds, length = [], ""
    for code in codes:
        if code.isdigit():
            length += code
        else:
            kinds.append(f"S{length}" if code == "s" else f"<{_NUMPY[code]}")
            length = ""
    if len(kinds) != len(form.columns) or not kinds or len(set(form.columns)) != len(kinds):
        return []
    record = np.dtype(list(zip(form.columns, kinds, strict=True)))
    offsets = offsets[offsets + 3 + record.itemsize <= data.size]
    rows = data[offsets[:, None] + 3 + np.arange(record.itemsize)].copy().view(record)[:, 0]
    clock, per_tick = ("TimeUS", 1_000) if "TimeUS" in form.columns else ("TimeMS", 1_000_000)
    if clock not in form.columns or not rows.size:
        return []
    rows = rows[rows[clock] <= LATEST]
    fields = [
        (name, mult)
        for name, kind, mult in zip(form.columns, kinds, form.msg_mults, strict=True)
        if not kind.startswith("S") and name not in (clock, form.instance_field)
    ]
    units = {}
    for name, _ in fields:
        unit = form.get_unit(name)
        if unit := _SPELT.get(unit, unit_in(f"[{unit}]")):
            units[name] = unit
    which = form.instance_field
    keys = np.unique(rows[which]) if which else [None]
    out = []
    for key in keys:
        part = rows if key is None else rows[rows[which] == key]
        shown = key.decode("latin-1").rstrip("\0") if isinstance(key, bytes) else str(key)
        out.append(
            Gathered(
                form.name if len(keys) == 1 else f"{form.name}[{shown}]",
                part[clock].astype(np.int64) * per_tick,
                {name: part[name].astype(np.float64) * (mult or 1.0) for name, mult in fields},
                units,
            )
        )
    return out


_NUMPY = {
    "b": "i1", "B": "u1", "h": "i2", "H": "u2", "i": "i4", "I": "u4", "q": "i8", "Q": "u8",
    "e": "f2", "f": "f4", "d": "f8",
}  # fmt: skip


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
