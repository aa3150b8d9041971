"""What undoing a doubt does to the error over whole runs, measured by a fit to the mended logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diffthrust._support.results import Brief
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.simulation._errors import Errors
from diffthrust.soundness._doubt import Doubt, Reading

EXCHANGES = {"swapped_thrusters": ("left_force", "right_force")}
"""Effects of the catalogue that stand for two channels in each other's place."""


@dataclass(frozen=True, repr=False)
class MeasuredMend(Brief):
    """The model as given, fitted to the logs as they are and to the mended ones, as thoroughly.

    Args:
        doubt: on the logs.
        reading: of the channels, that was tried.
        before: errors over whole runs of the logs as they are, unseen ones if there are any.
        after: the same of the mended logs, by the model that was fitted to mended training logs.
        worth: share of the squared error that the mend removes, each channel in units of its own
            spread.
        unseen: whether the errors are those of unseen logs.
    """

    doubt: Doubt
    reading: Reading
    before: Errors
    after: Errors
    worth: Worth
    unseen: bool

    @property
    def lowers(self) -> bool:
        """Whether the error falls clearly."""
        return self.worth.share > SETTINGS.whole_runs.mending_share

    @property
    def helps(self) -> bool:
        """Whether it does so surely."""
        return self.worth.low > 0 and self.lowers

    def to_json(self) -> dict[str, Any]:
        """The reading that was tried, and both errors, as plain data."""
        return {
            "reading": self.reading.words,
            "line": self.reading.line,
            "before": self.before.to_json(),
            "after": self.after.to_json(),
            "helps": self.helps,
        }


def mends_of(doubt: Doubt, mends: Sequence[MeasuredMend]) -> list[MeasuredMend]:
    """The mends of one doubt."""
    key = doubt.channel, doubt.kind
    return [mend for mend in mends if (mend.doubt.channel, mend.doubt.kind) == key]


def best_mends(mends: Sequence[MeasuredMend]) -> tuple[MeasuredMend, ...]:
    """The reading of each doubt with which whole runs err least, those that help most first."""
    best = {}
    for mend in mends:
        least = min(mends_of(mend.doubt, mends), key=lambda mend: mend.after.nrmse)
        best[mend.doubt.channel, mend.doubt.kind] = least
    return tuple(sorted(best.values(), key=lambda mend: -mend.worth.share))


def mends_lead(doubts: Sequence[Doubt], mends: Sequence[MeasuredMend], failing: bool) -> bool:
    """Whether logs are to be mended before anything is sought in them.

    Where a sign or an exchange of channels is doubted, and a mend helps. While the model fails it
    is enough that a mend lowers the error, or that one of the mistakes the doubt may come from has
    no fit that could be judged. On the BlueBoat as it was logged half an hour of search ended
    in thrusters that "steer with -0 % of the logged moment", and in a moment of inertia of
    0.02 kg m^2; and of a Kingfisher, whose heading turned against its thrusters in 14 runs, it
    depended on which of many optima a fit ended in whether that was told.

    ``failing``: whether the model moves opposite to channels over whole runs, its fit ran away, or
    is none to rely on.
    """
    contrary = [mend for mend in mends if mend.doubt.contrary]
    if not failing:
        return any(mend.helps for mend in contrary)
    lowered = any(mend.lowers for mend in contrary)
    return lowered or any(unjudged(doubt, mends) for doubt in doubts if doubt.contrary)


def unjudged(doubt: Doubt, mends: Sequence[MeasuredMend]) -> list[Reading]:
    """The mistakes that a doubt may come from whose mend no fit has judged."""
    judged = [mend.reading.words for mend in mends_of(doubt, mends)]
    return [reading for reading in doubt.readings if reading.words not in judged]


def undone_by(effect: str, mends: Sequence[MeasuredMend]) -> bool:
    """Whether an effect stands for a mistake that a doubt with a helpful mend tells of."""
    if effect not in EXCHANGES:
        return False
    readings = [reading for mend in mends if mend.helps for reading in mend.doubt.readings]
    first, second = EXCHANGES[effect]
    exchange = {first: (second, 1.0), second: (first, 1.0)}
    return any(dict(reading.sources) == exchange for reading in readings)
