"""Another model of the same logs, held against the one that is diagnosed, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diffthrust._support.results import Brief
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._result import Fit
from diffthrust.simulation._errors import Errors


@dataclass(frozen=True, repr=False)
class OtherModel(Brief):
    """A model of the library that the same channels feed, fitted to the same logs.

    Args:
        plain: the model as it is, with those effects of the diagnosed one that act in it.
        extended: the model with the effects of a short search of its own; ``None`` where none was
            made, or it found nothing.
        worth: share of the squared whole-run error, of the diagnosed model with all that was found,
            that this one removes; below 0 it errs more.
    """

    plain: Fit
    extended: Fit | None
    worth: Worth

    @property
    def name(self) -> str:
        """Of the model."""
        return self.plain.model.name

    @property
    def best(self) -> Fit:
        """The last fit of the model."""
        return self.extended or self.plain

    @property
    def better(self) -> bool:
        """Whether it surely errs less, and clearly, than the diagnosed model with all its terms."""
        return self.worth.low > 0 and self.worth.share > SETTINGS.rival_models.clear_share

    def to_json(self) -> dict[str, Any]:
        """Both fits' effects and errors as plain data."""
        return {
            "model": self.name,
            "plain": _fitted(self.plain),
            "extended": _fitted(self.extended) if self.extended else None,
            "worth": self.worth.to_json(),
            "better": self.better,
        }


def errors_of(fit: Fit) -> Errors:
    """Whole-run errors of a fit, of unseen logs if there are any."""
    return fit.holdout or fit.train


def _fitted(fit: Fit) -> dict[str, Any]:
    return {
        "effects": [effect.name for effect in fit.model.effects],
        "train": fit.train.to_json(),
        "holdout": fit.holdout.to_json() if fit.holdout else None,
    }
