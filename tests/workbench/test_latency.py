"""How soon the workbench follows: a slider from event to drawn, a long log opened and panned.

``pytest -m benchmark -s tests/workbench/test_latency.py``. Nothing here asserts a time. Beside the
clock stands the processor time, of Python and of the page: on a loaded machine it says more.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import example_names
import numpy as np
import pytest
from benchmarks.test_benchmarks import show
from bokeh.document import Document
from chromium import NEEDED

import diffthrust as dft
from diffthrust.workbench._page import Page  # private: what `explore` shows
from diffthrust.workbench._session import Session  # private: what the page shows
from diffthrust.workbench._source import opened  # private: `explore` opens by it
from tests.workbench.page import explored, looked_at

pytestmark = [pytest.mark.benchmark, NEEDED]

MOVES, FRAMES = 40, 60
PREPARE = """() => {
  const models = [...Bokeh.documents[0]._all_models.values()]
  const {PlotView} = Bokeh.require("models/plots/plot_canvas")
  const paint = PlotView.prototype._actual_paint
  const waiting = new Set()
  let done = () => {}
  PlotView.prototype._actual_paint = function () {
    paint.call(this)
    if (waiting.delete(this.model) && !waiting.size) done()
  }
  const drawn = models.find(model => model.data instanceof Map && model.data.has("modelled0"))
    ?? models.find(model => model.data && "modelled0" in model.data)
  const figures = models.filter(model => model.type == "Figure" &&
    model.renderers.some(renderer => renderer.data_source == drawn))
  const painted = () => new Promise(resolve => {
    figures.forEach(figure => waiting.add(figure))
    done = resolve
  })
  const slider = models.find(model => model.type == "Slider")
  const x = figures[0].x_range
  const {change} = drawn.properties.data
  window.moved = async value => {
    const begun = performance.now()
    const came = new Promise(resolve => {
      const once = () => { change.disconnect(once); resolve() }
      change.connect(once)
    })
    slider.value = value
    await came
    await painted()
    return performance.now() - begun
  }
  window.panned = async (start, end) => {
    const begun = performance.now(), all = painted()
    x.setv({start, end})
    await all
    return performance.now() - begun
  }
  return [slider.start, slider.end]
}"""
"""Ways to move a slider and to pan, each of which ends when all plots of the model are painted."""


def settle() -> None:
    """Wait until this process has nothing more to work out."""
    spent, least = time.process_time(), 0.05
    while True:
        time.sleep(0.5)
        spent, before = time.process_time(), spent
        if spent - before < least:
            return


def long_log(samples: int) -> dft.Log:
    """A thruster under steps of the command, of so many samples at 20 Hz."""
    rng = np.random.default_rng(5)
    stamps = 0.05 * np.arange(samples)
    command = np.repeat(rng.uniform(-3.0, 3.0, -(-samples // 40)), 40)[:samples]
    run = dft.simulate(dft.Thruster(**example_names.TRUTH), dft.Log(stamps, {"command": command}))
    names = {"speed": "rad/s", "thrust": "N"}
    noisy = {n: run[n] + 0.3 * rng.standard_normal(samples) for n in names}
    units = {"command": "V", **names}
    return dft.Log(stamps, {"command": command}, noisy, units=units, name=f"{samples}.csv")


class Clock:
    """Clock, and processor time of Python and of the page, since it was begun."""

    def __init__(self, page: Any) -> None:
        self._session = page.context.new_cdp_session(page)
        self._session.send("Performance.enable")
        self._begun = self._read()

    def _read(self) -> np.ndarray:
        metrics = self._session.send("Performance.getMetrics")["metrics"]
        named = {metric["name"]: metric["value"] for metric in metrics}
        return np.array([time.monotonic(), time.process_time(), named["ProcessTime"]])

    def each(self, count: int) -> tuple[str, ...]:
        """Milliseconds by each of so many, of Python and of the page."""
        _, python, page = 1e3 * (self._read() - self._begun) / count
        return f"{python:.0f}", f"{page:.0f}"


@contextmanager
def opened_with(samples: int) -> Iterator[tuple[Any, str, str]]:
    """The page of a long log, whose fit is there: how long it took to open, and to be drawn."""
    fit, log = example_names.fit(), long_log(samples)
    begun = time.monotonic(), time.process_time()
    with explored(fit, log) as address, looked_at(address) as page:
        page.wait_for_function("() => Bokeh.documents[0]?.is_idle")
        spent = time.monotonic() - begun[0], time.process_time() - begun[1]
        yield page, f"{spent[0]:.1f}", f"{spent[1]:.1f}"


@pytest.mark.parametrize("samples", [2_000, 10_000, 100_000])
def test_a_slider_from_event_to_drawn(samples):
    with opened_with(samples) as (page, *_):
        low, high = page.evaluate(PREPARE)
        settle()
        page.evaluate("value => moved(value)", 0.5 * (low + high))  # compiles
        clock = Clock(page)
        values = np.linspace(0.3 * high, 0.6 * high, MOVES)
        taken = [page.evaluate("value => moved(value)", float(value)) for value in values]
        median, most = np.percentile(taken, (50, 95))
        row = (f"{samples}", f"{median:.0f}", f"{most:.0f}", *clock.each(MOVES))
    heads = ("samples", "median [ms]", "95 %", "Python [ms]", "page [ms]")
    show("A slider, from event to drawn", [row], heads)


def test_a_million_samples_open_and_pan():
    with opened_with(1_000_000) as (page, clock_time, processor):
        page.evaluate(PREPARE)
        settle()
        width = 2_500.0  # a twentieth of the log
        page.evaluate("width => panned(0, width)", width)
        clock = Clock(page)
        begin = [100.0 + 0.02 * width * k for k in range(FRAMES)]
        taken = [page.evaluate("([a, b]) => panned(a, b)", [b, b + width]) for b in begin]
        rate = 1e3 * FRAMES / np.sum(taken)
        row = (clock_time, processor, f"{rate:.1f}", *clock.each(FRAMES))
    heads = ("open [s]", "its Python [s]", "frames/s", "Python [ms]", "page [ms]")
    show("A log of 1 000 000 samples, and each frame of a pan", [row], heads)


class Silent(Document):
    """A document whose next ticks come at once."""

    def add_next_tick_callback(self, callback: Any) -> Any:
        callback()


def test_memory_after_200_refits():
    session = Session(opened(example_names.fit()))
    page = Page(Silent(), session, session.task.compare())
    rows = []
    for count in range(1, 201):
        session.move({"alpha": 0.03 + 1e-5 * count})
        task = session.task
        page._fitted(task, task.fit())
        while page.quick.busy:
            time.sleep(0.005)
        if count in (1, 50, 100, 150, 200):
            gc.collect()
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            rows.append((f"{count}", f"{pages * os.sysconf('SC_PAGE_SIZE') / 2**20:.0f}"))
    page.close()
    show("Memory of the process", rows, ("refits", "MiB"))
