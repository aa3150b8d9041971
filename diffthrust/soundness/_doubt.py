"""A doubt about a channel of a log."""

from __future__ import annotations

from dataclasses import dataclass

DOUBT_KINDS = (
    "sign",
    "exchanged",
    "unit",
    "time_base",
    "lag",
    "stuck",
    "saturated",
    "sentinel",
    "outliers",
    "gap",
    "odd_log",
    "silent",
)
"""What may be wrong with a channel, the graver mistakes first."""


@dataclass(frozen=True)
class Doubt:
    """Something in a log that is probably not what its name, unit or clock says.

    Args:
        channel: the channel that is doubted, or ``"time"``.
        kind: one of ``sign``, ``exchanged``, ``unit``, ``time_base``, ``lag``, ``stuck``,
            ``saturated``, ``sentinel``, ``outliers``, ``gap``, ``odd_log``, ``silent``.
        evidence: what was seen, with its figures; names the log.
        mend: a line to copy, or what to look at.

    Example:
        >>> reversed_sign = dft.Log(
        ...     log.time, log.inputs, {**log.measured, "thrust": -log.measured["thrust"]}
        ... )
        >>> doubt = dft.soundness.doubts(reversed_sign, dft.Thruster())[0]
        >>> doubt.channel, doubt.kind, sorted(doubt.to_json())
        ('thrust', 'sign', ['channel', 'evidence', 'kind', 'mend'])
    """

    channel: str
    kind: str
    evidence: str
    mend: str

    def __str__(self) -> str:
        return f"{self.channel} ({self.kind}): {self.evidence} Mend: {self.mend}"

    def to_json(self) -> dict[str, str]:
        """Plain data."""
        return dict(vars(self))
