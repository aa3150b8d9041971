"""Predictive bands: against closed forms, and how much of what is measured lies inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from error_laws import Gaussian, StudentT
from made_posterior import made_posterior
from posterior_cases import mixed_quantile
from scipy import stats
from test_quantities import log

import diffthrust as dft
from diffthrust import InputError
from diffthrust.uncertainty import predict

TRUE = dft.Thruster()


@pytest.fixture(scope="module")
def fit() -> dft.estimation.Fit:
    return dft.fit(TRUE, log(TRUE), starts=2)


@pytest.fixture(scope="module")
def line() -> dft.estimation.Fit:
    rng = np.random.default_rng(2)
    depth = np.linspace(0.0, 6.0, 25)
    reading = 0.16 * depth + 1.6 + 0.02 * rng.standard_normal(25)
    table = dft.Log(np.arange(25.0), {"depth": depth}, {"reading": reading})
    return dft.fit(dft.LinearSensor(), table, starts=2)


def test_the_band_of_a_straight_line_is_that_of_its_closed_form(line):
    """Variance of the mean x' C x; of a measurement with that of the noise besides."""
    depth = np.array([-2.0, 0.0, 3.0, 12.0])
    table = dft.Log(np.arange(4.0), {"depth": depth}, {"reading": np.zeros(4)})
    band = predict(line, table, draws=20000).channels["reading"]
    row = {"slope": depth, "offset": np.ones(4)}
    x = np.stack([row[n] for n in line.free])
    mean = sum(row[n] * line.parameters[n].value for n in line.free)
    spread = np.sqrt(np.einsum("it,ij,jt->t", x, line.covariance, x))
    np.testing.assert_allclose(band.median, mean, atol=0.03 * spread.max())
    half = 0.5 * (band.high - band.low)
    np.testing.assert_allclose(half, 1.96 * spread, rtol=0.04)
    whole = 0.5 * (band.noisy_high - band.noisy_low)
    expected = 1.96 * np.sqrt(spread**2 + line.noise["reading"] ** 2)
    np.testing.assert_allclose(whole, expected, rtol=0.03)


@pytest.mark.parametrize("heavy", [False, True])
def test_noise_is_mixed_in_closed_form(heavy):
    law, noise = (stats.t(4), StudentT()) if heavy else (stats.norm(), Gaussian())
    for probability in (0.025, 0.5, 0.9):
        one = mixed_quantile(noise, np.full((3, 2), 5.0), np.full(3, 2.0), probability)
        np.testing.assert_allclose(one, 5.0 + 2.0 * law.ppf(probability), rtol=1e-7)
        centre, scale = np.array([[0.0], [3.0]]), np.array([1.0, 0.5])
        found = float(mixed_quantile(noise, centre, scale, probability)[0])
        share = np.mean(law.cdf((found - centre[:, 0]) / scale))
        assert share == pytest.approx(probability, abs=1e-6)


@pytest.mark.slow
def test_coverage_is_near_its_level_on_logs_of_the_same_thruster(fit):
    """24 logs of 300 samples by 2 channels: the standard deviation of the share is 0.2 %.

    A margin of 0.8 % gives a false alarm in one of some 10 000 seeds.
    """
    runs = [log(TRUE, seed) for seed in range(10, 34)]
    found = [predict(made_posterior(fit), fit, run).coverage for run in runs]
    total = np.mean([list(coverage.values()) for coverage in found])
    assert total == pytest.approx(0.95, abs=0.008)
    ours = [predict(fit, run).coverage["speed"] for run in runs[:6]]
    assert np.mean(ours) == pytest.approx(np.mean([c["speed"] for c in found[:6]]), abs=0.01)
    half = np.mean([predict(fit, run, level=0.5).coverage["thrust"] for run in runs[:6]])
    assert half == pytest.approx(0.5, abs=0.05)  # 1800 samples: 1.2 %


def test_student_t_noise_has_heavy_tails(fit):
    run = log(TRUE, 7)
    band = predict(replace(fit, loss="student_t"), run, level=0.99).channels["thrust"]
    plain = predict(fit, run, level=0.99).channels["thrust"]
    ratio = (band.noisy_high - band.noisy_low) / (plain.noisy_high - plain.noisy_low)
    assert np.median(ratio) == pytest.approx(stats.t(4).ppf(0.995) / stats.norm.ppf(0.995), rel=0.1)


def test_what_a_model_lacks_shows_in_its_coverage(fit):
    lacking = log(TRUE + dft.effects.CommandDeadband(half_width=0.8), seed=3)
    poor = predict(fit, lacking)
    assert poor.coverage["speed"] < 0.7
    assert "something is missing from the model" in poor.sentence
    fine = predict(fit, log(TRUE, 4))
    assert "as many as asked for" in fine.sentence
    quiet = predict(replace(fit, noise={"speed": 5.0, "thrust": 5.0}), log(TRUE, 4))
    assert "more than asked" in quiet.sentence


@pytest.mark.slow
def test_random_forces_of_an_innovations_fit_are_in_its_band():
    """A thruster in turbulent inflow: accelerations with a memory of 1 s act on the shaft."""

    def gusty(seed: int) -> dft.Log:
        rng = np.random.default_rng(seed)
        calm = log(TRUE, seed, samples=600)
        push = np.zeros(600)
        for i in range(1, 600):
            push[i] = 0.95 * push[i - 1] + 8.0 * rng.standard_normal()
        command = calm.inputs["command"] + push / TRUE.beta  # the fit is not told of the push
        told = dft.Log(calm.time, {"command": command}, {})
        driven = dft.simulate(TRUE, told, substeps=1)
        measured = {n: driven[n] + 0.3 * rng.standard_normal(600) for n in ("speed", "thrust")}
        return dft.Log(calm.time, calm.inputs, measured)

    whole = dft.fit(TRUE, gusty(0), starts=1, likelihood="innovations")
    found = dict(whole.disturbance or {})
    # half a minute tells little of how long the force lasts (0.73 s here, and 88 % inside the band)
    found["noise.speed.memory"] = replace(found["noise.speed.memory"], value=0.975)
    whole = replace(whole, disturbance=found)
    runs = [gusty(seed) for seed in range(100, 115)]
    predictions = [predict(whole, run, draws=100) for run in runs]
    inside = np.mean([list(p.coverage.values()) for p in predictions])
    # the errors last: a run counts as some 15 independent samples, 225 in all give +- 1.5 %
    assert inside == pytest.approx(0.95, abs=0.045)
    assert predictions[0].random_forces
    legend = predictions[0].plot().legends[0]
    assert "random forces" in legend.get_texts()[0].get_text()
    # errors are drawn at the samples, not at the integrator's steps between them
    finer = predict(replace(whole, substeps=2), runs[0], draws=100)
    assert finer.coverage["speed"] == pytest.approx(predictions[0].coverage["speed"], abs=0.05)
    # the errors of one step say nothing of a whole run
    short = predict(replace(whole, likelihood="simulation"), runs[0])
    assert short.coverage["speed"] < 0.5


def test_missing_samples_gaps_and_unsigned_sensors(fit):
    whole = log(TRUE, 5)
    keep = np.r_[0:150, 190:300]  # the command of sample 149 goes on until the next
    command = whole.inputs["command"].copy()
    command[140:190] = command[140]
    clean = dft.simulate(TRUE, dft.Log(whole.time, {"command": command}, {}), substeps=1)
    noise = {n: v - dft.simulate(TRUE, whole)[n] for n, v in whole.measured.items()}
    measured = {n: clean[n] + v for n, v in noise.items()}
    measured["speed"][50:120] = np.nan
    measured["thrust"] = np.abs(measured["thrust"])
    run = dft.Log(
        time=whole.time[keep],
        inputs={"command": command[keep]},
        measured={n: v[keep] for n, v in measured.items()},
        unsigned=["thrust"],
    )
    found = predict(fit, run)
    assert found.channels["speed"].samples == 190
    assert found.channels["thrust"].samples == 260
    assert found.time.size == found.channels["speed"].median.size == 260
    assert found.coverage["speed"] > 0.9
    assert found.channels["thrust"].median.min() >= 0
    assert len(found.plot().axes) == 4
    text = found.report()
    assert "190" in text
    assert "95 %" in text


@pytest.mark.slow
def test_angles_are_compared_to_the_nearest_turn():
    vessel = dft.Vessel()
    time = np.arange(0.0, 40.0, 0.2)
    inputs = {"propeller_speed": np.full(200, 98.0), "rudder_angle": np.full(200, 0.3)}
    clean = dft.simulate(vessel, dft.Log(time, inputs, {}))
    rng = np.random.default_rng(0)
    noisy = {n: clean[n] + 0.01 * rng.standard_normal(200) for n in ("surge", "sway", "yaw_rate")}
    heading = clean["heading"] + 0.01 * rng.standard_normal(200)
    assert np.ptp(heading) > 2 * np.pi
    wrapped = np.angle(np.exp(1j * heading))
    run = dft.Log(time, inputs, {**noisy, "heading": wrapped})
    fit = dft.fit(vessel.fix("exponent", "d11"), run, starts=1)
    band = predict(fit, run).channels["heading"]
    assert band.coverage > 0.85
    assert np.ptp(band.measured) > 2 * np.pi


def test_wrong_input_is_told(fit):
    run = log(TRUE, 6)
    post = made_posterior(fit, draws=20)

    def refused(words: str, *given, **asked):
        with pytest.raises(InputError, match=words):
            predict(*given, **asked)

    refused("expected a log, found NoneType", fit, fit)
    refused("expected a log, found list", fit, fit, [run])
    refused("is of another model", post, dft.AxisVehicle(), run)
    refused("needs the input 'command'", post, fit, dft.Log(run.time, {}, run.measured))
    only = dft.Log(run.time, run.inputs, {"torque": run.measured["thrust"]})
    refused("no output of 'thruster' is measured", post, fit, only)
    post.posterior = post.posterior.drop_vars("sigma")
    refused("is not known: the posterior has no 'sigma'", post, TRUE, run)
    assert predict(post, fit, run).coverage["thrust"] > 0.9  # the level of the fit
    known = dft.Log(run.time, run.inputs, run.measured, noise={"speed": 0.5, "thrust": 0.5})
    assert predict(post, TRUE, known).coverage["thrust"] > 0.9
    part = predict(replace(fit, noise={"speed": 0.5}), run)
    assert any(note.startswith("thrust: its noise is not known") for note in part.notes)
    data = part.to_json()
    assert set(data) == {"log", "level", "draws", "channels"}
