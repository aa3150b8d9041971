"""What is told of what was given: logs that disagree, constants held elsewhere, narrow bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diffthrust._support.tables import with_error
from diffthrust._support.words import an, capitalised, joined, percent, spelt

if TYPE_CHECKING:
    from diffthrust.diagnosis._findings import Findings, OddLog
    from diffthrust.estimation._result import Fit


def much_words(diag: Findings) -> list[str]:
    """The odd logs that carry so much of the error that they might decide, and whether they do."""
    words = [_odd_words(odd) for odd in diag.odd_logs if odd.much]
    if diag.apart:
        words.append(
            "The verdict rests on the other logs alone, with the model fitted to them: what is "
            "unlike them was recorded otherwise, or shows what they do not."
        )
    return words


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


def stopped_words(diag: Findings) -> list[str]:
    """Every parameter of the model as given that a bound has stopped.

    Also those that a bound held until effects were added: these may stand in for what lies beyond.

    Example:
        >>> stopped_words(diag)
        ['alpha stopped at its bound of 0.2 1/s: these logs want it higher. What is told here ...']
    """
    last = _stopped(diag.fit)
    news = joined(an(spelt(name)) for name in diag.added)
    words = []
    for full, (named, amount, way) in {**_stopped(diag.stages[0].fit), **last}.items():
        if full in diag.model.parameters and full in last:
            words.append(
                f"{named} stopped at its bound of {amount}: these logs want it {way}. What is told "
                "here holds under that bound: widen it, if nature allows, and diagnose again."
            )
        elif full in diag.model.parameters and news:
            words.append(
                f"{named} stood at its bound of {amount} before {news} came in, which may stand "
                f"for a {way} {named}: widen the bound, if nature allows, and diagnose again."
            )
    return words


def added_bound_words(diag: Findings) -> list[str]:
    """Every parameter of what was added that a bound has stopped."""
    return [
        f"{named} stopped at its bound of {amount}: the effect may explain more beyond it. Widen "
        "the bound, if nature allows."
        for full, (named, amount, _) in _stopped(diag.fit).items()
        if full not in diag.model.parameters
    ]


def _stopped(fit: Fit) -> dict[str, tuple[str, str, str]]:
    """Of each parameter that a bound stopped its name in words, the bound, and which way it went.

    Not of one that is gone, at the null of its effect or at the zero of a logarithm: notes tell.
    """
    found = {}
    for full, p in fit.model.parameters.items():
        e, (low, high) = fit.parameters[full], p.limits
        above = abs(e.value - high) < abs(e.value - low)
        gone = e.value == p.null or (p.transform == "log" and low <= 0 and not above)
        if e.at_bound and not gone:
            effect, _, name = full.rpartition(".")
            named = capitalised(f"{spelt(name)} of {an(spelt(effect))}") if effect else name
            amount = _amount(f"{e.shown[0]:.4g}", e.shown[2])
            found[full] = named, amount, "higher" if above else "lower"
    return found


def _amount(size: str, unit: str) -> str:
    return f"{size} {unit}".rstrip()


def _odd_words(odd: OddLog) -> str:
    return (
        f"Log {odd.log} is unlike the others: {odd.evidence}. It carries {percent(odd.share)} of "
        f"the squared {spelt(odd.channel)} error of all logs. Look at how it was recorded."
    )
