"""Lines in the spectrum of errors: found where they are, and not in noise of any colour."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from steps import SETTINGS, height_at, height_over_turns, strongest_line, unexplained_line

from diffthrust.diagnosis._periodic_stage import free_name  # private: without a search

LEVEL = SETTINGS.line.level


def coloured(rng, samples, correlation):
    return lfilter([1.0], [1.0, -correlation], rng.standard_normal(samples))


@pytest.mark.thorough
@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_noise_has_no_line(correlation):
    """One hundred draws of two logs: at the level of one in ten thousand not one alarm."""
    time, p = 0.1 * np.arange(300), []
    for seed in range(100):
        rng = np.random.default_rng([seed, 7])
        logs = [(time, coloured(rng, 300, correlation)) for _ in range(2)]
        p.append(strongest_line("speed", logs).p_value)
    assert min(p) > LEVEL
    # and what is called one in twenty is about that
    assert 0.0 < np.mean(np.array(p) < 0.05) < 0.12


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9, 0.98])
@pytest.mark.parametrize(("samples", "logs", "rate"), [(400, 1, 10), (800, 2, 20), (2000, 2, 20)])
def test_false_alarms_of_two_hundred_draws(correlation, samples, logs, rate):
    alarms = 0
    for seed in range(200):
        rng = np.random.default_rng([seed, samples, int(100 * correlation)])
        drawn = [(np.arange(samples) / rate, coloured(rng, samples, correlation))
                 for _ in range(logs)]  # fmt: skip
        alarms += strongest_line("speed", drawn).p_value < LEVEL
    assert alarms <= 2


def wave(time, frequency, phase):
    return np.sin(2 * np.pi * frequency * time + phase)


def test_a_line_under_coloured_noise_is_found_with_its_frequency_and_amplitude():
    rng = np.random.default_rng(3)
    logs = []
    for samples in (400, 700):
        time = 0.1 * np.arange(samples)
        logs.append((time, 2.0 * wave(time, 0.83, samples) + coloured(rng, samples, 0.9)))
    line = strongest_line("speed", logs)
    assert line.p_value < LEVEL
    assert line.frequency == pytest.approx(0.83, abs=0.002)
    assert line.amplitude == pytest.approx(2.0, rel=0.2)


def test_lost_and_held_samples_make_no_line_and_hide_none():
    rng, time = np.random.default_rng(4), 0.1 * np.arange(1200)
    noise = rng.standard_normal(1200)
    for kept in (np.arange(1200) % 4 == 0, rng.random(1200) < 0.7):
        quiet = np.where(kept, noise, np.nan)
        loud = np.where(kept, noise + wave(time, 0.4, 1.0), np.nan)
        assert strongest_line("speed", [(time, quiet)]).p_value > LEVEL
        assert strongest_line("speed", [(time, loud)]).frequency == pytest.approx(0.4, abs=0.003)


def test_too_few_samples_have_no_line():
    assert strongest_line("speed", [(0.1 * np.arange(50), np.ones(50))]) is None
    assert height_at([(0.1 * np.arange(50), np.ones(50))], 1.0) == 0.0


TIME = 0.05 * np.arange(1200)
SPEED = 20.0 + 8.0 * np.sin(0.11 * TIME) + 4.0 * np.sin(0.37 * TIME)  # [rad/s]
ANGLE = np.concatenate([[0.0], np.cumsum(0.5 * (SPEED[1:] + SPEED[:-1]) * 0.05)])


@pytest.mark.parametrize("by_turns", [False, True])
def test_a_ripple_by_turns_is_sharper_over_the_angle_and_a_force_in_time_over_time(by_turns):
    noise = np.random.default_rng(5).standard_normal(TIME.size)
    swing = np.sin(0.3 * ANGLE) if by_turns else wave(TIME, 0.95, 0.0)
    logs = [(TIME, swing + noise)]
    over_turns = height_over_turns(logs, [SPEED], 0.95)
    over_time = height_at(logs, 0.95)
    assert (over_turns > over_time) == by_turns


def search(errors, signals, rates=None):
    """A search with only what the lines are sought in: one log of one channel."""
    passed = [SimpleNamespace(path={"time": TIME}, errors=errors[None])]
    run = SimpleNamespace(
        time=TIME, signals={**signals, **(rates or {})}, channels={},
        units=dict.fromkeys(rates or {}, "rad/s"), record=SimpleNamespace(unsigned=frozenset()),
    )  # fmt: skip
    state = SimpleNamespace(
        current=SimpleNamespace(trial=SimpleNamespace(passed=passed)),
        stages=(SimpleNamespace(runs=(run,)),),
    )
    fitter = SimpleNamespace(channels=("speed",), records=(SimpleNamespace(time=TIME),))
    return SimpleNamespace(fitter=fitter), state


def test_a_line_that_a_signal_has_as_well_is_no_force_of_its_own():
    rng = np.random.default_rng(6)
    errors = wave(TIME, 0.7, 0.3) + rng.standard_normal(TIME.size)
    steps = np.repeat(rng.uniform(-1, 1, 30), 40)
    line = unexplained_line(*search(errors, {"command": steps}))
    assert line.frequency == pytest.approx(0.7, abs=0.003)
    # the square of the input swings with twice its frequency
    assert unexplained_line(*search(errors, {"command": wave(TIME, 0.35, 0.0)})) is None
    assert unexplained_line(*search(rng.standard_normal(TIME.size), {"command": steps})) is None


def test_a_line_that_is_sharper_over_the_turns_of_a_shaft_is_left_to_the_angle():
    rng = np.random.default_rng(7)
    errors = 2.0 * np.sin(0.3 * ANGLE + 1.0) + rng.standard_normal(TIME.size)
    # a speed that hardly moves smears a ripple little: over time, too, it is a line
    steady = 20.0 + 0.1 * (SPEED - 20.0)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (steady[1:] + steady[:-1]) * 0.05)])
    ripple = 2.0 * np.sin(0.3 * angle + 1.0) + rng.standard_normal(TIME.size)
    assert unexplained_line(*search(ripple, {}, {"speed": steady})) is None
    assert unexplained_line(*search(errors, {}, {"speed": SPEED})) is None


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_further_force_has_a_name_that_no_other_has(number):
    names = "periodic_force", "periodic_force_2", "periodic_force_3"
    candidates = dict.fromkeys((*names[1:number], "wind"))
    effects = tuple(SimpleNamespace(name=name) for name in names[: min(number, 1)])
    fitter, model = SimpleNamespace(candidates=candidates), SimpleNamespace(effects=effects)
    assert free_name(SimpleNamespace(fitter=fitter, given=model)) == names[number]
