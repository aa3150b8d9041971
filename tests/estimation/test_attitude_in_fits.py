"""Fits of crafts whose attitude is a quaternion: where segments begin, and what is free at all."""

import math

import numpy as np
import pytest
from observers import observer_of
from problems import build, restarts, solve

import diffthrust as dft
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import FourDegrees, Planar, SixDegrees
from diffthrust.sensors import Attitude

STEP, SAMPLES, NOISE = 0.1, 1200, 0.01
ANGLES, READ = ("roll", "pitch", "heading"), ("roll", "pitch", "yaw")
QUATERNION = ("qw", "qx", "qy", "qz")
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


def recorded(channels: tuple[str, ...], seed: int = 0, model: dft.Model | None = None) -> dft.Log:
    rng = np.random.default_rng(seed)
    draws = rng.uniform(-0.5, 0.8, (3, SAMPLES // 20))
    inputs = {
        f"{n}.command": np.repeat(series, 20) for n, series in zip(PLACES, draws, strict=True)
    }
    units = dict.fromkeys(inputs, "effort")
    time = STEP * np.arange(SAMPLES)
    run = dft.simulate(model or vehicle(), dft.Log(time, inputs, units=units), substeps=4)
    measured = {n: run[n] + NOISE * rng.standard_normal(SAMPLES) for n in channels}
    return dft.Log(time, inputs, measured, units=units)


def errors(log: dft.Log, horizon: float, model: dft.Model | None = None) -> dict[str, float]:
    """The noise level of each channel, by segments of the true model."""
    problem = build(model or vehicle(), [log], substeps=4, segmented=True)
    problem = restarts(problem, horizon, hold=True)
    end = solve(problem, problem.start(), budget=1)
    return dict(zip(problem.layout.channels, np.asarray(end.quadratic.sigma), strict=True))


@pytest.mark.parametrize(
    "read",
    [ANGLES, QUATERNION, *(tuple(f"odom.{n}" for n in names) for names in (QUATERNION, READ))],
)
def test_segments_begin_at_the_attitude_that_was_measured(read):
    """Ran it on, errors of the velocities at which segments begin would add up in it."""
    by_channel = errors(recorded((*VELOCITIES, *read)), 1.0)
    # readings begin segments, and a second of rates that begin with their own noise
    assert max(by_channel.values()) < 4 * NOISE


@pytest.mark.parametrize(
    "read", [("roll", "pitch"), ("heading",), ("odom.yaw",), ("heading", "odom.roll")]
)
def test_segments_do_not_begin_at_an_angle_that_nothing_measured(read):
    log = recorded((*VELOCITIES, *read))
    problem = build(vehicle(), [log], segmented=True)
    assert not set(QUATERNION) & set(problem.layout.grids[0].restarted)
    assert set(VELOCITIES) <= set(problem.layout.grids[0].restarted)


def test_angles_that_are_read_at_other_samples_than_velocities_begin_segments():
    log = recorded((*VELOCITIES, *ANGLES))
    odd = np.arange(SAMPLES) % 2 == 1
    measured = {n: np.where(odd == (n in ANGLES), v, np.nan) for n, v in log.measured.items()}
    by_channel = errors(log.replaced(measured=measured), 1.0)
    assert max(by_channel.values()) < 4 * NOISE


@pytest.mark.thorough
def test_an_attitude_that_a_sensor_distorts_begins_no_segment():
    """Begun at it, the offset of a compass would be nought."""
    channels = (*VELOCITIES, "north", "east", *ANGLES)
    offset = dft.effects.Formula("heading", "a", name="offset", a="rad")
    model = vehicle() + offset
    log = recorded(channels, model=model.replace({"offset.a": 0.2}))
    problem = build(model, [log], segmented=True)
    assert not set(QUATERNION) & set(problem.layout.grids[0].restarted)
    fit = dft.fit(model, log, starts=2, horizon=5.0)
    assert fit.parameters["offset.a"].value == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("body", [Planar(), FourDegrees()])
@pytest.mark.parametrize(("frame", "read"), [("NED", ("yaw",)), ("ENU", QUATERNION)])
def test_a_craft_that_stays_level_needs_the_heading_alone(body, frame, read):
    """It turns through all headings."""
    mounts = {n: StaticThruster().at(PLACES[n][0]) for n in ("port", "starboard")}
    model = dft.Craft(body, **mounts, odom=Attitude(frame=frame))
    time = STEP * np.arange(SAMPLES)
    inputs = {"port.command": np.full(SAMPLES, 0.5), "starboard.command": np.full(SAMPLES, 0.4)}
    units = dict.fromkeys(inputs, "effort")
    run = dft.simulate(model, dft.Log(time, inputs, units=units))
    rng = np.random.default_rng(3)
    assert np.ptp(run["heading"]) > 2 * np.pi
    names = ("surge", "sway", "yaw_rate", *(f"odom.{n}" for n in read))
    measured = {n: run[n] + NOISE * rng.standard_normal(SAMPLES) for n in names}
    by_channel = errors(dft.Log(time, inputs, measured, units=units), 5.0, model)
    assert max(by_channel.values()) < 4 * NOISE


def test_a_body_of_ones_own_may_take_numbers_alone():
    class Mine(SixDegrees):
        def start_from(self, first):
            half = 0.5 * math.remainder(first.get("heading", 0.0), 2 * math.pi)
            return {"qw": math.cos(half), "qx": 0.0, "qy": 0.0, "qz": math.sin(half)}

    law = StaticThruster(gain=20.0, exponent=1.6)
    model = dft.Craft(Mine(), **{n: law.at(*place) for n, place in PLACES.items()})
    problem = build(model, [recorded((*VELOCITIES, *ANGLES))], segmented=True)
    assert not set(QUATERNION) & set(problem.layout.grids[0].restarted)


def test_a_quaternion_is_no_angle_in_degrees():
    """Every reading without a unit was said to jump by a full turn."""
    log = recorded((*VELOCITIES, *(f"odom.{n}" for n in QUATERNION)))
    fit = dft.fit(vehicle(), log, starts=1, horizon=None)
    assert [doubt.kind for doubt in fit.doubts if doubt.channel.startswith("odom")] == []


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


@pytest.mark.parametrize("read", [ANGLES, tuple(f"odom.{n}" for n in QUATERNION)])
def test_a_quaternion_follows_the_angles_that_are_corrected(read):
    """By itself it had a gain by every velocity for every part; the angles corrected nothing."""
    observer = observer_of(vehicle(), recorded((*VELOCITIES, *read)), (*VELOCITIES, *read))
    assert observer.follow == QUATERNION
    assert dict(observer.corrected) == {n: (n,) for n in (*VELOCITIES, *read)}
    assert observer.forced == VELOCITIES


@pytest.mark.thorough
def test_an_innovations_fit_of_a_craft_in_six_degrees():
    model = vehicle()
    log = recorded((*VELOCITIES, *ANGLES), seed=4)
    fit = dft.fit(model, log, likelihood="innovations", starts=2, seed=1)
    for name, p in model.parameters.items():
        if not p.fixed:
            estimate = fit.parameters[name]
            assert abs(estimate.value - p.value) < 4 * estimate.std_error, name
    assert "noise.heading.gain.heading" in fit.disturbance
    assert not [name for name in fit.disturbance if ".q" in name]


def test_the_length_of_a_first_quaternion_means_nothing():
    log = recorded(ANGLES)
    turned = vehicle().start_from({"roll": 0.1, "pitch": -0.2, "heading": 2.0})
    longer = {name: 3.0 * part for name, part in turned.items()}
    first, second = (dft.simulate(vehicle(), log, initial=q) for q in (turned, longer))
    for name in ANGLES:
        np.testing.assert_allclose(first[name], second[name], atol=1e-12)
