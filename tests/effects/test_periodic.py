"""A force that is periodic in time: what it does, how it is fitted and written down."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import diffthrust as dft
from diffthrust.effects import PeriodicForce

STILL = {"alpha": 1e-12, "beta": 1e-12}
SLOW = {"periodic_force.sine": 0.6, "periodic_force.cosine": -0.8}


def log_of(time, speed=None, name="run"):
    measured = {} if speed is None else {"speed": speed}
    return dft.Log(time, {"command": np.zeros(time.size)}, measured, name=name)


@pytest.mark.parametrize("frequency", [0.7, 8.0])
def test_it_pushes_with_one_frequency_however_few_the_samples_of_a_cycle(frequency):
    """A shaft without load integrates the force; 8 Hz at 20 samples a second are 2.5 a cycle."""
    time = 0.05 * np.arange(400)
    model = dft.Thruster(**STILL) + PeriodicForce("shaft", frequency, 25.0, unit="rad/s^2")
    speed = dft.simulate(model, log_of(time), initial=SLOW, substeps=8)["speed"]
    w = 2 * np.pi * frequency
    exact = 25.0 / w * (0.6 * (1.0 - np.cos(w * time)) - 0.8 * np.sin(w * time))
    np.testing.assert_allclose(speed, exact, atol=2e-3 * 25.0 / w)


def pushed(frequency, amplitude, phase, seed, time):
    """The speed of a loaded shaft under a force, by SciPy, with the noise of a sensor."""

    def rate(t, x):
        push = amplitude * np.sin(2 * np.pi * frequency * t + phase)
        return 42.0 * 2.0 - 0.037 * x * np.abs(x) + push

    solved = solve_ivp(rate, (0, time[-1]), [0.0], t_eval=time, rtol=1e-8, max_step=0.05)
    noise = 0.2 * np.random.default_rng(seed).standard_normal(time.size)
    return dft.Log(time, {"command": np.full(time.size, 2.0)}, {"speed": solved.y[0] + noise})


def test_a_fit_shares_the_frequency_and_gives_each_log_its_amplitude_and_phase():
    time = 0.1 * np.arange(150)
    true = ((20.0, 0.4), (30.0, 2.9), (25.0, -2.0))
    *train, unseen = (pushed(0.7, a, p, k, time) for k, (a, p) in enumerate(true))
    model = dft.Thruster().fix("ct") + PeriodicForce("shaft", 0.69, 20.0, unit="rad/s^2")
    fit = dft.fit(model, train, holdout=unseen, starts=1)
    frequency = fit.parameters["periodic_force.frequency"]
    assert abs(frequency.value - 0.7) < 4 * frequency.std_error < 0.01
    for start, (amplitude, phase) in zip(fit.initial, true, strict=False):
        sine, cosine = start["periodic_force.sine"], start["periodic_force.cosine"]
        assert 20.0 * np.hypot(sine, cosine) == pytest.approx(amplitude, rel=0.05)
        assert np.cos(np.arctan2(cosine, sine) - phase) > 0.99
    assert fit.holdout.channels["speed"].rmse < 0.3  # amplitude and phase from the unseen log
    assert any("periodic_force.sine" in note for note in fit.notes)


@pytest.mark.thorough
def test_where_it_begins_is_estimated_for_one_step_predictions_too():
    time = 0.1 * np.arange(150)
    log = pushed(0.7, 25.0, 1.1, 5, time)
    model = dft.Thruster().fix("ct") + PeriodicForce("shaft", 0.7, 25.0, unit="rad/s^2")
    fit = dft.fit(model, log, starts=1, likelihood="innovations")
    start = fit.initial[0]
    assert np.hypot(start["periodic_force.sine"] - np.cos(1.1),
                    start["periodic_force.cosine"] - np.sin(1.1)) < 0.1  # fmt: skip


@pytest.mark.thorough
def test_a_diagnosis_adds_it_at_the_frequency_of_its_line():
    time = 0.1 * np.arange(400)
    *train, unseen = (pushed(0.7, 20.0 + 5.0 * k, 0.4 + k, k, time) for k in range(3))
    model = dft.Thruster().fix("ct")
    diag = dft.diagnose(
        model, train, holdout=unseen, candidates=["linear_damping"], experiment=False
    )
    assert diag.added == ("periodic_force",)
    assert diag.fit.parameters["periodic_force.frequency"].value == pytest.approx(0.7, abs=1e-3)


def test_it_does_nothing_at_its_null_and_says_how_large_it_is():
    time = 0.1 * np.arange(50)
    force = PeriodicForce("shaft", 0.7, 25.0, unit="rad/s^2", name="waves")
    null = dft.simulate(dft.Thruster() + force.at_null(), log_of(time))["speed"]
    assert not null.any()
    assert force.size_words([{"sine": 0.6, "cosine": 0.8}] * 2) == "amplitude 25 rad/s^2"
    two = [{"sine": 1.0, "cosine": 0.0}, {"sine": 0.0, "cosine": -2.0}]
    assert force.size_words(two) == "amplitude 25 to 50 rad/s^2"


def test_its_line_to_copy_makes_it_again():
    force = PeriodicForce("shaft", 0.7, 25.0, unit="rad/s^2", name="waves")
    assert eval(repr(force), {"PeriodicForce": PeriodicForce}).arguments == force.arguments
    table = force.as_table()
    assert table.pop("periodic_force") == "shaft"
    assert PeriodicForce("shaft", **table).arguments == force.arguments


@pytest.mark.parametrize("frequency", [-1.0, float("nan")])
def test_a_frequency_that_is_none_is_refused(frequency):
    with pytest.raises(dft.InputError, match="frequency"):
        PeriodicForce("shaft", frequency)
