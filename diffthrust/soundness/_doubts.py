"""Is a log sound?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._clock import misclocked
from diffthrust.soundness._companions import unlike
from diffthrust.soundness._doubt import DOUBT_KINDS, Doubt
from diffthrust.soundness._lag import lagging
from diffthrust.soundness._load import misloaded
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
    found: list[Doubt] = []
    records, tied = [], []
    timeless = model is not None and not model.states
    for log in logs:
        if timeless:  # a table of readings, in any order
            found += missized(log, None)
            continue
        seen, r = [*misclocked(log, model), *jumping(log)], record(log)
        coded = [doubt.channel for doubt in seen if doubt.kind == "sentinel"]
        seen += [doubt for doubt in repeating(log) if doubt.channel not in coded]
        seen += missized(log, r)
        # codes among the values, or another clock, would speak of everything else
        if r is not None and not coded and all(doubt.kind != "time_base" for doubt in seen):
            records.append(r)
            tied.append(ties(r))
            seen += _of_ties(r, tied[-1])
            if model is not None and model.name == "thruster":
                seen += misloaded(stretch(log))
        found += seen
    return _merged([*found, *unlike(records, tied)])


def _of_ties(r: Record, found: Sequence[Tie]) -> Iterator[Doubt]:
    """Doubts on what must hang together; where two channels are exchanged, on that alone."""
    shape = tuple(misshaped(r))
    yield from shape
    if shape:
        return
    late = tuple(lagging(r, found))
    yield from late
    if not late:  # a track turned by a late heading goes anywhere
        yield from misplaced(r, found)


def _merged(found: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """One doubt for each channel and kind; in how many more logs it was found is told."""
    by: dict[tuple[str, str], list[Doubt]] = {}
    for doubt in found:
        by.setdefault((doubt.channel, doubt.kind), []).append(doubt)
    merged = []
    for same in by.values():
        more = f" And so in {len(same) - 1} more." if len(same) > 1 else ""
        merged.append(replace(same[0], evidence=same[0].evidence + more))
    return tuple(sorted(merged, key=lambda doubt: DOUBT_KINDS.index(doubt.kind)))
