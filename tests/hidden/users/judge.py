"""What a diagnosis says of a set, against the truth."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from .made import Hidden, UserSet


class Judgement(NamedTuple):
    """What was named, what is false, what was missed.

    Attributes:
        right: all that must be named is named, no false claim leads, and all that must be said is.
        named: what is hidden and was named, learned, or placed rightly, and how.
        missed: what is hidden, must be named, and was not.
        false: claims of an effect or a law that is not there, in the order of the summary.
        leading: the first of all claims, if it is false; else "".
        unsaid: patterns that the text should match.
        wrongly: patterns that it should not match, with the text that does.
        off: estimated numbers that are far from the true ones; those of the model (``within``
            of the set) make a diagnosis wrong.
    """

    right: bool
    named: dict[str, str]
    missed: tuple[str, ...]
    false: tuple[str, ...]
    leading: str
    unsaid: tuple[str, ...]
    wrongly: tuple[str, ...]
    off: tuple[str, ...]


def judge(diag: Any, made: UserSet) -> Judgement:
    """Hold a diagnosis against the truth of its set."""
    text = said(diag)
    named: dict[str, str] = {}
    false: list[str] = []
    claims: list[tuple[str, bool]] = []
    groups = [*zip(diag.added, diag.groups, strict=False)]
    groups += [*zip(diag.detectable, diag.detectable_groups, strict=False)]
    for name, group in groups:
        hidden = _hidden_by_name(made, {name, *group})
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
    astray = any(text.startswith(f"{name} ") for text in off for name in made.within)
    right = not (missed or leading or unsaid or wrongly or astray)
    return Judgement(right, named, missed, tuple(false), leading, unsaid, wrongly, off)


def said(diag: Any) -> str:
    """All that a reader is told: the summary, the notes, and the doubts of the fit."""
    doubts = [str(doubt) for doubt in getattr(diag.fit, "doubts", ())]
    return "\n".join([diag.summary, *diag.notes, *doubts])


def _hidden_by_name(made: UserSet, names: set[str]) -> Hidden | None:
    return next((h for h in made.hidden if names & h.names), None)


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
