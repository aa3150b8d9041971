"""The [expected] block of a spec file: compared with a fit, and written from one."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffthrust._channels import listing, nearest
from diffthrust._errors import InputError
from diffthrust._spec_file import ExpectedNumber, ExpectedPart, parse_toml

if TYPE_CHECKING:
    from diffthrust._result import Fit

RELATIVE = 1e-4
"""The least tolerance by default, as a share of the value."""
SHARE = 0.1
"""The tolerance of a parameter by default, as a share of its standard error."""


@dataclass(frozen=True)
class Row:
    """One quantity of one fit, expected and found.

    Args:
        fit: name of the fit.
        quantity: ``status``, ``train_nrmse``, ``holdout_nrmse``, a parameter, or what went wrong.
        expected: number or word; ``None`` where nothing is written.
        found: number or word; ``None`` where there is none.
        tolerance: largest difference allowed; ``None`` for words.
        ok: the two agree.
        mend: what to do where they do not.
    """

    fit: str
    quantity: str
    expected: float | str | None
    found: float | str | None
    tolerance: float | None
    ok: bool
    mend: str = ""


def compared(name: str, expected: ExpectedPart, fit: Fit) -> Iterator[Row]:
    """A row for each quantity that the block holds, in the order of reading."""
    if expected.status is not None:
        found = fit.status.value
        yield Row(name, "status", expected.status, found, None, found == expected.status)
    numbers = {f"parameters.{key}": number for key, number in expected.parameters.items()}
    for key in ("train_nrmse", "holdout_nrmse"):
        if (number := getattr(expected, key)) is not None:
            numbers[key] = number
    now = found_numbers(fit)
    for key, number in numbers.items():
        quantity = key.removeprefix("parameters.")
        if key not in now:
            known = [k.removeprefix("parameters.") for k in now]
            near = nearest(quantity, known)
            mend = f"{quantity!r} is no result of this fit{'; ' + near if near else ''}; "
            mend += f"there are {listing(known)}."
            yield Row(name, quantity, number.value, None, number.tolerance, False, mend)
            continue
        found, tolerance = now[key]
        allowed = tolerance if number.tolerance is None else number.tolerance
        ok = abs(found - number.value) <= allowed
        yield Row(name, quantity, number.value, found, allowed, ok)


def found_numbers(fit: Fit) -> dict[str, tuple[float, float]]:
    """Every number worth expecting, with its tolerance by default; those not finite left out."""
    out = {}
    for name, e in fit.parameters.items():
        if not e.fixed:
            tolerance = max(SHARE * (e.std_error or 0.0), RELATIVE * abs(e.value), 1e-12)
            if e.at_bound:  # how near it comes to the bound means nothing
                tolerance = max(tolerance, RELATIVE * fit.model.parameters[name].scale)
            out[f"parameters.{name}"] = (e.value, tolerance)
    errors = {"train_nrmse": fit.train, "holdout_nrmse": fit.holdout}
    for name, error in errors.items():
        if error is not None:
            out[name] = (error.nrmse, max(RELATIVE * error.nrmse, 1e-12))
    return {name: pair for name, pair in out.items() if math.isfinite(pair[0])}


def updated(text: str, file: Path, expected: ExpectedPart | None, fit: Fit) -> str:
    """The text of the spec with its [expected] block brought up to a fit.

    Every byte outside the block stays. Numbers that still hold stay as they are written, and so
    do tolerances.

    Raises:
        InputError: the block is written in a form that cannot be replaced by itself.
    """
    kept = expected or ExpectedPart()
    rows = {row.quantity: row for row in compared("", kept, fit)}
    now = found_numbers(fit)
    same = expected is not None and all(row.ok for row in rows.values())
    names = {f"parameters.{key}" for key in kept.parameters}
    names |= {key for key in ("train_nrmse", "holdout_nrmse") if getattr(kept, key) is not None}
    if same and kept.status is not None and names == set(now):
        return text
    lines = [f'status = "{fit.status.value}"']
    for key in ("train_nrmse", "holdout_nrmse"):
        if key in now:
            lines.append(f"{key} = {_number(getattr(kept, key), *now[key])}")
    lines += ["", "[expected.parameters]"]
    for key, pair in now.items():
        name = key.removeprefix("parameters.")
        if name != key:
            quoted = name if re.fullmatch(r"[\w-]+", name) else f'"{name}"'
            lines.append(f"{quoted} = {_number(kept.parameters.get(name), *pair)}")
    new = _replaced(text, lines)
    before, after = parse_toml(text, file), parse_toml(new, file)
    if _without(before) != _without(after) or "parameters" not in after.get("expected", {}):
        raise InputError(
            f"{file}: the expected values are not written as one [expected] table, so they cannot "
            "be updated in place.",
            "Remove them, and run diffthrust check --update again: it writes the block at the end.",
        )
    return new


def _number(old: ExpectedNumber | None, value: float, tolerance: float) -> str:
    if old is not None and old.tolerance is not None:
        tolerance = old.tolerance
    if old is not None and abs(value - old.value) <= tolerance:
        value = old.value
    return f"{{ value = {value:.10g}, tolerance = {tolerance:.2g} }}"


def _without(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if key != "expected"}


def _replaced(text: str, block: list[str]) -> str:
    """The text with the lines of its [expected] tables replaced, or with the block at its end."""
    end = "\r\n" if "\r\n" in text else "\n"
    rows = text.splitlines(keepends=True)
    inside = [False] * len(rows)
    here = False
    for i, row in enumerate(rows):
        if re.match(r"\s*\[", row) and re.match(r"\s*\[[^=]*\]\s*(#.*)?$", row.rstrip("\r\n")):
            here = re.match(r"\s*\[\s*expected\s*[.\]]", row) is not None
        inside[i] = here
    if not any(inside):
        gap = "" if not text or text.endswith("\n") else end
        return text + gap + end + end.join(["[expected]", *block]) + end
    first = inside.index(True)
    last = first
    while last < len(rows) and inside[last]:
        last += 1
    after = last
    while after > first + 1 and re.match(r"\s*(#.*)?$", rows[after - 1].rstrip("\r\n")):
        after -= 1  # blank lines and comments before the next table belong to that table
    head = rows[first] if re.match(r"\s*\[\s*expected\s*\]", rows[first]) else f"[expected]{end}"
    notes = []  # comments that open the block stay
    for row in rows[first + 1 : after]:
        if not row.lstrip().startswith("#"):
            break
        notes.append(row)
    rest = [row for row, within in zip(rows[last:], inside[last:], strict=True) if not within]
    head = head if head.endswith("\n") else head + end
    return "".join([*rows[:first], head, *notes, end.join(block), end, *rows[after:last], *rest])
