"""Diagnosis: where a model fails, which effect it lacks, and what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.comparison._compare import compare
from diffthrust.diagnosis._candidates import Candidates
from diffthrust.diagnosis._groups import groups_of, proposal
from diffthrust.diagnosis._missing import missing_signals
from diffthrust.diagnosis._result import Diagnosis, Missing, Verdict
from diffthrust.diagnosis._stages import Progress, Stages
from diffthrust.estimation._arguments import by_input, check_arguments, listed
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model

MOST_STAGES = 5


def diagnose(
    fit: Fit | Model,
    logs: Log | Sequence[Log],
    *,
    holdout: Log | Sequence[Log] | None = None,
    candidates: Candidates | None = None,
    experiment: bool = True,
    limits: Mapping[str, tuple[float, float]] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what a model lacks: where it fails, which physical effect is missing, what is unknown.

    Every effect that the logs can test is tried in the innovations form of the model, in which
    random forces and lasting sensor errors have estimated sizes of their own: what remains is
    white, and a likelihood ratio on it means what it says. The best effect is added while it lowers
    the Bayesian information criterion clearly, and neither the one-step predictions of unseen logs
    nor whole runs speak against it: it must change them, and not make those of training and unseen
    logs together worse. Earlier effects that it made superfluous are dropped. At the end signals of
    unknown form are tried at each port: if the errors still depend on a signal of the model, or a
    channel contradicts it, the verdict is "unexplained".

    Args:
        fit: a fit, or a model that is fitted first.
        logs: training logs.
        holdout: unseen logs: they guard against effects that only imitate noise.
        candidates: names or objects of effects to try; all that fit the model where ``None``. The
            word "all" stands for the catalogue: ``["all", MyEffect()]``.
        experiment: propose a test that would separate effects that these logs cannot.
        limits: lowest and highest value of each input in that test, in the model's unit; by default
            the range of the training logs.
        seed: of the starts of the fits.
        progress: called with a message and the share done.

    Returns:
        A `Diagnosis`; ``print(diag.report())`` tells it, and ``model + diag.best`` is the model
        with what was found.

    Raises:
        InputError: logs that do not fit the model, or hold fewer measurements than the trials
            estimate numbers; candidates that are no effects, or cannot be tried.

    Example:
        >>> diag = dft.diagnose(fit, train, holdout=unseen)
        >>> diag.verdict, diag.added
        ('effects_found', ('command_deadband',))
    """
    train, unseen = listed(logs), listed(holdout) if holdout is not None else ()
    model = fit.model if isinstance(fit, Fit) else fit
    check_arguments(model, train, unseen, seed=seed)
    for name in by_input("limits", limits, model, "(low, high)"):
        if name not in model.inputs:
            raise InputError(
                f"limits: '{model}' has no input {name!r}; it has {listing(model.inputs)}.",
                "Correct the name.",
            )
    search = Stages(train, unseen, seed, progress or (lambda message, share: None))
    search.begin(fit, candidates)
    while len(search.present.effects) < MOST_STAGES and search.advance():
        pass
    groups = groups_of(search)
    search.say("what no known effect explains", 0.9)
    missing = search.timed("missing", missing_signals, search.trials, search.first)
    remaining = search.timed("remaining", search.structure)
    first, last = search.stages[0].fit, search.stages[-1].fit
    trained = (
        compare(first, train, initial=first.initial),
        compare(last, train, initial=last.initial),
    )
    held = (compare(first, unseen), compare(last, unseen)) if unseen else trained
    verdict: Verdict = "effects_found" if search.present.effects else "adequate"
    if remaining is not None or held[1].hints:
        verdict = "unexplained"
    left: tuple[Missing, ...] = ()
    if remaining is not None and search.present.effects:
        left = search.timed("missing", missing_signals, search.trials, search.present)
    tested = {candidate.effect for candidate in search.ranking}
    channels = search.trials.problem.layout.channels
    return Diagnosis(
        verdict=verdict,
        model=search.given,
        best=tuple(last.model.effects[len(search.given.effects) :]),
        groups=groups,
        stages=tuple(search.stages),
        ranking=tuple(search.ranking),
        remaining=remaining,
        untestable=search.untestable,
        dropped=tuple(search.dropped),
        before=held[0],
        after=held[1],
        missing=missing,
        left=left,
        refused={n: why for n, why in search.refused.items() if n not in search.present.effects},
        silent=tuple(sorted(search.silent - tested - set(search.untestable))),
        one_step=dict(zip(channels, map(float, search.present.quadratic.sigma), strict=True)),
        trained=trained,
        experiment=proposal(search, groups, limits) if experiment else None,
        seconds=search.seconds,
    )
