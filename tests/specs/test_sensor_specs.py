"""Sensors of crafts in spec files, with latitudes and pressures as vehicles log them."""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError

SPEC = """model = "craft"
body = "planar"
[thrusters]
model = "static_thruster"
[thrusters.port]
at = [-0.35, -0.285, 0]
input = "left"
[thrusters.starboard]
like = "port"
at = [-0.35, 0.285, 0]
input = "right"
[sensors]
gps = { model = "gnss", at = [0.3, 0.0, -1.0] }
bar = "pressure"
[sensors.imu]
model = "imu"
at = [0.1, 0.0, 0.0]
frame = "FLU"
[logs]
train = "run.csv"
time = { column = "t", unit = "s" }
[channels]
"gps.north" = { column = "lat", unit = "deg" }
"gps.east" = { column = "lon", unit = "deg" }
"bar.pressure" = { column = "p", unit = "mbar" }
[channels.imu.yaw_rate]
column = "gz"
unit = "deg/s"
[parameters]
"gps.x" = { fixed = false }
"bar.density" = 1025.0
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fit.toml").write_text(SPEC)
    k = np.arange(20)
    rows = np.c_[0.1 * k, np.full((20, 2), 0.5), 60 + 1e-6 * k, 10 + 1e-6 * k,
                 1013.25 + 0.1 * k, 2.0 * k]  # fmt: skip
    header = "t,left,right,lat,lon,p,gz"
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=header, comments="", fmt="%.9f")
    return tmp_path


def test_sensors_of_a_spec_file(folder):
    spec = dft.load_spec("fit.toml")
    assert repr(spec.model).startswith("Craft(Planar, port=StaticThruster")
    assert "gps=GNSS, bar=Pressure, imu=IMU" in repr(spec.model)
    assert spec.model.sensors["gps"].place == (0.3, 0.0, -1.0)
    assert spec.model.sensors["imu"].model.frame == "FLU"
    assert not spec.model.parameters["gps.x"].fixed
    (log,) = spec.train_logs()
    # a millionth of a degree: 0.1114 m of the meridian, 0.0558 m of the parallel at 60 degrees
    assert log.measured["gps.north"][-1] == pytest.approx(19 * 0.11141, rel=1e-3)
    assert log.measured["gps.east"][-1] == pytest.approx(19 * 0.05580, rel=1e-3)
    assert log.notes[0].startswith("gps.north and gps.east are in metres from the first fix")
    assert log.measured["bar.pressure"][-1] == pytest.approx(101_325 + 190)
    assert log.measured["imu.yaw_rate"][-1] == pytest.approx(np.radians(38))
    shown = dft.simulate(spec.model, log, in_units=True)
    plain = dft.simulate(spec.model, log)
    np.testing.assert_allclose(shown["imu.yaw_rate"], np.degrees(plain["imu.yaw_rate"]))
    np.testing.assert_allclose(shown["bar.pressure"], 0.01 * plain["bar.pressure"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('bar = "pressure"', 'bar = "presure"', r"line 14.*'presure'.*'pressure'"),
        ('frame = "FLU"', 'frame = "NED"', r"(?s)line 15.*found 'NED'.*frame='FLU'"),
        ('frame = "FLU"', 'fram = "FLU"', r"line 18.*'fram' is not known.*'frame'"),
        ("gps = {", "port = {", r"the sensor 'port' has the name of an actuator"),
        ('"gps.north"', '"gps.nort"', r"no channel 'gps.nort'.*'gps.north'"),
        ('column = "lon", unit = "deg"', 'column = "lon"', r"'gps.north' is an angle.*'gps.east'"),
    ],
)  # fmt: skip
def test_mistakes_are_named_with_their_mend(folder, old, new, message):
    (folder / "fit.toml").write_text(SPEC.replace(old, new))
    with pytest.raises(InputError, match=message):
        dft.load_spec("fit.toml").train_logs()


def test_sensors_are_of_crafts(folder):
    text = 'model = "vessel"\n[sensors]\ngps = "gnss"\n' + SPEC[SPEC.index("[logs]") :]
    (folder / "fit.toml").write_text(text)
    with pytest.raises(InputError, match=r"line 3.*\[sensors\] belongs to a craft.*'vessel'"):
        dft.load_spec("fit.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"gnss"', '"gnns"', r"line 13, sensors.gps: the model 'gnns'.*nearest is 'gnss'"),
        ('"FLU"', '"NEDD"', r"line 15, sensors.imu: IMU: expected the axes.*'NEDD'"),
    ],
)
def test_a_sensor_that_a_layout_cannot_have_is_named_with_its_line(tmp_path, old, new, message):
    layout = tmp_path / "boat.toml"
    layout.write_text(SPEC.partition("[logs]")[0].replace(old, new))
    with pytest.raises(InputError, match=message):
        dft.specs.craft_from(layout)
