"""The page without a browser: what its parts show of results, and what becomes of late answers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import example_names
import made_diagnosis
import numpy as np
import pytest
from bokeh.document import Document
from matplotlib.colors import to_hex

import diffthrust as dft
from diffthrust._support.plots import plot  # private: a figure of the page
from diffthrust.comparison._regimes import Regime, SignalRange  # private: what is shaded
from diffthrust.diagnosis._explained_share import Worth  # private: what an effect removes
from diffthrust.diagnosis._findings import HeldValue  # private: what is said of constants
from diffthrust.logs import PWM, Written
from diffthrust.logs._written import ShownUnits  # private: what the page takes from runs
from diffthrust.workbench._controls import CONSTANTS, Controls  # private: a part of the page
from diffthrust.workbench._page import Page  # private: what `explore` shows
from diffthrust.workbench._results import Results  # private: a part of it
from diffthrust.workbench._session import Session, Step, Task  # private: what the page shows
from diffthrust.workbench._source import opened  # private: `explore` opens by it


class Ticking(Document):
    """A document whose next ticks come when a test asks for them."""

    def __init__(self) -> None:
        super().__init__()
        self.ticks: list[Callable[[], Any]] = []

    def add_next_tick_callback(self, callback: Any) -> Any:
        self.ticks.append(callback)

    def run_until(self, holds: Callable[[], bool]) -> None:
        """Let everything that was worked out arrive, until something holds."""
        end = time.monotonic() + 120
        while not holds():
            assert time.monotonic() < end
            ticks, self.ticks = self.ticks, []
            for tick in ticks:
                tick()
            time.sleep(0.01)


@pytest.fixture
def page():
    session = Session(opened(example_names.fit()))
    page = Page(Ticking(), session, session.task.compare())
    yield page
    page.close()


def test_a_slider_is_followed_and_its_release_can_be_undone(page):
    before = page.plots.drawn.data["modelled0"].copy()
    page._slide("alpha", 0.05)
    page.document.run_until(lambda: (page.plots.drawn.data["modelled0"] != before).any())
    assert not page.session.setup.moved  # until it is let go
    page._release()
    assert page.session.setup.values["alpha"] == 0.05
    assert not page.undoing.disabled
    page.edit(page.session.undo)
    assert page.session.fitted


def test_the_error_that_sliders_made_is_within_the_picture(page):
    results, steps = page.results, page.session.staircase
    results.show_steps(steps, 0.5, 9.0, unseen=True)
    assert (results.now.location, results.stairs.heights.end) == (9.0, pytest.approx(10.8))
    assert results.now_label.text == "sliders: 9"
    results.show_steps(steps, 0.5, None, unseen=False)
    assert results.stairs.heights.end == pytest.approx(1.2 * steps[0].unseen)
    assert results.now_label.text == ""
    assert "fitted logs" in results.stairs.figure.yaxis[0].axis_label.text


def test_the_staircase_begins_with_the_model_as_opened_hatched_until_it_is_fitted():
    results, fit = Results(lambda samples: None), example_names.fit()
    results.show_steps([Step("command_deadband", fit)], 0.5, None, unseen=True)
    steps = results.stairs.steps.data
    assert (steps["error"][0], steps["hatch"]) == (0.5, ["/", " "])
    assert "as opened" in steps["step"][0]
    results.show_steps([Step("", fit)], 0.5, None, unseen=True)
    assert results.stairs.steps.data["hatch"] == [" "]
    assert not results.stairs.empty.visible
    results.show_steps([], np.nan, None, unseen=True)
    assert results.stairs.empty.visible


def test_what_was_selected_stays_lit_in_plots_and_scatter_once_another_model_is_drawn(page):
    page.select(1.0, 3.0)
    lit = page.results.points.selected.indices
    assert len(lit) > 20
    page._compared(page.session.task, page.comparison)
    assert page.results.points.selected.indices == lit
    assert page.stretch == (1.0, 3.0)
    page.plots.light_up(page.run.time < page.run.time[5])
    page._compared(page.session.task, page.session.task.compare())
    assert page.plots.lit.data["time"].size == 5
    assert page.plots.brushed.data == {"x0": [1.0], "x1": [3.0]}
    page._show_log(1)
    assert not page.results.points.selected.indices


def test_start_values_are_called_so_until_they_are_fitted(page):
    page.session.tick("command_deadband")
    page._show_state()
    assert "not fitted yet: start values" in page.title.text


def test_an_answer_for_a_model_that_was_left_is_dropped(page):
    task, comparison = page.session.task, page.comparison
    page.session.tick("command_deadband")
    page._compared(task, comparison)
    assert page._like(page.session.setup) is None  # sliders sleep until the new model has answered


def test_where_another_model_fails_is_not_shaded_until_it_is_known(page):
    everywhere = SignalRange("speed", -np.inf, np.inf, "rad/s")
    page._found_regimes((Regime("speed", (everywhere,), 0.9, 0.5, 0.001),))
    assert page.fails.children
    page._compared(page.session.task, page.comparison)
    assert not page.fails.children
    assert not any(source.data["x0"] for source in page.plots.failing.values())


def test_a_refused_change_is_said_and_changes_nothing(page):
    page.edit(lambda: page.session.shift(0.1))
    assert "expected channels to shift" in page.progress.text
    page.diagnose_stretch()
    assert "Select a stretch first" in page.progress.text


def test_what_waits_for_stopped_work_says_so_and_what_is_stopped_ends(page):
    begun, ended = threading.Event(), []
    ends = [threading.Event(), threading.Event()]

    def work(k, report):
        begun.set()
        assert ends[k].wait(120)
        report("on", 0.5)  # raises: it was stopped

    page._ask(partial(work, 0), ended.append, "looking")
    assert "looking" in page.progress.text
    assert begun.wait(120)
    page._stop()
    page._ask(partial(work, 1), ended.append, "fitting")
    assert "waiting until the stopped work lets go" in page.progress.text
    begun.clear()
    ends[0].set()
    page.document.run_until(lambda: "fitting" in page.progress.text)
    assert begun.wait(120)
    page._stop()
    ends[1].set()
    page.document.run_until(lambda: "stopped" in page.progress.text)
    assert page.stopping.disabled
    assert not ended


def test_a_diagnosis_waits_for_the_fit_that_is_made_and_says_so(page, monkeypatch):
    begun, end, asked = threading.Event(), threading.Event(), []
    fit = page.session.fit
    page._diagnosed = lambda task, diagnosis: asked.append(diagnosis)

    def fitting(task, progress):
        begun.set()
        assert end.wait(120)
        progress("on", 0.5)  # raises where it was stopped
        return fit

    monkeypatch.setattr(Task, "fit", fitting)
    monkeypatch.setattr(Task, "diagnose", lambda task, start, progress: start)
    page._fit()
    assert begun.wait(120)
    page._in_turn("looking for what is missing", page._diagnose)
    assert "Then: looking for what is missing" in page.progress.text
    end.set()
    page.document.run_until(lambda: bool(asked))
    assert asked == [fit]  # it begins with what was fitted


def test_a_tick_stops_no_diagnosis_and_is_fitted_after_it(page, monkeypatch):
    end, diagnosed, fitted = threading.Event(), [], []
    page._diagnosed = lambda task, diagnosis: diagnosed.append(diagnosis)
    page._fitted = lambda task, fit: fitted.append(fit)

    def diagnosing(task, start, progress):
        assert end.wait(120)
        progress("on", 0.5)  # raises where it was stopped
        return start

    monkeypatch.setattr(Task, "diagnose", diagnosing)
    monkeypatch.setattr(Task, "fit", lambda task, progress: task.setup.effects)
    page._diagnose()
    assert page.diagnosing.disabled
    page.edit(partial(page.session.tick, "command_deadband"))
    assert "Then: fitting. Stop ends both." in page.progress.text
    end.set()
    page.document.run_until(lambda: bool(fitted))
    assert len(diagnosed) == 1
    assert fitted == [("command_deadband",)]


@pytest.mark.thorough
def test_a_save_stops_nothing_and_is_not_lost_to_a_tick(page, tmp_path):
    begun, end, ended = threading.Event(), threading.Event(), []

    def diagnosing(report):
        begun.set()
        assert end.wait(120)
        report("on", 0.5)  # raises where it was stopped

    page._ask(diagnosing, ended.append, "looking")
    assert begun.wait(120)
    page.tools.folder.value = str(tmp_path / "explored")
    page.tools.save()
    page.long.ask(lambda _: None, ended.append, page._failed)  # what waits gives way to it
    assert page.tools.saver.label == "Save"
    page.document.run_until(lambda: "Saved in" in page.tools.said.text)
    assert (tmp_path / "explored" / "fit.json").is_file()
    assert page.tools.saver.label == "Overwrite"
    page.session.tick("command_deadband")
    page.tools.show()
    assert "not the one that was saved in" in page.tools.said.text
    page.session.undo()
    assert not ended
    end.set()
    page.document.run_until(lambda: len(ended) == 2)
    (tmp_path / "file").touch()
    page.tools.folder.value = str(tmp_path / "file" / "explored")
    page.tools.save()
    page.document.run_until(lambda: "cannot be made" in page.tools.said.text)


def in_pulses() -> dft.Log:
    """A log whose file has its command in pulses, and its speed in turns a minute."""
    time = np.linspace(0.0, 4.0, 81)
    units = {"command": "effort", "speed": "rad/s"}
    ways = {"command": Written("us", "pwm", PWM(1500.0, 1900.0)), "speed": Written("rpm", "rpm")}
    inputs, measured = {"command": np.sin(time)}, {"speed": 90 * np.sin(time)}
    return dft.Log(time, inputs, measured, units=units, written=ways)


def test_a_command_in_pulses_is_in_the_scatter_as_in_its_plot():
    model = dft.SpeedLoopThruster(command="effort")
    results = Results(lambda samples: None)
    results.show_run(model, dft.compare(model, in_pulses()).runs[0])
    assert results.signal.value == "command"
    assert results.points.data["x"].max() == pytest.approx(1900.0, abs=1.0)
    results.signal.value = "|command|"  # a size has no other zero
    assert results.points.data["x"].max() == pytest.approx(400.0, abs=1.0)


@pytest.mark.thorough
def test_the_learned_law_and_the_next_experiment_are_drawn():
    results = Results(lambda samples: None)
    full = made_diagnosis.diagnosis()
    results.show_diagnosis(full)
    drawn = [part.text for part in (results.learned, results.experiment)]
    assert [text.count("data:image/png") for text in drawn] == [
        int(bool(full.laws)),
        int(full.experiment is not None),
    ]
    assert sum(text.count("data:image/png") for text in drawn) > 0


@pytest.mark.thorough
def test_a_stretch_is_ranked_effect_by_effect():
    results = Results(lambda samples: None)
    results.show_stretch(made_diagnosis.found(), "run1.csv, 2 to 5 s")
    assert "command dead band" in results.stretch.text
    assert results.layout.active == 1


def test_names_of_users_are_text_on_the_page():
    log = example_names.log().replaced(name="<img src=x onerror=alert(1)>.csv")
    fit = dft.fit(dft.Thruster(), log, starts=1)
    session = Session(opened(dft.Thruster(), log))
    session.accept(session.task, fit)
    page = Page(Ticking(), session, session.task.compare())
    markup = [model.text for model in page.document.models if type(model).__name__ == "Div"]
    assert not any("<img src=x" in text for text in markup)
    page.close()


def test_a_page_has_the_colours_and_words_of_the_pictures(page):
    pairs = [line for axes in page.comparison.plot().axes for line in axes.get_lines()]
    drawn = {line.get_label(): to_hex(line.get_color()).upper() for line in pairs}
    figures = page.plots.figures
    glyphs = [r.glyph for f in figures for r in f.renderers if type(r.glyph).__name__ == "Line"]
    lines = {glyph.y: glyph.line_color.upper() for glyph in glyphs}
    assert lines["input0"] == drawn["_command"]
    assert lines["measured0"] == drawn["measured"]
    assert lines["modelled0"] == drawn["modelled"]
    assert lines["residual0"] == drawn["measured - modelled"]
    words = [item.label.value for f in figures for legend in f.legend for item in legend.items]
    assert words == ["measured", "modelled"]


def test_parameters_are_shown_in_the_units_of_the_report_and_moved_in_their_own():
    model = dft.Thruster() + "command_deadband" + "speed_sensor_offset"  # commanded in V
    controls, moved = controls_of(Session(opened(model, in_pulses())))
    controls.show(awake=True)
    width, offset = (
        controls._sliders[name][0]
        for name in ("command_deadband.half_width", "speed_sensor_offset.offset")
    )
    assert (width.title, width.start, width.value) == (
        "command dead band, half-width [us]", 0.0, pytest.approx(20.0)
    )  # fmt: skip
    assert offset.title == "speed sensor offset, offset [rpm]"
    width.value = 30.0
    assert moved == [("command_deadband.half_width", pytest.approx(0.075))]


def test_a_slider_stays_where_it_is_when_an_effect_is_added_and_says_how_sure_its_value_is():
    """Under an undo each value stood elsewhere on its slider, though it was the same."""
    session = Session(opened(example_names.fit()))
    controls, _ = controls_of(session)
    controls.show(awake=True)
    alpha = controls._sliders["alpha"][0]
    error = session.fit.parameters["alpha"].std_error
    assert alpha.title == f"alpha, propeller load [1/rad] (± {error:.2g})"
    ends = alpha.start, alpha.end
    session.tick("command_deadband")
    controls.show(awake=True)
    assert controls._sliders["alpha"][0] is alpha
    assert (alpha.start, alpha.end) == ends
    assert "±" not in alpha.title  # not fitted yet


def test_an_effect_whose_share_may_be_nothing_says_so_and_what_it_may_be_instead(monkeypatch):
    session = Session(opened(example_names.fit()))
    session.diagnosis = replace(
        made_diagnosis.found(), worth={"command_deadband": Worth(0.1, -0.05, 0.22)}
    )
    rival = {"command_deadband": "inflow"}
    monkeypatch.setattr("diffthrust.workbench._controls.unmeasured_rivals", lambda diagnosis: rival)
    controls, _ = controls_of(session)
    controls.show(awake=True)
    assert "command dead band: removes 10 %, perhaps none" in controls.boxes.labels
    assert "The inflow was not measured: it could look like this" in controls.about.text


def test_each_channel_has_a_colour_of_its_own_where_it_fails(page):
    everywhere = SignalRange("speed", -np.inf, np.inf, "rad/s")
    page._found_regimes(
        tuple(Regime(name, (everywhere,), 0.9, 0.5, 0.001) for name in ("speed", "thrust"))
    )
    words = [line.children[0].text for line in page.fails.children]
    colors = [page.plots.colors[name] for name in ("speed", "thrust")]
    assert len(set(colors)) == 2
    assert all(color in line for color, line in zip(colors, words, strict=True))


def test_no_place_of_the_error_is_said_only_where_it_was_looked_for_and_there_is_an_error(page):
    page._found_regimes(())
    (line,) = page.fails.children
    assert "No place is known where the error gathers" in line.text
    page._error = lambda comparison: np.nan  # the simulation fails
    page._found_regimes(())
    assert not page.fails.children
    page.regimes = None
    page._show_regimes()
    assert not page.fails.children


def test_a_residual_says_how_large_it_is(page):
    rmse = page.run.errors.channels["thrust"].rmse
    assert page.plots.sizes[1].text == f"measured - modelled, RMS {rmse:.3g} N"


def test_a_slider_ends_at_the_bounds_and_around_the_value_where_there_is_none():
    model = dft.Thruster(alpha=0.04) + "speed_sensor_offset"
    controls, _ = controls_of(Session(opened(model, example_names.log())))
    controls.show(awake=True)
    alpha, offset = (controls._sliders[n][0] for n in ("alpha", "speed_sensor_offset.offset"))
    assert (alpha.start, alpha.end) == (0.0, pytest.approx(0.12))
    assert (offset.start, offset.value, offset.end) == (-2.0, 1.0, 3.0)


def test_constants_are_listed_and_those_that_a_diagnosis_wants_elsewhere_are_found():
    session = Session(opened(dft.SpeedLoopThruster().fix("time_constant"), in_pulses()))
    controls, _ = controls_of(session)
    controls.show(awake=True)
    assert controls.boxes.labels == []
    diag = made_diagnosis.found()
    stages = (diag.stages[0], replace(diag.stages[0], effects=("time_constant",)))
    held = {"time_constant": HeldValue(0.2, 0.1, 0.01)}
    session.diagnosis = replace(diag, stages=stages, held=held, best=(), laws=())
    controls.show(awake=True)
    assert controls.boxes.labels == ["time constant"]
    assert "held at 0.2 s; these logs suggest 0.1" in controls.about.text
    controls.boxes.active = [0]
    assert session.setup.effects == ("time_constant",)
    session.undo()
    session.diagnosis = None
    controls.port.value = CONSTANTS
    assert controls.boxes.labels == ["time constant"]
    assert controls.boxes.active == []


def controls_of(session: Session) -> tuple[Controls, list[tuple[str, float]]]:
    """The controls of a session, and where they write what sliders are moved to."""
    moved: list[tuple[str, float]] = []
    controls = Controls(
        session,
        ShownUnits([log.written for log in session.source.train]),
        on_edit=lambda change: change(),
        on_slide=lambda name, value: moved.append((name, value)),
        on_release=lambda: None,
    )
    return controls, moved


def test_low_plots_have_three_ticks():
    tickers = [plot("speed", "", height=height).yaxis[0].ticker for height in (60, 170)]
    assert [ticker.desired_num_ticks for ticker in tickers] == [3, 6]
