"""What recurs where logs repeat their inputs, against the share that was made."""

from dataclasses import replace

import numpy as np
import pytest
from reference import thruster
from steps import recurring_shares

import diffthrust as dft

MODEL = dft.Thruster().replace(thruster.JASON)
TIME = 0.05 * np.arange(1200)


def lasting(rng):
    """Unit errors with a memory of ten samples."""
    errors = rng.standard_normal(TIME.size)
    for k in range(1, TIME.size):
        errors[k] = 0.9 * errors[k - 1] + np.sqrt(1 - 0.9**2) * errors[k]
    return errors


def pair(seed, common, other_inputs=False):
    """Two runs whose errors have a share in common."""
    rng = np.random.default_rng(seed)
    command, shared = np.repeat(rng.uniform(-4, 4, 60), 20), lasting(rng)
    logs = []
    for k in range(2):
        if k and other_inputs:
            command = np.repeat(rng.uniform(-4, 4, 60), 20)
        errors = np.sqrt(common) * shared + np.sqrt(1 - common) * lasting(rng)
        inputs, units = {"command": command}, {"command": "V", "speed": "rad/s"}
        log = dft.Log(TIME, inputs, units={"command": "V"})
        speed = dft.simulate(MODEL, log)["speed"] + errors
        logs.append(dft.Log(TIME, inputs, {"speed": speed}, units=units, name=f"run {k}"))
    return dft.compare(MODEL, logs).runs


@pytest.mark.parametrize("common", [0.0, 0.4, 0.9])
def test_the_share_is_that_of_the_truth_and_its_interval_covers_it(common):
    """Of ten intervals of 90 % fewer than six cover in one of six hundred studies."""
    shares = [recurring_shares(MODEL, pair(seed, common))["speed"] for seed in range(10)]
    assert np.mean([share.share for share in shares]) == pytest.approx(common, abs=0.1)
    assert sum(share.low <= common <= share.high for share in shares) >= 6


def test_runs_of_other_inputs_say_nothing():
    assert recurring_shares(MODEL, pair(3, 0.9, other_inputs=True)) == {}


def test_channels_keep_their_order_where_the_first_two_runs_share_but_the_last():
    first, second = pair(3, 0.9)
    speed = first.channels["speed"]
    both = {"thrust": speed, "speed": speed}
    runs = replace(first, channels=both), second, replace(second, channels=both)
    assert list(recurring_shares(MODEL, runs)) == ["thrust", "speed"]
