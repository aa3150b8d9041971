"""Plain data as people copy them: into Python, and into one line of TOML."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


class ToCopy(str):
    """Lines to be copied: code whose lines must not be folded."""


def as_python(value: Any) -> str:
    """Plain data as Python."""
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, float) and not math.isfinite(value):
        return f'float("{value}")'
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{as_python(k)}: {as_python(v)}' for k, v in value.items())}}}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(as_python, value))}{',' * (len(value) == 1)})"
    return repr(value)


def as_toml(value: Any) -> str:
    """Plain data as TOML in one line; TOML has no null, so a missing bound becomes infinite."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {as_toml(v)}' for key, v in value.items())} }}"
    if isinstance(value, tuple | list):
        ends = ("-inf", "inf")
        parts = (ends[i > 0] if v is None else as_toml(v) for i, v in enumerate(value))
        return f"[{', '.join(parts)}]"
    return repr(value)
