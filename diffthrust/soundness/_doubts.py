"""Is a log sound?"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._clock import misclocked
from diffthrust.soundness._companions import unlike
from diffthrust.soundness._doubt import Doubt
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
from diffthrust.soundness._together import misplaced


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
        >>> for doubt in dft.soundness.doubts(log, dft.Thruster()):
        ...     print(doubt)
    """
    logs = (logs,) if isinstance(logs, Log) else tuple(logs)
    found: list[Found] = []
    places, records, tied = [], [], []
    timeless = model is not None and not model.states
    for place, log in enumerate(logs):
        if timeless:  # a table of readings, in any order
            found += [(place, doubt) for doubt in missized(log, None)]
            continue
        seen, r = [*misclocked(log, model), *jumping(log)], record(log)
        coded = [doubt.channel for doubt in seen if doubt.kind == "sentinel"]
        seen += [doubt for doubt in repeating(log) if doubt.channel not in coded]
        seen += missized(log, r)
        # codes among the values, or another clock, would speak of everything else
        if r is not None and not coded and all(doubt.kind != "time_base" for doubt in seen):
            places.append(place)
            records.append(r)
            tied.append(ties(r))
            held = {d.channel for d in seen if d.kind in ("stuck", "saturated")}
            seen += _of_ties(r, tied[-1], held)
            if model is not None and model.name == "thruster":
                seen += misloaded(stretch(log))
        found += [(place, doubt) for doubt in seen]
    clocks = [*misrated([logs[place].step for place in places], records, tied)]
    astray = {places[i] for i, _ in clocks}
    astray |= {place for place, doubt in found if doubt.kind in ("sign", "exchanged")}
    beside = [row for row in unlike(records, tied) if places[row[0]] not in astray]
    found += [(places[i], doubt) for i, doubt in (*clocks, *beside)]
    return merged(found, [log.name for log in logs])


def _of_ties(r: Record, found: Sequence[Tie], held: Collection[str]) -> Iterator[Doubt]:
    """Doubts on what must hang together; where two channels are exchanged, on that alone.

    A channel that is held or cut off says nothing of the law between channels, nor of their clocks.
    """
    shape = () if {"speed", "thrust"} & set(held) else tuple(misshaped(r))
    yield from shape
    if shape:
        return
    free = [tie for tie in found if not {tie.channel, *tie.others} & set(held)]
    late = tuple(lagging(r, free))
    yield from late
    if not late:  # a track turned by a late heading goes anywhere
        yield from misplaced(r, found)
