"""A log that is unlike the others of the same call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diffthrust._support.words import number
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._mends import UNITS, sign_line, unit_factors, unit_line
from diffthrust.soundness._record import Record
from diffthrust.soundness._ties import DRIVE, PHYSICS, Tie

_FIRM = 0.8
"""Correlation from which on the ratio of two channels means something."""
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


def unlike(records: Sequence[Record], tied: Sequence[Sequence[Tie]]) -> Iterator[tuple[int, Doubt]]:
    """Doubts on single logs of three and more, by ratios of channels that they share.

    Each comes with the place of its log.
    """
    if len(records) < 3:
        return
    gains = [{(t.channel, t.words): t for t in each if _comparable(t)} for each in tied]
    for i, r in enumerate(records):
        beside: dict[tuple[str, str], float] = {}
        odd = False
        for key, tie in gains[i].items():
            peers = [g[key].gain for j, g in enumerate(gains) if j != i and key in g]
            if len(peers) < 2:
                continue
            if all(np.sign(g) != np.sign(tie.gain) for g in peers):
                if tie.kind == DRIVE:  # its own log shows whether it is opposed
                    continue
                yield i, _turned(r, tie)
                continue
            sizes = np.log(np.abs(peers))
            middle = float(np.median(sizes))
            off = float(np.log(abs(tie.gain))) - middle
            usual = float(np.abs(sizes - middle).max())
            beside[key] = off
            odd |= abs(off) > max(np.log(_ODD.get(tie.kind, 1.8)), _SPREAD * usual)
        if odd:
            yield i, _scaled(r, gains[i], beside)
        else:
            yield from ((i, doubt) for doubt in _shifted(r, gains, i))


def _comparable(tie: Tie) -> bool:
    return abs(tie.together) > _FIRM and (tie.kind != DRIVE or tie.others == ("command",))


def _turned(r: Record, tie: Tie) -> Doubt:
    line = sign_line(tie.channel, r.scales.get(tie.channel, 1.0))
    return Doubt(
        tie.channel,
        "sign",
        f"{r.name}: {tie.channel} goes the other way with {tie.words} (correlation "
        f"{tie.together:+.2f}) than in every other log.",
        f"{line} Or of {' or '.join(tie.others)}.",
    )


def _scaled(
    r: Record, gains: dict[tuple[str, str], Tie], beside: dict[tuple[str, str], float]
) -> Doubt:
    """Which channel's scale explains all ratios best, and by which factor it is too large."""
    rated = []
    worst = max(beside, key=lambda key: abs(beside[key]))
    for channel, power in gains[worst].powers.items():
        size = beside[worst] / power
        misfit = sum(abs(off - gains[k].powers.get(channel, 0) * size) for k, off in beside.items())
        # where nothing tells them apart, a known factor, and the channel before what it follows
        misfit -= 0.3 if _known(channel, size) else 0.0
        rated.append((misfit, channel != gains[worst].channel, channel, size))
    _, _, channel, size = min(rated)
    named = _known(channel, size)
    tie, off = gains[worst], beside[worst]
    evidence = (
        f"{r.name}: {tie.channel} is {number(float(np.exp(abs(off))), 3)} times as "
        f"{'large' if off > 0 else 'small'} beside {tie.words} as in the other logs"
    )
    if named:
        return Doubt(
            channel,
            "time_base" if channel == "time" else "unit",
            f"{evidence}, as if {channel} were in {named.partition(',')[0]}.",
            unit_line(channel, named),
        )
    return Doubt(
        channel,
        "odd_log",
        f"{evidence}.",
        f"leave this log out, or look what was different about {channel} (scale="
        f"{number(float(np.exp(-size)), 3)} in its own read_log would make it like the others).",
    )


def _known(channel: str, size: float) -> str:
    """The unit in which numbers are larger by this logarithm than in the unit written."""
    units = unit_factors(channel).items()
    return next((unit for unit, scale in units if abs(size + np.log(scale)) < _KNOWN), "")


def _shifted(r: Record, gains: Sequence[dict[tuple[str, str], Tie]], i: int) -> Iterator[Doubt]:
    """A sensor whose zero is off in one log only."""
    for key, tie in gains[i].items():
        if tie.kind != PHYSICS:
            continue
        zeros = {
            j: float(np.mean(g[key].seen) - g[key].gain * np.mean(g[key].due))
            for j, g in enumerate(gains)
            if key in g
        }
        peers = [zero for j, zero in zeros.items() if j != i]
        if len(peers) < 2:
            continue
        middle, span = float(np.median(peers)), float(np.ptp(tie.seen))
        usual = max(abs(zero - middle) for zero in peers)
        off = zeros[i] - middle
        if abs(off) > max(_SHIFT * span, _SPREAD * usual):
            yield Doubt(
                tie.channel,
                "odd_log",
                f"{r.name}: {tie.channel} stands {number(off, 3)} beside where it stands in the "
                f"other logs, {number(abs(off) / span, 2)} times its range: its zero is off.",
                f"take {number(off, 3)} {UNITS[tie.channel]} off {tie.channel} by Column(..., "
                "offset=...) in its own read_log, or tare the sensor.",
            )
