"""Is a log sound?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._clock import misclocked
from diffthrust.soundness._companions import unlike
from diffthrust.soundness._doubt import Doubt, Reading
from diffthrust.soundness._frames import misframed
from diffthrust.soundness._lag import lagging
from diffthrust.soundness._load import misloaded
from diffthrust.soundness._merged import Found, merged
from diffthrust.soundness._rates import misrated
from diffthrust.soundness._record import Record, record, stretch
from diffthrust.soundness._repeats import repeating
from diffthrust.soundness._shape import misshaped
from diffthrust.soundness._sizes import missized
from diffthrust.soundness._spikes import jumping
from diffthrust.soundness._ties import Tie, ties
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
        held = {doubt.channel for doubt in suspected if doubt.kind == "stuck"}
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
