"""Compare the [expected] block of a spec file with a fit, or write it."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import tomlkit
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.items import Item, Table

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust._support.visible import visible
from diffthrust._support.words import joined
from diffthrust.estimation._origin import versions
from diffthrust.specs._file import parse_toml
from diffthrust.specs._parts import ExpectedNumber, ExpectedPart
from diffthrust.uncertainty._values import Shown

if TYPE_CHECKING:
    from diffthrust.estimation._result import Fit
    from diffthrust.specs._spec import Spec

_FOR_PEOPLE = ("per", "shown_unit")
_ERRORS = ("train_nrmse", "holdout_nrmse")
_DIGITS = 16
"""Digits of a hash that are written: enough to identify a file."""
_SHARE = 0.1
"""A parameter may move by this share of its standard error."""
_ROUNDING = 1e-8
"""Relative tolerance for rounding, where standard errors are even smaller."""
_RELATIVE = 1e-4
"""Relative tolerance if no standard error is written."""


@dataclass(frozen=True)
class CheckRow(Shown):
    """One quantity of one fit: expected and actual value, ``None`` where there is none."""

    _in_unit = ("expected", "found", "tolerance", "std_error")

    fit: str
    quantity: str  # status, train_nrmse, holdout_nrmse, a parameter, or what went wrong
    expected: float | str | None
    found: float | str | None
    tolerance: float | None  # largest difference allowed; None for words
    ok: bool
    mend: str = ""
    std_error: float | None = None  # of a parameter as expected, else that of the new fit
    unit: str = ""  # of all these numbers
    per: float = 1.0  # number of shown_unit per unit
    shown_unit: str = ""  # as in the log; unit if empty

    @property
    def change(self) -> float | None:
        """Found minus expected; ``None`` unless both are numbers."""
        if isinstance(self.found, float) and isinstance(self.expected, float):
            return self.found - self.expected
        return None

    @property
    def difference(self) -> float | None:
        """The change in expected standard errors; ``None`` if undefined."""
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
        kept = {name: value for name, value in vars(self).items() if name not in _FOR_PEOPLE}
        verdict = {"difference": self.difference, "verdict": self.verdict}
        return {**kept, **verdict, **self._json(*self._in_unit, "unit")}


@dataclass(frozen=True)
class Marks:
    """Fingerprints of a stored fit, to report what has changed since."""

    library: str  # versions, such as "diffthrust 0.1.0, jax 0.10.2, numpy 2.4.6"
    spec: str  # hash of the spec without [expected]
    data: dict[str, str]  # hash of each log file, by its path relative to the spec

    def since(self, expected: ExpectedPart, agrees: bool) -> str:
        """A sentence on what changed since a block was written; "" where results agree on its data.

        A heading off by five degrees in one sample stays within every tolerance, and is no less
        another file.
        """
        stored, data = expected.data, self.data
        files = [file for file in {**stored, **data} if stored.get(file) != data.get(file)]
        if agrees and not (stored and files):
            return ""
        if agrees:
            return (
                f"The data ({', '.join(files)}) changed since it was stored; the results stay "
                "within their tolerances. Restore the data, or accept them: diffthrust check "
                "--update."
            )
        if not (expected.library and expected.spec and stored):
            return (
                "Its [expected] block does not name the data, spec and library that it belongs to: "
                "diffthrust check --update adds them."
            )
        library = f"the library (it was {expected.library}; now {self.library})"
        compared = {
            "data": (f"the data ({', '.join(files)})", bool(files)),
            "spec": ("the spec", expected.spec != self.spec),
            "library": (library, expected.library != self.library),
        }
        changed = [words for words, differs in compared.values() if differs]
        same = [name for name, (_, differs) in compared.items() if not differs]
        if not changed:
            return (
                "Data, spec and versions are as stored: the code of diffthrust or the machine has "
                "moved it."
            )
        unchanged = f"; {joined(same)} {'is' if len(same) == 1 else 'are'} the same" if same else ""
        return f"Since it was stored {joined(changed)} changed{unchanged}."


def marks_of(spec: Spec, fit: Fit) -> Marks:
    """The fingerprints of a spec's fit."""
    assert fit.origin is not None
    logs = (*fit.origin.train, *fit.origin.holdout)
    files, here = (*spec.train, *spec.holdout), spec.path.parent
    return Marks(
        library=", ".join(f"{name} {version}" for name, version in versions().items()),
        spec=spec.sha256[:_DIGITS],
        data={
            visible(os.path.relpath(file, here)).replace(os.sep, "/"): log.file.sha256[:_DIGITS]
            for file, log in zip(files, logs, strict=True)
            if log.file is not None
        },
    )


class FoundNumber(NamedTuple):
    """A number of a fit, its standard error, and the least sensible tolerance."""

    value: float
    std_error: float | None = None
    least: float = 1e-12


def compared(name: str, expected: ExpectedPart, fit: Fit) -> Iterator[CheckRow]:
    """A row for each quantity of the block, in order."""
    if expected.status is not None:
        status = fit.status.value
        yield CheckRow(name, "status", expected.status, status, None, status == expected.status)
    now = found_numbers(fit)
    for key, number in _numbers_of(expected).items():
        quantity = key.removeprefix("parameters.")
        if key not in now:
            names = [k.removeprefix("parameters.") for k in now]
            mend = f"{quantity!r} is no result of this fit{nearest(quantity, names, '; ')}; "
            mend += f"there are {listing(names)}."
            yield CheckRow(name, quantity, number.value, None, number.tolerance, False, mend)
            continue
        value, error, _ = now[key]
        allowed = _allowed(number, now[key])
        ok = abs(value - number.value) <= allowed
        error = error if number.std_error is None else number.std_error
        row = CheckRow(name, quantity, number.value, value, allowed, ok, std_error=error)
        if key.startswith("parameters."):
            e = fit.parameters[quantity]
            row = replace(row, unit=e.unit, per=e.per, shown_unit=e.shown_unit)
        yield row


def _allowed(expected: ExpectedNumber, now: FoundNumber) -> float:
    """Allowed change of a number: its tolerance, or from its standard error, or from its size."""
    if expected.tolerance is not None:
        return expected.tolerance
    if expected.std_error is not None:
        return max(_SHARE * expected.std_error, _ROUNDING * abs(expected.value), now.least)
    return max(_SHARE * (now.std_error or 0.0), _RELATIVE * abs(now.value), now.least)


def found_numbers(fit: Fit) -> dict[str, FoundNumber]:
    """All finite numbers of a fit that a block may expect."""
    out = {}
    for name, e in fit.parameters.items():
        if not e.fixed:
            has_error = e.std_error is not None and math.isfinite(e.std_error)
            number = FoundNumber(e.value, e.std_error if has_error else None)
            # An estimate at a bound stops somewhere within the solver's tolerance of it: its
            # distance from the bound is arbitrary.
            if e.at_bound:
                number = number._replace(least=_RELATIVE * fit.model.parameters[name].scale)
            out[f"parameters.{name}"] = number
    for name, error in zip(_ERRORS, (fit.train, fit.holdout), strict=True):
        if error is not None:
            out[name] = FoundNumber(error.nrmse)
    return {name: number for name, number in out.items() if math.isfinite(number.value)}


def updated(text: str, file: Path, expected: ExpectedPart | None, fit: Fit, marks: Marks) -> str:
    """The text of the spec with its [expected] block updated to a fit.

    Every byte outside the block is kept, and so are its comments and the order of its keys. Numbers
    that still agree are kept, and so are tolerances; missing standard errors are added. Hashes of
    data and spec are updated if changed.
    """
    old = _numbers_of(expected) if expected else {}
    wanted = {key: _renewed(old.get(key), now) for key, now in found_numbers(fit).items()}
    if expected and expected.status == fit.status.value and old == wanted:
        stored = (expected.spec, expected.data)  # whatever the library
        if expected.library and stored == (marks.spec, marks.data):
            return text
    return with_expected(text, file, fit.status.value, wanted, marks)


def _numbers_of(expected: ExpectedPart) -> dict[str, ExpectedNumber]:
    """The numbers of a block, those of parameters as "parameters.NAME"."""
    numbers = {f"parameters.{key}": number for key, number in expected.parameters.items()}
    errors = {key: getattr(expected, key) for key in _ERRORS}
    return numbers | {key: number for key, number in errors.items() if number is not None}


def with_expected(
    text: str, file: Path, status: str, numbers: Mapping[str, ExpectedNumber], marks: Marks
) -> str:
    """The text of a spec with status, numbers and hashes in its [expected] block."""
    # The file is a person's: comments, order, line ends and a byte order mark stay. Editors on
    # Windows write \r\n and the mark, and tomlkit alters both.
    original = parse_toml(text, file)
    mark = "\ufeff" * text.startswith("\ufeff")
    line_ends = "\r\n" if "\n" not in text.replace("\r\n", "") and "\r\n" in text else "\n"
    document = tomlkit.parse(text.removeprefix(mark).replace(line_ends, "\n"))
    if "expected" not in document:
        lines = tomlkit.dumps(document)
        gap = "" if not lines or lines.endswith("\n") else "\n"
        document = tomlkit.parse(f"{lines}{gap}\n[expected]\n")
    # [expected] and [expected.parameters] with other tables between them: joined to one block.
    if isinstance(document["expected"], OutOfOrderTableProxy):
        document["expected"] = tomlkit.table()
    table = document["expected"]
    values = {key: _written(number) for key, number in numbers.items()}
    errors = {key: value for key, value in values.items() if key in _ERRORS}
    parameters = {
        key.removeprefix("parameters."): value for key, value in values.items() if key not in errors
    }
    files = ", ".join(f"{json.dumps(file)} = {json.dumps(h)}" for file, h in marks.data.items())
    words = {"status": tomlkit.item(status), **errors}
    words |= {"library": tomlkit.item(marks.library), "spec": tomlkit.item(marks.spec)}
    if isinstance(table, Table):
        _fill(table, {**words, "data": tomlkit.value(f"{{ {files} }}")})
        _fill(table["parameters"], parameters)
    new = mark + tomlkit.dumps(document).replace("\n", line_ends)
    block = {"status": status, **errors, **vars(marks), "parameters": parameters}
    # tomlkit edits unusual layouts (dotted keys, inline tables) wrongly at times: the result is
    # parsed again, and must be the old file with the new block.
    if parse_toml(new, file) != {**original, "expected": block}:
        raise InputError(
            f"{file}: the expected values are not written as one [expected] table, so they cannot "
            "be updated in place.",
            "Remove them, and run diffthrust check --update again: it writes the block at the end.",
        )
    return new


def _renewed(old: ExpectedNumber | None, now: FoundNumber) -> ExpectedNumber:
    """The new expected number: the old one if it still agrees."""
    if old is None:
        return ExpectedNumber(value=now.value, std_error=now.std_error)
    holds = abs(now.value - old.value) <= _allowed(old, now)
    error = now.std_error
    if holds and error is not None and old.std_error is not None:
        error = old.std_error if abs(error - old.std_error) <= _SHARE * old.std_error else error
    value = old.value if holds else now.value
    return ExpectedNumber(value=value, std_error=error, tolerance=old.tolerance)


def _written(number: ExpectedNumber) -> Item:
    """The number as TOML, or a table with its standard error and tolerance."""
    parts = [f"value = {number.value:.10g}"]
    if number.std_error is not None:
        parts.append(f"std_error = {number.std_error:.4g}")
    if number.tolerance is not None:
        parts.append(f"tolerance = {number.tolerance:.10g}")
    written = f"{{ {', '.join(parts)} }}" if len(parts) > 1 else f"{number.value:.10g}"
    return tomlkit.value(written)


def _fill(table: Table, values: Mapping[str, Item]) -> None:
    """Set the values of a table and delete others, except its table of parameters."""
    # tomlkit counts blank lines and comments before the next table to this one: new keys must go
    # above them.
    tail = []
    while table.value.body and table.value.body[-1][0] is None:
        tail.append(table.value.body.pop()[1])
    for key in [key for key in table if key not in values and key != "parameters"]:
        del table[key]
    for key, value in values.items():
        if key not in table:
            table.add(key, value)
        elif table[key] != value:
            table[key] = value
    if "status" in values and not isinstance(table.get("parameters"), Table):
        table.pop("parameters", None)
        table.add(tomlkit.nl())
        table.add("parameters", tomlkit.table())
    for item in reversed(tail):
        table.add(item)
