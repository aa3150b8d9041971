"""The rows and sentences of intervals, directions, predictions and quantities, as data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from diffthrust._support.report import Bullets, Report, Rows, Section, notes
from diffthrust._support.words import number, percent, with_error
from diffthrust.estimation._arguments import LIKELIHOODS, NOISE_MODELS
from diffthrust.estimation._result import Fit
from diffthrust.uncertainty._prediction.band import Band, DerivedQuantity
from diffthrust.uncertainty._values import (
    Interval,
    Profile,
    Row,
    longer_arm,
    shortest_half_arm,
)


def profile_rows(profiles: Iterable[Profile], level: float) -> Rows:
    """One row for each profile."""
    percent = f"{100 * level:g} %"
    rows = []
    for p in (profile.shown for profile in profiles):
        error = shortest_half_arm(p.value, (p.low, p.high)) or p.std_error
        ends = [("open" if e is None else with_error(e, error)[0]) for e in (p.low, p.high)]
        rows.append((p.name, with_error(p.value, error)[0], *ends, p.unit))
    return Rows.of(("Profile", "Value", f"{percent} from", "to", "Unit"), rows, numbers=(1, 2, 3))


def intervals_report(
    rows: Sequence[Row],
    methods: Sequence[str],
    level: float,
    notes: Iterable[str],
    directions: Report,
) -> Report:
    """One row for each parameter, the recommended interval marked by a star, and what to say."""
    sentences = [sentence for row in rows for sentence in row.sentences]
    return Report(
        Section(f"Intervals of {100 * level:g} %; the recommended one has a star.", *notes),
        Section("", _interval_rows(rows, methods)),
        Section("Where they disagree", Bullets(sentences))
        if sentences
        else Section("", "They agree."),
        Section("What the logs know", *(p for s in directions.sections for p in s.parts)),
    )


def _interval_rows(rows: Sequence[Row], methods: Sequence[str]) -> Rows:
    cells = []
    for row in rows:
        ends = (end for interval in row.intervals.values() for end in interval)
        error = shortest_half_arm(row.value, ends)
        intervals = (
            ("* " if method == row.recommended else "")
            + _ends(row.intervals.get(method), row.bounds, error)
            for method in methods
        )
        name = f"{row.name} [{row.unit}]" if row.unit else row.name
        cells.append((name, with_error(row.value, error)[0], *intervals))
    headings = ("Parameter", "Value", *methods)
    columns = range(1, len(headings))
    return Rows.of(headings, cells, numbers=columns, unbroken=columns)


def _ends(
    interval: Interval | None, bounds: tuple[float | None, float | None], error: float | None
) -> str:
    if interval is None:
        return "-"
    return " to ".join(
        with_error(end, error)[0] if end is not None else "open" if bound is None else "bound"
        for end, bound in zip(interval, bounds, strict=True)
    )


def direction_rows(directions: Iterable[tuple[float, str, Mapping[str, float]]]) -> Rows:
    """How well each direction is known, and what it moves."""
    rows = []
    for std_error, grade, members in directions:
        moves = ", ".join(f"{name} {100 * change:+.2g} %" for name, change in members.items())
        error = f"{100 * std_error:.2g} %" if math.isfinite(std_error) else "-"
        rows.append((error, grade, moves))
    headings = ("Known to", "", "Moves together (by one standard error)")
    return Rows.of(headings, rows, numbers=(0,))


_APART = 0.2
"""Two intervals disagree where an end differs by this share of the arm it belongs to."""
_CLEARLY = 1.25
"""A sandwich and a covariance disagree where one is wider by this factor."""


@dataclass(frozen=True)
class Evidence:
    """What is known of one parameter's intervals.

    The sandwich is ``inflation`` times as wide as the covariance, within ``chance``; the
    ``correlation`` is that of residuals taken as white; ``met`` are other parameters whose bounds
    are within their own intervals.
    """

    fit: Fit
    profile: Profile
    intervals: Mapping[str, Interval]
    inflation: float | None
    chance: float
    correlation: float
    prior: bool
    recommended: str
    met: tuple[str, ...] = ()


def heading(fit: Fit, lag: float, correlated: bool, sandwich: bool) -> str:
    """The recommendation, with its reason."""
    lasting = NOISE_MODELS[fit.noise_model].lasts
    if correlated:
        kind = "What is new in the noise is" if lasting else "Residuals are"
        mend = "something is missing from the model" if lasting else _mend(fit)
        return (
            f"{kind} correlated from sample to sample ({lag:.2f}) where the fit takes them as "
            f"white: covariance, profile and posterior are too narrow, take the sandwich. To "
            f"narrow it down: {mend}."
        )
    if sandwich:
        return (
            "Residuals are white, but not of one size or law: take the sandwich where it is "
            "marked, else the profile."
        )
    what = "What is new in the noise at each sample is" if lasting else "Residuals are"
    return f"{what} white, as the fit takes them: take the profile."


def _mend(fit: Fit) -> str:
    if LIKELIHOODS[fit.likelihood].corrects or not fit.model.states:
        return "look for what the model lacks (diagnose)"
    return (
        'look for what the model lacks (diagnose), or fit with noise_model="ar1" or '
        'likelihood="innovations"'
    )


def sentences(e: Evidence) -> Iterator[str]:
    """A sentence for each disagreement."""
    name = e.profile.name
    estimate = e.fit.parameters[name]
    if estimate.at_bound:
        yield (
            f"{name} lies at its bound: it has no standard error there, only the profile says how "
            "far it may be from it."
        )
    elif estimate.std_error is None:
        yield (
            f"{name} has no standard error: these logs cannot tell it from others; the profile "
            "says what is known of it alone."
        )
    whys = ("downwards", e.profile.open_low), ("upwards", e.profile.open_high)
    for (side, why), bound in zip(whys, e.profile.bounds, strict=True):
        if why and not (estimate.at_bound and bound is not None):
            it = "it " if bound is not None else ""
            yield f"{name}: {side} the profile is open; {it}{why}."
    yield from _lopsided(e, name)
    yield from _inflated(e, name)
    yield from _posterior_apart(e, name)


def _lopsided(e: Evidence, name: str) -> Iterator[str]:
    longer = longer_arm(e.profile)
    if not longer:
        return
    met = f", for {' and '.join(e.met)} may meet a bound" if e.met else ""
    expect = ": expect the same of the truth, within the width of the sandwich"
    yield (
        f"{name}: the profile reaches {longer}. The likelihood is not quadratic "
        f"there{met}, and covariance and sandwich are symmetric by construction"
        f"{expect if e.recommended == 'sandwich' else ''}."
    )


def _inflated(e: Evidence, name: str) -> Iterator[str]:
    if e.inflation is None or 1 / _CLEARLY < e.inflation < _CLEARLY:
        return
    words = f"{name}: the sandwich is {e.inflation:.2g} times as wide as the covariance: "
    if e.correlation:
        yield f"{words}residuals are correlated from sample to sample ({e.correlation:.2f})."
    elif abs(e.inflation - 1) < e.chance:
        yield f"{words}no more than chance gives on so few samples."
    elif e.inflation < 1:
        yield f"{words}residuals are small where this parameter acts most, or alternate in sign."
    else:
        yield f"{words}residuals are large, or last long, where this parameter acts most."


def _posterior_apart(e: Evidence, name: str) -> Iterator[str]:
    drawn, profile = e.intervals.get("posterior"), e.intervals["profile"]
    if drawn is None or drawn.low is None or drawn.high is None:
        return
    ends = (("lower", drawn.low, profile.low), ("upper", drawn.high, profile.high))
    apart = [
        side
        for side, here, end in ends
        if end is not None and abs(here - end) > _APART * max(abs(end - e.profile.value), 1e-300)
    ]
    if not apart:
        return
    where = f"the {apart[0]} end" if len(apart) == 1 else "both ends"
    if e.profile.lopsided is None or longer_arm(e.profile):
        why = (
            "the likelihood is not quadratic, and a posterior averages over the other parameters "
            "where a profile takes their best"
        )
    elif e.prior:
        why = "the draws follow the density of the prior, which weighs values once more"
    else:
        why = (
            "a bound or the prior cuts the posterior off, other parameters are far from quadratic, "
            "or the chains have not converged"
        )
    yield f"{name}: posterior and profile differ at {where}: {why}."


_POINTS = 12
"""Most points of a curve in a table."""


def interval_text(median: float, low: float, high: float) -> tuple[str, str, str]:
    """Median and ends, all to the second digit of half the interval's width."""
    half = 0.5 * (high - low)
    if not (np.isfinite([median, low, high]).all() and half > 0):
        return number(median), number(low), number(high)
    places = 1 - int(np.floor(np.log10(half)))
    if 0 <= places <= 8 and 1e-4 <= max(abs(low), abs(high)) < 1e6:
        return f"{median:.{places}f}", f"{low:.{places}f}", f"{high:.{places}f}"
    top = int(np.floor(np.log10(max(abs(low), abs(high)))))
    digits = min(max(2, top + places + 1), 12)
    return number(median, digits), number(low, digits), number(high, digits)


def evenly(size: int, most: int) -> np.ndarray:
    """Indices of at most so many points, first and last among them."""
    return np.unique(np.linspace(0, size - 1, min(size, most)).round().astype(int))


def prediction_report(
    channels: Mapping[str, Band], level: float, sentence: str, remarks: Iterable[str]
) -> Report:
    """Coverage by channel, and in words."""
    rows = ((n, percent(band.coverage), str(band.samples)) for n, band in channels.items())
    headings = ("Channel", f"Inside {percent(level)} band", "Samples")
    return Report(Section("", Rows.of(headings, rows, numbers=(1, 2)), sentence, *notes(remarks)))


def quantities_report(
    quantities: Iterable[DerivedQuantity], level: float, remarks: Iterable[str]
) -> Report:
    """Intervals of the numbers, then each curve, at some of its points where it has many."""
    ends = (f"{percent(level)} from", "to")
    quantities = [q.shown for q in quantities]
    numbers = [
        (q.name, *interval_text(float(q.median), float(q.low), float(q.high)), q.unit)
        for q in quantities
        if q.grid is None
    ]
    headings = ("Quantity", "Median", *ends, "Unit")
    curves = (_curve_rows(q, q.grid, ends) for q in quantities if q.grid is not None)
    return Report(
        Section("", Rows.of(headings, numbers, numbers=(1, 2, 3))),
        *(Section("", rows) for rows in curves),
        Section("", *notes(remarks)),
    )


def _curve_rows(q: DerivedQuantity, grid: np.ndarray, ends: tuple[str, str]) -> Rows:
    unit = f" [{q.grid_unit}]" if q.grid_unit else ""
    headings = (f"{q.grid_name}{unit}", f"{q.name}{f' [{q.unit}]' if q.unit else ''}", *ends)
    rows = (
        (
            f"{float(grid[at]):.6g}",
            *interval_text(float(q.median[at]), float(q.low[at]), float(q.high[at])),
        )
        for at in evenly(grid.size, _POINTS)
    )
    return Rows.of(headings, rows, numbers=range(4))
