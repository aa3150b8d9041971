"""Crafts in spec files: thrusters one by one, or a frame; and drawn by a command."""

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
