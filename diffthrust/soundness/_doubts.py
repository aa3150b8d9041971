"""Is a log sound?"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.words import joined
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._doubt import DOUBT_KINDS, Doubt, Reading
from diffthrust.soundness._frames import misframed
from diffthrust.soundness._record import Record, Tie, record, stretch, ties
from diffthrust.soundness._repeats import repeating
from diffthrust.soundness._sizes import misloaded, misshaped, missized
from diffthrust.soundness._spikes import jumping
from diffthrust.soundness._times import lagging, misclocked, misrated
from diffthrust.soundness._together import contradicts, misplaced, unlike


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
    names = [log.name for log in logs]
    if model is not None and not model.states:  # tables of readings, in any order
        findings = [(place, d) for place, log in enumerate(logs) for d in missized(log, None)]
        return _merged(findings, names, lambda place, reading: True)
    findings, records = _alone(logs, model)
    tied = {place: ties(r) for place, r in records.items()}
    # first, as companions tell a clock's factor better than its own step does
    steps = {place: logs[place].step for place in records}
    findings = [*misrated(steps, records, tied), *findings]
    for place, r in records.items():
        suspected = [doubt for at, doubt in findings if at == place]
        if any(doubt.kind == "time_base" for doubt in suspected):
            continue  # another clock would speak of everything else
        stuck = [doubt for doubt in suspected if doubt.kind == "stuck"]
        held = {channel for doubt in stuck for channel in (doubt.channel, *doubt.also)}
        broken = [*_of_ties(r, tied[place], {*logs[place].railed}, held)]
        if model is not None and model.quadratic_load is not None:
            # the load shows by the law of the shaft that `misloaded` takes for granted
            broken += misloaded(stretch(logs[place]))
        findings += [(place, doubt) for doubt in broken]
    kinds = ("sign", "exchanged", "time_base")
    astray = {place for place, doubt in findings if doubt.kind in kinds}
    # beside logs with a turned sign, it is the sound one that differs
    findings += [
        (place, doubt)
        for place, doubt in unlike(records, tied)
        if place not in astray and not (astray and doubt.kind == "sign")
    ]

    def against(place: int, reading: Reading) -> bool:
        return place not in records or contradicts(records[place], tied[place], reading)

    return _merged(findings, names, against)


Found = tuple[int, Doubt]
"""The place of a log in the call, and what is doubted about it."""


def _alone(logs: Sequence[Log], model: Model | None) -> tuple[list[Found], dict[int, Record]]:
    """What single channels and clocks show; and by place the records of which more can be said."""
    findings: list[Found] = []
    records: dict[int, Record] = {}
    for place, log in enumerate(logs):
        suspected, r = [*misclocked(log, model), *jumping(log)], record(log)
        coded = {doubt.channel for doubt in suspected if doubt.kind == "sentinel"}
        suspected += [doubt for doubt in repeating(log) if doubt.channel not in coded]
        suspected += [*missized(log, r), *misframed(log, model)]
        findings += [(place, doubt) for doubt in suspected]
        if r is not None and not coded:  # codes among the values would speak of everything else
            records[place] = r
    return findings, records


def _of_ties(r: Record, tied: Sequence[Tie], cut: set[str], held: set[str]) -> Iterator[Doubt]:
    """Doubts on what must hang together; where two channels are exchanged, on that alone.

    What is cut off says nothing of the law between channels, and what is held nothing of clocks.
    """
    if not {"speed", "thrust"} & cut and (shape := tuple(misshaped(r))):
        yield from shape
        return
    late = tuple(lagging(r, [tie for tie in tied if not {tie.channel, *tie.others} & held]))
    yield from late
    if not late:  # a track turned by a late heading goes anywhere
        yield from misplaced(r, tied)


_READ = ("sign", "exchanged", "unit", "time_base")
"""Kinds whose mend changes how a column is read."""
_SPEC_KEY = re.compile(r"(\[channels\.[^\]]*\] |time = ).*?, or (?=\"|Column)")
"""What speaks to a spec file in a mend; its keys hold for every log."""


def _merged(
    findings: Iterable[Found], names: Sequence[str], against: Callable[[int, Reading], bool]
) -> tuple[Doubt, ...]:
    """One doubt for each channel and kind; it names its log, and in how many more it was found.

    Logs that are too calm to show a mistake have it as well, where they were recorded alike: a boat
    that ran straight on says nothing of the sign of its yaw rate. So a mend is for some logs alone
    only if it would spoil another, ``against`` which it speaks.
    """
    by: dict[tuple[str, str], dict[int, Doubt]] = {}
    for place, doubt in findings:
        by.setdefault((doubt.channel, doubt.kind), {}).setdefault(place, doubt)
    doubts = []
    for by_log in by.values():
        place, doubt = next(iter(by_log.items()))
        evidence = f"{names[place]}: {doubt.evidence}"
        if len(by_log) > 1:
            evidence += f" And so in {len(by_log) - 1} more."
        silent = [k for k in range(len(names)) if k not in by_log]
        if silent and doubt.kind in _READ:
            if any(not doubt.readings or against(k, doubt.readings[0]) for k in silent):
                concerned = tuple(names[k] for k in sorted(by_log))
                doubt = replace(doubt, mend=_for_some(doubt.mend, concerned), logs=concerned)
            else:
                calm = "one does" if len(silent) == 1 else f"{len(silent)} do"
                evidence += f" The other {calm} not contradict it."
        doubts.append(replace(doubt, evidence=evidence))
    return tuple(sorted(doubts, key=lambda doubt: DOUBT_KINDS.index(doubt.kind)))


def _for_some(mend: str, names: Sequence[str]) -> str:
    """The mend where other logs of the call must stay as they are."""
    whose = "its" if len(names) == 1 else "their"
    return (
        f"for {joined(names)} alone, in {whose} own read_log (a key in a spec file changes "
        f"all logs): {_SPEC_KEY.sub('', mend)} Or correct the file{'s' if len(names) > 1 else ''}."
    )
