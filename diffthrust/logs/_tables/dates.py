"""Parse dates and times of day in cells of text.

Dates that begin with the year are read directly. Any other order is ambiguous, as 03/04/2025 is in
April or in March: it needs a format from the user, and the message offers those that fit.
"""

import re
from collections.abc import Collection, Sequence
from datetime import UTC, datetime

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._tables.cells import BadCell, quoted

_YEAR_FIRST = re.compile(r"(\d{4})([-/.])(\d\d?)\2(\d\d?)")
_DAY = (
    r"(?P<a>\d\d?)(?P<sep>[-/. ])(?P<b>\d\d?|[A-Za-z]{3})(?P=sep)(?P<year>\d{4}|\d\d)"
    r"(?P<gap>[ T]|, )?"
)
_CLOCK = r"(?P<clock>\d\d?:\d\d(?P<seconds>:\d\d(?P<dot>[.,]\d+)?)?(?P<noon> ?[AaPp][Mm])?)"
_OTHER = re.compile(f"(?:{_DAY})?(?:{_CLOCK})?")
_FINE = re.compile(r"([.,]\d{6})\d+")  # datetime resolves microseconds
_MANY = 20_000  # above this many cells importing pandas pays off
_FRACTION = re.compile(r"[.,]%f")


class OtherDate(BadCell):
    """A date that does not begin with the year, with its row and the formats that fit."""

    def __init__(self, index: int, text: str, formats: Sequence[str]) -> None:
        super().__init__(index, text, "a number, or a date that begins with the year")
        self.formats = formats


def is_date(text: str) -> bool:
    """Whether a cell begins with year, month and day."""
    return _YEAR_FIRST.match(text) is not None


def formats_of(cells: Sequence[str | None]) -> list[str]:
    """The formats, in the notation of ``strptime``, that fit all cells that are not empty.

    None if the first is not a date; several if day and month are ambiguous.
    """
    texts = [text for cell in cells if cell and (text := cell.strip())]
    match = _OTHER.fullmatch(texts[0]) if texts and texts[0] else None
    if match is None:
        return []
    fine = any(re.search(r":\d\d[.,]\d", text) for text in texts)
    clock = ""
    if match["clock"]:
        mark = next((m[1] for t in texts if (m := re.search(r":\d\d([.,])\d", t))), ".")
        clock = "%H:%M" + ":%S" * bool(match["seconds"])
        if match["noon"]:
            clock = clock.replace("%H", "%I") + " " * match["noon"].startswith(" ") + "%p"
        elif fine:
            clock += f"{mark}%f"
    orders = [""]
    if match["sep"]:
        year = "%Y" if len(match["year"]) == 4 else "%y"
        parts = [("%d", "%b", year)] if match["b"].isalpha() else [("%d", "%m", year)]
        if parts[0][1] == "%m":
            parts.append(("%m", "%d", year))
            parts += [("%y", "%m", "%d")] if year == "%y" else []
        orders = [match["sep"].join(fields) + (match["gap"] or "") for fields in parts]
    # Each order is tried on all cells: one day above 12 anywhere settles which number is the month.
    formats = []
    for order in orders:
        try:
            seconds_of(texts, (), order + clock)
        except BadCell:
            continue
        formats.append(order + clock)
    return formats


def seconds_of(cells: Sequence[str | None], missing: Collection[str], form: str = "") -> np.ndarray:
    """Read dates as seconds after the first, ``(n,)``; NaN for empty cells and ``missing`` words.

    ``form`` is their format, as for ``strptime``, if the year is not first; else `BadCell`.
    """
    if form and len(cells) > _MANY and (fast := _at_once(cells, missing, form)) is not None:
        return _past_midnight(fast, form)
    out = np.full(len(cells), np.nan)
    first: datetime | None = None
    for index, cell in enumerate(cells):
        text = cell.strip() if cell else ""
        if not text or text in missing:
            continue
        try:
            stamp = _by_format(text, form) if form else _year_first(text)
            if stamp.tzinfo is None:
                stamp = stamp.replace(tzinfo=UTC)
            first = stamp if first is None else first
            out[index] = (stamp - first).total_seconds()
        except (ValueError, OverflowError, re.error):
            expected = f"a date as in {form!r}" if form else "an ISO date and time"
            raise BadCell(index, quoted(text), expected) from None
    return _past_midnight(out, form)


def _past_midnight(out: np.ndarray, form: str) -> np.ndarray:
    """Let times of day continue across midnight; dates stay unchanged."""
    finite = np.isfinite(out)
    # A format without a day (%d, %j, %U): 23:59:59 is followed by 00:00:00, a step back by a day.
    if form and not set(form) & set("djU") and finite.any():
        out[finite] = np.unwrap(out[finite], period=86_400.0)
    return out


def _at_once(cells: Sequence[str | None], missing: Collection[str], form: str) -> np.ndarray | None:
    """Read many dates with pandas; None on failure, so that a slower pass finds the bad cell."""
    import pandas as pd

    texts = [(cell or "").strip() for cell in cells]
    plain = [None if text in missing else text or None for text in texts]
    try:
        stamps = pd.to_datetime(pd.Series(plain, dtype=object), format=form)
        since = stamps - stamps.dropna().iloc[0]
        return since.dt.total_seconds().to_numpy(dtype=np.float64, copy=True)
    except (ValueError, TypeError, IndexError, AttributeError, OverflowError):
        return None


def _year_first(text: str) -> datetime:
    try:
        return datetime.fromisoformat(text)
    except ValueError:  # such as 2025/3/21, or a blank before the time zone
        match = _YEAR_FIRST.match(text)
        if match is None:
            raise
        day = f"{match[1]}-{int(match[3]):02}-{int(match[4]):02}"
        # Until "2025-03-21 10:00:00 +0000": a blank before the zone, which fromisoformat refuses.
        clock = re.sub(r"\s+(?=[Z+-])|\s*UTC$", "", text[match.end() :]).strip()
        clock = re.sub(r"^T?(\d):", r"0\1:", clock)
        return datetime.fromisoformat(f"{day}T{clock.lstrip('T')}" if clock else day)


def _by_format(text: str, form: str) -> datetime:
    text = _FINE.sub(r"\1", text)
    try:
        return datetime.strptime(text, form)
    except ValueError:
        if "%f" not in form:
            raise
        # Many programs write whole seconds without a fraction: 10:00:00 between 09:59:59.5 and ...
        return datetime.strptime(text, _FRACTION.sub("", form))


def other_date(place: Place, bad: OtherDate) -> InputError:
    """The error for a date whose order of day, month and year is ambiguous."""
    column = place.column or "t"
    first, *more = bad.formats
    mend = f"give its format: time = Column({column!r}, dates={first!r})"
    spec = f"in a spec file time = {{ column = {_toml(column)}, dates = {_toml(first)} }}"
    if "%d" not in first:
        problem = f"expected a number, or a date and time, found the time of day {bad.text}."
    elif more:
        problem = f"expected {bad.expected}, found {bad.text}, which may be several days."
        mend += f" where the {_FIRST[first[:2]]} comes first"
        mend += "".join(f", dates={form!r} where the {_FIRST[form[:2]]} does" for form in more)
    else:
        problem = f"expected {bad.expected}, found {bad.text}."
    return InputError.at(place, problem, f"{mend}; {spec}.")


_FIRST = {"%d": "day", "%m": "month", "%y": "year"}


def _toml(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
