"""Sentences, printed numbers, and which check belongs to which sentence."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .page import Page

ROUNDING = 0.51
"""Of the last digit: what a printed number may be away from what it stands for."""
NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
SHARE = r"(?:-?\d+(?:\.\d+)? %|\?)"
WORTH = rf"{SHARE} \({SHARE} to {SHARE}\)"

Check = Callable[[re.Match, Any, Page | None], Iterator[str]]


@dataclass(frozen=True)
class Claim:
    """A kind of sentence, and what holds it against the truth."""

    pattern: re.Pattern
    check: Check


CLAIMS: list[Claim] = []


def claim(pattern: str) -> Callable[[Check], Check]:
    """Make a function the check of sentences of a pattern, which matches up to their full stop."""

    def keep(check: Check) -> Check:
        CLAIMS.append(Claim(re.compile(pattern + r"(?=\s|$)", re.DOTALL), check))
        return check

    return keep


def contradictions(diag: Any, page: Page | None = None, text: str = "") -> list[str]:
    """What is not so in the summary and in the details, and sentences that nobody checks.

    Args:
        diag: the diagnosis.
        page: what is known besides; without it the sentences are held against the object alone.
        text: in their place.
    """
    if not text:
        both = (contradictions(diag, page, part) for part in (diag.summary, diag.details))
        return [*too_long(diag.summary), *(wrong for part in both for wrong in part)]
    wrong, text = [], text.strip()
    while text:
        matched = next((s for s in _of_the_logs(diag) if text.startswith(s)), "")
        if not matched:
            found = next(((c, m) for c in CLAIMS if (m := c.pattern.match(text))), None)
            if found is None:
                return [*wrong, f"nobody checks this sentence: {text[:300]!r}"]
            wrong += [f"{why}: {found[1][0]!r}" for why in found[0].check(found[1], diag, page)]
            matched = found[1][0]
        text = text[len(matched) :].lstrip()
    return wrong


def too_long(summary: str) -> Iterator[str]:
    """More than sixty words, or than four figures outside names and units."""
    if len(summary.split()) > 60:
        yield f"{len(summary.split())} words: {summary!r}"
    plain = re.sub(r"[\w.]*[A-Za-z_]+[\w.^*]*|\*\*\w|\^-?\d", " ", summary)
    figures = re.findall(r"\d[\d.]*", plain)
    if len(figures) > 4:
        yield f"{len(figures)} figures: {summary!r}"


def _of_the_logs(diag: Any) -> Iterator[str]:
    """Sentences on what channels mean, from the doubts and the comparison."""
    yield from diag.before.hints
    for doubt in diag.doubts:
        yield f"A doubt on {in_words(doubt.channel)}: {doubt.evidence} Mend: {doubt.mend}"
    for mend in diag.mends:
        yield f"First the logs: {mend.doubt.evidence}"
        for logs in ("", f", for {' and '.join(mend.doubt.logs)} alone"):
            yield f"Mend{logs}: {mend.reading.line}"


def is_said(text: str, value: float, slack: float = 0.0) -> bool:
    """Whether a printed number is this value, to its last digit and to a share of it."""
    mantissa, _, power = text.partition("e")
    places = len(mantissa.partition(".")[2])
    digit = 10.0 ** (int(power or 0) - places)
    return abs(float(text) - value) <= ROUNDING * digit + slack * abs(value)


def shares_in(text: str) -> list[float]:
    return [
        np.nan if part == "?" else float(part.removesuffix(" %")) / 100
        for part in re.findall(SHARE, text)
    ]


def all_shares(worth: Any) -> list[Any]:
    """What an effect removes when it is added and beside all others, of unseen logs and of all."""
    both = (worth, worth and worth.beside_others)
    return [share for w in both if w for share in (w, w.everywhere) if share]


def worth_is(text: str, worth: Any) -> bool:
    values = (worth.share, worth.low, worth.high)
    parts = re.findall(SHARE, text)
    return all(
        part == "?" if not np.isfinite(value) else is_said(part.removesuffix(" %"), 100 * value)
        for part, value in zip(parts, values, strict=True)
    )


def in_words(name: str) -> str:
    return name.replace("_", " ").replace("deadband", "dead band").replace("coulomb", "Coulomb")


def error_of(comparison: Any, channel: str) -> tuple[float, float]:
    """RMSE and NRMSE of a channel, from the traces of a comparison."""
    traces = [r.channels[channel] for r in comparison.runs if channel in r.channels]
    measured = np.concatenate([t.measured for t in traces])
    difference = np.concatenate([t.measured - t.modelled for t in traces])
    if channel == "heading":
        difference = (difference + np.pi) % (2 * np.pi) - np.pi
    rmse = float(np.sqrt(np.nanmean(difference**2)))
    spread = np.nanstd(np.unwrap(measured[np.isfinite(measured)]) if channel == "heading"
                       else measured)  # fmt: skip
    return rmse, rmse / float(spread)


def last_fit(diag: Any) -> Any:
    """The fit whose numbers are copied."""
    return diag.laws[-1].reported if diag.laws else diag.fit


def is_provisional(diag: Any) -> bool:
    """Whether the fit that is copied did not end, or errs no less than constants would."""
    fit = last_fit(diag)
    learned = (fit.holdout or fit.train).channels
    is_of_law = diag.laws and diag.apart is None
    sizes = [learned[name].nrmse if is_of_law else error_of(diag.judged, name)[1]
             for name in diag.judged.errors.channels]  # fmt: skip
    blind = all(not size < 1.0 for size in sizes)
    return blind or fit.status.value in ("not_converged", "simulation_failed")
