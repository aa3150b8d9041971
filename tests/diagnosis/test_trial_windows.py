"""The windows of long logs on which effects are tried: which, where they begin, what is said."""

from __future__ import annotations

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.diagnosis import (  # private: what is many is set to few
    _periodic_stage,
    _trial_windows,
)
from diffthrust.diagnosis._spectral_line import height_over_turns  # private: of made errors
from diffthrust.diagnosis._trial_windows import (  # private: no diagnosis shows its windows
    trial_windows,
    window_note,
)
from diffthrust.simulation._record import bind  # private: windows are records
from diffthrust.simulation._runs import runs_over  # private: windows begin in runs

TRUE = dft.Thruster(alpha=0.03, beta=60.0, ct=0.01)
STEP = 0.05


def driven(command: np.ndarray, name: str, seed: int = 0, **lacking: float) -> dft.Log:
    """A log of the thruster, with white noise and, if asked, a dead band."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(command.size)
    model = TRUE + dft.effects.CommandDeadband(**lacking) if lacking else TRUE
    out = dft.simulate(model, dft.Log(time, {"command": command}))
    measured = {
        "speed": out["speed"] + rng.normal(0.0, 0.3, time.size),
        "thrust": out["thrust"] + rng.normal(0.0, 0.2, time.size),
    }
    return dft.Log(time, {"command": command}, measured, name=name)


def stairs(seed: int, samples: int, held: int = 20) -> np.ndarray:
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, samples // held)
    return np.repeat(levels, held)


@pytest.fixture
def few(monkeypatch):
    """Two thousand measurements are many."""
    monkeypatch.setattr(_trial_windows, "_MOST", 2000)
    return monkeypatch


def test_short_logs_are_passed_whole():
    runs = runs_over(TRUE, bind(TRUE, [driven(stairs(1, 400), "run 1")]))
    windows = trial_windows(TRUE, runs)
    assert windows == (runs[0].record,)
    assert window_note(windows, windows) == ()


def test_short_logs_stay_whole_and_long_ones_share_the_rest():
    shares = _trial_windows._shares(np.array([50_000.0, 1000.0, 30_000.0]), 20_000.0)
    assert shares.tolist() == [9500.0, 1000.0, 9500.0]


def test_a_window_lies_where_the_signals_move(few):
    still = np.full(3000, 0.2)
    command = np.concatenate([still, stairs(2, 1000), still])
    runs = runs_over(TRUE, bind(TRUE, [driven(command, "run 1")]))
    (window,) = trial_windows(TRUE, runs)
    assert len(window) == 1000
    assert 2750 * STEP <= window.time[0] <= 3250 * STEP
    np.testing.assert_array_equal(
        window.measured["thrust"],
        runs[0].record.measured["thrust"][window.time[0] <= runs[0].time][:1000],
    )


def test_a_window_begins_in_the_states_of_the_run(few):
    """Of what is measured, in its first reading there; of what is not, as the model runs."""
    log = driven(stairs(3, 6000), "run 1")
    unread = dft.Log(log.time, log.inputs, {"thrust": log.measured["thrust"]})
    for given, own in ((log, 0.0), (unread, 1.0)):
        (run,) = runs_over(TRUE, bind(TRUE, [given]))
        (window,) = trial_windows(TRUE, [run])
        first = round(window.time[0] / STEP)
        modelled = run.signals["speed"][first]
        read = log.measured["speed"][first]
        assert first > 0
        assert window.start["speed"] == (modelled if own else read)


def test_what_is_held_or_cut_off_is_so_in_a_window_too(few):
    """A reading that is repeated counts once, and no other value is taken for a rail."""
    log = driven(stairs(4, 6000), "run 1")
    held = np.repeat(log.measured["thrust"][::10], 10)
    cut = np.clip(log.measured["speed"], -20.0, 20.0)
    log = dft.Log(log.time, log.inputs, {"speed": cut, "thrust": held})
    (run,) = runs_over(TRUE, bind(TRUE, [log]))
    (window,) = trial_windows(TRUE, [run])
    at = np.flatnonzero(np.isin(run.record.time, window.time))
    for name, values in window.measured.items():
        np.testing.assert_array_equal(values, run.record.measured[name][at])


def test_logs_stay_whole_where_no_window_has_all_channels(few):
    """A channel without any reading would have a noise of nothing."""
    log, place = driven(stairs(9, 6000), "run 1"), np.arange(6000)
    speed = np.where(place < 40, log.measured["speed"], np.nan)
    thrust = np.where(place >= 2000, log.measured["thrust"], np.nan)
    (run,) = runs_over(
        TRUE, bind(TRUE, [dft.Log(log.time, log.inputs, {"speed": speed, "thrust": thrust})])
    )
    few.setattr(_trial_windows, "_MOST", 400)
    assert trial_windows(TRUE, [run]) == (run.record,)


def test_effects_are_tried_on_windows_and_fitted_to_all(few):
    logs = [driven(stairs(k, 1500), f"run {k}", k, half_width=0.15) for k in (5, 6, 7)]
    start = dft.Thruster(alpha=0.04, beta=50.0, ct=0.008)
    diag = dft.diagnose(
        start, logs[:2], holdout=logs[2], candidates=["command_deadband"], experiment=False
    )
    assert diag.verdict == "effects_found"
    assert diag.added == ("command_deadband",)
    assert all(stage.train.channels["thrust"].samples == 3000 for stage in diag.stages)
    band = diag.fit.parameters["command_deadband.half_width"]
    assert abs(band.value - 0.15) < 4 * band.std_error
    (note,) = (note for note in diag.notes if "tried on" in note)
    assert note.startswith("Effects were tried on 2000 of 6000 measurements")
    assert "run 5: " in note
    assert note in " ".join(diag.report().split())


def test_a_shaft_is_read_where_errors_are():
    """In a window of a log, and over a gap, where the times of both differ."""
    time = np.arange(0.0, 100.0)
    errors = [(time[20:60], np.zeros(40)), (np.arange(0.0, 50.0, 0.5), np.zeros(100))]
    shaft = [(time, 3.0 * time), (np.delete(time[:51], slice(10, 20)), np.full(41, 7.0))]
    rates = _periodic_stage._at_times_of(errors, shaft)
    np.testing.assert_array_equal(rates[0], 3.0 * time[20:60])
    np.testing.assert_array_equal(rates[1], np.full(100, 7.0))
    assert np.isfinite(height_over_turns(errors, rates, 0.2))
