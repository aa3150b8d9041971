"""The check of the integration step: what it prints for the shipped logs, and when it warns."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from stored_logs import thruster_logs, vessel_logs

import diffthrust as dft
from diffthrust.simulation._step_size import sensor_noise  # private: no public way to it


@pytest.mark.parametrize(
    ("model", "read"),
    [
        (dft.Thruster(), thruster_logs),
        pytest.param(dft.Vessel(), vessel_logs, marks=pytest.mark.slow),
    ],
)
def test_on_the_shipped_logs_the_error_is_below_a_hundredth_of_the_noise(model, read, capsys):
    fit = dft.fit(model, read())
    with capsys.disabled():
        for log in read():
            errors = dft.simulation.step_error(fit.model, log, fit.substeps)
            told = ", ".join(f"{name} {error:.1e}" for name, error in errors.items())
            print(f"\n{log.name}: integration error over sensor noise: {told}", end="")
            assert max(errors.values()) < 0.01


def test_the_estimate_agrees_with_an_independent_integrator():
    log = thruster_logs()[0].slice(stop=10.0)
    model = dft.Thruster()
    coarse = dft.simulate(model, log, substeps=1, initial={"speed": 0.0})["speed"]
    exact, omega = [0.0], 0.0
    for t0, t1, c in zip(log.time[:-1], log.time[1:], log.inputs["command"], strict=False):
        solved = solve_ivp(
            lambda _, w, c=c: 42.0 * c - 0.037 * w * abs(w),
            (t0, t1), [omega], method="DOP853", rtol=1e-11, atol=1e-12,
        )  # fmt: skip
        omega = solved.y[0, -1]
        exact.append(omega)
    true = np.sqrt(np.mean((coarse - exact) ** 2)) / sensor_noise(log.measured["speed"])
    told = dft.simulation.step_error(model, log, 1, initial={"speed": 0.0})["speed"]
    assert told == pytest.approx(true, rel=0.15)  # halving leaves a sixteenth of the error


def test_sensor_noise_is_that_of_the_sensor_not_of_the_signal():
    rng = np.random.default_rng(0)
    time = np.linspace(0, 20, 4001)
    slow = 30 * np.sin(time)
    assert sensor_noise(slow + rng.normal(0, 0.3, time.size)) == pytest.approx(0.3, rel=0.05)
    assert sensor_noise(slow) < 0.01


def test_a_model_too_fast_for_the_log_warns_and_more_substeps_are_chosen_first():
    time = np.arange(0, 10, 0.1)
    command = np.where(np.sin(time) > 0, 2.0, -1.0)
    speed = np.random.default_rng(0).normal(0, 0.1, time.size)
    log = dft.Log(time=time, inputs={"command": command}, measured={"speed": speed})
    assert dft.simulation.choose_substeps(dft.Thruster(), log) == 1
    assert dft.simulation.choose_substeps(dft.Thruster(alpha=0.1, beta=200.0), log) > 1
    with pytest.warns(dft.CoarseStepWarning, match="too fast for the log's sample rate"):
        dft.simulation.choose_substeps(dft.Thruster(alpha=30.0, beta=30000.0), log)
