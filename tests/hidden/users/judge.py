"""What a diagnosis says of a set, against the truth."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any, NamedTuple

from .made import Hidden, UserSet

MOST_ALIKE = 3
"""Effects that are said to look alike: a longer list that holds the true one names nothing."""
FAR_OFF = 0.5
"""Error of an estimate to the true number's size (of a vector's larger part), beyond which an
effect that is there by name is taken for something else: a dead band three times too wide."""


class Judgement(NamedTuple):
    """What was named, what is false, what was missed.

    Attributes:
        right: all that must be named is named, no false claim leads, all that must be said is, and
            the error over the unseen logs comes close enough to that of the true structure.
        named: what is hidden and was named, learned, or placed rightly, and how.
        missed: what is hidden, must be named, and was not.
        false: claims of an effect or a law that is not there, in the order of the summary.
        leading: the first of all claims, if it is false; else "".
        unsaid: patterns that the text should match.
        wrongly: patterns that it should not match, with the text that does.
        off: estimated numbers that are far from the true ones; those of the model (``within``
            of the set) make a diagnosis wrong.
        ratio: the unseen error with all that was found, to that of the true structure, fitted.
        astray: this ratio in words, where the set asks for less (``close`` of the set); else "".
    """

    right: bool
    named: dict[str, str]
    missed: tuple[str, ...]
    false: tuple[str, ...]
    leading: str
    unsaid: tuple[str, ...]
    wrongly: tuple[str, ...]
    off: tuple[str, ...]
    ratio: float
    astray: str


def judge(diag: Any, made: UserSet, true_error: float) -> Judgement:
    """Hold a diagnosis against the truth of its set.

    Args:
        diag: the diagnosis.
        made: the set.
        true_error: NRMSE of the unseen logs under the true structure, fitted by a plain least
            squares: a law at the right port need not be the right law.
    """
    text = said(diag)
    named: dict[str, str] = {}
    false: list[str] = []
    claims: list[tuple[str, bool]] = []
    groups = [*zip(diag.added, diag.groups, strict=False)]
    groups += [*zip(diag.detectable, diag.detectable_groups, strict=False)]
    for name, group in groups:
        hidden = _hidden_by_name(made, name, group)
        if hidden is not None and _far_off(diag, hidden, name):
            hidden = None
        claims.append((name, hidden is not None))
        if hidden is not None:
            named.setdefault(hidden.what, f"named {name}")
    for law in diag.laws:
        signals = " and ".join(law.signals)
        hidden = _hidden_by_law(made, law.curve.port, signals)
        claims.append((f"law at {law.curve.port} of {signals}", hidden is not None))
        if hidden is not None:
            form = law.form.name if law.form else "curve"
            named.setdefault(hidden.what, f"learned at {law.curve.port} of {signals} ({form})")
    if diag.remaining is not None:
        left = diag.remaining
        hidden = _hidden_by_law(made, left.port, left.depends_on)
        claims.append((f"remains at {left.port} by {left.depends_on}", hidden is not None))
        if hidden is not None:
            named.setdefault(hidden.what, f"remains at {left.port} by {left.depends_on}")
    false = [claim for claim, true in claims if not true]
    leading = claims[0][0] if claims and not claims[0][1] else ""
    missed = tuple(h.what for h in made.hidden if h.required and h.what not in named)
    unsaid = tuple(p for p in made.says if not re.search(p, text, re.IGNORECASE))
    wrongly = tuple(found[0] for p in made.never if (found := re.search(p, text, re.IGNORECASE)))
    off = tuple(_off(diag, made))
    wrong_model = any(text.startswith(f"{name} ") for text in off for name in made.within)
    ratio = last_error(diag).nrmse / true_error
    too_far = made.close is not None and ratio > made.close
    astray = f"{ratio:.2f} times the error of the true structure" if too_far else ""
    right = not (missed or leading or unsaid or wrongly or wrong_model or astray)
    named_false = (tuple(false), leading)
    return Judgement(right, named, missed, *named_false, unsaid, wrongly, off, ratio, astray)


def last_error(diag: Any) -> Any:
    """Errors of the unseen logs with all effects that were added and the laws that were learned."""
    learned = diag.laws[-1].reported.holdout if diag.laws else None
    return learned or diag.stages[-1].holdout


def said(diag: Any) -> str:
    """All that a reader is told: the summary, the notes, and the doubts of the fit."""
    doubts = [str(doubt) for doubt in getattr(diag.fit, "doubts", ())]
    return "\n".join([diag.details, *diag.notes, *doubts])


def _hidden_by_name(made: UserSet, name: str, group: Collection[str]) -> Hidden | None:
    """What is hidden and has this name, or one of the few that these logs cannot tell from it."""
    names = {name, *group} if len({name, *group}) <= MOST_ALIKE else {name}
    return next((h for h in made.hidden if names & h.names), None)


def _far_off(diag: Any, hidden: Hidden, effect: str) -> bool:
    """Whether the effect is there with numbers that have nothing to do with the true ones."""
    estimates = diag.fit.parameters
    pairs = [(estimates.get(f"{effect}.{n}"), true) for n, true in hidden.parameters.items()]
    size = max((abs(true) for true in hidden.parameters.values()), default=0.0)
    return any(e is not None and abs(e.value - true) > FAR_OFF * size for e, true in pairs)


def _hidden_by_law(made: UserSet, port: str, signal: str) -> Hidden | None:
    for hidden in made.hidden:
        if port in hidden.ports and any(re.search(p, signal) for p in hidden.signals):
            return hidden
    return None


def _off(diag: Any, made: UserSet) -> list[str]:
    """Numbers beyond three standard errors, and beyond a tenth, of the true ones."""
    estimates = diag.fit.parameters
    out = []
    true = {n: (value, share) for n, (value, share) in made.within.items()}
    for hidden in made.hidden:
        for effect in hidden.names:
            for n, value in hidden.parameters.items():
                true[f"{effect}.{n}"] = (value, 0.1)
    for name, (value, share) in true.items():
        estimate = estimates.get(name)
        if estimate is None:
            continue
        spread = max(3.0 * (estimate.std_error or 0.0), share * abs(value))
        if abs(estimate.value - value) > spread:
            out.append(
                f"{name} {estimate.value:.4g} +- {estimate.std_error or 0.0:.2g}, true {value:.4g}"
            )
    return out
