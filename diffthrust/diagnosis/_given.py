"""What a diagnosis finds against what was given: a log that disagrees, a constant held wrongly."""

from __future__ import annotations

from dataclasses import dataclass

_MUCH = 1 / 3
"""An odd log that carries more than this of a channel's squared error may decide all."""


@dataclass(frozen=True)
class OddLog:
    """A log that disagrees with the others.

    Args:
        log: its name.
        channel: the measured channel in which it shows most.
        evidence: a sentence that says how it differs.
        share: of the squared whole-run error of all logs that this one carries.
    """

    log: str
    channel: str
    evidence: str
    share: float = float("nan")

    @property
    def much(self) -> bool:
        """Whether that is so much that it belongs to the summary."""
        return self.share > _MUCH


@dataclass(frozen=True)
class HeldValue:
    """A parameter that is held at a value against which the logs speak.

    Args:
        value: at which it is held.
        wanted: what these logs want.
        std_error: of that.
        unit: of all three.
    """

    value: float
    wanted: float
    std_error: float
    unit: str = ""
