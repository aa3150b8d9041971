"""Models that leave the finite numbers, and logs too short to hold anything against."""

import json
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from short_logs import made_log

import diffthrust as dft
from diffthrust import InputError

pytestmark = pytest.mark.filterwarnings("ignore::diffthrust.simulation.CoarseStepWarning")


class Runaway(dft.Effect):
    """Feeds the shaft back with the wrong sign."""

    name = "runaway"
    port = "shaft"
    gain: float = dft.parameter(5.0, bounds=(1.0, 10.0))

    def __call__(self, value, s):
        """The acceleration, and more of it the faster it is."""
        return value + self.gain * s.speed**3


LOG = made_log(seed=0, count=300)
CASES = {
    "alpha": (dft.Thruster(alpha=1e300), LOG, "state 'speed' is no number"),
    "runaway": (dft.Thruster() + Runaway(), LOG, "state 'speed'"),
    "command": (
        dft.Thruster(),
        LOG.replaced(inputs={"command": 1e300 * LOG.inputs["command"]}),
        "state 'speed'",
    ),
    "speed": (
        dft.Thruster(),
        LOG.replaced(measured={**LOG.measured, "speed": 1e200 * (1.0 + LOG.measured["speed"])}),
        "output 'thrust' is infinite (speed",
    ),
}


def without_infinities(result):
    """The report and the JSON of a result, of which no number is infinite or none."""
    told, data = result.report(), json.dumps(result.to_json(), allow_nan=False)
    assert not {"inf", "-inf", "nan"} & set(told.split())
    return told, data


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
def test_an_overflow_is_a_failed_simulation_that_says_where(case):
    model, log, where = CASES[case]
    fit = dft.fit(model, log, starts=2)
    assert fit.status is dft.estimation.Status.SIMULATION_FAILED
    for words in (log.name, "t = ", where):
        assert words in fit.message
    assert not any(doubt.kind == "silent" for doubt in fit.doubts)
    without_infinities(fit)
    assert "simulation_failed" in repr(fit)


@pytest.mark.parametrize("case", CASES)
def test_a_comparison_says_where_it_failed(case):
    model, log, where = CASES[case]
    comparison = dft.compare(model, log)
    (sentence,) = comparison.failures
    assert where in sentence
    told, _ = without_infinities(comparison)
    assert "simulation_failed" in told
    assert "look like white" not in told
    assert "No regime" not in told


def test_a_simulation_warns_where_it_failed():
    model, log, where = CASES["alpha"]
    with pytest.warns(dft.simulation.SimulationFailedWarning, match=where):
        out = dft.simulate(model, log, substeps=1)
    first = int(np.argmin(np.isfinite(out["speed"])))
    assert first > 0


def test_an_unseen_log_over_which_the_model_fails_is_told():
    fit = dft.fit(dft.Thruster(), LOG, holdout=CASES["command"][1], starts=2)
    assert fit.status.ok
    assert any("leaves the finite numbers" in note for note in fit.notes)
    without_infinities(fit)


@pytest.mark.thorough
def test_a_diagnosis_says_where_it_failed():
    with pytest.raises(InputError, match="leaves the finite numbers at t = "):
        dft.diagnose(dft.Thruster(), CASES["command"][1])


def test_numbers_too_large_to_be_squared_are_told():
    log = LOG.replaced(measured={**LOG.measured, "thrust": 1e200 * LOG.measured["thrust"]})
    (sentence,) = dft.compare(dft.Thruster(), log).failures
    assert "too large to be squared" in sentence
    assert "thrust" in sentence


@pytest.mark.parametrize("count", [1, 2])
def test_a_log_of_a_sample_or_two_is_refused_but_simulated(count):
    short = LOG.slice(0.0, (count - 1) * LOG.step).replaced(name="short.csv")
    assert len(short) == count
    model, told = dft.Thruster(), f"short.csv: expected at least 3 samples.*found {count}"
    for work in (
        lambda: dft.fit(model, short),
        lambda: dft.fit(model, [LOG, short]),
        lambda: dft.fit(model, LOG, holdout=short),
        lambda: dft.compare(model, short),
        lambda: dft.diagnose(model, short),
    ):
        with pytest.raises(InputError, match=told):
            work()
    assert dft.simulate(model, short)["speed"].size == count


class SpringLaw(dft.Model):
    """A user's own: the power of a spring, whose slope by the power is not finite at rest."""

    name = "spring_law"
    inputs: ClassVar = {"force": "N"}
    states: ClassVar = {"velocity": "m/s"}
    outputs: ClassVar = {"velocity": "m/s"}
    gain: float = dft.parameter(2.0, bounds=(0, None))
    slack: float = dft.parameter(0.3, "N", bounds=(0, None))

    def equations(self, s, port):
        pull = self.gain * jnp.sqrt(self.slack * s.force)
        return {"velocity": pull - s.velocity}, {"velocity": s.velocity}


def test_where_the_slope_of_a_model_of_ones_own_is_not_finite():
    """It was said that every start diverged; a diagnosis asked for longer time constants."""
    time = 0.1 * np.arange(60)
    force = np.where((time > 1.95) & (time < 2.95), 0.0, 1.0)
    measured = {"velocity": np.random.default_rng(0).normal(0.5, 0.1, 60)}
    log = dft.Log(time, {"force": force}, measured, name="run 1")
    fit = dft.fit(SpringLaw(), log, starts=1, horizon=None)
    words = (
        "run 1: the simulation is finite, but the derivative of the rate of 'velocity' by the "
        "parameter 'slack' is not, at 10 of 60 samples; first at sample 21 (t = 2 s), where "
        "force = 0 N, velocity = "
    )
    assert fit.status is dft.estimation.Status.SIMULATION_FAILED
    assert words in fit.message
    assert "jnp.sqrt(jnp.maximum(x, 1e-12)), or fix 'slack'" in fit.message
    with pytest.raises(dft.InputError, match="'spring_law' cannot be diagnosed") as caught:
        dft.diagnose(fit, log)
    assert words in str(caught.value)
    assert "or fix 'slack'" in caught.value.mend
