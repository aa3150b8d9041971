"""Axes of sensors that are declared otherwise than the logs have them."""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import Planar, SixDegrees
from diffthrust.sensors import DVL, GNSS, IMU, Attitude, Pressure

LAW = StaticThruster(gain=30.0, exponent=1.5)
CHANNELS = (
    *("imu.roll_rate", "imu.pitch_rate", "imu.yaw_rate", "imu.x_force", "imu.z_force"),
    *("dvl.surge", "dvl.sway", "dvl.heave", "gps.north", "gps.east"),
    *("att.qw", "att.qx", "att.qy", "att.qz", "bar.pressure"),
)


def vehicle(body, imu="FRD", dvl="FRD", att="NED") -> dft.Craft:
    mounts = {n: LAW.at((-0.4, y, 0.05)) for n, y in (("port", -0.3), ("starboard", 0.3))}
    if isinstance(body, SixDegrees):
        mounts["lift"] = LAW.at((0.1, 0.05, 0), (0, 0, 1))
    return dft.Craft(
        body,
        **mounts,
        imu=IMU(frame=imu).at((0.1, 0, 0)),
        dvl=DVL(frame=dvl).at((0.4, 0, 0.1)),
        att=Attitude(frame=att),
        gps=GNSS().at((0.6, 0.1, -1)),
        bar=Pressure(),
    )


def recorded(truth: dft.Craft, channels=CHANNELS, seed=1, noise=0.02) -> dft.Log:
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(600)
    low = 0.1 if isinstance(truth.body, SixDegrees) else -0.3
    steps = np.repeat(rng.uniform(low, 1.0, (len(truth.inputs), 40)), 15, axis=1)
    inputs = dict(zip(truth.inputs, 0.5 * steps, strict=True))
    units = dict.fromkeys(inputs, "effort")
    start = truth.start_from({"heading": 1.0}) or {"heading": 1.0}
    out = dft.simulate(truth, dft.Log(time, inputs, units=units), initial=start, substeps=4)
    measured = {n: out[n] + rng.normal(0, noise * np.std(out[n]) + 1e-3, 600) for n in channels}
    return dft.Log(time, inputs, measured, units=units, name="dive")


def framed(log: dft.Log, model: dft.Craft) -> list[dft.soundness.Doubt]:
    return [d for d in dft.soundness.doubts(log, model) if d.kind == "frame"]


@pytest.fixture(
    scope="module", params=[SixDegrees(d55=10, d44=10), Planar()], ids=["six", "planar"]
)
def body(request):
    return request.param


@pytest.fixture(scope="module")
def ros(body) -> dft.Log:
    """A log of ROS: forward, port, up, and east, north, up."""
    return recorded(vehicle(body, "FLU", "FLU", "ENU"))


def test_what_is_declared_as_it_is_raises_no_doubt(body, ros):
    assert not dft.soundness.doubts(ros, vehicle(body, "FLU", "FLU", "ENU"))
    assert not dft.soundness.doubts(recorded(vehicle(body), seed=2), vehicle(body))


@pytest.mark.parametrize(
    ("declared", "channel", "mend"),
    [
        (("FRD", "FLU", "ENU"), "imu", 'imu=dft.sensors.IMU(frame="FLU")'),
        (("FLU", "FRD", "ENU"), "dvl", 'dvl=dft.sensors.DVL(frame="FLU")'),
        (("FLU", "FLU", "NED"), "att", 'att=dft.sensors.Attitude(frame="ENU")'),
        (("FRD", "FRD", "NED"), "imu", 'frame = "ENU" below [sensors.att]'),
    ],
)
def test_axes_that_a_log_contradicts_are_named_with_their_mend(body, ros, declared, channel, mend):
    silent = isinstance(body, Planar)  # its sway is that of its turns
    if silent and declared == ("FLU", "FRD", "ENU"):
        assert not framed(ros, vehicle(body, *declared))
        return
    (doubt,) = framed(ros, vehicle(body, *declared))
    assert doubt.channel == channel
    assert mend in doubt.mend
    wrong = sum(word not in ("FLU", "ENU") for word in declared)
    assert doubt.mend.count("=dft.sensors") == min(wrong, 2 if silent else 3)
    assert "opposes" in doubt.evidence or "upside down" in doubt.evidence


def test_two_readings_that_mend_as_well_are_both_named():
    log = recorded(vehicle(Planar(), "FLU"), ("imu.yaw_rate", "att.yaw"))
    (doubt,) = framed(log, vehicle(Planar()))
    assert " Or: " in doubt.mend
    assert "correlation -" in doubt.evidence


def test_noise_about_rest_is_no_other_frame():
    still = ("imu.roll_rate", "imu.pitch_rate", "imu.yaw_rate", "att.yaw", "dvl.heave")
    log = recorded(vehicle(Planar()), still)
    noise = np.random.default_rng(3).normal(0, 0.01, len(log))
    log = log.replaced(measured={**log.measured, "imu.yaw_rate": noise})
    assert not framed(log, vehicle(Planar()))
