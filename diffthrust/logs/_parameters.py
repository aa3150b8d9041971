"""The settings of an autopilot, from its log or from a file of parameters."""

from __future__ import annotations

import math
import re
from os import PathLike
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.names import short_repr
from diffthrust.logs._contents import contents
from diffthrust.logs._kinds import kind_of

PARAMETER_FILES = (".param", ".params", ".parm")
"""Endings of files in which ground stations save parameters."""

# "NAME,VALUE" (Mission Planner), "NAME VALUE" (MAVProxy), or vehicle, component, name, value and
# type in columns (QGroundControl)
_LINE = re.compile(r"(?:\d+\s+\d+\s+)?([A-Za-z]\w*)[\s,=]+(\S+?)(?:[\s,].*)?")


def parameters_in(path: str | PathLike[str]) -> dict[str, float]:
    r"""Read the settings of an autopilot.

    Args:
        path: a log of ArduPilot (.bin, .tlog) or PX4 (.ulg), whose last value of a parameter
            counts; or a file of parameters as ground stations save it (.param, .params, .parm).

    Returns:
        Values by name, such as ``FRAME_CONFIG``; empty for a log that holds none.

    Raises:
        InputError: there is no such file, it is neither, it has no parameters, or a line of it has
            no value.

    Example:
        >>> with open("rov.param", "w") as file:
        ...     _ = file.write("FRAME_CONFIG,2\nSERVO1_FUNCTION,33\n")
        >>> dft.logs.parameters_in("rov.param")
        {'FRAME_CONFIG': 2.0, 'SERVO1_FUNCTION': 33.0}
    """
    if not isinstance(path, str | PathLike):
        raise InputError(
            f"expected the path of a log or of a file of parameters, found {short_repr(path)}.",
            'Name the file: "dive.bin".',
        )
    file = Path(path)
    kind = kind_of(file)
    if kind.messages:
        return dict(contents(file).parameters)
    if file.suffix.lower() not in PARAMETER_FILES:
        raise InputError(
            f"{file}: expected a log of an autopilot or a file of its parameters, found "
            f"{kind.article}.",
            f"Name a .bin, .tlog or .ulg, or a file ending in {', '.join(PARAMETER_FILES)}.",
        )
    return _listed(file)


def _listed(file: Path) -> dict[str, float]:
    values = {}
    for number, line in enumerate(file.read_text("utf-8-sig", "replace").splitlines(), 1):
        text = line.split("#")[0].strip()
        if not text:
            continue
        match = _LINE.fullmatch(text)
        try:
            value = float(match[2]) if match else math.nan
        except ValueError:
            value = math.nan
        if match is None or not math.isfinite(value):
            raise InputError(
                f"{file}, line {number}: expected a parameter and its value, found {text[:60]!r}.",
                "Write it as in FRAME_CONFIG,2, or remove the line.",
            )
        values[match[1]] = value
    if not values:
        raise InputError(
            f"{file}: expected parameters, found none.",
            "Save the parameters of the vehicle anew from its ground station.",
        )
    return values
