"""A vehicle that falls off its course by itself, under a helmsman: whole runs hardly tell it."""

import math

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.estimation._unstable import unstable_advice  # private: the sentence alone
from diffthrust.simulation._runs import runs_over  # private: what it looks at

GROWTH, GAIN, STEP, COUNT = 1.0, 2.0, 0.05, 400


class Yawing(dft.Model):
    """The yaw rate of a hull that keeps no course: Nomoto with a negative time constant."""

    name = "yawing"
    inputs = {"rudder_angle": "rad"}
    states = {"yaw_rate": "rad/s"}
    outputs = {"yaw_rate": "rad/s"}
    ports = {}

    growth: float = dft.parameter(GROWTH, "1/s", bounds=(None, None), size=1.0)
    gain: float = dft.parameter(GAIN, "1/s^2", bounds=(None, None), size=1.0)

    def equations(self, s, port):
        return {"yaw_rate": self.growth * s.yaw_rate + self.gain * s.rudder_angle}, {
            "yaw_rate": s.yaw_rate
        }


def steered(seed=0, count=COUNT):
    """Steered by what is measured, with small gusts: solved exactly from sample to sample."""
    rng = np.random.default_rng(seed)
    kept = math.exp(GROWTH * STEP)
    rate, true, angle, read = 0.0, [], [], []
    for _ in range(count):
        true.append(rate)
        read.append(rate + 0.01 * rng.standard_normal())
        angle.append(-1.5 * read[-1] + 0.5 * rng.standard_normal())
        rate = kept * rate + (kept - 1.0) / GROWTH * GAIN * angle[-1]
        rate += 0.005 * rng.standard_normal()
    time = STEP * np.arange(count)
    units = {"rudder_angle": "rad", "yaw_rate": "rad/s"}
    return dft.Log(time, {"rudder_angle": np.array(angle)}, {"yaw_rate": np.array(read)}, units)


@pytest.mark.filterwarnings("ignore::diffthrust.CoarseStepWarning")  # of the one that fails
def test_a_fit_of_whole_runs_that_fails_says_why_and_innovations_find_it():
    log = steered()
    whole = dft.fit(Yawing(), log, substeps=2)  # from the truth
    assert not whole.status.ok
    assert "likelihood='innovations'" in whole.message
    assert abs(whole.parameters["gain"].value - GAIN) > 0.1  # and it is wrong
    found = dft.fit(Yawing(), log, likelihood="innovations", substeps=2)
    assert found.status.ok, found.message
    assert "unstable" not in found.message
    for name, value in (("growth", GROWTH), ("gain", GAIN)):
        p = found.parameters[name]
        assert abs(p.value - value) < 4.0 * p.std_error
        assert p.std_error < 0.1 * value


def test_a_small_difference_grows_as_the_closed_form_has_it():
    log = steered(count=250)
    (run,) = runs_over(Yawing(), [log], initial=[{"yaw_rate": 0.0}])
    told = unstable_advice(dft.Status.NOT_CONVERGED, Yawing(), [run], False)
    grown = math.exp(GROWTH * STEP * 249)
    assert f"grows {grown:.0e} times as large" in told
    assert unstable_advice(dft.Status.CONVERGED, Yawing(), [run], False) == ""
    assert unstable_advice(dft.Status.NOT_CONVERGED, Yawing(), [run], True) == ""


def test_a_stable_model_is_not_blamed():
    stable = Yawing(growth=-1.0)
    runs = runs_over(stable, [steered()])
    assert unstable_advice(dft.Status.NOT_CONVERGED, stable, runs, False) == ""
