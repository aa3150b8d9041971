"""Laws that may be missing, by how likely one-step errors make them."""

from __future__ import annotations

from diffthrust.diagnosis._learning.evidence import LikelyCurve, likely_curves, sharpened
from diffthrust.diagnosis._learning.hypotheses import Hypothesis, products, scene, simple_laws
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._search import Tools
from diffthrust.diagnosis._trials import TrialFit, side_by_side
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


def likeliest(tools: Tools, trial: TrialFit, place: DrivingPort) -> list[LikelyCurve]:
    """The laws that are worth a fit, the likeliest first; of equals the plainest."""
    trials, at = tools.trials, scene(tools.trials, trial, place)
    found = likely_curves(trials, trial, simple_laws(at))
    if not found:
        return []
    found += likely_curves(trials, trial, products(at, [one.law for one in found[:_LIKELY]]))
    found.sort(key=lambda one: -one.evidence)
    once = {one.law[:3]: one for one in reversed(found)}  # of several guesses the likeliest
    least = _NEAR * found[0].evidence
    near = [one for one in once.values() if one.evidence > least]
    found = [one for one in once.values() if one.evidence <= least]
    found += side_by_side(lambda one: sharpened(trials, trial, at.seen, one), near)
    best = max(one.evidence for one in found)
    found.sort(key=lambda one: (one.evidence < best - _ALIKE, _plainness(one.law), -one.evidence))
    first = [one for one in found if one.evidence >= best - _ALIKE]
    rest = sorted(found[len(first) :], key=lambda one: -one.evidence)
    return [one for one in (*first, *rest) if one.evidence > _CLEAR]


def rival_law(likely: list[LikelyCurve], sure: bool) -> LikelyCurve | None:
    """The likeliest law of another signal, where whole runs may choose that.

    Args:
        likely: the laws, the likeliest first.
        sure: whether that is surely worth something over whole runs.
    """
    first = likely[0]
    others = (one for one in likely[1:] if one.law.signal != first.law.signal)
    # the same law in other words is as likely
    apart = [one for one in others if abs(one.evidence - first.evidence) >= _EQUAL]
    rival = max(apart, key=lambda one: one.evidence, default=None)
    least = (_CLOSE if sure else _RIVAL) * first.evidence
    return rival if rival and rival.evidence > least else None


def forgetful(likely: list[LikelyCurve], curve: Curve) -> LikelyCurve | None:
    """The law of the same signal as it is, where a law remembers: over whole runs it may do."""
    plain = expression_of(curve.signal).memories and {*expression_of(curve.signal).places}
    same = (one for one in likely if (one.law.port, one.law.times) == (curve.port, curve.times))
    return next((one for one in same if one.law.signal in (plain or ())), None)


def _plainness(law: Hypothesis) -> tuple[int, bool, int]:
    times = ("", ARRIVING, law.times).index(law.times)
    return times, ARRIVING in expression_of(law.signal).places, len(law.signal)
