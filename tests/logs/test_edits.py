"""Stretches that are left out, and channels moved in time, of a log and by a spec."""

from fractions import Fraction

import numpy as np
import pytest

import diffthrust as dft

TIME = 0.1 * np.arange(50)


def made(**fields):
    rng = np.random.default_rng(3)
    inputs = {"command": np.repeat(rng.uniform(-3.0, 3.0, 10), 5)}
    measured = {"speed": np.cumsum(rng.normal(size=50)), "thrust": np.sin(TIME)}
    units = {"command": "V", "speed": "rad/s", "thrust": "N"}
    return dft.Log(TIME, inputs, measured, units=units, name="run1.csv", **fields)


def test_a_stretch_left_out_is_missing_and_noted_while_the_command_goes_on():
    log = made()
    shorter = log.leave_out(1.0, 2.0, "weed in the propeller")
    inside = (TIME > 0.95) & (TIME < 2.05)
    for name, values in log.measured.items():
        np.testing.assert_array_equal(shorter.measured[name], np.where(inside, np.nan, values))
    np.testing.assert_array_equal(shorter.inputs["command"], log.inputs["command"])
    assert shorter.notes[-1] == "1 to 2 s are left out: weed in the propeller."
    assert log.leave_out(0.0, 0.3).notes[-1] == "0 to 0.3 s are left out."


@pytest.mark.parametrize(
    ("start", "stop", "expected"),
    [
        (2.0, 1.0, "found 2.0 to 1.0"),
        (float("nan"), 1.0, "found nan to 1.0"),
        (8.0, 9.0, "the log lasts 4.9 s"),
        (-1.0, 9.0, "nothing is left of 'speed'"),
    ],
)
def test_a_stretch_that_cannot_be_left_out_is_refused(start, stop, expected):
    with pytest.raises(dft.InputError, match=expected):
        made().leave_out(start, stop)


def test_channels_move_together_by_whole_samples_to_the_last_bit():
    log = made()
    late = log.shifted(0.3, "speed", "thrust", "command")
    for name in ("speed", "thrust"):
        np.testing.assert_allclose(late.measured[name][3:], log.measured[name][:-3], atol=1e-12)
        assert np.isnan(late.measured[name][:3]).all()
    np.testing.assert_array_equal(late.inputs["command"][3:], log.inputs["command"][:-3])
    assert (late.inputs["command"][:3] == log.inputs["command"][0]).all()
    early = log.shifted(-0.2, "speed")
    np.testing.assert_allclose(early.measured["speed"][:-2], log.measured["speed"][2:], atol=1e-12)
    assert np.isnan(early.measured["speed"][-2:]).all()
    assert "thrust" in log.measured
    np.testing.assert_array_equal(early.measured["thrust"], log.measured["thrust"])


def test_a_shift_by_half_a_sample_is_the_mean_of_two():
    log = made()
    late, thrust = log.shifted(0.05, "thrust").measured["thrust"], log.measured["thrust"]
    np.testing.assert_allclose(late[1:], 0.5 * (thrust[1:] + thrust[:-1]), atol=1e-12)


def test_any_kind_of_number_shifts():
    late, same = (made().shifted(half, "speed") for half in (Fraction(1, 2), 0.5))
    np.testing.assert_array_equal(late.measured["speed"], same.measured["speed"])
    assert late.notes == same.notes


def test_a_shift_back_undoes_a_shift():
    log = made()
    back = log.shifted(0.4, "speed").shifted(-0.4, "speed")
    kept = np.isfinite(back.measured["speed"])
    np.testing.assert_allclose(back.measured["speed"][kept], log.measured["speed"][kept])
    assert kept.sum() == 46


@pytest.mark.parametrize("channels", [(), ("rpm",)])
def test_a_shift_of_no_channel_is_refused(channels):
    with pytest.raises(dft.InputError, match="command, speed, thrust"):
        made().shifted(0.1, *channels)
    with pytest.raises(dft.InputError, match="expected a shift in seconds, found inf"):
        made().shifted(float("inf"), "speed")
