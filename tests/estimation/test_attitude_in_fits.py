"""Fits of crafts whose attitude is a quaternion: where segments begin, and what is free at all."""

import numpy as np
import pytest
from problems import build, restarts, solve

import diffthrust as dft
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import SixDegrees
from diffthrust.sensors import Attitude

STEP, SAMPLES, NOISE = 0.1, 1200, 0.01
ANGLES, QUATERNION = ("roll", "pitch", "heading"), ("qw", "qx", "qy", "qz")
VELOCITIES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
PLACES = {
    "port": ((-0.2, -0.2, 0.0), (1.0, 0.0, 0.0)),
    "starboard": ((-0.2, 0.2, 0.0), (1.0, 0.0, 0.0)),
    "bow": ((0.2, 0.1, 0.1), (0.0, 0.6, 0.8)),
}


def vehicle() -> dft.Model:
    law = StaticThruster(gain=20.0, exponent=1.6)
    mounts = {name: law.at(*place) for name, place in PLACES.items()}
    body = SixDegrees(
        m11=17.0, m22=24.0, m33=26.0, i44=0.4, i55=0.6, i66=0.6, d11=8.0, d22=16.0, d33=15.0,
        d44=0.8, d55=0.9, d66=0.7, q11=18.0, q22=20.0, q33=30.0, q44=0.5, q55=0.5, q66=0.5,
        weight=112.8, buoyancy=112.8, z_g=0.05,
    )  # fmt: skip
    model = dft.Craft(body, **mounts, odom=Attitude(), share=[tuple(PLACES)])
    return model.fix(*(n for n in model.parameters if n not in ("m11", "i44", "i66", "d11", "d66")))


def recorded(channels: tuple[str, ...], seed: int = 0) -> dft.Log:
    rng = np.random.default_rng(seed)
    draws = rng.uniform(-0.5, 0.8, (3, SAMPLES // 20))
    inputs = {
        f"{n}.command": np.repeat(series, 20) for n, series in zip(PLACES, draws, strict=True)
    }
    units = dict.fromkeys(inputs, "effort")
    time = STEP * np.arange(SAMPLES)
    run = dft.simulate(vehicle(), dft.Log(time, inputs, units=units), substeps=4)
    measured = {n: run[n] + NOISE * rng.standard_normal(SAMPLES) for n in channels}
    return dft.Log(time, inputs, measured, units=units)


def errors(log: dft.Log, horizon: float) -> dict[str, float]:
    """The noise level of each channel, by segments of the true model."""
    problem = build(vehicle(), [log], substeps=4, segmented=True)
    problem = restarts(problem, horizon, hold=True)
    end = solve(problem, problem.start(), budget=1)
    return dict(zip(problem.layout.channels, np.asarray(end.quadratic.sigma), strict=True))


@pytest.mark.parametrize(
    "read", [ANGLES, QUATERNION, tuple(f"odom.{n}" for n in QUATERNION), ("odom.yaw",)]
)
def test_segments_begin_at_the_attitude_that_was_measured(read):
    """Ran it on, errors of the velocities at which segments begin would add up in it."""
    log = recorded((*VELOCITIES, *read))
    by_channel = errors(log, 1.0)
    # readings begin segments, and a second of rates that begin with their own noise
    assert max(by_channel[n] for n in read) < 4 * NOISE


def test_segments_do_not_begin_at_a_heading_that_nothing_measured():
    log = recorded((*VELOCITIES, "roll", "pitch"))
    problem = build(vehicle(), [log], segmented=True)
    assert not set(QUATERNION) & set(problem.layout.grids[0].restarted)
    assert set(VELOCITIES) <= set(problem.layout.grids[0].restarted)


def test_an_attitude_that_a_sensor_distorts_begins_no_segment():
    log = recorded((*VELOCITIES, *ANGLES))
    model = vehicle() + dft.effects.Formula("heading", "a", name="offset", a="rad")
    problem = build(model, [log], segmented=True)
    assert not set(QUATERNION) & set(problem.layout.grids[0].restarted)


@pytest.mark.thorough
def test_a_fit_of_a_craft_in_six_degrees():
    """From 20 % off; the length of the first quaternion is no unknown."""
    logs = [recorded((*VELOCITIES, *ANGLES), seed) for seed in (1, 2)]
    model = vehicle()
    free = {n: p.value for n, p in model.parameters.items() if not p.fixed}
    fit = dft.fit(model.replace({n: 1.2 * v for n, v in free.items()}), logs, seed=1)
    assert fit.status.ok, fit.message
    for name, true in free.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - true) < 4 * estimate.std_error, name
    assert fit.checks.rank == fit.checks.free_parameters == len(free) + 2 * (6 + 3)
    assert fit.checks.condition < 1e4
    for start in fit.initial:
        assert sum(start[n] ** 2 for n in QUATERNION) == pytest.approx(1.0, abs=0.05)


def test_the_length_of_a_first_quaternion_means_nothing():
    log = recorded(ANGLES)
    turned = vehicle().start_from({"roll": 0.1, "pitch": -0.2, "heading": 2.0})
    longer = {name: 3.0 * part for name, part in turned.items()}
    first, second = (dft.simulate(vehicle(), log, initial=q) for q in (turned, longer))
    for name in ANGLES:
        np.testing.assert_allclose(first[name], second[name], atol=1e-12)
