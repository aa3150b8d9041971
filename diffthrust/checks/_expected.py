"""The [expected] block of a spec file: compared with a fit, and written from one."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.specs._file import ExpectedNumber, ExpectedPart, parse_toml

if TYPE_CHECKING:
    from diffthrust.estimation._result import Fit

ERRORS = ("train_nrmse", "holdout_nrmse")
SHARE = 0.1
"""A parameter may move by this share of its standard error."""
ROUNDING = 1e-8
"""What refits may differ by, as a share of the value, where standard errors are smaller still."""
RELATIVE = 1e-4
"""The same where no standard error is written."""


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
        std_error: expected standard error of a parameter, that of the new fit where none is
            written; ``None`` where there is none.
    """

    fit: str
    quantity: str
    expected: float | str | None
    found: float | str | None
    tolerance: float | None
    ok: bool
    mend: str = ""
    std_error: float | None = None

    @property
    def change(self) -> float | None:
        """Found less expected; ``None`` where these are not both numbers."""
        if isinstance(self.found, float) and isinstance(self.expected, float):
            return self.found - self.expected
        return None

    @property
    def difference(self) -> float | None:
        """The change in expected standard errors; ``None`` where there is no such number."""
        return self.change / self.std_error if self.change is not None and self.std_error else None

    @property
    def verdict(self) -> str:
        """``unchanged``, ``moved``, ``missing`` from the fit, or ``not compared`` at all."""
        if self.ok:
            return "unchanged"
        if self.expected is None:
            return "not compared"
        return "missing" if self.found is None else "moved"

    def to_json(self) -> dict[str, Any]:
        """The row as plain data."""
        return {**vars(self), "difference": self.difference, "verdict": self.verdict}


class Found(NamedTuple):
    """A number of a fit: its standard error, and the least tolerance that makes sense."""

    value: float
    std_error: float | None = None
    least: float = 1e-12


def compared(name: str, expected: ExpectedPart, fit: Fit) -> Iterator[Row]:
    """A row for each quantity that the block holds, in the order of reading."""
    if expected.status is not None:
        found = fit.status.value
        yield Row(name, "status", expected.status, found, None, found == expected.status)
    numbers = {f"parameters.{key}": number for key, number in expected.parameters.items()}
    for key in ERRORS:
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
        value, error, _ = now[key]
        allowed = _allowed(number, now[key])
        ok = abs(value - number.value) <= allowed
        error = error if number.std_error is None else number.std_error
        yield Row(name, quantity, number.value, value, allowed, ok, std_error=error)


def _allowed(expected: ExpectedNumber, now: Found) -> float:
    """How far a number may move: as it says itself, or by its standard error, or by its size.

    A refit of the same data differs by rounding alone, far less than a tenth of a standard error.
    """
    if expected.tolerance is not None:
        return expected.tolerance
    if expected.std_error is not None:
        return max(SHARE * expected.std_error, ROUNDING * abs(expected.value), now.least)
    return max(SHARE * (now.std_error or 0.0), RELATIVE * abs(now.value), now.least)


def found_numbers(fit: Fit) -> dict[str, Found]:
    """Every number worth expecting; those not finite left out."""
    out = {}
    for name, e in fit.parameters.items():
        if not e.fixed:
            known = e.std_error is not None and math.isfinite(e.std_error)
            number = Found(e.value, e.std_error if known else None)
            if e.at_bound:  # how near it comes to the bound means nothing
                number = number._replace(least=RELATIVE * fit.model.parameters[name].scale)
            out[f"parameters.{name}"] = number
    for name, error in zip(ERRORS, (fit.train, fit.holdout), strict=True):
        if error is not None:
            out[name] = Found(error.nrmse)
    return {name: number for name, number in out.items() if math.isfinite(number.value)}


def updated(text: str, file: Path, expected: ExpectedPart | None, fit: Fit) -> str:
    """The text of the spec with its [expected] block brought up to a fit.

    Every byte outside the block stays. Numbers that still hold stay as they are written, and so
    do tolerances; standard errors are added where there are none.

    Raises:
        InputError: the block is written in a form that cannot be replaced by itself.
    """
    kept = expected or ExpectedPart()
    old = {f"parameters.{key}": number for key, number in kept.parameters.items()}
    old |= {key: getattr(kept, key) for key in ERRORS}
    wanted = {key: _renewed(old.get(key), found) for key, found in found_numbers(fit).items()}
    held = {key: number for key, number in old.items() if number is not None}
    if expected is not None and kept.status == fit.status.value and held == wanted:
        return text
    lines = [f'status = "{fit.status.value}"']
    lines += [f"{key} = {_written(wanted[key])}" for key in ERRORS if key in wanted]
    lines += ["", "[expected.parameters]"]
    for key, number in wanted.items():
        name = key.removeprefix("parameters.")
        if name != key:
            quoted = name if re.fullmatch(r"[\w-]+", name) else f'"{name}"'
            lines.append(f"{quoted} = {_written(number)}")
    new = _replaced(text, lines)
    before, after = parse_toml(text, file), parse_toml(new, file)
    if _without(before) != _without(after) or "parameters" not in after.get("expected", {}):
        raise InputError(
            f"{file}: the expected values are not written as one [expected] table, so they cannot "
            "be updated in place.",
            "Remove them, and run diffthrust check --update again: it writes the block at the end.",
        )
    return new


def _renewed(old: ExpectedNumber | None, now: Found) -> ExpectedNumber:
    """The number to expect from now on."""
    if old is None:
        return ExpectedNumber(value=now.value, std_error=now.std_error)
    holds = abs(now.value - old.value) <= _allowed(old, now)
    error = now.std_error
    if holds and error is not None and old.std_error is not None:
        error = old.std_error if abs(error - old.std_error) <= SHARE * old.std_error else error
    value = old.value if holds else now.value
    return ExpectedNumber(value=value, std_error=error, tolerance=old.tolerance)


def _written(number: ExpectedNumber) -> str:
    """The number as TOML, alone or in a table with what else is known of it."""
    parts = [f"value = {number.value:.10g}"]
    if number.std_error is not None:
        parts.append(f"std_error = {number.std_error:.4g}")
    if number.tolerance is not None:
        parts.append(f"tolerance = {number.tolerance:.10g}")
    return f"{{ {', '.join(parts)} }}" if len(parts) > 1 else f"{number.value:.10g}"


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
