"""Commands of a craft that are exchanged or turned are named; what is only physics is not."""

import math
from dataclasses import replace

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import FourDegrees, Planar
from diffthrust.estimation._unexplained import doubts_about  # private: without a fit
from diffthrust.estimation._wiring import (  # private: without a fit
    measured_axes,
    velocities_of,
    wiring_doubts,
)
from diffthrust.simulation._record import bind  # private: a run of the model as given
from diffthrust.simulation._runs import runs_over  # private: a run of the model as given
from diffthrust.soundness import Doubt

C = math.sqrt(0.5)
LAW = StaticThruster(gain=25.0, exponent=1.5)
ROV = dft.Craft(
    FourDegrees(),
    t1=LAW.at((0.14, 0.10, 0.0), (C, -C, 0.0)),
    t2=LAW.at((0.14, -0.10, 0.0), (C, C, 0.0)),
    t3=LAW.at((-0.14, 0.10, 0.0), (C, C, 0.0)),
    t4=LAW.at((-0.14, -0.10, 0.0), (C, -C, 0.0)),
    t5=LAW.at((0.0, 0.11, 0.0), (0.0, 0.0, -1.0)),
    t6=LAW.at((0.0, -0.11, 0.0), (0.0, 0.0, -1.0)),
    share=[("t1", "t2", "t3", "t4", "t5", "t6")],
)
BOAT = dft.Craft(
    Planar(), port=LAW.at((-0.4, -0.3, 0)), starboard=LAW.at((-0.4, 0.3, 0)),
    share=[("port", "starboard")],
)  # fmt: skip


BODY = "surge", "sway", "heave", "yaw_rate"


def doubts(craft, wired=None, truth=None, seed=1, missing=slice(0), turned=(), read=BODY):
    """The doubts on a log whose columns are wired otherwise, of another truth."""
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(400)
    steps = np.repeat(rng.uniform(-0.8, 0.8, (len(craft.inputs), 40)), 10, axis=1)
    inputs = dict(zip(craft.inputs, steps, strict=True))
    units = dict(craft.inputs)
    out = dft.simulate(truth or craft, dft.Log(time, inputs, units=units), substeps=6)
    names = [n for n in read if n in out]
    measured = {n: out[n] + rng.normal(0, 0.01, 400) for n in names}
    measured[names[0]][missing] = np.nan
    measured |= {name: -measured[name] for name in turned}
    logged = {**inputs, **{n: s * inputs[other] for n, (other, s) in (wired or {}).items()}}
    log = dft.Log(time, logged, measured, units=units)
    runs = runs_over(craft, bind(craft, [log]), substeps=4)
    return [*wiring_doubts(craft, runs)], log, inputs


def exchanged(first, second):
    first, second = f"{first}.command", f"{second}.command"
    return {first: (second, 1.0), second: (first, 1.0)}


@pytest.mark.parametrize("pair", [("t1", "t2"), ("t2", "t3"), ("t1", "t5")])
def test_two_exchanged(pair):
    (doubt,), log, inputs = doubts(ROV, exchanged(*pair))
    assert doubt.kind == "exchanged"
    assert f"the commands of {pair[0]} and {pair[1]} exchanged" in doubt.evidence
    mended = doubt.readings[0].log(log)
    for name, series in inputs.items():
        np.testing.assert_array_equal(mended.inputs[name], series)


@pytest.mark.parametrize("name", ["t1", "t4", "t6"])
def test_one_turned(name):
    wired = {f"{name}.command": (f"{name}.command", -1.0)}
    (doubt,), _, _ = doubts(ROV, wired)
    assert (doubt.channel, doubt.kind) == (f"{name}.command", "sign")
    assert f"the command of {name} turned" in doubt.evidence
    assert "scale = -1" in doubt.mend


def test_a_boat_with_its_sides_exchanged():
    (doubt,), _, _ = doubts(BOAT, exchanged("port", "starboard"))
    assert "the commands of port and starboard exchanged" in doubt.evidence


SIDES = {"port.command": ("starboard.command", -1.0), "starboard.command": ("port.command", 1.0)}


def test_exchanged_sides_one_of_them_turned():
    """As a BlueBoat's log is, read by its columns' names."""
    (doubt,), log, inputs = doubts(BOAT, SIDES)
    assert doubt.kind == "exchanged"
    assert "the commands of port and starboard exchanged, then the command of" in doubt.evidence
    assert "then give the command of" in doubt.mend
    mended = doubt.readings[0].log(log)
    for name, series in inputs.items():
        np.testing.assert_array_equal(mended.inputs[name], series)


@pytest.mark.parametrize("turned", [("t2", "t6"), ("t1", "t4")])
def test_two_turned(turned):
    wired = {f"{name}.command": (f"{name}.command", -1.0) for name in turned}
    (doubt,), log, inputs = doubts(ROV, wired)
    assert doubt.kind == "sign"
    mended = doubt.readings[0].log(log)
    for name, series in inputs.items():
        np.testing.assert_array_equal(mended.inputs[name], series)


@pytest.mark.parametrize(
    "axes", [("sway", "yaw_rate"), ("yaw_rate",), ("sway",)], ids=lambda axes: "+".join(axes)
)
def test_sensors_of_the_other_sign_stand_before_two_exchanged_pairs(axes):
    """The logs fit both, and a frame is one mistake."""
    (doubt,), log, _ = doubts(ROV, turned=axes)
    assert (doubt.channel, doubt.kind) == (axes[0], "sign")
    assert "of the other sign or the commands of" in doubt.evidence
    mended = doubt.readings[0].log(log)
    for name in log.measured:
        sign = -1.0 if name in axes else 1.0
        np.testing.assert_array_equal(mended.measured[name], sign * log.measured[name])


def test_exchanged_sides_may_be_a_turned_yaw_rate():
    (doubt,), _, _ = doubts(BOAT, exchanged("port", "starboard"))
    assert "exchanged or yaw_rate of the other sign" in doubt.evidence
    assert dict(doubt.readings[1].sources) == {"yaw_rate": ("yaw_rate", -1.0)}


def test_a_boat_that_waves_turn_against_its_damping_autopilot_has_no_mistake():
    """Its thrusters do next to nothing, and its commands follow the turning."""
    rng = np.random.default_rng(4)
    time = 0.1 * np.arange(1500)
    waves = 0.3 * np.sin(0.8 * time + 0.5 * np.cumsum(rng.normal(0, 0.1, 1500)))
    turning = np.concatenate([[0.0, 0.0], waves[:-2]]) + rng.normal(0, 0.01, 1500)
    commands = {"port.command": 0.3 - 0.8 * turning, "starboard.command": 0.3 + 0.8 * turning}
    surge = 0.5 + rng.normal(0, 0.02, 1500)
    log = dft.Log(time, commands, {"surge": surge, "yaw_rate": waves}, units=dict(BOAT.inputs))
    runs = runs_over(BOAT, bind(BOAT, [log]), substeps=4)
    assert [*wiring_doubts(BOAT, runs)] == []


def test_missing_readings_leave_the_others_counted():
    (doubt,), _, _ = doubts(BOAT, SIDES, missing=slice(20, 30))
    assert doubt.kind == "exchanged"


@pytest.mark.parametrize(
    "truth",
    [
        None,
        ROV.replace({"t3.strength": 0.4}),
        ROV + ("t2", dft.effects.CommandDeadband(half_width=0.3)),
        ROV.replace({"x_g": 0.05, "m22": 35.0, "q66": 0.4}),
        ROV + dft.effects.CommandDelay(delay=0.3),
    ],
    ids=["nothing", "weak", "dead band", "another body", "late"],
)
@pytest.mark.parametrize("seed", [2, 3])
def test_missing_physics_is_no_exchange(truth, seed):
    assert doubts(ROV, truth=truth, seed=seed)[0] == []


@pytest.mark.parametrize(
    ("wired", "kinds"), [(exchanged("t3", "t4"), ["exchanged"]), ({}, ["lag"])]
)
def test_beside_an_exchange_nothing_is_said_to_come_late(wired, kinds, monkeypatch):
    """What is taken for a late reading there is the error of the exchange."""
    late = [Doubt("yaw_rate", "lag", "it comes late", "log when it was measured")]
    monkeypatch.setattr("diffthrust.estimation._unexplained.late_readings", lambda runs: late)
    _, log, _ = doubts(ROV, wired)
    runs = runs_over(ROV, bind(ROV, [log]), substeps=4)
    assert [doubt.kind for doubt in doubts_about({}, runs, ROV, ROV, [log])] == kinds


APART = dft.Craft(
    Planar(),
    port=LAW.at((-0.4, -0.3, 0)),
    starboard=StaticThruster(gain=40.0, exponent=2.0).at((-0.4, 0.3, 0)),
)


def test_two_that_do_not_share_their_numbers_are_exchanged():
    """Each has its own law for the other's command."""
    (doubt,), log, inputs = doubts(APART, exchanged("port", "starboard"))
    assert "the commands of port and starboard exchanged" in doubt.evidence
    mended = doubt.readings[0].log(log)
    for name, series in inputs.items():
        np.testing.assert_array_equal(mended.inputs[name], series)


@pytest.mark.filterwarnings("ignore::diffthrust.simulation.CoarseStepWarning")
@pytest.mark.parametrize(
    ("wired", "words"),
    [(exchanged("port", "starboard"), "the commands of port and starboard exchanged"),
     ({"port.command": ("port.command", -1.0)}, "the command of port turned"), ({}, "")],
    ids=["exchanged", "turned", "as logged"],
)  # fmt: skip
def test_a_fit_of_two_with_numbers_of_their_own_tells_how_they_are_wired(wired, words):
    """With the port command turned the fit drives one gain to nothing and the other to 7e15."""
    begun = dft.Craft(Planar(), port=LAW.at((-0.4, -0.3, 0)), starboard=LAW.at((-0.4, 0.3, 0)))
    _, log, _ = doubts(begun, wired, begun.replace({"starboard.gain": 32.0}))
    about = [d.evidence for d in dft.fit(begun, log, starts=1).doubts if "command" in d.channel]
    assert len(about) == (words != "")
    assert all(words in evidence for evidence in about)


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize(
    "truth", [None, APART.replace({"port.gain": 10.0}), APART + ("port", "command_delay")]
)
def test_two_of_their_own_numbers_that_are_wired_as_logged(truth, seed):
    assert doubts(APART, truth=truth, seed=seed)[0] == []


SENSED = ROV.with_sensors(
    dvl=dft.sensors.DVL(frame="FLU").at((0.2, 0.1, 0.15)), imu=dft.sensors.IMU(frame="FLU")
)
SENSORS = "dvl.surge", "dvl.sway", "dvl.heave", "imu.yaw_rate"


@pytest.mark.parametrize("pair", [("t1", "t2"), ("t2", "t3"), ("t1", "t5")])
def test_an_exchange_seen_by_sensors_at_their_places(pair):
    (doubt,), log, inputs = doubts(SENSED, exchanged(*pair), read=SENSORS)
    assert f"the commands of {pair[0]} and {pair[1]} exchanged" in doubt.evidence
    mended = doubt.readings[0].log(log)
    for name, series in inputs.items():
        np.testing.assert_array_equal(mended.inputs[name], series)


def test_a_sensor_of_the_other_frame():
    craft = SENSED.with_sensors(dvl=dft.sensors.DVL(frame="FLU"))
    (doubt,), _, _ = doubts(craft, turned=("imu.yaw_rate",), read=SENSORS)
    assert (doubt.channel, doubt.kind) == ("imu.yaw_rate", "sign")


def test_sensors_that_agree_with_the_commands():
    assert doubts(SENSED, read=SENSORS)[0] == []


def test_velocities_at_a_place_without_turning_tell_nothing():
    """Those of the body would be guessed."""
    assert doubts(SENSED, exchanged("t1", "t2"), read=SENSORS[:3])[0] == []


def test_velocities_of_the_body_by_sensors_at_their_places():
    """Also where the sensors are read in turn; the IMU's axes are those of ROS."""
    far = SENSED.with_sensors(dvl=dft.sensors.DVL(frame="FLU").at((0.9, 0.4, 0.3)))
    time = 0.02 * np.arange(400)
    inputs = {n: 0.5 * np.sin((1.0 + 0.2 * i) * time) for i, n in enumerate(far.inputs)}
    log = dft.Log(time, inputs, units=dict(far.inputs))
    out = dft.simulate(far, log, substeps=2)
    measured = {
        n: np.where(np.arange(400) % 2 == (n[:3] == "imu"), out[n], np.nan) for n in SENSORS
    }
    (run,) = runs_over(far, bind(far, [replace(log, measured=measured)]), substeps=2)
    axes = measured_axes(far, [run])
    assert axes == dict(zip(SENSORS, ("surge", "sway", "heave", "yaw"), strict=True))
    for name, values in zip(SENSORS, velocities_of(far, run, axes), strict=True):
        there = np.isfinite(values)
        assert there[2:-2].mean() > 0.4
        np.testing.assert_allclose(values[there], out[name.partition(".")[2]][there], atol=2e-3)


class Wheel(dft.sensors.Sensor):
    """It reads the speed ahead, wherever it is, by a scale."""

    name = "wheel"
    outputs = {"speed": "m/s"}
    placed = False
    scale: float = dft.parameter(2.0, bounds=(0, None), fixed=True)

    def read(self, moving):
        return {"speed": self.scale * moving.velocity.surge}

    def as_of_body(self, readings):
        return {"surge": readings["speed"] / self.scale}


def test_a_sensor_without_a_place():
    craft = BOAT.with_sensors(wheel=Wheel())
    read = "wheel.speed", "yaw_rate"
    (doubt,), _, _ = doubts(craft, exchanged("port", "starboard"), read=read)
    assert "the commands of port and starboard exchanged" in doubt.evidence


@pytest.mark.parametrize("wired", [exchanged("t2", "t3"), {}], ids=["exchanged", "as logged"])
def test_rows_of_long_logs_overlap_less(wired, monkeypatch):
    whole, *_ = doubts(ROV, wired)
    monkeypatch.setattr("diffthrust.estimation._wiring._ROWS", 100)
    fewer, *_ = doubts(ROV, wired)
    assert [doubt.readings[0].sources for doubt in fewer] == [
        doubt.readings[0].sources for doubt in whole
    ]
    assert len(fewer) == len(wired) / 2


def test_other_models_are_not_doubted():
    assert [*wiring_doubts(dft.Thruster(), ())] == []
