"""What is told of what was given: logs that disagree, constants that are held elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diffthrust._support.tables import with_error
from diffthrust._support.words import percent, spelt

if TYPE_CHECKING:
    from diffthrust.diagnosis._findings import Findings, OddLog

_MUCH = 1 / 3
"""An odd log that carries more than this of a channel's squared error belongs to the summary."""


def much_words(diag: Findings) -> list[str]:
    """The odd logs that carry so much of the error that the outcome rests on them."""
    return [_odd_words(odd) for odd in diag.odd_logs if odd.share > _MUCH]


def odd_words(diag: Findings) -> list[str]:
    """Every log that is unlike the others, and how.

    Example:
        >>> odd_words(diag)
        ['Log 14V is unlike the others: its thrust error is 3.4 times that of the median log. ...']
    """
    return [_odd_words(odd) for odd in diag.odd_logs]


def held_words(diag: Findings) -> list[str]:
    """Every constant against which the logs speak.

    Example:
        >>> held_words(diag)
        ["lever_arm is held at 0.5 m; these logs want 0.399 ± 0.002 m. Measure it anew, or ..."]
    """
    return [
        f"{name} is held at {_amount(f'{held.value:.4g}', held.unit)}; these logs want "
        f"{_amount(' ± '.join(with_error(held.wanted, held.std_error)), held.unit)}. Measure it "
        f"anew, or free it: model.free('{name}')."
        for name, held in diag.held.items()
    ]


def _amount(size: str, unit: str) -> str:
    return f"{size} {unit}".rstrip()


def _odd_words(odd: OddLog) -> str:
    return (
        f"Log {odd.log} is unlike the others: {odd.evidence}. It carries {percent(odd.share)} of "
        f"the squared {spelt(odd.channel)} error of all logs. Look at how it was recorded."
    )
