"""What a person sees of a diagnosis: sentences, tables, figures and the page."""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import replace
from decimal import Decimal
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import claims
import made_diagnosis as made
import numpy as np
import pytest
import written_fits
from presentation import an, distinct_numbers, humanize, joined, unseen
from steps import (
    ChannelError,
    Errors,
    Refusal,
    Remaining,
    SignalForm,
    Stage,
    caution_words,
    change_words,
    diagnosis_page,
    log_rows,
    missing_figure,
    missing_words,
    own_effect,
    place_words,
    ranking_figure,
    sized_words,
    stage_words,
    stages_figure,
)

import diffthrust as dft
from diffthrust.effects import EFFECTS


@pytest.fixture(scope="module")
def full() -> dft.diagnosis.Diagnosis:
    return made.diagnosis()


@pytest.fixture
def sketched(monkeypatch):
    """Pages whose figures are made but not painted, which takes nine tenths of a page's time."""
    monkeypatch.setattr("diffthrust._support.page.image", lambda draw: str(id(unseen(draw))))
    monkeypatch.setattr("diffthrust._support.page._living", lambda picture: None)


# -- words -----------------------------------------------------------------------------------------


SNAPSHOTS = Path(__file__).with_name("reports")
"""Reports as they were approved; DIFFTHRUST_APPROVE=1 writes them again."""
REPORTS = {
    "found": made.found,
    "full": made.diagnosis,
    "adequate": made.adequate,
    "unexplained": made.unexplained,
    "nothing_tried": lambda: replace(made.adequate(), silent=()),
    "nothing_testable": lambda: replace(
        made.adequate(), silent=(), untestable={"inflow": "no log has it"}
    ),
    "place_unclear": lambda: replace(made.unexplained(), remaining=None),
    "grown_errors": lambda: replace(made.found(), one_step={"speed": 0.01}),
    "refused": lambda: replace(made.found(), refused={"actuator_lag": Refusal.UNSEEN_LOGS}),
}


DECIMAL = re.compile(r"(\d+\.\d+(?:e[+-]\d+)?)")


def assert_approved(name: str, text: str) -> None:
    """A text is that of the file, line by line; decimals to one in their last digit.

    On one machine all digits agree. On another, BLAS and XLA may add up in another order, which
    moves a fit by some 1e-9 and can so tip what is rounded, but neither a count nor a line break.
    """
    path = SNAPSHOTS / f"{name}.txt"
    if os.environ.get("DIFFTHRUST_APPROVE"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    shown, approved = (t.splitlines() for t in (text, path.read_text(encoding="utf-8")))
    assert [DECIMAL.sub("#.#", line) for line in shown] == [
        DECIMAL.sub("#.#", line) for line in approved
    ]
    for line, expected in zip(shown, approved, strict=True):
        for found, number in zip(DECIMAL.findall(line), DECIMAL.findall(expected), strict=True):
            last_digit = Decimal(1).scaleb(Decimal(number).as_tuple().exponent)
            assert abs(Decimal(found) - Decimal(number)) <= last_digit, (expected, line)


@pytest.mark.parametrize("name", REPORTS)
def test_a_report_reads_as_approved(name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert_approved(name, REPORTS[name]().report())


def test_the_summary_has_the_errors_of_the_fits(full):
    baseline, updated = (stage.fit.holdout for stage in full.stages[:2])
    assert baseline is not None
    assert updated is not None
    for name, unit in (("speed", "rad/s"), ("thrust", "N")):
        sizes = re.search(
            rf"{name} error.*? from (\S+) to (\S+) {unit} \(NRMSE (\S+) to (\S+)\)",
            made.found().details,
        )
        assert sizes is not None
        exact = [
            *(e.channels[name].rmse for e in (baseline, updated)),
            *(e.channels[name].nrmse for e in (baseline, updated)),
        ]
        np.testing.assert_allclose([float(x) for x in sizes.groups()], exact, rtol=0.05)


def test_an_error_that_rises_is_said_to_rise(full):
    channels = full.stages[0].fit.holdout.channels.items()
    larger = {name: replace(e, rmse=3 * e.rmse, nrmse=3 * e.nrmse) for name, e in channels}
    assert "rises from" in made.with_fit(made.found(), holdout=Errors(9.0, larger)).details


@pytest.mark.parametrize(
    ("first", "last", "said"),
    [
        (3.4, 0.41, "falls from 3.4 to 0.41"),
        (3.4, np.inf, "rises from 3.4 to inf"),
        (3.4, np.nan, "goes from 3.4 to -"),
        (np.nan, 3.4, "goes from - to 3.4"),
        (3.4, 3.4, "stays at 3.400"),
    ],
)
def test_an_error_that_is_no_number_neither_falls_nor_rises(first, last, said):
    assert change_words(first, last) == said


def test_a_fit_that_may_not_claim_its_numbers_is_noted(full, sketched):
    message = "The error still falls."
    diag = made.with_fit(full, status=dft.estimation.Status.NOT_CONVERGED, message=message)
    stage = "The fit of stage 2 (+ actuator lag) has the status"
    words = f"{stage} 'not_converged': The error still falls."
    answer = " ".join(diag.report().partition("Details")[0].split())
    assert words in answer
    assert words not in " ".join(caution_words(diag))  # once is enough
    top = diagnosis_page(diag).replace("&#39;", "'").partition("<details>")[0]
    assert words in top
    lines = diag.summary.splitlines()
    assert "Caution: the last fit did not converge." in lines
    assert "Next: fit again, from more starts or with constants held that you know." in lines
    assert sum(line.startswith("Perhaps: ") for line in lines) == 2
    assert not any(line.startswith(("Found: ", "Copy: ")) for line in lines)
    assert claims.contradictions(diag, text=diag.summary) == []
    diag = made.with_fit(full, status=dft.estimation.Status.CONVERGED, message=message)
    assert claims.contradictions(diag, text="\n".join(lines)) != []


def test_a_page_begins_with_the_answer_and_the_lines_to_copy_and_folds_all_tables(full, sketched):
    top, _, rest = diagnosis_page(full, spec="model = 1").partition("<details>")
    assert "Copy: effects = [" in top
    assert "[parameters]" in top.partition("To copy into a spec file:")[2]
    assert "<table" not in top
    opened = 1 + rest.count("<details>")
    assert opened == rest.count("</details>") > 10
    for part in rest.split("</details>")[1:]:
        assert "<table" not in part.partition("<details>")[0]


def test_a_hint_on_a_channel_comes_into_the_summary(full):
    (unseen,) = full.before.runs
    flipped = dft.Log(
        unseen.time, unseen.log.inputs, {"speed": -np.asarray(unseen.log.measured["speed"])}
    )
    diag = replace(made.unexplained(), before=dft.compare(full.fit, flipped))
    assert diag.before.hints
    assert "A channel may not mean what its name says" in diag.details
    assert diag.before.hints[0] in diag.details


def test_the_missing_signal_in_words(full):
    time, signal, _ = full.missing[1].runs[0]
    sure = replace(full.missing[1], runs=((time, signal, np.full(time.size, 1.0)),))
    sentences = [missing_words(missing, full.model) for missing in (*full.missing, sure)]
    assert_approved("missing_signals", "\n".join(sentences) + "\n")


def test_places_and_stages(full):
    assert place_words(full.model, "speed") == "the measured speed (its sensor)"
    assert place_words(full.model, "command") == "the recorded command"
    assert [stage_words(full, i) for i in range(3)] == [
        "as given", "+ command dead band", "+ actuator lag",
    ]  # fmt: skip
    swapped = replace(full.stages[2], effects=("actuator_lag",))
    diag = replace(full, stages=(*full.stages[:2], swapped))
    assert stage_words(diag, 2) == "+ actuator lag, - command dead band"


def test_an_effect_of_several_parameters_names_each(full):
    freed = full.fit.parameters["command_deadband.restored"]
    parameters = {
        **full.fit.parameters, "command_deadband.restored": replace(freed, value=0.5, fixed=False),
    }  # fmt: skip
    words = sized_words("command_deadband", replace(full.fit, parameters=parameters))
    assert words == "a command dead band (half-width 0.399 V, restored 0.50)"
    assert sized_words("swapped_thrusters", full.fit) == "swapped thrusters"


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_has_words(name):
    words = an(humanize(name))
    assert "_" not in words
    assert words.split()[0] in ("a", "an") or words == humanize(name)


def test_phrases():
    assert an("Coulomb friction") == "Coulomb friction"
    assert joined(["a", "b", "c"], "or") == "a, b or c"
    assert joined([]) == ""
    assert distinct_numbers(5.6, 0.3) == ("5.6", "0.30")
    assert distinct_numbers(0.3121, 0.3119) == ("0.3121", "0.3119")


# -- an effect of one's own ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("port", "signal", "manner"),
    [
        ("load", SignalForm("speed"), "adds"), ("drive", SignalForm("command"), "adds"),
        ("propeller", SignalForm("speed"), "adds"), ("shaft", SignalForm("time"), "adds"),
        ("shaft", SignalForm("speed", rate=True), "adds"),
        ("command", SignalForm("command"), "adds"), ("drive", SignalForm("time"), "scales"),
        ("propeller", SignalForm("speed", past=1.0), "scales"),
    ],
)  # fmt: skip
def test_the_skeleton_runs_and_does_nothing_at_its_null(full, port, signal, manner):
    code = own_effect(full.fit.model, Remaining(port, signal, 0.5, manner), full.missing)
    scope: dict = {}
    exec(code, scope)
    effect = scope["MyEffect"]()
    assert effect.port == port
    log = full.before.runs[0].log
    model = full.fit.model
    plain, same = (dft.simulate(m, log)["thrust"] for m in (model, model + effect))
    np.testing.assert_allclose(same, plain, rtol=1e-12, atol=1e-12)  # compiled anew: to rounding
    moved = dft.simulate(model + scope["MyEffect"](strength=0.3), log)["thrust"]
    assert not np.allclose(plain, moved)
    assert '"actuator_lag", "my_effect.py:MyEffect"' in code


def test_the_skeleton_has_the_unit_of_its_strength(full):
    def unit(left):
        return re.search('unit="(.*?)"', own_effect(full.fit.model, left, full.missing))[1]

    assert unit(full.remaining) == "(rad/s^2)/(rad/s)"
    assert unit(Remaining("propeller", SignalForm("command"), 0.5)) == "N/V"
    assert unit(Remaining("propeller", SignalForm("command"), 0.5, "scales")) == "1/V"
    assert "class MyEffect" not in made.found().report()


# -- tables ----------------------------------------------------------------------------------------


def test_the_errors_of_every_log_are_told(full):
    train, unseen = made.logs()
    held = [dft.compare(stage.fit, train) for stage in (full.stages[0], full.stages[-1])]
    rows = log_rows(replace(full, trained=tuple(held)))
    told = [row[:2] for block in rows.blocks for row in block if row[0]]
    assert told == [(unseen.name, "unseen"), (train.name, "training")]


# -- figures ---------------------------------------------------------------------------------------


def test_the_figure_of_the_stages(full):
    figure = full.plot()
    falling, command, *traces = figure.axes
    assert command.get_ylabel() == "command\n[V]"
    assert falling.get_ylabel() == "NRMSE [-]"
    lines = {line.get_label(): line.get_ydata() for line in falling.get_lines()}
    assert list(lines) == ["speed, training", "speed, unseen", "thrust, training", "thrust, unseen"]
    held = [stage.holdout.channels["speed"].nrmse for stage in full.stages if stage.holdout]
    np.testing.assert_allclose(lines["speed, unseen"], held)
    ticks = [tick.get_text().replace("\n", " ") for tick in falling.get_xticklabels()]
    assert ticks == ["as given", "+ command dead band", "+ actuator lag"]
    assert [panel.get_ylabel() for panel in traces] == ["speed [rad/s]", "thrust [N]"]
    assert traces[-1].get_xlabel() == "time [s]"
    (legend,) = (one for part in figure.subfigs for one in part.legends)
    assert [t.get_text() for t in legend.get_texts()] == [
        "measured",
        "model as given",
        "last stage",
    ]
    figure.savefig(BytesIO(), dpi=40)


def test_with_one_stage_nothing_falls():
    figure = stages_figure(made.adequate())
    labels = [panel.get_ylabel() for panel in figure.axes]
    assert labels == ["command\n[V]", "speed [rad/s]", "thrust [N]"]
    assert "training log" in figure.axes[0].get_title(loc="left")


def test_a_failed_simulation_and_a_formula_in_a_name_can_be_drawn(full):
    (run,) = full.before.runs
    endless = {
        name: replace(trace, modelled=np.full(run.time.size, np.inf))
        for name, trace in run.channels.items()
    }
    errors = Errors(np.inf, {n: ChannelError(np.inf, np.inf, -np.inf, 9) for n in endless})
    failed = replace(run, name="run $x_$", channels=endless, errors=errors)
    before = replace(full.before, runs=(failed,), errors=errors)
    diag = made.with_fit(replace(full, before=before), 0, holdout=errors, train=errors)
    stages_figure(diag).savefig(BytesIO(), dpi=40)
    assert "falls from inf to" in diag.details


def test_the_figure_of_the_missing_signal(full):
    time, curve = missing_figure(full).axes  # at the other port nothing shows
    assert time.get_xlabel() == "time [s]"
    assert time.get_ylabel() == "drive [rad/s^2]"
    assert curve.get_xlabel() == "command [V]"
    assert "91 %" in curve.get_title(loc="left")
    assert len(time.collections) == 1  # the band
    known, other = full.missing
    ((at, signal, _),) = other.runs
    sure = replace(other, runs=((at, signal, np.full(at.size, 0.01)),))
    *_, panel = missing_figure(replace(full, missing=(known, sure))).axes
    assert panel.texts[0].get_text() == "no signal of the model explains it"


def test_the_figure_of_the_ranking(full):
    first, second = ranking_figure(full).axes
    assert [t.get_text() for t in first.get_yticklabels()] == ["command dead band", "actuator lag"]
    assert second.get_xlabel() == "likelihood ratio [-]"
    colours = [patch.get_facecolor() for patch in (*first.patches, *second.patches)]
    assert len(set(colours)) == 3  # added, neither, and not to be told from the added one
    assert colours[0] == colours[2]


# -- the page --------------------------------------------------------------------------------------


class _Page(HTMLParser):
    """Open tags, what they refer to, and the text."""

    void = ("meta", "link", "img", "br", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.sources += [value for key, value in attrs if key in ("src", "href")]
        assert tag != "img" or dict(attrs)["alt"]
        if tag not in self.void:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["script"]:
            self.text += data


@pytest.mark.thorough
def test_the_page_is_whole_and_needs_nothing_else(full, tmp_path):
    path = tmp_path / "report.html"
    full.save(str(path))
    text = path.read_text(encoding="utf-8")
    found = _Page(text)
    assert found.open == []
    assert found.tags.count("img") == 5
    assert all(source.startswith("data:") for source in found.sources)
    order = [
        full.details, "Stages", "Where the model as given fails", "Errors by log", "Missing signal",
        "Effects tried, each fitted to one-step errors",
        "The motor controller ignores small commands.",
        "What these logs cannot tell apart", "Proposed test", "What remains", "class MyEffect",
        "Parameters", "Not testable by these logs", "How far to trust this", "Words",
    ]  # fmt: skip
    places = [found.text.find(word) for word in order]
    assert -1 not in places
    assert places == sorted(places)


def test_the_headroom_is_told_before_and_after(full, sketched):
    train, _ = made.logs()
    assert full.headroom is None  # put together by hand, without the training logs
    assert "Room for improvement" not in diagnosis_page(full)
    trained = tuple(dft.compare(full.stages[i].fit, train) for i in (0, -1))
    whole = replace(full, trained=trained)
    first, last = whole.headroom
    assert first.worth
    assert first.channels["thrust"].share > 0.3 > 0.1 > last.channels["thrust"].share
    assert "Room for improvement" in whole.report()
    text = diagnosis_page(whole)
    assert text.index("<h2>Stages") < text.index("<h2>Room for improvement")
    assert first.summary not in _Page(text).text  # the table has its numbers
    assert first.channels["thrust"].cells[2] in _Page(text).text
    assert whole.to_json()["headroom"]["before"]["worth"] is True


def test_the_page_escapes_what_comes_from_outside(full, sketched):
    text = diagnosis_page(full, title=made.NASTY, spec=f"# {made.NASTY}")
    assert "<script" not in text
    assert text.count("&lt;script&gt;alert(1)&lt;/script&gt;") >= 4  # title, heading, log, spec


@pytest.mark.parametrize("kind", ["found", "adequate", "unexplained"])
def test_every_verdict_has_its_page(kind, sketched):
    diag = getattr(made, kind)()
    found = _Page(diagnosis_page(diag))
    assert found.open == []
    assert diag.details in found.text
    assert ("Missing signal" in found.text) == bool(diag.missing)
    assert ("class MyEffect" in found.text) == (kind == "unexplained")


def test_the_page_of_a_diagnosis_in_which_no_signal_is_missing(full, sketched):
    text = _Page(diagnosis_page(replace(full, missing=full.missing[1:]))).text
    assert "Missing signal" in text
    assert "a band of two standard errors" not in text  # the caption of the figure


def test_the_page_is_part_of_the_package():
    from importlib.resources import files

    assert files("diffthrust._support").joinpath("page.html").is_file()


@pytest.mark.thorough
def test_figures_do_not_touch_pyplot(full, monkeypatch):
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)  # ArviZ brings it along
    diagnosis_page(full)
    assert "matplotlib.pyplot" not in sys.modules


def test_parameters_in_json_are_in_their_unit_and_as_the_log_was_written(full):
    fit = written_fits.fit()
    tried = replace(
        full.ranking[0], parameters={"half_width": fit.parameters["command_deadband.half_width"]}
    )
    diag = replace(full, stages=(*full.stages[:1], Stage(("x",), fit)), ranking=(tried,))
    data = json.loads(json.dumps(diag.to_json()))
    stage, width = data["stages"][1]["parameters"], fit.parameters["command_deadband.half_width"]
    assert stage == json.loads(json.dumps(fit.to_json()))["parameters"]
    assert stage["command_deadband.half_width"]["written"]["unit"] == "us"
    assert data["ranking"][0]["parameters"]["half_width"] == {
        "value": width.value,
        "unit": "effort",
        "written": {"value": 400 * width.value, "unit": "us"},
    }


def test_missing_signals_are_told_and_drawn_in_the_units_of_the_logs(full, sketched):
    fit = written_fits.fit()
    known, time = full.missing[0], np.arange(4.0)
    push = (time, np.array([3.0, -3.0, 3.0, -3.0]), np.full(4, 0.1))
    curve = np.array([-0.5, 0.0, 0.5]), np.array([-1.0, 0.0, 1.0]), np.full(3, 0.1)
    thrust = replace(
        known, port="propeller", unit="N", runs=(push,), dependence_unit="effort", curve=curve
    )
    rate = replace(
        known, port="loop", runs=(push,), signal=SignalForm("speed", rate=True),
        dependence_unit="rad/s/s", curve=curve,
    )  # fmt: skip
    diag = replace(
        full, model=fit.model, stages=(Stage((), fit),), missing=(thrust, rate), remaining=None
    )
    told = diag.report()
    assert "a signal of 0.31 kgf (RMS)" in told
    assert "a signal of 3.0 rad/s^2 (RMS)" in told
    assert " N (RMS)" not in told
    assert "0.31 kgf" in diagnosis_page(diag)
    first, over, _, over_rate = missing_figure(diag).axes
    assert (first.get_ylabel(), over.get_ylabel()) == ("propeller [kgf]", "propeller [kgf]")
    assert (over.get_xlabel(), over_rate.get_xlabel()) == ("command [us]", "d(speed)/dt [rpm/s]")
    drawn = over.get_lines()[1].get_xydata()
    np.testing.assert_allclose(drawn[:, 0], [1300.0, 1500.0, 1700.0])
    np.testing.assert_allclose(drawn[:, 1], [-written_fits.KGF, 0.0, written_fits.KGF])
    np.testing.assert_allclose(
        over_rate.get_lines()[1].get_xdata(), written_fits.RPM * curve[0], rtol=1e-12
    )
