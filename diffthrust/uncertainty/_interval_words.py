"""Why intervals of the same parameter disagree, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from diffthrust.estimation._arguments import LIKELIHOODS, NOISE_MODELS
from diffthrust.estimation._result import Fit
from diffthrust.uncertainty._intervals_row import Interval
from diffthrust.uncertainty._profile_curve import LOPSIDED, Profile

_APART = 0.2
"""Two intervals disagree where an end differs by this share of the arm it belongs to."""
_CLEARLY = 1.25
"""A sandwich and a covariance disagree where one is wider by this factor."""


@dataclass(frozen=True)
class Evidence:
    """What is known of one parameter's intervals.

    Args:
        fit: the fit.
        profile: the parameter's profile.
        intervals: by method.
        inflation: width of the sandwich over that of the covariance, or ``None``.
        chance: how far from one it may be by chance.
        correlation: of the residuals that the fit took as white; zero where they are.
        prior: the parameter has one.
        recommended: the method to take.
        met: other parameters whose bounds are within their own intervals.
    """

    fit: Fit
    profile: Profile
    intervals: Mapping[str, Interval]
    inflation: float | None
    chance: float
    correlation: float
    prior: bool
    recommended: str
    met: tuple[str, ...] = ()


def heading(fit: Fit, lag: float, correlated: bool, sandwich: bool) -> str:
    """The recommendation, with its reason."""
    lasting = NOISE_MODELS[fit.noise_model].lasts
    if correlated:
        kind = "What is new in the noise is" if lasting else "Residuals are"
        mend = "something is missing from the model" if lasting else _mend(fit)
        return (
            f"{kind} correlated from sample to sample ({lag:.2f}) where the fit takes them as "
            f"white: covariance, profile and posterior are too narrow, take the sandwich. To "
            f"narrow it down: {mend}."
        )
    if sandwich:
        return (
            "Residuals are white, but not of one size or law: take the sandwich where it is "
            "marked, else the profile."
        )
    what = "What is new in the noise at each sample is" if lasting else "Residuals are"
    return f"{what} white, as the fit takes them: take the profile."


def _mend(fit: Fit) -> str:
    if LIKELIHOODS[fit.likelihood].corrects or not fit.model.states:
        return "look for what the model lacks (diagnose)"
    return (
        'look for what the model lacks (diagnose), or fit with noise_model="ar1" or '
        'likelihood="innovations"'
    )


def sentences(e: Evidence) -> Iterator[str]:
    """A sentence for each disagreement."""
    name = e.profile.name
    estimate = e.fit.parameters[name]
    if estimate.at_bound:
        yield (
            f"{name} lies at its bound: it has no standard error there, only the profile says how "
            "far it may be from it."
        )
    elif estimate.std_error is None:
        yield (
            f"{name} has no standard error: these logs cannot tell it from others; the profile "
            "says what is known of it alone."
        )
    whys = ("downwards", e.profile.open_low), ("upwards", e.profile.open_high)
    for (side, why), bound in zip(whys, e.profile.bounds, strict=True):
        if why and not (estimate.at_bound and bound is not None):
            it = "it " if bound is not None else ""
            yield f"{name}: {side} the profile is open; {it}{why}."
    yield from _lopsided(e, name)
    yield from _inflated(e, name)
    yield from _drawn(e, name)


def _lopsided(e: Evidence, name: str) -> Iterator[str]:
    ratio = e.profile.lopsided
    if ratio is None or 1 / LOPSIDED < ratio < LOPSIDED:
        return
    way, size = ("up", ratio) if ratio > 1 else ("down", 1 / ratio)
    met = f", for {' and '.join(e.met)} may meet a bound" if e.met else ""
    words = (
        f"{name}: the profile reaches {size:.2g} times as far {way} as the other way. The "
        f"likelihood is not quadratic there{met}, and covariance and sandwich are symmetric by "
        "construction"
    )
    if e.recommended == "sandwich":
        words += ": expect the same of the truth, within the width of the sandwich"
    yield f"{words}."


def _inflated(e: Evidence, name: str) -> Iterator[str]:
    if e.inflation is None or 1 / _CLEARLY < e.inflation < _CLEARLY:
        return
    words = f"{name}: the sandwich is {e.inflation:.2g} times as wide as the covariance: "
    if e.correlation:
        yield f"{words}residuals are correlated from sample to sample ({e.correlation:.2f})."
    elif abs(e.inflation - 1) < e.chance:
        yield f"{words}no more than chance gives on so few samples."
    elif e.inflation < 1:
        yield f"{words}residuals are small where this parameter acts most, or alternate in sign."
    else:
        yield f"{words}residuals are large, or last long, where this parameter acts most."


def _drawn(e: Evidence, name: str) -> Iterator[str]:
    drawn, profile = e.intervals.get("posterior"), e.intervals["profile"]
    if drawn is None or drawn.low is None or drawn.high is None:
        return
    value = e.profile.value
    apart = []
    for side, drawn_end, profile_end in (
        ("lower", drawn.low, profile.low),
        ("upper", drawn.high, profile.high),
    ):
        if profile_end is not None and abs(drawn_end - profile_end) > _APART * max(
            abs(profile_end - value), 1e-300
        ):
            apart.append(side)
    if not apart:
        return
    ends = f"the {apart[0]} end" if len(apart) == 1 else "both ends"
    ratio = e.profile.lopsided
    skewed = ratio is None or not 1 / LOPSIDED < ratio < LOPSIDED
    if skewed:
        why = (
            "the likelihood is not quadratic, and a posterior averages over the other parameters "
            "where a profile takes their best"
        )
    elif e.prior:
        why = "the draws follow the density of the prior, which weighs values once more"
    else:
        why = (
            "a bound or the prior cuts the posterior off, other parameters are far from quadratic, "
            "or the chains have not converged"
        )
    yield f"{name}: posterior and profile differ at {ends}: {why}."
