"""Pages of reports in a real browser: figures that live, and pictures where they cannot."""

from __future__ import annotations

import re
import sys
from contextlib import contextmanager
from pathlib import Path

import chromium
import made_diagnosis as made
import numpy as np
import pytest
from chromium import NEEDED
from places import ROOT

import diffthrust as dft
from diffthrust.comparison._page import write_comparison_page  # private: what `--report` writes

LARGEST = 3_000_000  # bytes of a page
SHOWN = '(() => Bokeh.documents[0].get_model_by_name("shown").data)()'
SIGHTS = """[...Bokeh.documents[0]._all_models.values()]
  .filter(model => model.type == "Figure" && model.x_range.type == "Range1d")
  .map(model => [model.x_range.start, model.x_range.end])
"""
"""From when to when each plot shows its log."""


def written(path: Path, comparison: dft.comparison.Comparison) -> Path:
    write_comparison_page(path, title=path.stem, spec="", comparisons={"logs": comparison})
    return path


@contextmanager
def looked_at(path: Path, width: int = 1280, **options):
    window = {"width": width, "height": 1000}
    with chromium.looked_at(path.as_uri(), "file://", viewport=window, **options) as page:
        if options.get("java_script_enabled", True):
            page.wait_for_selector(".live:not([hidden]) canvas")
            page.wait_for_function("() => Bokeh.documents[0].is_idle")
        yield page


def first_plot(page) -> tuple[float, float]:
    """Left edge and middle of the plot of the first channel, which has a legend of two lines."""
    plot = page.locator(".live canvas").nth(4)
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    return box["x"], box["y"] + box["height"] / 2


@pytest.mark.thorough
def test_a_page_of_the_bench_is_small_and_refers_to_nothing(tmp_path):
    dft.look(ROOT / "examples" / "bench").save_spec(tmp_path / "fit.toml")
    spec = dft.load_spec(tmp_path / "fit.toml")
    fit = dft.fit(spec.model, spec.train_logs(), starts=1)
    comparison = dft.compare(fit, spec.train_logs() + spec.holdout_logs())
    assert_small_and_whole(written(tmp_path / "bench.html", comparison))


def assert_small_and_whole(page: Path) -> None:
    """A page that may be sent: of few bytes, and without an address of another file."""
    assert page.stat().st_size < LARGEST
    text, scripts = re.subn("<script.*?</script>", "", page.read_text("utf-8"), flags=re.DOTALL)
    assert scripts == 3  # the figure, Bokeh, and what brings both together
    assert not re.search(r'(src|href)="(?!data:)', text)


def large_log() -> dft.Log:
    """A log of 100 000 samples with a spike of one of them."""
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(100_000)
    command = np.repeat(rng.uniform(-2.0, 2.0, 500), 200)
    speed = 40.0 * command + 0.1 * rng.standard_normal(time.size)
    speed[54_321] = 999.0
    units = {"command": "V", "speed": "rad/s"}
    return dft.Log(time, {"command": command}, {"speed": speed}, units=units, name="large.csv")


def test_a_large_log_is_thinned_without_losing_a_spike(tmp_path):
    from diffthrust.comparison._run_plots import live_runs  # private: the figure of the page

    comparison = dft.compare(dft.Thruster(), large_log())
    assert_small_and_whole(written(tmp_path / "large.html", comparison))
    live = live_runs({"as given": comparison.runs})
    assert live is not None
    assert np.nanmax(live.shown.data["measured0"]) == 999.0
    assert live.shown.data["time"].size < 25_000
    assert "each 17 samples" in live.remark


@pytest.mark.thorough
def test_where_bokeh_is_not_installed_pictures_are_shown(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "bokeh"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "diffthrust.comparison._run_plots", raising=False)
    monkeypatch.delitem(sys.modules, "diffthrust._support.plots", raising=False)
    monkeypatch.setitem(sys.modules, "bokeh", None)
    text = written(tmp_path / "a.html", made.found().before).read_text("utf-8")
    assert "<script" not in text
    assert "data:image/png;base64," in text


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    made.diagnosis().save(path, title=made.NASTY, spec=f"# {made.NASTY}")
    return path


@pytest.mark.thorough
@NEEDED
def test_stages_are_switched_and_the_error_falls(report):
    fits, unseen = [stage.fit for stage in made.diagnosis().stages], made.logs()[1]
    errors = [dft.compare(fit, unseen).errors.channels["speed"].rmse for fit in fits]
    labels = ["as given", "1: + command dead band", "2: + actuator lag"]
    with looked_at(report) as page:
        assert page.get_by_label(labels[-1]).is_checked()
        for label, error in zip(labels, errors, strict=True):
            page.get_by_label(label).check()
            drawn = np.array(page.evaluate(f"[...{SHOWN}.residual0]"))
            assert np.sqrt(np.mean(drawn**2)) == pytest.approx(error, rel=1e-3)
    assert errors[0] > 2 * errors[1]


@pytest.mark.thorough
@NEEDED
def test_a_drag_zooms_all_plots_and_two_taps_go_back(report):
    with looked_at(report) as page:
        whole = page.evaluate(SIGHTS)
        assert whole == [[0, 30]] * 5  # command, channels, residuals
        left, middle = first_plot(page)
        page.mouse.move(left + 200, middle)
        page.mouse.down()
        page.mouse.move(left + 400, middle, steps=4)
        page.mouse.up()
        start, end = page.evaluate(SIGHTS)[0]
        assert 0 < start < end < 25
        assert page.evaluate(SIGHTS) == [[start, end]] * 5
        page.mouse.dblclick(left + 300, middle)
        assert page.evaluate(SIGHTS) == whole


@pytest.mark.thorough
@NEEDED
def test_the_mouse_is_told_values_with_their_units(report):
    with looked_at(report) as page:
        left, middle = first_plot(page)
        page.mouse.move(left + 300, middle)
        page.get_by_text(re.compile(r"^-?[\d.]+ rad/s$")).first.wait_for()
        page.get_by_text(re.compile(r"^[\d.]+ s$")).first.wait_for()


@pytest.mark.thorough
@NEEDED
@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_the_page_fits_a_window(report, width):
    with looked_at(report, width) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("img").first.is_hidden()
        touched = "element => getComputedStyle(element).touchAction"
        assert "pan-y" in page.locator(".bk-events").first.evaluate(touched)
        assert made.diagnosis().summary.splitlines()[0] in page.inner_text("body")


@pytest.mark.thorough
@NEEDED
def test_paper_has_pictures(report):
    with looked_at(report) as page:
        page.emulate_media(media="print")
        assert page.locator("img").first.is_visible()
        assert page.locator(".live").first.is_hidden()


@pytest.mark.thorough
@NEEDED
def test_without_scripts_there_are_pictures(report):
    with looked_at(report, java_script_enabled=False) as page:
        assert page.locator("img").first.is_visible()
        assert page.locator(".live").first.is_hidden()


@pytest.mark.thorough
@NEEDED
def test_names_are_text_and_logs_are_switched(tmp_path):
    names = [made.NASTY, "</script><img src=x onerror=alert(1)>", "b & $$x$$ @time"]
    logs = [log.replaced(name=n) for n, log in zip(names, made.logs() * 2, strict=False)]
    page_file = written(tmp_path / "a.html", dft.compare(made.found().fit, logs))
    with looked_at(page_file) as page:
        for name in names:
            page.get_by_label(name, exact=True).check()
            assert page.evaluate(f"{SHOWN}.time.length") == logs[0].time.size
        assert not page.evaluate("document.querySelectorAll('img[src=x]').length")
