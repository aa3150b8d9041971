"""Sensors that are read at every so many samples: their repeats are no measurements."""

import re

import numpy as np
import pytest
from short_logs import made_log

import diffthrust as dft


def held_readings(values):
    """Every how many samples the log says that a sensor is read, and which are readings."""
    log = dft.Log(0.05 * np.arange(values.size), {}, {"speed": values})
    if log.unrepeated is log:
        return None
    note = log.unrepeated.notes[-1]
    every = float(re.search(r"at every (\S+) samples", note)[1])
    return every, np.isfinite(log.unrepeated.measured["speed"])


def signal(samples=1200, seed=0):
    time, rng = 0.05 * np.arange(samples), np.random.default_rng(seed)
    return 30 * np.sin(time) + 10 * np.sin(2.3 * time) + rng.normal(0, 0.3, samples)


def held(values, every, phase=0):
    """What a log has of a sensor that is read at every so many samples, and the readings."""
    read = np.unique(np.ceil(np.arange(-phase, values.size, every)).astype(int))
    last = np.searchsorted(read, np.arange(values.size), side="right") - 1
    first = read[read >= 0]
    out = np.where(read[last] >= 0, values[np.maximum(read[last], 0)], values[0] - 1.0)
    return out, first


@pytest.mark.parametrize("every", [2, 3, 5, 10, 20])
@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize("quantum", [0.0, 1.0])
def test_held_readings_are_found(every, phase, quantum):
    values = signal() if not quantum else np.round(signal() / quantum) * quantum
    repeated, first = held(values, every, phase)
    found = held_readings(repeated)
    assert found is not None
    assert found[0] == pytest.approx(every)
    missed = np.setxor1d(np.flatnonzero(found[1]), first)
    assert missed.size <= (quantum > 0)  # a last reading that repeats the one before it


def test_readings_at_rest_count():
    values = np.where(np.abs(signal()) < 15, 0.0, signal())
    repeated, first = held(values, 6)
    assert np.flatnonzero(held_readings(repeated)[1]).tolist() == first.tolist()


def test_holds_of_two_and_three_samples_in_turn():
    repeated, first = held(signal(), 2.5)
    every, read = held_readings(repeated)
    assert every == pytest.approx(2.5, abs=0.01)
    assert np.isin(first[1:], np.flatnonzero(read)).all()  # the age of the first is not known


@pytest.mark.parametrize(
    "values",
    [
        signal(),
        np.round(signal()),
        5 * np.round(signal() / 5),
        np.round(0.13 * np.arange(1200)),  # counts on at an even rate
        np.round(10 * np.abs((0.05 * np.arange(1200)) % 20 - 10)),
        np.where(np.abs(signal()) < 30, 0.0, signal()),
        np.full(1200, 3.0),
        np.repeat(signal(5), 240),
    ],
    ids=["noisy", "coarse", "coarser", "counter", "to and fro", "rests", "dead", "few steps"],
)
def test_sensors_that_are_not_held(values):
    assert held_readings(values) is None


def test_lost_samples_and_a_gap_do_not_hide_a_hold():
    repeated, _ = held(signal(), 8)
    torn = np.delete(repeated, [100, 500, 501, 900])  # the grid moves
    torn[600:700] = np.nan
    every, read = held_readings(torn)
    assert every == pytest.approx(8, abs=0.1)
    assert np.isfinite(torn[read]).all()
    assert read.sum() == pytest.approx((torn.size - 100) / 8, abs=4)


def slow(log, every):
    """The log with its speed held."""
    return log.replaced(measured={**log.measured, "speed": held(log.measured["speed"], every)[0]})


def test_a_fit_counts_the_readings_only():
    log = made_log(seed=0, count=800)
    fit = dft.fit(dft.Thruster(), slow(log, 10))
    whole = dft.fit(dft.Thruster(), log)
    assert fit.train.channels["speed"].samples == 80
    assert any("speed is read at every 10 samples" in note for note in fit.notes)
    for name in ("alpha", "beta", "ct"):  # a hold taken for measurements is late by 5 samples
        error = fit.parameters[name].std_error
        assert abs(fit.parameters[name].value - whole.parameters[name].value) < 4 * error
    assert fit.train.nrmse < 1.2 * whole.train.nrmse


def test_a_comparison_counts_the_readings_only():
    log = slow(made_log(seed=0, count=800), 10)
    comp = dft.compare(dft.Thruster(), log)
    assert comp.errors.channels["speed"].samples == 80
    assert comp.origin.train[0].sha256 == log.sha256  # it is of the log that was given


def test_a_log_that_is_not_held_stays_itself():
    log = made_log(seed=0, count=800)
    assert log.unrepeated is log
    once = slow(log, 4).unrepeated
    assert once.unrepeated is once


TIME = np.arange(0.0, 200.0, 0.05)


def motor(seed, noise=0.5):
    """The command of a first-order motor and its speed, read after 0.8 to 2.7 s, and where."""
    rng = np.random.default_rng(seed)
    command = rng.uniform(-80, 80, 41)[(TIME // 5).astype(int)]
    speed = np.zeros(TIME.size)
    for k in range(TIME.size - 1):  # exact for a time constant of 0.5 s
        speed[k + 1] = command[k] + (speed[k] - command[k]) * np.exp(-0.1)
    read = np.searchsorted(TIME, np.cumsum(rng.uniform(0.8, 2.7, 300)))
    read = read[read < TIME.size]
    readings = speed + noise * rng.standard_normal(TIME.size)
    return command, repeat(readings, read), read


def repeat(values, read):
    """The values at some places, each kept until the next; the first one before."""
    last = np.searchsorted(read, np.arange(values.size), side="right") - 1
    return values[read[np.maximum(last, 0)]]


def motor_log(command, speed):
    return dft.Log(TIME, {"command": command}, {"speed": speed}, units={"command": "rad/s"})


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("quantum", [0.0, 0.1])
def test_readings_at_irregular_times_are_found(seed, quantum):
    command, speed, read = motor(seed)
    speed = np.round(speed / quantum) * quantum if quantum else speed
    log = motor_log(command, speed)
    found = np.flatnonzero(log.holds["speed"].read)
    assert np.isin(found, read).all()
    assert found.size >= read.size - 1 - 0.03 * read.size * (quantum > 0)
    assert f"{found.size} readings count" in log.counted.notes[-1]
    assert f"of {TIME.size} samples" in log.counted.notes[-1]
    assert f"speed ({found.size} readings" in repr(log).replace(" [rad/s]", "")


def test_irregular_readings_at_rest_count():
    command, speed, read = motor(0)
    rest = (TIME > 60) & (TIME < 120)
    log = motor_log(np.where(rest, 0.0, command), np.where(rest, 0.0, speed))
    counted = log.unrepeated.measured["speed"]
    inside = np.isfinite(counted) & (TIME > 62) & (TIME < 118)
    assert 5 <= inside.sum() <= ((read > 1240) & (read < 2360)).sum()
    last = TIME[np.isfinite(counted) & rest][-1]
    assert last < 120 - 2.7  # a value that is held when the speed moves off again is old


@pytest.mark.parametrize("kind", ["follows", "demand", "ends", "rests", "coarse", "stands"])
def test_what_only_resembles_irregular_readings(kind):
    rng = np.random.default_rng(3)
    places = np.append(0, np.cumsum(rng.integers(15, 60, 200)))
    steps = repeat(rng.uniform(-80, 80, TIME.size), places[places < TIME.size])
    smooth = 60 * np.sin(TIME) + 20 * np.sin(2.3 * TIME)
    speed = {
        "follows": 0.9 * steps,  # at once, and without noise
        "demand": np.roll(steps, 3),
        "ends": np.clip(smooth, -40, 40),
        "rests": np.where(np.abs(smooth) < 50, 0.0, smooth),
        "coarse": np.round(np.sin(0.05 * TIME) * 30),
        "stands": np.where(TIME % 20 < 15, np.floor(TIME / 20), smooth),
    }[kind]
    assert motor_log(steps, speed).holds == {}


def test_commands_are_held_by_nature():
    command, speed, _ = motor(1)
    log = motor_log(command, speed)
    assert np.array_equal(log.counted.inputs["command"], command)
    assert "command" not in log.holds


def test_a_constant_input_hides_no_hold():
    command, speed, read = motor(2)
    inputs = {"command": command, "supply_voltage": np.full(TIME.size, 24.0)}
    log = dft.Log(TIME, inputs, {"speed": speed})
    assert log.holds["speed"].readings >= read.size - 1
