"""What remains without the odd logs that carry much of the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from diffthrust.comparison._compare import Comparison, compare
from diffthrust.diagnosis._residual_structure import remaining_structure
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.diagnosis._search_state import SearchContext, compiled_fitter
from diffthrust.logs._log import Log


def set_aside(tools: SearchContext, found: Diagnosis) -> Diagnosis:
    """What was found, with all that is open judged by the other logs.

    A log that is unlike the others may say nothing of what all lack, and bends what they share:
    where one is among the training logs the last stage is fitted without it, and asked anew what
    remains.

    Args:
        tools: what the search works with.
        found: what it has found, with the odd logs.

    Returns:
        The same where nothing is open, where no log is so odd, and where no unseen log would be
        left: what is odd about the only one may be what the model lacks.
    """
    odd = {one.log for one in found.odd_logs if one.much}
    is_open = found.far or found.remaining is not None or found.after.hints
    if not odd or not is_open or found.trained is None:
        return found

    def others(logs: Sequence[Log], held: Comparison) -> list[Log]:
        return [log for log, run in zip(logs, held.runs, strict=True) if run.name not in odd]

    every, fit = tools.fitter.logs, found.fit
    train = others(every, found.trained[1])
    unseen = others(tools.unseen, found.after) if tools.unseen else []
    gone = len(every) + len(tools.unseen) - len(train) - len(unseen)
    if gone > len(odd) or (tools.unseen and not unseen):  # logs may be called alike
        return found
    if len(train) < len(every):
        tools.say("without the odd logs", 1.0)
        fit = tools.refit(fit.model, logs=(train, unseen))
        trials, trial = compiled_fitter(fit, (), (), train, unseen)
        sizes = map(float, trial.quadratic.sigma)
        found = replace(
            found,
            remaining=remaining_structure(trials, trial),
            one_step=dict(zip(trials.channels, sizes, strict=True)),
        )
    trained = compare(fit, train, initial=fit.initial)
    return replace(found, apart=(trained, compare(fit, unseen) if unseen else trained))
