"""A bar that never goes back, with a clock that runs, where somebody looks; nothing elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from places import ROOT

import diffthrust as dft
from diffthrust._support.progress import (  # private: shared by all work
    Remaining,
    progressing,
    reporter,
    subtask,
)

LOOK = """
import time
import diffthrust._support.progress as progress
from diffthrust._support.progress import bar
progress._EARLY = 0.5
with bar("reading") as tell:
    for share in (0.2, 0.6, 0.4, 0.9):
        tell("working", share)
        time.sleep(0.7)
print("over")
"""


LINE = r" *\d+ % \d\d:\d\d(, \d\d:\d\d left)?  working"


def on_a_terminal(code: str, columns: int = 80) -> list[str]:
    """What a terminal of 80 columns gets to see of a script, drawing by drawing."""
    pty = pytest.importorskip("pty", reason="there are no pseudo-terminals here")
    import fcntl
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    env = {k: v for k, v in os.environ.items() if k != "COLUMNS"} | {"PYTHONPATH": str(ROOT)}
    child = subprocess.Popen([sys.executable, "-c", code], stdout=theirs, stderr=theirs, env=env)
    os.close(theirs)
    text = b""
    while True:
        try:
            text += (more := os.read(ours, 65536))
        except OSError:
            break
        if not more:
            break
    assert child.wait(60) == 0
    os.close(ours)
    return text.decode().replace("\n", "\r").split("\r")


def test_the_bar_never_goes_back_and_its_clock_runs():
    seen = on_a_terminal(LOOK)
    shares = [int(found[1]) for line in seen if (found := re.search(r"(\d+) %", line))]
    assert shares == sorted(shares)
    assert {0, 20, 60, 90} == set(shares)
    clocks = [line.rsplit("] ", 1)[1][:5] for line in seen if "60 %" in line]
    assert len(set(clocks)) >= 2  # between two words of progress
    assert max(map(len, seen)) <= 80
    assert any(re.search(r"60 % .*\] \d\d:\d\d, \d\d:\d\d left", line) for line in seen)
    before, after = " ".join(seen).rsplit("] ", 1)[1][5:].split("over")
    assert not before.strip()  # the line of the bar is empty again
    assert not after.strip()


def test_the_time_that_is_left_never_grows_and_ends_where_it_promised_too_much():
    remaining = Remaining()
    assert remaining.after(1.0, 0.01) is None  # too early to say
    # a diagnosis at 92 % after 29 s, which took 41 s more
    steps = [(10.0, 0.5), (29.0, 0.92), (30.0, 0.92), (35.0, 0.93), (60.0, 0.95), (69.0, 0.99)]
    left = [remaining.after(*step) for step in steps]
    assert left[0] == pytest.approx(10.0)
    told = [seconds for seconds in left if seconds is not None]
    assert told == sorted(told, reverse=True)
    assert left[3:5] == [None, None]  # longer than it said: 2.6 s and 3.2 s
    assert left[5] == pytest.approx(0.7, abs=0.01)


def test_short_work_writes_nothing_into_files_and_pipes(capfd):
    log = dft.Log(np.arange(9), {"depth": np.arange(9.0)}, {"reading": 2.0 + np.arange(9) ** 0.99})
    assert dft.fit(dft.LinearSensor(), log, starts=1, progress=True).status.ok
    assert capfd.readouterr() == ("", "")


def test_long_work_tells_a_pipe_now_and_then_how_far_it_is():
    code = LOOK.replace("progress._EARLY = 0.5", "progress._LINES = 0.6")
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True
    )
    assert run.stdout == "over\n"
    lines = run.stderr.splitlines()
    assert 2 <= len(lines) <= 5
    assert all(re.fullmatch(LINE, line) for line in lines)


@pytest.mark.parametrize("horizon", [None, pytest.param([2.0, None], marks=pytest.mark.thorough)])
def test_the_shares_of_a_fit_rise_to_one(horizon):
    time = np.arange(200) * 0.05
    plain = dft.Log(time, {"command": np.sign(np.sin(3 * time))}, {})
    found = dft.simulate(dft.Thruster(alpha=0.04), plain)
    log = dft.Log(time, plain.inputs, {"speed": found["speed"]})
    told: list[tuple[str, float]] = []
    dft.fit(
        dft.Thruster(), log, starts=3, horizon=horizon, progress=lambda *word: told.append(word)
    )
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(set(shares)) > 3


def test_profiles_and_maps_tell_how_far_they_are():
    time = np.arange(200) * 0.05
    rng = np.random.default_rng(5)
    plain = dft.Log(time, {"command": np.sign(np.sin(3 * time))}, {})
    speed = dft.simulate(dft.Thruster(), plain)["speed"] + rng.normal(0, 0.2, time.size)
    log = dft.Log(time, plain.inputs, {"speed": speed})
    fit = dft.fit(dft.Thruster().fix("ct"), log, starts=2)
    for work in (
        lambda tell: dft.uncertainty.profile(fit, log, progress=tell),
        lambda tell: dft.describing_function(fit, [1.0, 2.0], [1.0, 3.0], output="speed",
                                             progress=tell),
    ):  # fmt: skip
        told: list[float] = []
        work(lambda message, share, told=told: told.append(share))
        assert told == sorted(told)
        assert len(told) >= 1


def test_what_is_told_never_falls():
    told = []
    tell = reporter(lambda *word: told.append(word))
    for share in (0.2, 0.5, 0.3, 1.2, 0.9):
        tell("working", share)
    assert [share for _, share in told] == [0.2, 0.5, 0.5, 1.0, 1.0]
    assert reporter(None)("working", 0.5) is None


def test_a_part_goes_from_its_share_to_the_next():
    told = []
    subtask(lambda *word: told.append(word), 0.2, 0.6)("half", 0.5)
    assert told == [("half", pytest.approx(0.4))]


def test_only_true_makes_a_bar():
    given = []
    work = progressing(lambda *, progress=None: given.append(progress))
    work(progress=False)
    work()
    work(progress=print)
    assert given == [False, None, print]


def test_a_warning_stands_where_the_work_was_asked_for():
    time = np.arange(100) * 0.05
    log = dft.Log(time, {"command": np.sin(time)}, {"speed": 20 * np.sin(time)})
    with pytest.warns(dft.simulation.CoarseStepWarning) as seen:
        dft.fit(dft.Thruster(), log, starts=1, substeps=1)
    assert {warning.filename for warning in seen} == {__file__}
