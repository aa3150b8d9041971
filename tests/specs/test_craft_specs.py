"""Crafts in spec files: thrusters one by one, or a frame, and sensors; and drawn by a command."""

import numpy as np
import pytest
from command_line import run

import diffthrust as dft
from diffthrust import InputError

SPEC = """model = "craft"
body = "planar"
effects = ["command_deadband", "port.command_delay"]
[thrusters]
model = "static_thruster"
pwm = { stop = 1500, full = 1900 }
[thrusters.port]
at = [-0.35, -0.285, 0]
input = "RCOU.C1"
[thrusters.starboard]
like = "port"
at = [-0.35, 0.285, 0]
input = "RCOU.C3"
[logs]
train = "run.csv"
time = { column = "t", unit = "s" }
[channels]
surge = { column = "u", unit = "m/s" }
yaw_rate = { column = "r", unit = "rad/s" }
[parameters]
m11 = { value = 36.0, fixed = true }
"port.exponent" = 1.5
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fit.toml").write_text(SPEC)
    header = "t,RCOU.C1,RCOU.C3,u,r"
    rows = np.c_[0.1 * np.arange(20), np.full(20, 1700), np.full(20, 1600), np.zeros((20, 2))]
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=header, comments="")
    return tmp_path


def test_thrusters_one_by_one(folder):
    spec = dft.load_spec("fit.toml")
    assert str(spec.model) == "craft + command_deadband + port.command_delay"
    assert spec.model.share == (("port", "starboard"),)
    assert spec.model.parameters["m11"].fixed
    assert spec.model.parameters["port.exponent"].value == 1.5
    assert {n: c.column for n, c in spec.inputs.items()} == {
        "port.command": "RCOU.C1",
        "starboard.command": "RCOU.C3",
    }
    (log,) = spec.train_logs()
    out = dft.simulate(spec.model - "port.command_delay", log)
    assert out["yaw_rate"][-1] > 0.01  # port pushes more


def test_a_channel_of_a_thruster_may_stand_as_a_table_of_its_own(folder):
    text = SPEC.replace('input = "RCOU.C1"\n', "").replace(
        "[parameters]",
        '[channels.port.command]\ncolumn = "RCOU.C1"\npwm = { stop = 1500, full = 1900 }\n'
        "[parameters]",
    )
    (folder / "fit.toml").write_text(text)
    assert dft.load_spec("fit.toml").inputs["port.command"].column == "RCOU.C1"


def test_a_frame_and_its_columns(folder):
    columns = ", ".join(f'"C{k}"' for k in range(1, 7))
    text = (
        f'model = "craft"\n[thrusters]\nframe = "bluerov2"\ncolumns = [{columns}]\n'
        "pwm = { stop = 1500, full = 1900 }\n"
        '[logs]\ntrain = "run.csv"\n[channels]\ndepth = "d"\n'
    )
    (folder / "fit.toml").write_text(text)
    spec = dft.load_spec("fit.toml")
    assert spec.inputs["t6.command"].column == "C6"
    strengths = [n for n, p in spec.model.parameters.items() if n.endswith("strength")]
    assert [spec.model.parameters[n].fixed for n in strengths] == [True] + 5 * [False]
    for old, new, message in (
        ("bluerov2", "bluerov", r"line 2.*'bluerov' is not known.*'bluerov2'"),
        (', "C6"', "", r"expected 6 columns.*found 5"),
        ("columns =", "colums =", r"line 4.*the key 'colums' is not known.*'columns'"),
        ('frame = "bluerov2"', "", r"expected a frame or thrusters"),
    ):
        (folder / "fit.toml").write_text(text.replace(old, new))
        with pytest.raises(InputError, match=message):
            dft.load_spec("fit.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('body = "planar"', 'body = "planer"', r"found 'planer'.*'planar'"),
        ('like = "port"', 'like = "bow"', r"like = 'bow' names no thruster"),
        ("at = [-0.35, -0.285, 0]\n", "", r"\[thrusters.port\] has no place"),
        (
            'model = "static_thruster"',
            'model = "static_thrustr"',
            r"fit\.toml.*'static_thrustr'.*not known",
        ),
        ("port.command_delay", "prt.command_delay", r"no actuator 'prt'.*'port'"),
    ],
)
def test_mistakes_are_named_with_their_mend(folder, old, new, message):
    (folder / "fit.toml").write_text(SPEC.replace(old, new))
    with pytest.raises(InputError, match=message):
        dft.load_spec("fit.toml")


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        (
            '"RCOU.C3"',
            '"RCOU.C33"',
            r"RCOU\.C33.*in fit\.toml, line 13, thrusters\.starboard\.input",
        ),
        ("stop = 1500, ", "stop = 1500, ful = 1, ", r"line 6, thrusters\.pwm\.ful"),
        ("pwm = { stop = 1500, full = 1900 }", 'unit = "banana"', r"line 6, thrusters\.unit"),
        (
            "[thrusters.port]\n",
            "[thrusters.port]\npwm = [1500, 1900]\n",
            r"line 8, thrusters\.port\.pwm: expected a table.*\n.*\[thrusters\.port\.pwm\] with",
        ),
        (
            "[thrusters.port]\n",
            '[thrusters.port]\nunit = "kgf"\n',
            r"line 8, thrusters\.port\.unit",
        ),
    ],
)
def test_mistakes_of_a_thruster_are_told_with_its_own_line(folder, old, new, place):
    (folder / "fit.toml").write_text(SPEC.replace(old, new))
    with pytest.raises(InputError, match=place):
        dft.load_spec("fit.toml").train_logs()


def test_look_draws_a_craft(folder):
    (folder / "boat.toml").write_text('thrusters = { frame = "otter" }')
    shown = run("look", "--craft", "boat.toml", "--figure", "boat.png")
    assert "rad/s    like port" in shown.stdout
    assert "Maritime Robotics Otter, 2 m, two thrusters" in shown.stdout
    assert "gain 0.01108, reverse 0.5817   measured" in shown.stdout
    assert (folder / "boat.png").stat().st_size > 5000
    (folder / "boat.toml").write_text('thrusters = { frame = "otter", model = "thruster" }')
    shown = run("look", "--craft", "boat.toml")
    assert "m11 60.30" in shown.stdout
    assert "gain" not in shown.stdout  # of thrusters of another model the layout says nothing
    shown = run("look", "--craft", "fit.toml")
    assert "like port" in shown.stdout
    (folder / "none.toml").write_text('model = "thruster"')
    assert "expected a table [thrusters]" in run("look", "--craft", "none.toml", status=2).output
    told = run("look", "run.csv", "--craft", "fit.toml", "--spec", "new.toml", status=2).output
    assert "found FILE, --spec as well" in told


SENSED = """model = "craft"
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
def sensed(folder):
    """Latitudes and pressures as vehicles log them."""
    (folder / "fit.toml").write_text(SENSED)
    k = np.arange(20)
    rows = np.c_[0.1 * k, np.full((20, 2), 0.5), 60 + 1e-6 * k, 10 + 1e-6 * k,
                 1013.25 + 0.1 * k, 2.0 * k]  # fmt: skip
    header = "t,left,right,lat,lon,p,gz"
    np.savetxt(folder / "run.csv", rows, delimiter=",", header=header, comments="", fmt="%.9f")
    return folder


def test_sensors_of_a_spec_file(sensed):
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
def test_mistakes_of_a_sensor_are_named_with_their_mend(sensed, old, new, message):
    (sensed / "fit.toml").write_text(SENSED.replace(old, new))
    with pytest.raises(InputError, match=message):
        dft.load_spec("fit.toml").train_logs()


def test_sensors_are_of_crafts(sensed):
    text = 'model = "vessel"\n[sensors]\ngps = "gnss"\n' + SENSED[SENSED.index("[logs]") :]
    (sensed / "fit.toml").write_text(text)
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
    layout.write_text(SENSED.partition("[logs]")[0].replace(old, new))
    with pytest.raises(InputError, match=message):
        dft.specs.craft_from(layout)
