"""The verdict on a model: one of four, from numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.simulation._errors import Errors

Verdict = Literal["adequate", "effects_found", "unexplained", "undecided"]


@dataclass(frozen=True)
class VerdictEvidence:
    """The numbers from which a verdict follows.

    Args:
        errors: of the last model over whole runs of the logs on which the verdict rests.
        noise: by channel the standard deviation of its one-step errors, or of its sensor where
            that is stated and smaller.
        repeated: by channel the least share of its squared errors that a flexible model surely
            explains, or that surely recurs in runs with the same inputs, as far as that was worked
            out.
        structure: one-step errors still depend on a signal of the model at some port.
        contradicted: a channel contradicts the model: its sign or scale is another, or inputs are
            exchanged (the hints of a comparison).
        added: an effect was added.
        freed: a constant of the model was freed.
    """

    errors: Errors
    noise: Mapping[str, float]
    repeated: Mapping[str, float]
    structure: bool
    contradicted: bool
    added: bool
    freed: bool

    @property
    def far(self) -> tuple[str, ...]:
        """The channels whose errors over whole runs are large and last, the worst first."""
        return far_above_noise(self.errors, self.noise)

    @property
    def repeating(self) -> tuple[str, ...]:
        """Those of them whose errors surely repeat."""
        least = SETTINGS.verdict.repeating_share
        return tuple(name for name in self.far if self.repeated.get(name, 0.0) > least)


def verdict_of(evidence: VerdictEvidence) -> Verdict:
    """The verdict.

    Structure remains where one-step errors depend on a signal, where a channel contradicts the
    model, and where errors over whole runs are large, last and repeat: no random force makes those.
    Large errors that do not repeat leave it undecided, unless an effect was added; a constant that
    was freed does not decide it.
    """
    if evidence.structure or evidence.contradicted or evidence.repeating:
        return "unexplained"
    if evidence.added or (evidence.freed and not evidence.far):
        return "effects_found"
    return "undecided" if evidence.far else "adequate"


def far_above_noise(errors: Errors, noise: Mapping[str, float]) -> tuple[str, ...]:
    """The channels whose errors over whole runs are large and last, the worst first.

    Far above those from one sample to the next, or above the stated noise of the sensor.
    """
    # "not less" instead of "greater": an error that is NaN or infinite is far off
    ratios = {
        name: error.rmse / max(noise[name], 1e-300)
        for name, error in errors.channels.items()
        if name in noise and not error.nrmse < SETTINGS.verdict.least_nrmse
    }
    least = SETTINGS.verdict.far_above_one_step
    far = [name for name, ratio in ratios.items() if not ratio < least]
    return tuple(sorted(far, key=lambda name: -errors.channels[name].nrmse))
