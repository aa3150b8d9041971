"""How logs become arrays: few shapes, so that compiled code is shared."""

import numpy as np
import pytest
from compilations import compilations
from problems import build, jacobians
from reference import inputs, noise, thruster

import diffthrust as dft


def made(samples, seed=0):
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(samples)
    command = inputs.low_passed_random(time, 2.0, rng)
    record = thruster.simulate(time, command, method="rk4")
    record = noise.measure(record, rng, speed=noise.Sensor(0.1))
    return dft.Log(record.time, {"command": command}, record.measured)


def test_logs_of_like_length_share_compiled_code():
    dft.fit(dft.Thruster(), made(190), starts=2)
    before = compilations("solved")
    fits = [dft.fit(dft.Thruster(), made(n), starts=2) for n in (200, 231, 250)]
    assert compilations("solved") == before
    assert all(fit.status.ok for fit in fits)


@pytest.mark.thorough
def test_logs_of_several_lengths_are_one_batch_and_say_what_each_says_alone():
    logs = [made(200, seed=1), made(120, seed=2), made(90, seed=3)]
    together = build(dft.Thruster(), logs)
    assert together.order == ((0, 1, 2),)
    rests, slopes = jacobians(together.layout, together.numbers, together.start())[0]
    for row, log in enumerate(logs):
        alone = build(dft.Thruster(), [log])
        rest, slope = jacobians(alone.layout, alone.numbers, alone.start())[0]
        np.testing.assert_allclose(rests[row, :, : len(log)], rest[0, :, : len(log)], rtol=1e-12)
        own = slice(0, together.shared + len(together.layout.starts))
        np.testing.assert_allclose(
            slopes[row, own, :, : len(log)], slope[0, own, :, : len(log)], rtol=1e-9, atol=1e-12
        )
        assert not np.any(rests[row, :, len(log) :])


@pytest.mark.parametrize(("length", "batches"), [(40, 2), (400, 1)])
def test_a_log_far_shorter_than_the_others_is_a_batch_of_its_own(length, batches):
    problem = build(dft.Thruster(), [made(1000), *(made(length, seed) for seed in range(3))])
    assert len(problem.layout.grids) == batches
