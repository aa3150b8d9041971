"""What a diagnosis reports, in order: terminal, notebook and page read these sections."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from diffthrust._support.live import Live
from diffthrust._support.page import glossary, page, spec_section
from diffthrust._support.report import (
    Bullets,
    OnPage,
    Outcome,
    Part,
    Picture,
    Report,
    Rows,
    Section,
    Styled,
    closing_section,
    notes,
)
from diffthrust._support.words import capitalised, humanize, joined
from diffthrust.comparison._compare import Comparison, compare
from diffthrust.diagnosis._bounds import is_whole
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._report import figures, tables
from diffthrust.diagnosis._report.details import details, missing_words, odd_words, remaining_words
from diffthrust.diagnosis._report.doubts import doubt_bullets
from diffthrust.diagnosis._report.learned import EFFECT_NAME, learned_words, own_effect
from diffthrust.diagnosis._report.summary import TO_COPY, summary
from diffthrust.diagnosis._report.text import (
    an_effect,
    beyond_bound,
    copied_fit,
    measured,
    model_words,
    parameter_words,
    rival_words,
    stage_words,
    unmeasured_rivals,
    verdict_words,
)
from diffthrust.estimation._origin import python_lines, spec_lines
from diffthrust.estimation._per_log import per_log_section
from diffthrust.estimation._result import Fit
from diffthrust.experiments._result import Experiment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GLOSSARY = {
    "RMSE": "Root mean square of measured minus modelled, in the channel's unit.",
    "NRMSE": "The RMSE over the standard deviation of the measured channel: 0 is perfect, 1 no "
    "better than the mean.",
    "Port": "A named place on the signal path of the model where something may be missing.",
    "Effect": "A physical term that plugs into a port.",
    "Likelihood ratio": "Twice the gain in log-likelihood of the one-step predictions by adding "
    "the effect.",
    "BIC change": "Change of the Bayesian information criterion, which charges for parameters; "
    "negative is better. An effect is added where it falls by more than 4, which one of some "
    "thirty effects reaches by chance in about one diagnosis of a hundred, and where unseen logs "
    "do not speak against it.",
    "Stage": "One round: the model with the effects found so far, fitted again. Stage 0 is the "
    "model as it was given.",
    "One-step error": "Measured minus what is predicted from all earlier samples: the error when "
    "the past corrects the model.",
    "p": "How often chance alone would make the effect look as useful, with noise that is "
    "correlated in time; for this effect alone, of all that were tried.",
}


def diagnosis_report(diag: Findings) -> Report:
    """All sections; pages add the figures, and explanations for readers without the library."""
    seconds = ", ".join(f"{step} {time:.1f} s" for step, time in diag.seconds.items())
    folded = (
        Section("Details", details(diag)),
        Section("Doubts on the logs", Bullets(doubt_bullets(diag))),
        _stages(diag),
        *_shares(diag),
        *_failures(diag),
        _missing(diag),
        _tried(diag),
        _alike(diag),
        _experiment(diag),
        _remaining(diag),
        _learned(diag),
        Section("Parameters", tables.stage_parameter_rows(diag)),
        per_log_section(diag.fit.per_log, "Numbers by log, last stage"),
        Section("Not testable by these logs", tables.untestable_rows(diag)),
        Section(
            "How far to trust this",
            OnPage(tables.check_rows(diag)),
            *notes(caution_words(diag)),
            OnPage(f"Time spent: {seconds}."),
        ),
        closing_section(
            [
                *(diag.origin.sentences if diag.origin else ()),
                f"{TO_COPY}, and into Python:",
                spec_lines(diag.improved),
                python_lines(diag.improved),
            ]
        ),
    )
    return Report(_answer(diag), *(section.fold() for section in folded))


def _answer(diag: Findings) -> Section:
    """What is read first; on pages with the lines to copy, and how the errors fell."""
    style = "good" if diag.verdict == "adequate" else "doubtful"
    return Section(
        "",
        Outcome("Verdict", Styled(verdict_words(diag), style), summary(diag)),
        Bullets(Styled(words, "doubtful") for words in unfinished_words(diag)),
        OnPage(f"{TO_COPY}:"),
        OnPage(spec_lines(diag.improved)),
        Picture(
            partial(figures.stages_figure, diag),
            "Left: how the error falls from stage to stage. Right: the log that the model as given "
            "fits worst, as it was measured and as it is modelled."
            if len(diag.stages) > 1
            else "The log that the model fits worst.",
            partial(_live_stages, diag),
        ),
    )


def _live_stages(diag: Findings) -> Live | None:
    """The logs with the model of each stage, to switch between, and how their errors fell."""
    from diffthrust.comparison._run_plots import live_runs

    logs = [run.record.log for run in diag.before.runs]
    models = {stage_words(diag, 0): diag.before.runs}
    for k, stage in enumerate(diag.stages[1:], 1):
        is_last = k == len(diag.stages) - 1
        runs = diag.after.runs if is_last else compare(stage.fit, logs).runs
        models[f"{k}: {stage_words(diag, k)}"] = runs
    errors = [(stage.holdout or stage.train).nrmse for stage in diag.stages]
    return live_runs(models, errors, "unseen logs" if diag.stages[0].holdout else "training logs")


def _explained(rows: Rows, explanation: str) -> tuple[Part, ...]:
    """A table, on pages under a paragraph that explains it; nothing where it is empty."""
    return (OnPage(explanation), rows) if rows else ()


def _drawn(shown: object, draw: Callable[[], Figure], caption: str) -> tuple[Part, ...]:
    """A figure, where there is something to show."""
    return (Picture(draw, caption),) if shown else ()


def beginnings(fit: Fit) -> str:
    """At what states runs begin, where training runs and unseen ones differ in it."""
    if fit.holdout is None or not fit.begins_freely:
        return ""
    hidden = [n for n in fit.model.states if n not in fit.train.channels and n in fit.initial[0]]
    but = ""
    if hidden:
        but = f", but for the {joined(map(humanize, hidden))}, which no channel measures"
    return f"Training runs begin at states that were fitted, unseen runs at measured ones{but}."


def _stages(diag: Findings) -> Section:
    several = len(diag.stages) > 1
    again = " as it was given, and again with each effect that was added" if several else ""
    removed = joined(map(an_effect, diag.dropped))
    return Section(
        "Stages",
        OnPage(
            f"The {model_words(diag.model)} was fitted to the training logs{again}. The errors are "
            "those of a simulation over whole logs; unseen logs took no part in the fits."
        ),
        tables.stage_rows(diag),
        beginnings(diag.stages[0].fit),
        f"Added and later removed, superfluous beside a later effect: {removed}."
        if removed
        else "",
        *(
            f"In the place of {an_effect(old)} came {an_effect(new)}: whole runs err less with it."
            for old, new in diag.exchanged.items()
        ),
    )


def _shares(diag: Findings) -> list[Section]:
    """What effects, a flexible correction and other models remove of the errors."""
    nevertheless = ""
    if diag.remaining and diag.headroom and not diag.headroom[1].worth:
        nevertheless = "One-step errors show structure nevertheless: see what remains."
    return [
        Section(
            "What each effect removes of the squared error over whole runs",
            *_explained(
                tables.worth_rows(diag),
                "As given: of the model without any of them, in the order in which they were "
                "added. Beside the others: of the model without this one, the others fitted again. "
                "Where channels stand together, each is in units of its own spread. The interval "
                "comes from resampled logs and blocks of time.",
            ),
        ),
        Section(
            "Room for improvement",
            *_explained(
                tables.headroom_rows(diag),
                "A regression of moderate flexibility learned the error of the model on the "
                "training logs, from its inputs, states and outputs. What it explains of the error "
                "on logs that it has not seen is structure, whatever its form: a physical effect "
                "can remove about as much.",
            ),
            nevertheless,
        ),
        Section(
            "Other models of these logs",
            *_explained(
                tables.other_model_rows(diag),
                "Models of the library that the same channels feed, fitted as they are; where one "
                "errs about as little as the model as given did, also with effects found by a "
                "short search of its own. They remove that share of the squared error over whole "
                "runs that the diagnosed model leaves with all that was found; below zero they err "
                "more.",
            ),
        ),
    ]


def _failures(diag: Findings) -> list[Section]:
    hints, warning = diag.before.hints, "A channel may not mean what its name says."
    return [
        Section(
            "Where the model as given fails",
            OnPage(Styled(warning if hints else "", "strong")),
            OnPage(Bullets(hints)),
            _failure_bullets(diag.before, diag.verdict == "adequate"),
            Picture(
                diag.before.plot_residuals,
                "The residuals (measured minus modelled) of the model as given: over time and over "
                "the signal of the worst regime, their autocorrelation, and their correlation with "
                "the signal to which they are most related.",
            ),
        ),
        Section("Errors by log", tables.log_rows(diag)),
    ]


def _failure_bullets(comparison: Comparison, adequate: bool = False) -> Bullets:
    """Where the error of a model is large, and whether it is noise."""
    meaning = "too small to matter here" if adequate else "something is missing"
    tests = (capitalised(tests.words(meaning)) for tests in comparison.tests.values())
    return Bullets((*(regime.sentence for regime in comparison.regimes), *tests))


def _missing(diag: Findings) -> Section:
    if not diag.missing:
        return Section("")
    return Section(
        "Missing signal",
        OnPage(
            "What would have to be added at a port of the model as given for it to follow the "
            "training logs, estimated without assuming its form."
        ),
        Bullets(missing_words(m, diag.model, diag.remaining) for m in diag.shown(diag.missing)),
        *_drawn(
            any(missing.shows for missing in diag.missing),
            partial(figures.missing_figure, diag),
            "Left: the missing signal over time, with a band of two standard errors, in the "
            "training log where it is largest. Right: its mean over the signal that explains most "
            "of it.",
        ),
    )


def _tried(diag: Findings) -> Section:
    silent = joined(map(an_effect, diag.silent))
    return Section(
        "Effects tried, each fitted to one-step errors",
        *_explained(
            tables.ranking_rows(diag),
            "Each was added alone to the model of its stage and fitted to the errors from one "
            "sample to the next, in which random forces do not build up. The NRMSE are those of "
            "whole runs with these estimates: the fits of the stages above, made for whole runs, "
            "come closer.",
        ),
        *(
            f"{capitalised(an_effect(n))} was not added: it {why}."
            for n, why in diag.refused.items()
        ),
        *_stopped(diag),
        f"No improvement: {silent}." if silent else "",
        *_drawn(
            diag.ranking,
            partial(figures.ranking_figure, diag),
            "Gain in likelihood by each candidate. Filled: added. Pale: cannot be told from the "
            "one that was added.",
        ),
        OnPage(tables.meaning_rows(diag)),
    )


def _stopped(diag: Findings) -> list[str]:
    """The parameters of promising effects that a bound has stopped, and the mend."""
    stopped = {
        (c.effect, name): e
        for c in diag.ranking
        if c.effect not in diag.added and (c.delta_bic < 0 or c.effect in diag.possible)
        for name, e in c.parameters.items()
        if e.at_bound and not is_whole(c.effect, name, e.value)
    }
    return [
        f"{parameter_words(name, effect)} {beyond_bound(measured(e))}"
        for (effect, name), e in stopped.items()
    ]


def _alike(diag: Findings) -> Section:
    return Section(
        "What these logs cannot tell apart",
        *(
            f"{capitalised(channel)}, which no log has, could look like {an_effect(name)}."
            for name, channel in unmeasured_rivals(diag).items()
        ),
        *(
            f"These logs cannot tell {an_effect(name)} from {rivals}."
            for name, rivals in rival_words(diag).items()
        ),
    )


def _experiment(diag: Findings) -> Section:
    if diag.experiment is None:
        return Section("")

    def untitled(experiment: Experiment) -> Figure:
        figure = experiment.plot()
        figure.suptitle("")  # the section has that heading
        return figure

    caption = "The proposed test: what to command, and what each rival predicts."
    picture = Picture(partial(untitled, diag.experiment), caption)
    return Section("Proposed test", diag.experiment.sentence, picture)


def _remaining(diag: Findings) -> Section:
    words = remaining_words(diag)
    parts: list[Part] = [words if diag.remaining else OnPage(words)]
    parts += [missing_words(m, diag.model, diag.remaining) for m in diag.shown(diag.left[:1])]
    if len(diag.stages) > 1 and (failures := _failure_bullets(diag.after)):
        parts += [OnPage("The simulation errors of the last stage:"), OnPage(failures)]
    if diag.remaining and not diag.laws:
        parts += [
            f"Write the law that you suspect as an effect of your own, say in {EFFECT_NAME}.py, "
            "and fit it:",
            own_effect(diag.fit.model, diag.remaining, diag.missing),
        ]
    return Section("What remains", *parts)


def _learned(diag: Findings) -> Section:
    caption = (
        "The learned curve with its band, the closed forms that were tried, and below how many "
        "samples the logs hold."
    )
    picture = _drawn(diag.laws, partial(figures.learned_figure, diag), caption)
    return Section("What was learned", *learned_words(diag), *picture, *tables.form_rows(diag))


def unfinished_words(diag: Findings) -> list[str]:
    """The fits that are not what they should be, of the stages and with what was learned."""
    fits = {f"of stage {i} ({stage_words(diag, i)})": s.fit for i, s in enumerate(diag.stages)}
    if diag.laws:
        fits["with what was learned"] = copied_fit(diag)
    return [
        f"The fit {which} has the status '{fit.status.value}': {fit.message}"
        for which, fit in fits.items()
        if not fit.status.ok
    ]


def caution_words(diag: Findings) -> list[str]:
    """What weakens the outcome, besides fits that did not converge, which the answer names."""
    sentences = []
    if diag.stages[-1].holdout is None:
        sentences.append(
            "No log was kept unseen: the errors are those of the logs that the models were fitted "
            "to, which every effect lowers. Give holdout logs."
        )
    return [*sentences, *map(odd_words, diag.odd_logs), *diag.notes, *diag.fit.notes]


def diagnosis_page(diag: Findings, *, title: str = "", spec: str = "") -> str:
    """The report as one page, by default under the model's name, with a spec file at its end."""
    report = diagnosis_report(diag)
    sections = (*report.sections, glossary(_GLOSSARY).fold(), spec_section(spec).fold())
    return page(Report(*sections), title or f"Diagnosis of the {model_words(diag.model)}")
