"""What a diagnosis reports, in order: terminal, notebook and page read these sections."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

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
from diffthrust.diagnosis._findings import Findings
from diffthrust.diagnosis._report.figures import (
    learned_figure,
    missing_figure,
    ranking_figure,
    stages_figure,
)
from diffthrust.diagnosis._report.learned import learned_words
from diffthrust.diagnosis._report.own_effect import HOW, own_effect
from diffthrust.diagnosis._report.remarks import (
    bound_words,
    caution_words,
    closing_words,
    dropped_words,
    failure_words,
    group_words,
    headroom_words,
    missing_sentences,
    refused_words,
    silent_words,
)
from diffthrust.diagnosis._report.tables import (
    check_rows,
    form_rows,
    headroom_rows,
    log_rows,
    meaning_rows,
    ranking_rows,
    stage_parameter_rows,
    stage_rows,
    untestable_rows,
    worth_rows,
)
from diffthrust.diagnosis._report.text import model_words, remaining_words, summary, verdict_words
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
    style = "good" if diag.verdict == "adequate" else "doubtful"
    outcome = Outcome("Verdict", Styled(verdict_words(diag), style), summary(diag))
    return Report(
        Section("", outcome),
        _stages(diag),
        Section(
            "What each effect removes of the squared error over whole runs",
            *_explained(
                worth_rows(diag),
                "All channels together, each in units of its own spread; the interval comes from "
                "resampled logs and blocks of time.",
            ),
        ),
        Section(
            "Room for improvement",
            *_explained(
                headroom_rows(diag),
                "A regression of moderate flexibility learned the error of the model on the "
                "training logs, from its inputs, states and outputs. What it explains of the error "
                "on logs that it has not seen is structure, whatever its form: a physical effect "
                "can remove about as much.",
            ),
            Bullets(headroom_words(diag)),
        ),
        *_failures(diag),
        _missing(diag),
        _tried(diag),
        Section("What these logs cannot tell apart", *group_words(diag)),
        _experiment(diag),
        _remaining(diag),
        _learned(diag),
        Section("Parameters", stage_parameter_rows(diag)),
        Section("Not testable by these logs", untestable_rows(diag)),
        _cautions(diag),
        closing_section(closing_words(diag)),
    )


def _stages(diag: Findings) -> Section:
    several = len(diag.stages) > 1
    again = " as it was given, and again with each effect that was added" if several else ""
    caption = (
        "Left: the error of each channel at each stage. Right: the log that the model as given "
        "fits worst, with the first and the last model."
        if several
        else "The log that the model fits worst."
    )
    return Section(
        "Stages",
        OnPage(
            f"The {model_words(diag.model)} was fitted to the training logs{again}. The errors are "
            "those of a simulation over whole logs; unseen logs took no part in the fits."
        ),
        stage_rows(diag),
        dropped_words(diag),
        Picture(partial(stages_figure, diag), caption),
    )


def _failures(diag: Findings) -> list[Section]:
    hints, warning = diag.before.hints, "A channel may not mean what its name says."
    return [
        Section(
            "Where the model as given fails",
            OnPage(Styled(warning if hints else "", "strong")),
            OnPage(Bullets(hints)),
            Bullets(failure_words(diag.before)),
            Picture(
                diag.before.plot_residuals,
                "The residuals (measured minus modelled) of the model as given: over time and over "
                "the signal of the worst regime, their autocorrelation, and their correlation with "
                "the signal to which they are most related.",
            ),
        ),
        Section("Errors by log", log_rows(diag)),
    ]


def _missing(diag: Findings) -> Section:
    if not diag.missing:
        return Section("")
    picture = Picture(
        partial(missing_figure, diag),
        "Left: the missing signal over time, with a band of two standard errors, in the training "
        "log where it is largest. Right: its mean over the signal that explains most of it.",
    )
    return Section(
        "Missing signal",
        OnPage(
            "What would have to be added at a port of the model as given for it to follow the "
            "training logs, estimated without assuming its form."
        ),
        Bullets(missing_sentences(diag.missing, diag)),
        *([picture] if any(missing.shows for missing in diag.missing) else []),
    )


def _tried(diag: Findings) -> Section:
    picture = Picture(
        partial(ranking_figure, diag),
        "Gain in likelihood by each candidate. Filled: added. Pale: cannot be told from the one "
        "that was added.",
    )
    return Section(
        "Effects tried",
        *_explained(
            ranking_rows(diag),
            "Each was added alone to the model of its stage and fitted to the errors from one "
            "sample to the next, in which random forces do not build up. The NRMSE are those of "
            "whole runs with these estimates: the fits of the stages above, made for whole runs, "
            "come closer.",
        ),
        *refused_words(diag),
        *bound_words(diag),
        silent_words(diag),
        *([picture] if diag.ranking else []),
        OnPage(meaning_rows(diag)),
    )


def _experiment(diag: Findings) -> Section:
    if diag.experiment is None:
        return Section("")
    picture = Picture(
        partial(_untitled, diag.experiment),
        "The proposed test: what to command, and what each rival predicts.",
    )
    return Section("Proposed test", diag.experiment.sentence, picture)


def _untitled(experiment: Experiment) -> Figure:
    """The figure of a proposed test without its heading, which the section already says."""
    figure = experiment.plot()
    figure.suptitle("")
    return figure


def _remaining(diag: Findings) -> Section:
    sentence = remaining_words(diag)
    code = ()
    if diag.remaining and not diag.laws:
        code = (HOW, own_effect(diag.fit.model, diag.remaining, diag.missing))
    failures = failure_words(diag.after) if len(diag.stages) > 1 else []
    return Section(
        "What remains",
        sentence if diag.remaining else OnPage(sentence),
        *missing_sentences(diag.left[:1], diag),
        OnPage("The simulation errors of the last stage:" if failures else ""),
        OnPage(Bullets(failures)),
        *code,
    )


def _learned(diag: Findings) -> Section:
    if not diag.laws:
        return Section("")
    picture = Picture(
        partial(learned_figure, diag),
        "The learned curve with its band, the closed forms that were tried, and below how many "
        "samples the logs hold.",
    )
    return Section("What was learned", *learned_words(diag), picture, *form_rows(diag))


def _cautions(diag: Findings) -> Section:
    seconds = ", ".join(f"{step} {time:.1f} s" for step, time in diag.seconds.items())
    return Section(
        "How far to trust this",
        OnPage(check_rows(diag)),
        *notes(caution_words(diag)),
        OnPage(f"Time spent: {seconds}."),
    )


def _explained(rows: Rows, explanation: str) -> tuple[Part, ...]:
    """A table, on pages under a paragraph that explains it; nothing where it is empty."""
    return (OnPage(explanation), rows) if rows else ()


def diagnosis_page(diag: Findings, *, title: str = "", spec: str = "") -> str:
    """The report as one page.

    Args:
        diag: the diagnosis.
        title: heading of the page; by default it names the model.
        spec: text of a spec file, shown at the end.
    """
    report = diagnosis_report(diag)
    sections = (*report.sections, glossary(_GLOSSARY), spec_section(spec))
    return page(Report(*sections), title or f"Diagnosis of the {model_words(diag.model)}")
