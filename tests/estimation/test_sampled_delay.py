"""A delay counts from the samples of the command: where it changes between them, a half is lost."""

import numpy as np
import pytest

import diffthrust as dft

FINE, STEP, DELAY = 0.002, 0.02, 0.12


def logged(seed, between):
    """A shaft at 50 Hz under a late command that changes at samples, or between them."""
    rng = np.random.default_rng(seed)
    count, every = 7500, round(STEP / FINE)
    time, command, t = FINE * np.arange(count), np.zeros(count), 0.0
    while t < time[-1]:
        end = t + rng.uniform(0.5, 1.5)
        command[(time >= t) & (time < end)] = rng.uniform(-4.0, 4.0)
        t = end
    rows = np.arange(0, count, every)
    if not between:
        command = np.repeat(command[rows], every)
    back = round(DELAY / FINE)
    late, speed = np.r_[np.full(back, command[0]), command[:-back]], np.zeros(count)
    for k in range(count - 1):
        speed[k + 1] = speed[k] + FINE * (42.0 * late[k] - 0.037 * speed[k] * abs(speed[k]))
    noisy = speed[rows] + 0.3 * rng.standard_normal(rows.size)
    return dft.Log(time[rows], {"command": command[rows]}, {"speed": noisy})


@pytest.mark.parametrize(("between", "lost"), [(False, 0.0), (True, 0.5 * STEP)])
def test_what_a_delay_loses_is_said_with_its_size(between, lost):
    model = dft.Thruster().fix("ct") + "command_delay"
    fit = dft.fit(model, logged(1, between), starts=1, doubts=False)
    delay = fit.parameters["command_delay.delay"]
    assert delay.value == pytest.approx(DELAY - lost, abs=0.2 * STEP)
    assert 4 * delay.std_error < 0.2 * STEP  # and so a half of a step is far beyond it
    (note,) = [note for note in fit.notes if note.startswith("command_delay.delay counts")]
    assert "0.02 s apart" in note
    assert "half of that on average, 0.01 s" in note


def test_a_command_without_a_delay_has_no_such_note():
    fit = dft.fit(dft.Thruster().fix("ct"), logged(1, False), starts=1, doubts=False)
    assert not any("counts from the samples" in note for note in fit.notes)
    assert dft.effects.CommandDelay(delay=0.0).of_sampling(0.02) == ""
