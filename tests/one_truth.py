"""What contradicts itself in a diagnosis: between its fields, and between them and its page."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import diffthrust as dft


def contradictions(diag: dft.diagnosis.Diagnosis) -> list[str]:
    """What it is, in words; nothing where the diagnosis tells one truth."""
    return [*_of_names(diag), *_of_verdict(diag), *_of_words(diag)]


def _of_names(diag: dft.diagnosis.Diagnosis) -> Iterator[str]:
    told = {
        "added": diag.added, "detectable": diag.detectable, "possible": diag.possible,
        "untestable": diag.untestable, "silent": diag.silent,
    }  # fmt: skip
    for (one, these), (other, those) in combinations(told.items(), 2):
        if both := {*these} & {*those}:
            yield f"{both} {one} and {other}"
    if both := {*diag.refused} & {*diag.added, *diag.detectable}:
        yield f"{both} refused and added"
    if lost := {*diag.worth} - {*diag.added, *diag.detectable}:
        yield f"{lost} of worth, and not in the model"
    own = tuple(effect.name for effect in diag.fit.model.effects)
    if own != (*(effect.name for effect in diag.model.effects), *diag.added):
        yield f"added {diag.added}, and the last model has {own}"
    if [name in group for name, group in zip(diag.added, diag.groups, strict=True)].count(False):
        yield "an added effect is not of its own group"


def _of_verdict(diag: dft.diagnosis.Diagnosis) -> Iterator[str]:
    open_ends = diag.remaining is not None or bool(diag.judged.hints) or bool(diag.repeating)
    if (diag.verdict == "unexplained") != open_ends:
        yield f"verdict {diag.verdict}, and something remains: {open_ends}"
    if (diag.verdict == "effects_found") != (bool(diag.added or diag.held) and not open_ends):
        yield f"verdict {diag.verdict}, and added: {diag.added}, held: {diag.held}"
    if diag.verdict == "adequate" and diag.far:
        yield f"adequate, and whole runs are far off: {diag.far}"
    if diag.verdict == "undecided" and not diag.far:
        yield "undecided, and whole runs are good"


def _of_words(diag: dft.diagnosis.Diagnosis) -> Iterator[str]:
    text = " ".join(diag.report().split())
    nothing = "What remains cannot be told from noise" in text
    if nothing and (diag.remaining is not None or diag.far):
        yield "nothing remains, and something does"
    if "no signal of these logs surely explains" in text and diag.repeating:
        yield "no signal explains the rest, and a flexible model does"
    if " is adequate: " in text and diag.verdict != "adequate":
        yield "adequate in words alone"
    last = diag.headroom[1].summary if diag.headroom else ""
    if diag.remaining is not None and "does not repeat" in last and "structure remains" not in text:
        yield "what is left does not repeat, and structure remains"
    for name in diag.untestable:
        if f"'{name}'" in text.partition("To copy into a spec file")[2]:
            yield f"{name} is not testable, and to be copied"
