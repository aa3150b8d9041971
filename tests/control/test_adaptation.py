"""Adaptive sliding control: what it learns of an obstructed duct, and not beyond a limit."""

import math

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import control, effects

ALPHA, BETA, CT = 0.037, 42.0, 0.022
LOAD, INERTIA, LIMIT = ALPHA / BETA, 1.0 / BETA, 10.0
THRUSTER = dft.Thruster(alpha=ALPHA, beta=BETA, ct=CT)
GAINS = {"gain": 1.0, "floor": 0.3, "limit": LIMIT}
RATE, TURN = 200.0, 0.6 * math.pi


def tracked(block, amplitude=0.05, duration=30.0, speed=0.0, obstructed=None):
    loop = control.Loop(
        thruster=THRUSTER + effects.CommandSaturation(limit=LIMIT),
        vehicle=dft.AxisVehicle(mass=340.0, drag=67.0),
        controller=control.PositionController(bandwidth=1.0, mass=340.0, drag=67.0),
        compensator=block,
        rate=RATE,
        faults=[] if obstructed is None else [control.duct_obstruction(at=obstructed)],
    )
    way = control.Sinusoid(amplitude, TURN, offset=amplitude, phase=-math.pi / 2)
    return loop.simulate(way, duration, initial={"speed": speed}, substeps=4)


def turning(amplitude):
    """The speed that the reference asks for at first, so that nothing jumps."""
    return math.sqrt(340.0 * amplitude * TURN**2 / CT)


def load(run):
    return run["compensator.load_estimate"]


def by_hand(amplitude, duration, speed, obstructed, load_rate):
    """The same loop written out: the law of section V at each sample, Runge-Kutta in between."""
    period, substeps = 1.0 / RATE, 4
    x, v, w, last = 0.0, 0.0, speed, None
    c, h, told = LOAD, INERTIA, []
    for k in range(round(duration * RATE) + 1):
        t = k * period
        wanted = amplitude * (1.0 - math.cos(TURN * t))
        rate, bend = amplitude * TURN * math.sin(TURN * t), amplitude * TURN**2 * math.cos(TURN * t)
        force = 67.0 * v * abs(v) + 340.0 * (bend - 2.0 * (v - rate) - (x - wanted))
        aim = force / math.sqrt(CT * (abs(force) + 0.3))
        climb = 0.0 if last is None else (aim - last) / period
        last, s, swept = aim, w - aim, w * abs(w)
        free = c * swept + h * climb - max(-1.0, min(1.0, s / 4.0))
        command = max(-LIMIT, min(LIMIT, free))
        outside = s - max(-4.0, min(4.0, s))
        if (free > LIMIT and outside < 0) or (free < -LIMIT and outside > 0):
            outside = 0.0  # it would ask for still more
        c, h = c - period * load_rate * swept * outside, h - period * 5e-6 * climb * outside
        told.append((x, c, h))
        blocked = t >= obstructed - 1e-9
        alpha, ct = ALPHA * (2.0 if blocked else 1.0), CT * (0.9 if blocked else 1.0)

        def slope(y, command=command, alpha=alpha, ct=ct):
            _, v, w = y
            thrust = ct * w * abs(w)
            drag = 67.0 * v * abs(v)
            return np.array([v, (thrust - drag) / 340.0, BETA * command - alpha * w * abs(w)])

        y, step = np.array([x, v, w]), period / substeps
        for _ in range(substeps):
            a = slope(y)
            b = slope(y + 0.5 * step * a)
            d = slope(y + 0.5 * step * b)
            e = slope(y + step * d)
            y = y + step / 6.0 * (a + 2.0 * b + 2.0 * d + e)
        x, v, w = (float(value) for value in y)
    return np.array(told).T


def test_the_loop_is_that_of_the_paper_written_out():
    """Through the obstruction and the commands at the limit, position and both estimates."""
    block = control.AdaptiveSliding.of(THRUSTER, load_rate=1e-7, **GAINS)
    run = tracked(block, duration=8.0, speed=turning(0.05), obstructed=3.0)
    x, c, h = by_hand(0.05, 8.0, turning(0.05), 3.0, 1e-7)
    np.testing.assert_allclose(run["position"], x, atol=1e-6)
    np.testing.assert_allclose(load(run), c, rtol=1e-4)
    np.testing.assert_allclose(run["compensator.inertia_estimate"], h, rtol=1e-4)
    assert c[-1] > 1.9 * c[0]
    assert np.max(np.abs(run["command"])) == LIMIT


def test_an_obstruction_is_learned_and_its_error_falls():
    """Figures 19 and 21: nothing is learned with the duct free; obstructed, the load is found."""
    first = turning(0.05)
    learning = control.AdaptiveSliding.of(THRUSTER, load_rate=1e-7, **GAINS)
    free = tracked(learning, speed=first)
    assert np.ptp(load(free)) < 0.01 * LOAD
    blocked = tracked(learning, speed=first, obstructed=8.0)
    before = blocked.time <= 8.0
    assert np.ptp(load(blocked)[before]) < 0.01 * LOAD
    assert load(blocked)[-1] == pytest.approx(2.0 * LOAD, rel=0.05)
    assert np.ptp(load(blocked)[blocked.time > 10.0]) < 2e-3 * LOAD  # learned, and at rest again
    plain = tracked(control.Sliding.of(THRUSTER, **GAINS), speed=first, obstructed=8.0)
    unlearning = tracked(learning.replace(load_rate=1e-30, inertia_rate=1e-30), speed=first,
                         obstructed=8.0)  # fmt: skip
    errors = [one.tracking(start=15.0).relative for one in (blocked, plain, unlearning)]
    assert errors[0] < 0.25 * errors[1]
    assert errors[2] == pytest.approx(errors[1], rel=1e-6)  # it is the adaptation that does it
    assert all(np.max(np.abs(one["command"])) <= LIMIT for one in (free, blocked, plain))


def test_estimates_converge_from_zero_and_then_rest():
    """Figure 20: a commanded position of 0.2 m at 0.3 Hz, which takes the 10 V of the motor."""
    block = control.AdaptiveSliding(thrust_coefficient=CT, gain=1.5, width=6.0, load_rate=2e-8,
                                    inertia_rate=2e-6, floor=5.0, limit=LIMIT)  # fmt: skip
    run = tracked(block, amplitude=0.2)
    inertia = run["compensator.inertia_estimate"]
    assert load(run)[0] == inertia[0] == 0.0
    assert load(run)[-1] == pytest.approx(LOAD, rel=0.15)
    assert inertia[-1] == pytest.approx(INERTIA, rel=0.4)  # the paper: "do not converge exactly"
    late = run.time > 10.0
    assert np.ptp(load(run)[late]) < 1e-3 * LOAD
    assert np.ptp(inertia[late]) < 2e-3 * INERTIA
    assert run.tracking(start=10.0).relative < 0.05


def test_an_unknown_limit_winds_the_estimates_up_and_a_known_one_does_not():
    block = control.AdaptiveSliding(thrust_coefficient=CT, gain=1.0, load_rate=1e-7, floor=5.0)
    wound, calm = (tracked(block.replace(limit=limit), amplitude=0.2) for limit in (1e3, LIMIT))
    assert np.max(np.abs(wound["command"])) > 100.0
    assert wound.tracking(start=10.0).relative > 1.0
    assert load(calm)[-1] == pytest.approx(LOAD, rel=0.1)
    assert calm.tracking(start=10.0).relative < 0.05
