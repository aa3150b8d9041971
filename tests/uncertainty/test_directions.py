"""Directions of the information: against the covariance, and in words."""

import numpy as np
import pytest
from short_logs import MODEL, TRUE, TwiceTheSame, fitted, made_log

import diffthrust as dft
from diffthrust.uncertainty import directions


def test_directions_are_those_of_the_relative_covariance():
    log = made_log(seed=1)
    fit = fitted(log)
    found = directions(fit, log)
    value = np.array([fit.parameters[n].value for n in fit.free])
    expected = np.sqrt(np.linalg.eigvalsh(fit.covariance / np.outer(value, value)))
    np.testing.assert_allclose([d.std_error for d in found], expected, rtol=1e-6)
    rebuilt = np.zeros((3, 3))
    for d in found:
        change = np.array([d.changes[n] for n in fit.free])
        rebuilt += np.outer(change, change)
    np.testing.assert_allclose(rebuilt, fit.covariance, rtol=1e-6)


def test_the_words_name_what_moves_together():
    # rest and full speed one way: only the steady speed, alpha over beta, is seen well
    time = np.arange(60) * 0.9
    command = np.where((np.arange(60) // 15) % 2 == 0, 1.0, 2.0)
    plain = dft.Log(time=time, inputs={"command": command}, measured={"speed": 0 * time})
    speed = np.asarray(dft.simulate(MODEL, plain, substeps=50)["speed"])
    speed = speed + 0.3 * np.random.default_rng(0).standard_normal(60)
    log = dft.Log(time=time, inputs={"command": command}, measured={"speed": speed})
    fit = dft.fit(MODEL.fix("ct"), log, starts=1, substeps=50)
    found = directions(fit, log)
    assert found[0].std_error < 0.1 * found[1].std_error
    assert "alpha" in found[0].sentence
    assert "down" in found[0].sentence
    assert found[1].members.keys() == {"alpha", "beta"}
    assert found[1].sentence.count("up") == 2
    assert "Moves together" in found.report()


def test_a_direction_of_which_nothing_is_known_is_the_last():
    log = made_log(seed=7)
    found = directions(dft.fit(MODEL + TwiceTheSame(), log, starts=1), log)
    assert len(found) == 4
    last = found[3]
    assert not np.isfinite(last.std_error)
    assert last.members.keys() == {"beta", "drive_gain.gain"}
    assert last.sentence.startswith("not known at all: ")
    assert last.relative["beta"] == pytest.approx(-last.relative["drive_gain.gain"], rel=1e-3)
    assert found.to_json()[3]["std_error"] is None
    assert all(np.isfinite(d.std_error) for d in found.directions[:3])


def test_a_parameter_at_a_bound_takes_no_part():
    model = MODEL.replace(alpha={"value": 0.05, "bounds": (0.045, 0.2)})
    log = made_log(seed=6)
    found = directions(dft.fit(model, log, starts=1), log)
    assert found.held == ("alpha",)
    assert len(found) == 2
    assert "held at a bound: alpha" in found.sentences
    assert set(TRUE) - {"alpha"} == set(found[0].changes)


@pytest.mark.thorough
def test_a_linear_parameter_changes_relative_to_its_value_too():
    clean = made_log(seed=8)
    damped = MODEL + dft.effects.LinearDamping(rate=2.0)
    made = dft.simulate(damped, clean)
    noise = np.random.default_rng(8).normal(0.0, 0.3, (2, clean.time.size))
    measured = {n: made[n] + rest for n, rest in zip(("speed", "thrust"), noise, strict=True)}
    log = dft.Log(time=clean.time, inputs=dict(clean.inputs), measured=measured)
    fit = dft.fit(damped, log, starts=1)
    value = np.array([fit.parameters[n].value for n in fit.free])
    expected = np.sqrt(np.linalg.eigvalsh(fit.covariance / np.outer(value, value)))
    np.testing.assert_allclose([d.std_error for d in directions(fit, log)], expected, rtol=1e-6)
