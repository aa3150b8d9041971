"""Parse cells of text as numbers, or as dates and times of day.

Dates that begin with the year are read directly. Any other order is ambiguous, as 03/04/2025 is in
April or in March: it needs a format from the user, and the message offers those that fit.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from diffthrust._support.errors import InputError, Place

_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
_QUOTED_COMMA = re.compile(r"'[+-]?[\d.,]*\d,\d[\d.,]*'")
_YEAR_FIRST = re.compile(r"(\d{4})([-/.])(\d\d?)\2(\d\d?)")
_DAY = (
    r"(?P<a>\d\d?)(?P<sep>[-/. ])(?P<b>\d\d?|[A-Za-z]{3})(?P=sep)(?P<year>\d{4}|\d\d)"
    r"(?P<gap>[ T]|, )?"
)
_CLOCK = r"(?P<clock>\d\d?:\d\d(?P<seconds>:\d\d(?P<dot>[.,]\d+)?)?(?P<noon> ?[AaPp][Mm])?)"
_OTHER = re.compile(f"(?:{_DAY})?(?:{_CLOCK})?")
_FINE = re.compile(r"([.,]\d{6})\d+")  # datetime resolves microseconds
_FRACTION = re.compile(r"[.,]%f")
_MANY = 20_000
"""Numerics: above this many cells importing pandas pays off."""


@dataclass
class BadCell(Exception):
    """A cell that is no number, with its row in the column.

    ``formats`` are those that fit where it is a date that does not begin with the year.
    """

    index: int
    text: str
    expected: str = "a number"
    formats: Sequence[str] = ()

    def error(self, place: Place, form: str = "") -> InputError:
        """The error for this cell; ``form`` is the format of dates that the user gave."""
        problem = f"expected {self.expected}, found {self.text}."
        mend = f"list {self.text} under [logs] missing_values, or remove the line."
        if form:
            mend = f"correct the format, dates = {form!r}, or list {self.text} under "
            mend += "missing_values."
        elif self.formats:
            problem, mend = _ambiguous_date(self, place.column or "t")
        elif _QUOTED_COMMA.fullmatch(self.text):
            problem = f"{problem[:-1]}, whose comma may be a thousands separator."
            mend = "write numbers without thousands separators, and with a decimal point."
        return InputError.at(place, problem, mend)


def quoted(cell: str) -> str:
    """Quote a cell for a message, cut where it is long."""
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a point or a comma."""
    try:
        float(cell.replace(",", ".", 1))
    except ValueError:
        return False
    return True


def text_numbers(
    cells: Sequence[str | None], missing: Collection[str], comma: bool, is_time: bool
) -> tuple[np.ndarray, bool, bool]:
    """Read a column of text: numbers, ``(n,)``, whether they were dates, or had decimal commas.

    Empty text, ``nan``, None and ``missing`` words become NaN, other cells raise `BadCell`.
    ``comma`` says that commas are decimal commas, as with semicolons between cells; otherwise they
    are read so only if they cannot be thousands separators.
    """
    try:
        numbers, commas = _number_cells(cells, missing, comma)
        return numbers, False, commas
    except BadCell as bad:
        if not is_time:
            raise
        if is_date((cells[bad.index] or "").strip()):
            return seconds_of(cells, missing), True, False
        formats = formats_of([c for c in cells if c and c.strip() not in missing])
        if not formats:
            raise
        expected = "a number, or a date that begins with the year"
        raise BadCell(bad.index, bad.text, expected, formats) from None


def _number_cells(
    cells: Sequence[str | None], missing: Collection[str], comma: bool
) -> tuple[np.ndarray, bool]:
    try:
        return _numbers(cells, missing), False
    except BadCell as bad:
        text = [c.strip() for c in cells if c and "," in c]
        # "1,234" in a file with commas between quoted cells may be 1234 or 1.234: refused. "1,23"
        # among them can only be a decimal comma.
        if comma or not all(_THOUSANDS.fullmatch(c) for c in text):
            comma = _DECIMAL_COMMA.fullmatch(cells[bad.index] or "") is not None
        if comma:
            return _numbers(cells, missing, decimal_comma=True), True
        raise


def _numbers(
    cells: Sequence[str | None], missing: Collection[str], decimal_comma: bool = False
) -> np.ndarray:
    out = np.full(len(cells), np.nan)
    for index, cell in enumerate(cells):
        text = number = cell.strip() if cell else ""
        if not text or text in missing:
            continue
        if decimal_comma:
            if "." in text:
                raise BadCell(index, quoted(text), "a number with a decimal comma, as above it")
            number = text.replace(",", ".", 1)
        try:
            out[index] = float(number)
        except ValueError:
            raise BadCell(index, quoted(text)) from None
        if "_" in number or not number.isascii():  # Python accepts 1_000, no other program does
            raise BadCell(index, quoted(text))
    return out


def is_date(text: str) -> bool:
    """Whether a cell begins with year, month and day."""
    return _YEAR_FIRST.match(text) is not None


def formats_of(cells: Sequence[str | None]) -> list[str]:
    """The formats, in the notation of ``strptime``, that fit all cells that are not empty.

    None if the first is not a date; several if day and month are ambiguous.
    """
    texts = [text for cell in cells if cell and (text := cell.strip())]
    match = _OTHER.fullmatch(texts[0]) if texts else None
    if match is None:
        return []
    clock = ""
    if match["clock"]:
        marks = [m[1] for text in texts if (m := re.search(r":\d\d([.,])\d", text))]
        clock = "%H:%M" + ":%S" * bool(match["seconds"])
        if match["noon"]:
            clock = clock.replace("%H", "%I") + " " * match["noon"].startswith(" ") + "%p"
        elif marks:
            clock += f"{marks[0]}%f"
    orders = [""]
    if match["sep"]:
        year = "%Y" if len(match["year"]) == 4 else "%y"
        parts = [("%d", "%b", year)] if match["b"].isalpha() else [("%d", "%m", year)]
        if parts[0][1] == "%m":
            parts.append(("%m", "%d", year))
            parts += [("%y", "%m", "%d")] if year == "%y" else []
        orders = [match["sep"].join(fields) + (match["gap"] or "") for fields in parts]
    # Each order is tried on all cells: one day above 12 anywhere settles which number is the month.
    return [order + clock for order in orders if _fits(texts, order + clock)]


def _fits(texts: Sequence[str], form: str) -> bool:
    try:
        seconds_of(texts, (), form)
    except BadCell:
        return False
    return True


_FEW = 4096
"""Numerics: of so many stamps it is seen first whether they are times of day."""


def times_of_day(stamps: np.ndarray) -> np.ndarray | None:
    """Seconds from numbers that are times of day, hhmmss.f, ``(n,)``; None of any other numbers.

    None of these ends in 60 to 99, in the seconds or in the minutes, and at least once a minute
    goes by. Read as seconds, the clock of a SWAMP leaps by 40 s there.
    """
    few = stamps[:: max(1, stamps.size // _FEW)]
    # ends most clocks: of a million stamps all of them took 0.12 s, a quarter of a reading
    if np.any(few[np.isfinite(few)] % 100 >= 60):
        return None
    finite = stamps[np.isfinite(stamps)]
    if finite.size < 2 or finite.min() < 0 or finite.max() >= 240_000 or np.ptp(finite) < 100:
        return None
    hours, minutes, seconds = stamps // 10_000, stamps // 100 % 100, stamps % 100
    if np.nanmax(minutes) >= 60 or np.nanmax(seconds) >= 60 or not _passes_minutes(finite):
        return None
    return 3600.0 * hours + 60.0 * minutes + seconds


def _passes_minutes(stamps: np.ndarray) -> bool:
    """Whether most steps from one minute to the next are longer by 40 than others are at most."""
    steps, minute = np.diff(stamps), np.diff(stamps // 100) != 0
    if minute.all() or not minute.any():
        return False
    return bool(np.median(steps[minute]) >= 40.0 > np.median(steps[~minute]))


def seconds_of(cells: Sequence[str | None], missing: Collection[str], form: str = "") -> np.ndarray:
    """Read dates as seconds after the first, ``(n,)``; NaN for empty cells and ``missing`` words.

    ``form`` is their format, as for ``strptime``, if the year is not first; else `BadCell`.
    """
    texts = [(cell or "").strip() for cell in cells]
    out = _at_once(texts, missing, form) if form and len(cells) > _MANY else None
    if out is None:
        out = _one_by_one(texts, missing, form)
    finite = np.isfinite(out)
    # A format without a day (%d, %j, %U): 23:59:59 is followed by 00:00:00, a step back by a day.
    if form and not set(form) & set("djU") and finite.any():
        out[finite] = np.unwrap(out[finite], period=86_400.0)
    return out


def _at_once(texts: Sequence[str], missing: Collection[str], form: str) -> np.ndarray | None:
    """Read many dates with pandas; None on failure, so that a slower pass finds the bad cell."""
    import pandas as pd

    plain = [None if text in missing else text or None for text in texts]
    try:
        stamps = pd.to_datetime(pd.Series(plain, dtype=object), format=form)
        since = stamps - stamps.dropna().iloc[0]
        return since.dt.total_seconds().to_numpy(dtype=np.float64, copy=True)
    except (ValueError, TypeError, IndexError, AttributeError, OverflowError):
        return None


def _one_by_one(texts: Sequence[str], missing: Collection[str], form: str) -> np.ndarray:
    out = np.full(len(texts), np.nan)
    first: datetime | None = None
    for index, text in enumerate(texts):
        if not text or text in missing:
            continue
        try:
            stamp = _by_format(text, form) if form else _year_first(text)
            if stamp.tzinfo is None:
                stamp = stamp.replace(tzinfo=UTC)
            first = first or stamp
            out[index] = (stamp - first).total_seconds()
        except (ValueError, OverflowError, re.error):
            expected = f"a date as in {form!r}" if form else "an ISO date and time"
            raise BadCell(index, quoted(text), expected) from None
    return out


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


def _ambiguous_date(bad: BadCell, column: str) -> tuple[str, str]:
    """Problem and mend for a date whose order of day, month and year is ambiguous."""
    first, *more = bad.formats
    problem = f"expected {bad.expected}, found {bad.text}."
    mend = f"give its format: time = Column({column!r}, dates={first!r})"
    if "%d" not in first:
        problem = f"expected a number, or a date and time, found the time of day {bad.text}."
    elif more:
        problem = f"{problem[:-1]}, which may be several days."
        mend += f" where the {_FIRST[first[:2]]} comes first"
        mend += "".join(f", dates={form!r} where the {_FIRST[form[:2]]} does" for form in more)
    spec = f"in a spec file time = {{ column = {_toml(column)}, dates = {_toml(first)} }}"
    return problem, f"{mend}; {spec}."


_FIRST = {"%d": "day", "%m": "month", "%y": "year"}


def _toml(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
