"""Doubts of several logs as one list: what to do where not all logs show them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from diffthrust._support.words import joined
from diffthrust.soundness._doubt import DOUBT_KINDS, Doubt, Reading

Found = tuple[int, Doubt]
"""The place of a log in the call, and what is doubted about it."""
_READ = ("sign", "exchanged", "unit", "time_base")
"""Kinds whose mend changes how a column is read."""
_SPEC_KEY = re.compile(r"(\[channels\.[^\]]*\] |time = ).*?, or (?=\"|Column)")
"""What speaks to a spec file in a mend; its keys hold for every log."""


def merged(
    findings: Iterable[Found],
    names: Sequence[str],
    against: Callable[[int, Reading], bool] = lambda place, reading: True,
) -> tuple[Doubt, ...]:
    """One doubt for each channel and kind; it says in how many more logs it was found.

    Logs that are too calm to show a mistake have it as well, where they were recorded alike: a boat
    that ran straight on says nothing of the sign of its yaw rate. So a mend is for some logs alone
    only if it would spoil another.

    Args:
        findings: doubts with the place of the log in which each was found.
        names: of all logs of the call.
        against: whether the log at a place speaks against a reading.
    """
    by: dict[tuple[str, str], dict[int, Doubt]] = {}
    for place, doubt in findings:
        by.setdefault((doubt.channel, doubt.kind), {}).setdefault(place, doubt)
    doubts = []
    for of in by.values():
        first = next(iter(of.values()))
        if len(of) > 1:
            first = replace(first, evidence=f"{first.evidence} And so in {len(of) - 1} more.")
        if len(of) < len(names) and first.kind in _READ:
            silent = [place for place in range(len(names)) if place not in of]
            speaking = (
                [place for place in silent if against(place, first.readings[0])]
                if (first.readings)
                else silent
            )
            if speaking:
                alone = [names[place] for place in sorted(of)]
                first = replace(first, mend=_alone(first.mend, alone), logs=tuple(alone))
            else:
                calm = "one does" if len(silent) == 1 else f"{len(silent)} do"
                first = replace(first, evidence=f"{first.evidence} The other {calm} not show it.")
        doubts.append(first)
    return tuple(sorted(doubts, key=lambda doubt: DOUBT_KINDS.index(doubt.kind)))


def _alone(mend: str, names: Sequence[str]) -> str:
    """The mend where other logs of the call must stay as they are."""
    whose = "its" if len(names) == 1 else "their"
    return (
        f"for {joined(list(names))} alone, in {whose} own read_log (a key in a spec file changes "
        f"all logs): {_SPEC_KEY.sub('', mend)} Or correct the file{'s' if len(names) > 1 else ''}."
    )
