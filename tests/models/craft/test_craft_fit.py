"""Parameters of crafts recovered from noise, and what logs cannot tell."""

import math

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import FourDegrees, Planar, SixDegrees

C = math.sqrt(0.5)
LAW = StaticThruster(gain=30.0, exponent=1.5)
NOISE = {
    **dict.fromkeys(("surge", "sway", "heave", "yaw_rate"), 0.01),
    **dict.fromkeys(("depth", "heading", "roll", "pitch"), 0.01),
}


def recorded(truth: dft.Craft, seed: int, count: int, *, step=0.1, hold=15, low=-1.0) -> dft.Log:
    """A log of steps of all commands, with noise on what such vehicles measure."""
    rng = np.random.default_rng(seed)
    time = step * np.arange(count)
    steps = rng.uniform(low, 1.0, (len(truth.inputs), count // hold + 1))
    inputs = dict(zip(truth.inputs, np.repeat(steps, hold, 1)[:, :count], strict=True))
    out = dft.simulate(truth, dft.Log(time, inputs, units=dict(truth.inputs)), substeps=8)
    measured = {n: out[n] + rng.normal(0, s, count) for n, s in NOISE.items() if n in out}
    return dft.Log(time, inputs, measured, units=dict(truth.inputs), name=f"run{seed}")


def distances(fit: dft.estimation.Fit, truth: dft.Craft) -> np.ndarray:
    """Errors of the free parameters in standard errors."""
    free = {n: e for n, e in fit.parameters.items() if not e.fixed}
    assert all(e.std_error for e in free.values()), fit.report()
    true = truth.parameters
    return np.array([(e.value - true[n].value) / e.std_error for n, e in free.items()])


def twin(**numbers: float) -> dft.Craft:
    """A boat of two thrusters, of which one is weaker."""
    return dft.Craft(
        Planar(),
        port=LAW.at((-0.4, -0.285, 0)),
        starboard=LAW.at((-0.4, 0.285, 0)),
        share=[("port", "starboard")],
    ).replace(numbers)


TWIN = {"m11": 36.0, "m22": 58.0, "i33": 5.0, "d11": 18.0, "d22": 70.0, "d33": 10.0}


@pytest.fixture(scope="module")
def twin_logs() -> list[dft.Log]:
    truth = twin(**TWIN, **{"starboard.strength": 0.8})
    return [recorded(truth, seed, 300, low=-0.3) for seed in (1, 2)]


def test_two_thrusters_and_the_strength_of_the_weaker(twin_logs):
    truth = twin(**TWIN, **{"starboard.strength": 0.8})
    begin = twin().replace({"m11": {"value": 36.0, "fixed": True}}).free("starboard.strength")
    fit = dft.fit(begin, twin_logs, starts=2)
    assert fit.status is dft.estimation.Status.CONVERGED
    assert np.abs(distances(fit, truth)).max() < 4
    assert fit.parameters["starboard.strength"].std_error < 0.02


@pytest.mark.thorough
def test_without_a_force_only_ratios_to_the_thrust_are_known(twin_logs):
    fit = dft.fit(twin().free("starboard.strength"), twin_logs, starts=1)
    assert fit.status is dft.estimation.Status.NOT_IDENTIFIABLE
    message = " ".join(fit.report().split())
    scaled = ("m11", "m22", "i33", "d11", "d22", "d33", "port.gain")
    sentence = message[message.index("changing") : message.index("together")]
    assert all(name in sentence for name in scaled)
    assert "port.exponent" not in sentence


SIX_THRUSTERS = {
    "t1": ((0.14, 0.10, 0.0), (C, -C, 0.0)),
    "t2": ((0.14, -0.10, 0.0), (C, C, 0.0)),
    "t3": ((-0.14, 0.10, 0.0), (C, C, 0.0)),
    "t4": ((-0.14, -0.10, 0.0), (C, -C, 0.0)),
    "t5": ((0.0, 0.11, 0.0), (0.0, 0.0, -1.0)),
    "t6": ((0.0, -0.11, 0.0), (0.0, 0.0, -1.0)),
}


@pytest.mark.thorough
def test_six_thrusters_in_four_degrees():
    mounts = {name: LAW.at(*place) for name, place in SIX_THRUSTERS.items()}
    craft = dft.Craft(FourDegrees(), **mounts, share=[tuple(SIX_THRUSTERS)])
    truth = craft.replace({"t3.strength": 0.7, "m22": 28.0, "q11": 22.0, "buoyancy": 116.0})
    logs = [recorded(truth, seed, 300) for seed in (5, 6)]
    held = {"t1.gain": {"fixed": True}, "d11": {"fixed": True}, "d22": {"fixed": True}}
    begin = craft.replace(held).fix("d33", "d66").free("t3.strength")
    fit = dft.fit(begin, logs, starts=1)
    assert fit.status is dft.estimation.Status.CONVERGED
    assert np.abs(distances(fit, truth)).max() < 4


def test_a_quaternion_begins_as_the_first_angles_say():
    craft = dft.Craft(SixDegrees(), **{"lift": LAW.at((0, 0, 0), (0, 0, 1))})
    time = 0.1 * np.arange(21)
    log = dft.Log(
        time,
        {"lift.command": 0.3 * np.ones(21)},
        {"heading": np.full(21, 2.0), "roll": np.full(21, 0.1)},
        units={"lift.command": "effort"},
    )
    out = dft.simulate(craft, log, substeps=2)
    assert abs(out["heading"][0] - 2.0) < 1e-12
    assert abs(out["roll"][0] - 0.1) < 1e-12
