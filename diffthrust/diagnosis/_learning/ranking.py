"""Laws that may be missing, by how likely one-step errors make them."""

from __future__ import annotations

from diffthrust.diagnosis._innovations_fit import TrialFit, side_by_side
from diffthrust.diagnosis._learning.evidence import LikelyCurve, likely_curves, sharpened
from diffthrust.diagnosis._learning.hypotheses import Hypothesis, products, scene, simple_laws
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.effects._curve import Curve
from diffthrust.effects._grammar import expression_of
from diffthrust.models._base.made_effect import ARRIVING

_LIKELY = 8
"""The signals of so many of the likeliest laws are tried times another."""
_CLOSE, _RIVAL = 0.8, 0.6
"""Another law is fitted to whole runs as well, where its evidence is no less than so much of the
likeliest's, or so much where that is not surely worth anything there: to what errors from one
sample to the next say, laws answer straight, and whole runs decide."""
_NEAR = 0.6
"""What a law remembers is looked at closely, where its evidence is no less than so much of it."""
_ALIKE = 1.0
"""Of laws whose evidence is no further apart than this the plainer one is taken."""
_EQUAL = 0.1
"""One law in two ways of writing it is as likely but for so much."""
_CLEAR = 10.0
"""Less evidence than this is not worth a fit."""


def likeliest(tools: SearchContext, trial: TrialFit, place: DrivingPort) -> list[LikelyCurve]:
    """The laws that are worth a fit, the likeliest first; of equals the plainest."""
    trials, at = tools.fitter, scene(tools.fitter, trial, place)
    curves = likely_curves(trials, trial, simple_laws(at))
    if not curves:
        return []
    curves += likely_curves(trials, trial, products(at, [curve.law for curve in curves[:_LIKELY]]))
    curves.sort(key=lambda curve: -curve.evidence)
    distinct = {
        curve.law[:3]: curve for curve in reversed(curves)
    }  # of several guesses the likeliest
    least = _NEAR * curves[0].evidence
    near = [curve for curve in distinct.values() if curve.evidence > least]
    curves = [curve for curve in distinct.values() if curve.evidence <= least]
    curves += side_by_side(lambda curve: sharpened(trials, trial, at.seen, curve), near)
    best = max(curve.evidence for curve in curves)
    curves.sort(
        key=lambda curve: (curve.evidence < best - _ALIKE, _plainness(curve.law), -curve.evidence)
    )
    first = [curve for curve in curves if curve.evidence >= best - _ALIKE]
    remaining = sorted(curves[len(first) :], key=lambda curve: -curve.evidence)
    return [curve for curve in (*first, *remaining) if curve.evidence > _CLEAR]


def rival_law(likely: list[LikelyCurve], sure: bool) -> LikelyCurve | None:
    """The likeliest law of another signal, where whole runs may choose that.

    Args:
        likely: the laws, the likeliest first.
        sure: whether that is surely worth something over whole runs.
    """
    first = likely[0]
    rivals = (curve for curve in likely[1:] if curve.law.signal != first.law.signal)
    # the same law in other words is as likely
    apart = [curve for curve in rivals if abs(curve.evidence - first.evidence) >= _EQUAL]
    rival = max(apart, key=lambda curve: curve.evidence, default=None)
    least = (_CLOSE if sure else _RIVAL) * first.evidence
    return rival if rival and rival.evidence > least else None


def forgetful(likely: list[LikelyCurve], curve: Curve) -> LikelyCurve | None:
    """The law of the same signal as it is, where a law remembers: over whole runs it may do."""
    plain = expression_of(curve.signal).memories and {*expression_of(curve.signal).places}
    same = (
        candidate
        for candidate in likely
        if (candidate.law.port, candidate.law.times) == (curve.port, curve.times)
    )
    return next((candidate for candidate in same if candidate.law.signal in (plain or ())), None)


def _plainness(law: Hypothesis) -> tuple[int, bool, int]:
    times = ("", ARRIVING, law.times).index(law.times)
    return times, ARRIVING in expression_of(law.signal).places, len(law.signal)
