"""Channels that do not hang together, and the single mistake that explains it.

A tie is broken where it can be so by no noise: the two oppose each other, or what must be equal is
several times as large. Every single mistake is undone in turn; one is named if it mends a broken
tie, and breaks none. So a log that random forces shake, or that lacks physics, is not doubted: no
change of a sign or a unit would mend it.

Of three logs and more, one may be unlike the others by the ratios of channels that they share.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from diffthrust._support.words import number
from diffthrust.soundness._doubt import (
    STEPS,
    UNITS,
    Doubt,
    Reading,
    clocks,
    exchanges,
    rescaled,
    sign_line,
    signs,
    unit_factors,
    unit_line,
)
from diffthrust.soundness._record import (
    DRIVE,
    FIRM,
    GEOMETRY,
    LOOSE,
    OPPOSED,
    PHYSICS,
    Record,
    Tie,
    ties,
)

_OFF = 1.4
"""Ratio from which on equal quantities are not taken to be so; measured ones were 0.64 to 1.06."""
_RIGHT = 1.15
"""Ratio within which a mend must bring them."""


def misplaced(r: Record, tied: Sequence[Tie]) -> Iterator[Doubt]:
    """Doubts on signs, exchanged channels and units, from the ties of one log."""
    broken = [tie for tie in tied if _is_broken(tie)]
    if not broken:
        return
    concerned = {channel for tie in broken for channel in tie.powers}
    rated = []
    # a ratio that several equal quantities share, or a step that no log has: the clock's
    shared = [tie.gain for tie in tied if tie.equal and tie.together > FIRM]
    similar = len(shared) > 1 and max(shared) < _RIGHT * min(shared)
    odd = not STEPS[0] <= r.step <= STEPS[1]
    timed = [*clocks(r, 1 / float(np.median(shared)))] if shared and (similar or odd) else []
    for kind, reading in (*timed, *signs(r), *exchanges(r), *rescaled(r)):
        if not concerned & set(reading.sources):
            continue
        after = {tie.key: tie for tie in ties(r.under(reading.sources))}
        mended = [tie for tie in broken if _holds(after.get(tie.key))]
        if kind == "unit" and all(tie.kind == DRIVE for tie in mended):
            continue  # a drive tells the direction only
        if mended and not any(not _is_broken(t) and _worse(t, after.get(t.key)) for t in tied):
            quality = sum(after[tie.key].together for tie in tied if tie.key in after)
            rated.append((len(mended), quality, kind, reading, mended, after))
    if not rated:
        return
    most = max(count for count, *_ in rated)
    best = [row for row in rated if row[0] == most]
    best = [row for row in best if row[1] > max(quality for _, quality, *_ in best) - 0.1]
    _, _, kind, reading, mended, after = best[0]
    evidence = f"{'; '.join(_improvement(tie, after[tie.key]) for tie in mended[:2])}."
    line = reading.line
    rivals = [(row[2], row[3]) for row in best[1:]]
    if rivals:
        named = [_named(*rival) for rival in rivals[:2]]
        evidence += f" The same would follow from {' or '.join(named)}."
        line += f" Or: {rivals[0][1].line}"
    readings = (reading, *(rival for _, rival in rivals))
    yield Doubt(next(iter(reading.sources)), kind, evidence, line, readings)


def contradicts(r: Record, tied: Sequence[Tie], reading: Reading) -> bool:
    """Whether a log speaks against a reading that other logs ask for: what holds in it breaks."""
    if not {source for source, _ in reading.sources.values()} <= set(r.values):
        return True  # the time, or a channel it lacks
    after = {tie.key: tie for tie in ties(r.under(reading.sources))}
    return any(_holds(tie) and _worse(tie, after.get(tie.key)) for tie in tied)


def _improvement(tie: Tie, after: Tie) -> str:
    if tie.together > FIRM:
        return (
            f"{tie.channel} is {abs(tie.gain):.3g} times {tie.words} "
            f"(with the mend {abs(after.gain):.3g} times)"
        )
    verb = "opposes" if tie.together < 0 else "does not follow"
    turning = tie.kind == DRIVE and tie.channel == "heading"
    return (
        f"{'the rate of the heading' if turning else tie.channel} {verb} {tie.words} (correlation "
        f"{tie.together:+.2f}, with the mend {after.together:+.2f})"
    )


def _named(kind: str, reading: Reading) -> str:
    if kind == "exchanged":
        return reading.words
    return f"the {'sign' if kind == 'sign' else 'unit'} of {next(iter(reading.sources))}"


def _is_broken(tie: Tie) -> bool:
    """Whether a tie is broken in a way that no noise explains."""
    if tie.together < OPPOSED or (tie.kind == GEOMETRY and tie.together < LOOSE):
        return True
    return tie.equal and tie.together > FIRM and not 1 / _OFF < tie.gain < _OFF


def _holds(tie: Tie | None) -> bool:
    if tie is None:
        return False
    if tie.kind == DRIVE:
        return tie.together > -OPPOSED
    return tie.together > FIRM and (not tie.equal or 1 / _RIGHT < tie.gain < _RIGHT)


def _worse(baseline: Tie, tie: Tie | None) -> bool:
    """Whether a tie that held is broken, or no longer says what it said."""
    if tie is None or _is_broken(tie) or tie.together < baseline.together - 0.2:
        return True
    off = abs(np.log(abs(tie.gain))) - abs(np.log(abs(baseline.gain)))
    return baseline.equal and off > 0.1


_ODD = {DRIVE: 7.0, PHYSICS: 1.8}
"""Ratio of a log's gain to that of its companions from which on it is odd. What follows a command
by a lag has a gain that depends on how it was driven, the thrust of a speed has not. Of boats it
depends too much (by a factor of up to 15 between runs of one): their drives are not compared."""
_SPREAD = 4.0
"""And this many times as far from their middle (as a logarithm) as the farthest of them."""
_KNOWN = 0.15
"""How near to a known factor (as a logarithm) a ratio must come to be taken for it."""
_SHIFT = 0.4
"""Offset of a thrust sensor, as a share of its range, by which a log is odd; tares drift by 0.1."""

_Key = tuple[str, str]


def unlike(
    records: Mapping[int, Record], tied: Mapping[int, Sequence[Tie]]
) -> Iterator[tuple[int, Doubt]]:
    """Doubts on single logs of three and more, by ratios of channels that they share.

    Logs are by place, and each doubt comes with that of its log.
    """
    if len(records) < 3:
        return
    firm = {i: [tie for tie in of if abs(tie.together) > FIRM] for i, of in tied.items()}
    gains = {
        i: {tie.key: tie for tie in of if tie.kind != DRIVE or tie.others == ("command",)}
        for i, of in firm.items()
    }
    for i, r in records.items():
        beside: dict[_Key, float] = {}
        odd = False
        for key, tie in gains[i].items():
            peers = [g[key].gain for j, g in gains.items() if j != i and key in g]
            if len(peers) < 2:
                continue
            if all(np.sign(g) != np.sign(tie.gain) for g in peers):
                if tie.kind != DRIVE:  # its own log shows whether a drive is opposed
                    evidence = (
                        f"{tie.channel} goes the other way with {tie.words} (correlation "
                        f"{tie.together:+.2f}) than in every other log."
                    )
                    line = sign_line(tie.channel, r.scales.get(tie.channel, 1.0))
                    mend = f"{line} Or of {' or '.join(tie.others)}."
                    yield i, Doubt(tie.channel, "sign", evidence, mend)
                continue
            sizes = np.log(np.abs(peers))
            middle = float(np.median(sizes))
            usual = float(np.abs(sizes - middle).max())
            beside[key] = off = float(np.log(abs(tie.gain))) - middle
            odd |= abs(off) > max(np.log(_ODD.get(tie.kind, 1.8)), _SPREAD * usual)
        if odd:
            yield i, _scaled(gains[i], beside)
        else:
            yield from ((i, doubt) for doubt in _shifted(gains, i))


def _scaled(gains: Mapping[_Key, Tie], beside: Mapping[_Key, float]) -> Doubt:
    """Which channel's scale explains all ratios best, and by which factor it is too large."""
    rated = []
    worst = max(beside, key=lambda key: abs(beside[key]))
    tie, off = gains[worst], beside[worst]
    for channel, power in tie.powers.items():
        if not power:
            continue
        size = off / power
        misfit = sum(abs(b - gains[k].powers.get(channel, 0) * size) for k, b in beside.items())
        # where nothing tells them apart, a known factor, and the channel before what it follows
        misfit -= 0.3 if _known(channel, size) else 0.0
        rated.append((misfit, channel != tie.channel, channel, size))
    _, _, channel, size = min(rated)
    evidence = (
        f"{tie.channel} is {number(float(np.exp(abs(off))), 3)} times as "
        f"{'large' if off > 0 else 'small'} beside {tie.words} as in the other logs"
    )
    if unit := _known(channel, size):
        kind = "time_base" if channel == "time" else "unit"
        evidence += f", as if {channel} were in {unit.partition(',')[0]}."
        return Doubt(channel, kind, evidence, unit_line(channel, unit))
    mend = (
        f"leave this log out, or look what was different about {channel} (scale="
        f"{number(float(np.exp(-size)), 3)} in its own read_log would make it like the others)."
    )
    return Doubt(channel, "odd_log", f"{evidence}.", mend)


def _known(channel: str, size: float) -> str:
    """The unit in which numbers are larger by this logarithm than in the unit written."""
    units = unit_factors(channel).items()
    return next((unit for unit, scale in units if abs(size + np.log(scale)) < _KNOWN), "")


def _shifted(gains: Mapping[int, Mapping[_Key, Tie]], i: int) -> Iterator[Doubt]:
    """A sensor whose zero is off in one log only."""
    for key, tie in gains[i].items():
        if tie.kind != PHYSICS:
            continue
        zeros = {
            j: float(np.mean(g[key].seen) - g[key].gain * np.mean(g[key].due))
            for j, g in gains.items()
            if key in g
        }
        peers = [zero for j, zero in zeros.items() if j != i]
        if len(peers) < 2:
            continue
        middle, span = float(np.median(peers)), float(np.ptp(tie.seen))
        usual = max(abs(zero - middle) for zero in peers)
        off = zeros[i] - middle
        if abs(off) > max(_SHIFT * span, _SPREAD * usual):
            evidence = (
                f"{tie.channel} stands {number(off, 3)} beside where it stands in the other logs, "
                f"{number(abs(off) / span, 2)} times its range: its zero is off."
            )
            mend = (
                f"take {number(off, 3)} {UNITS[tie.channel]} off {tie.channel} by Column(..., "
                "offset=...) in its own read_log, or tare the sensor."
            )
            yield Doubt(tie.channel, "odd_log", evidence, mend)
