"""A model whose state the logs prescribe has no initial states, and is diagnosed all the same."""

import numpy as np
import pytest

import diffthrust as dft


def run(seed: int) -> dft.Log:
    """The thrust of a measured speed, of a propeller that pushes less astern."""
    time = np.arange(0, 10, 0.05)
    speed = 30 * np.sin(0.7 * time + seed) + 10 * np.sign(np.sin(1.3 * time + seed))
    inputs = {"speed": speed, "command": 0 * time}
    plant = dft.Thruster() + dft.effects.ReverseThrustAsymmetry(change=-0.3)
    thrust = dft.simulate(plant, dft.Log(time, inputs, {"thrust": 0 * time}))["thrust"]
    noise = np.random.default_rng(seed).normal(0, 0.3, time.size)
    return dft.Log(time, inputs, {"thrust": thrust + noise})


@pytest.mark.thorough
def test_the_effect_is_found():
    candidates = ["reverse_thrust_asymmetry", "thrust_sensor_offset"]
    train, unseen = [run(0), run(1), run(2)], run(3)  # so many that each is held against the others
    model = dft.Thruster()
    diag = dft.diagnose(model, train, holdout=unseen, candidates=candidates, experiment=False)
    assert diag.added == ("reverse_thrust_asymmetry",)
