"""Figures show where somebody can see them, once, and do not pile up."""

from __future__ import annotations

import gc
import subprocess
import sys
import textwrap
import threading
import warnings
from weakref import ref

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg, FigureManagerBase
from places import ROOT
from presentation import unseen

import diffthrust as dft

SHOWN: list[object] = []


class WindowManager(FigureManagerBase):
    """Windows that nobody has to close."""

    @classmethod
    def pyplot_show(cls, *, block=None):
        SHOWN.extend(manager.canvas.figure for manager in plt._pylab_helpers.Gcf.figs.values())


class FigureCanvas(FigureCanvasAgg):
    """The canvas of a backend with windows, which is this file."""

    manager_class = WindowManager
    required_interactive_framework = None


FigureManager = WindowManager


@pytest.fixture(scope="module")
def comparison() -> dft.comparison.Comparison:
    time = np.arange(60) * 0.05
    log = dft.Log(time, {"command": np.sign(np.sin(time))}, {"speed": 10 * np.sin(time)})
    return dft.compare(dft.Thruster(), log)


@pytest.fixture
def windows():
    plt.switch_backend(f"module://{__name__}")
    SHOWN.clear()
    yield
    plt.close("all")
    plt.switch_backend("agg")


def test_a_script_shows_each_figure_once(windows, comparison):
    figures = [comparison.plot(), comparison.plot_residuals()]
    assert plt.gcf() is figures[1]
    plt.show()
    assert figures == SHOWN


def test_a_loop_over_hundreds_of_figures_keeps_twenty_and_warns_of_nothing(windows, comparison):
    own = plt.figure()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        last = [comparison.plot() for _ in range(60)][-1]
    assert plt.gcf() is last
    assert len(plt.get_fignums()) == 20
    assert plt.fignum_exists(own.number)  # the user's own is not closed


def test_pages_commands_and_threads_show_nothing(windows, comparison):
    assert unseen(comparison.plot).axes
    thread = threading.Thread(target=comparison.plot)
    thread.start()
    thread.join()
    assert plt.get_fignums() == []
    comparison.plot()  # and what follows shows again
    assert len(plt.get_fignums()) == 1


@pytest.mark.thorough
def test_without_a_display_figures_last_as_long_as_they_are_kept(comparison):
    assert plt.get_backend().lower() == "agg"
    gone = ref(comparison.plot())
    gc.collect()
    assert gone() is None
    assert plt.get_fignums() == []


@pytest.mark.thorough
def test_a_script_runs_without_a_display(tmp_path):
    script = """
        import matplotlib.pyplot as plt, numpy as np, diffthrust as dft
        time = np.arange(60) * 0.05
        log = dft.Log(time, {"command": np.sin(time)}, {"speed": 10 * np.sin(time)})
        figure = dft.compare(dft.Thruster(), log).plot()
        plt.show()
        figure.savefig("figure.png")
        print(plt.get_fignums())
    """
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(script)],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "PATH": ""},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
