"""Is a log sound?"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.words import joined
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._companions import unlike
from diffthrust.soundness._doubt import DOUBT_KINDS, Doubt, Reading
from diffthrust.soundness._frames import misframed
from diffthrust.soundness._record import Record, record, stretch
from diffthrust.soundness._repeats import repeating
from diffthrust.soundness._sizes import missized
from diffthrust.soundness._spikes import jumping
from diffthrust.soundness._thruster import misloaded, misshaped
from diffthrust.soundness._ties import Tie, ties
from diffthrust.soundness._times import lagging, misclocked, misrated
from diffthrust.soundness._together import contradicts, misplaced


@np.errstate(over="ignore", invalid="ignore")  # a wrong unit may overflow, and is reported
def doubts(logs: Log | Sequence[Log], model: Model | None = None) -> tuple[Doubt, ...]:
    """Say what in logs is probably not what its name, unit or clock says.

    Looks at the values of each channel alone, at the time, at channels that must hang together
    (a heading turns at the yaw rate, thrust goes with the square of the speed, speeds follow
    their drive), and at logs that are unlike their companions. Nothing is fitted.

    Args:
        logs: one or several logs of one system.
        model: what is to be fitted to them; gives the time constants that a log must show.

    Returns:
        A `Doubt` for each finding, the graver kinds first; empty where nothing is odd. A doubt
        is no proof: a real effect may look like a mistake.

    Example:
        >>> dft.soundness.doubts(log, dft.Thruster())
        ()
    """
    logs = (logs,) if isinstance(logs, Log) else tuple(logs)
    findings: list[Found] = []
    places: list[int] = []
    records: list[Record] = []
    timeless = model is not None and not model.states
    for place, log in enumerate(logs):
        if timeless:  # a table of readings, in any order
            findings += [(place, doubt) for doubt in missized(log, None)]
            continue
        suspected, r = [*misclocked(log, model), *jumping(log)], record(log)
        coded = [doubt.channel for doubt in suspected if doubt.kind == "sentinel"]
        suspected += [doubt for doubt in repeating(log) if doubt.channel not in coded]
        suspected += [*missized(log, r), *misframed(log, model)]
        findings += [(place, doubt) for doubt in suspected]
        if r is not None and not coded:  # codes among the values would speak of everything else
            places.append(place)
            records.append(r)
    tied = [ties(r) for r in records]
    # first, as companions tell a clock's factor better than its own step does
    clocks = misrated([logs[place].step for place in places], records, tied)
    findings = [*((places[i], doubt) for i, doubt in clocks), *findings]
    for place, r, each in zip(places, records, tied, strict=True):
        suspected = [doubt for at, doubt in findings if at == place]
        if any(doubt.kind == "time_base" for doubt in suspected):
            continue  # and so would another clock
        stuck = [doubt for doubt in suspected if doubt.kind == "stuck"]
        held = {channel for doubt in stuck for channel in (doubt.channel, *doubt.also)}
        findings += [(place, doubt) for doubt in _of_ties(r, each, {*logs[place].railed}, held)]
        if model is not None and model.quadratic_load is not None:
            # the load shows by the law of the shaft that `misloaded` takes for granted
            findings += [(place, doubt) for doubt in misloaded(stretch(logs[place]))]
    kinds = ("sign", "exchanged", "time_base")
    astray = {place for place, doubt in findings if doubt.kind in kinds}
    for i, doubt in unlike(records, tied):
        # beside logs with a turned sign, it is the sound one that differs
        if places[i] not in astray and not (astray and doubt.kind == "sign"):
            findings.append((places[i], doubt))

    def against(place: int, reading: Reading) -> bool:
        at = places.index(place) if place in places else -1
        return at < 0 or contradicts(records[at], tied[at], reading)

    return merged(findings, [log.name for log in logs], against)


def _of_ties(r: Record, tied: Sequence[Tie], cut: set[str], held: set[str]) -> Iterator[Doubt]:
    """Doubts on what must hang together; where two channels are exchanged, on that alone.

    What is cut off says nothing of the law between channels, and what is held nothing of clocks.
    """
    shape = () if {"speed", "thrust"} & cut else tuple(misshaped(r))
    yield from shape
    if shape:
        return
    free = [tie for tie in tied if not {tie.channel, *tie.others} & held]
    late = tuple(lagging(r, free))
    yield from late
    if not late:  # a track turned by a late heading goes anywhere
        yield from misplaced(r, tied)


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
                evidence = f"{first.evidence} The other {calm} not contradict it."
                first = replace(first, evidence=evidence)
        doubts.append(first)
    return tuple(sorted(doubts, key=lambda doubt: DOUBT_KINDS.index(doubt.kind)))


def _alone(mend: str, names: Sequence[str]) -> str:
    """The mend where other logs of the call must stay as they are."""
    whose = "its" if len(names) == 1 else "their"
    return (
        f"for {joined(list(names))} alone, in {whose} own read_log (a key in a spec file changes "
        f"all logs): {_SPEC_KEY.sub('', mend)} Or correct the file{'s' if len(names) > 1 else ''}."
    )
