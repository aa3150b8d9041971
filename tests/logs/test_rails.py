"""Samples at the ends of a sensor's range: found, or given, and left out of what counts."""

from pathlib import Path

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError

TIME = np.arange(1500) * 0.02
TRUE = 40.0 * np.sin(0.7 * TIME) + 15.0 * np.sin(2.1 * TIME + 1.0)
NOISE = np.random.default_rng(4).standard_normal(TIME.size)
OTHER = TRUE + np.random.default_rng(5).standard_normal(TIME.size)


def log_of(thrust, speed=OTHER, command=TRUE / 20.0, **told):
    return dft.Log(TIME, {"command": command}, {"speed": speed, "thrust": thrust}, **told)


def test_a_clipped_sensor_is_seen_at_both_ends():
    thrust = np.clip(TRUE + NOISE, -30.0, 35.0)
    log = log_of(thrust)
    assert set(log.railed) == {"thrust"}
    low, high, side = log.railed["thrust"]
    assert (low, high) == (-30.0, 35.0)
    assert np.array_equal(side, np.where(thrust == 35.0, 1, np.where(thrust == -30.0, -1, 0)))
    counted = log.counted
    assert np.array_equal(np.isnan(counted.measured["thrust"]), side != 0)
    assert np.array_equal(counted.measured["speed"], OTHER)
    assert counted.counted is counted
    (note,) = counted.notes
    assert f"{(side < 0).sum()} at -30.00 and {(side > 0).sum()} at 35.00 of 1500" in note
    assert "are ignored" in note


def test_without_noise_the_other_sensors_tell():
    """What another sensor still sees move; where that stands still, the system is at its limit."""
    thrust = np.minimum(np.round(TRUE, 1), 35.0)
    assert log_of(thrust).railed["thrust"].high == 35.0
    assert log_of(thrust, speed=np.minimum(TRUE, 35.0) + 0.1 * NOISE).railed == {}


def settled(step):
    """A first-order answer to steps, rounded: its last level is the largest."""
    command = np.where((np.arange(TIME.size) // 300) % 2, 30.0, -10.0)
    out, x = np.empty(TIME.size), 0.0
    for k, u in enumerate(command):
        x += 0.1 * (u - x)
        out[k] = x
    return np.round(out / step) * step, command


@pytest.mark.parametrize("step", [1e-9, 0.01, 0.1, 0.5])
def test_a_level_at_which_a_sensor_settles_is_no_rail(step):
    values, command = settled(step)
    assert log_of(values, speed=values + 0.5 * NOISE, command=command).railed == {}


@pytest.mark.parametrize(
    ("thrust", "command"),
    [
        (TRUE + NOISE, TRUE / 20.0),
        (np.round(TRUE + 0.3 * NOISE), TRUE / 20.0),
        (TRUE + NOISE, np.clip(TRUE / 20.0, -1.0, 1.0)),  # an input may be limited
        (np.maximum(TRUE + 0.01 * NOISE, 0.0), TRUE / 20.0),  # at rest
        ((TRUE + NOISE)[np.arange(TIME.size) // 10 * 10], TRUE / 20.0),  # held
        (np.where(np.arange(TIME.size) % 97 == 3, 999.0, TRUE + NOISE), TRUE / 20.0),  # a code
        (np.full(TIME.size, 7.0), TRUE / 20.0),
    ],
)
def test_sound_channels_have_no_rails(thrust, command):
    assert log_of(thrust, command=command).railed == {}


def test_rails_that_are_given_hold_in_the_unit_of_the_channel():
    thrust = np.minimum(TRUE + NOISE, 35.0) / 9.80665
    log = log_of(thrust, units={"thrust": "kgf"}, rails={"thrust": (-np.inf, 34.0 / 9.80665)})
    assert np.array_equal(log.railed["thrust"].side == 1, thrust * 9.80665 >= 34.0)
    assert log.railed["thrust"].high == pytest.approx(34.0)
    assert "3.467 kgf" in log.counted.notes[0]
    assert log.sha256 != log_of(thrust, units={"thrust": "kgf"}).sha256


def test_a_channel_may_be_said_to_have_no_rails():
    log = log_of(np.minimum(TRUE + NOISE, 35.0), rails={"thrust": (-np.inf, np.inf)})
    assert log.railed == {}
    assert log.counted is log


@pytest.mark.parametrize("rails", [(3.0, 1.0), (1.0,), "200", (0.0, float("nan")), 5.0])
def test_rails_that_cannot_be_meant_are_refused(rails):
    with pytest.raises(InputError, match=r"rails as \(low, high\)") as caught:
        log_of(TRUE, rails={"thrust": rails})
    assert "thrust" in str(caught.value)


def test_rails_of_an_input_are_refused():
    with pytest.raises(InputError, match="rails names 'command'"):
        log_of(TRUE, rails={"command": (-1.0, 1.0)})


def test_a_file_says_where_a_range_ends(tmp_path: Path):
    thrust = np.minimum(TRUE + NOISE, 35.0)
    rows = np.stack([TIME, TRUE / 20.0, thrust], axis=1)
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,u,F", comments="")
    column = dft.Column("F", unit="N", rails=(-np.inf, 35.0), censored=True)
    read = dft.read_log(
        tmp_path / "run.csv", time="t", inputs={"command": "u"}, measured={"thrust": column}
    )
    assert read.railed["thrust"].samples == (thrust == 35.0).sum()
    assert read.censored == {"thrust"}
    (tmp_path / "fit.toml").write_text(
        'model = "thruster"\n[logs]\ntrain = ["run.csv"]\ntime = "t"\n'
        '[channels.command]\ncolumn = "u"\n'
        '[channels.thrust]\ncolumn = "F"\nunit = "N"\nrails = [-inf, 35]\ncensored = true\n'
    )
    (log,) = dft.load_spec(tmp_path / "fit.toml").train_logs()
    assert log.rails == {"thrust": (-np.inf, 35.0)}
    assert log.sha256 == read.sha256
