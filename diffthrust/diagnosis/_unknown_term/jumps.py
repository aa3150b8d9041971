"""How likely one-step errors make a jump: a law that changes at once at a value of its signal.

A curve of eight pieces turns slowly, and where a law jumps, curves of other slow signals do as
well. Thrust lost below 14 V of a battery went for thrust that is lost as a motor warms up
(evidence 122 against 110; of a jump of the voltage 187). So the signals of likely curves are asked
for jumps, with their sizes integrated out as those of curves are.
"""

from __future__ import annotations

import numpy as np

from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._unknown_term.evidence import (
    LikelyCurve,
    largest_size,
    marginal_likelihood,
    projected_information,
)
from diffthrust.diagnosis._unknown_term.terms import Regressors, Term

_PLACES = 127
"""Numerics: places at which a jump is tried, with as many of the samples between any two; and as
many again about the likeliest. A jump placed wrongly by a fortieth of the range lost three quarters
of its evidence."""


def with_jump(trial: TrialFit, regressors: Regressors, likely: LikelyCurve) -> LikelyCurve:
    """A likely curve, with the evidence of the likeliest jump of its signal if that is more.

    A wave, which has its shape already, is returned as it is.
    """
    term = likely.term
    if term.is_linear:
        return likely
    pooled = term.pooled
    level = largest_size(term, [log[term.port] for log in regressors.current.ports])
    shares, spacing = np.linspace(0.0, 1.0, _PLACES + 2)[1:-1], 1.0 / (_PLACES + 1)
    best = 0.0
    for _ in range(2):
        places = np.unique(np.quantile(pooled, shares.clip(0.0, 1.0)))
        evidence = _evidence_of_jumps(trial, term, places, level)
        best = max(best, float(evidence.max()))
        likeliest = float(np.mean(pooled < places[evidence.argmax()]))
        shares = likeliest + spacing * np.linspace(-1.0, 1.0, _PLACES)
    # it may jump at any sample: one place among so many is paid for
    return likely._replace(evidence=max(likely.evidence, best - float(np.log(pooled.size))))


def _evidence_of_jumps(trial: TrialFit, term: Term, places: np.ndarray, level: float) -> np.ndarray:
    """The evidence of a jump at each place, beside a constant; ``(K,)``."""
    # a constant, and a step at each place
    series = term.basis(lambda x: np.vstack([np.ones_like(x), x > places[:, None]]))
    ((information, gradient, unprojected),) = projected_information(trial, term.port, [series])
    pairs = ([0, k] for k in range(1, len(places) + 1))
    return np.array(
        [
            marginal_likelihood(
                information[np.ix_(pair, pair)], gradient[pair], unprojected[pair], level
            ).evidence
            for pair in pairs
        ]
    )
