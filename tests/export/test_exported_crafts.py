"""Crafts in other programs: as they are in plain Python and C, their thrusters in simulators."""

from xml.etree import ElementTree

import numpy as np
import pytest
from exported_programs import needs_compiler, run_c, run_python, worst

import diffthrust as dft
from diffthrust.actuators import Azimuth, StaticThruster
from diffthrust.export import export_model

LOOP = dft.SpeedLoopThruster()
BOAT = dft.Craft(
    dft.bodies.Planar(x_g=0.05),
    port=LOOP.at((-0.35, -0.285, 0.1)),
    starboard=LOOP.at((-0.35, 0.285, 0.1), pointing=(1, 0.2, -0.1)),
    share=[("port", "starboard")],
).replace({"starboard.strength": 0.8, "port.exponent": 1.0})
CRAFTS = {
    "azimuth and effects": dft.Craft(
        dft.bodies.Planar(),
        port=LOOP.at((-0.35, -0.285, 0)),
        starboard=LOOP.at((-0.35, 0.285, 0)),
        bow=Azimuth(StaticThruster(), slew_time=0.7).at((0.9, 0, 0)),
        share=[("port", "starboard")],
    )
    + "command_deadband"
    + ("port", "command_delay")
    + ("starboard", "inflow_thrust_loss")
    + "quadratic_surge_drag",
    "six degrees": dft.layouts.BLUEROV2_HEAVY.craft().with_sensors(
        gps=dft.sensors.GNSS().at((0.3, 0.1, -0.2)),
        imu=dft.sensors.IMU(frame="FLU").at((0.1, 0, 0)),
        ros=dft.sensors.Attitude(frame="ENU"),
        bar=dft.sensors.Pressure(),
    ),
}


@needs_compiler
@pytest.mark.parametrize("name", CRAFTS)
def test_a_craft_moves_in_python_and_c_as_simulated(name, tmp_path):
    craft = CRAFTS[name]
    rng = np.random.default_rng(6)
    time = np.cumsum(rng.uniform(0.02, 0.06, 500))
    inputs = {n: np.repeat(rng.uniform(-0.4, 0.4, 20), 25) for n in craft.inputs}
    log = dft.Log(time, inputs, units=dict(craft.inputs))
    wanted = dft.simulate(craft, log, substeps=2)
    texts = {to: export_model(craft, to, substeps=2).text for to in ("python", "c")}
    assert worst(run_python(texts["python"], "Craft", log), wanted, craft.outputs) < 1e-11
    fields = {n: n.replace(".", "_") for n in craft.outputs}
    found = run_c(texts["c"], "craft", log, list(fields.values()), tmp_path)
    assert worst({n: found[f] for n, f in fields.items()}, wanted, craft.outputs) < 1e-11


def parts_of(craft, target, **more):
    exported = export_model(craft, target, limits=(-1.0, 1.0), **more)
    return ElementTree.fromstring(f"<file>{exported.text}</file>"), exported


def turned(angles):
    """The x axis after roll, pitch and yaw, by three rotations."""
    roll, pitch, yaw = angles
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    cy, sy = np.cos(yaw), np.sin(yaw)
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return (about_z @ about_y @ about_x)[:, 0]


def numbers(text):
    return np.array(text.split(), float)


def test_thrusters_of_a_craft_stand_in_stonefish_where_they_are():
    tree, exported = parts_of(BOAT, "stonefish")
    actuators = tree.findall("actuator")
    assert [a.get("name") for a in actuators] == ["craft_port", "craft_starboard"]
    for name, actuator in zip(BOAT.actuators, actuators, strict=True):
        mounted, origin = BOAT.actuators[name], actuator.find("origin")
        np.testing.assert_allclose(numbers(origin.get("xyz")), mounted.place, atol=1e-6)
        ahead = turned(numbers(origin.get("rpy")))
        np.testing.assert_allclose(ahead, mounted.pointing, atol=1e-5)
    forward = [float(a.find("thrust_model/thrust_coeff").get("forward")) for a in actuators]
    assert forward[1] / forward[0] == pytest.approx(0.8)
    assert exported.notes[0].startswith("The hull is left out")
    assert "strength = 0.8: held." in exported.text


@pytest.mark.parametrize(("target", "pattern"), [("gz", "<pose>"), ("uuv", "<origin xyz=")])
def test_places_of_gazebo_count_to_port_and_up(target, pattern):
    _, exported = parts_of(BOAT, target)
    lines = [line for line in exported.text.splitlines() if pattern in line]
    assert len(lines) == 2
    words = lines[1].split(pattern)[1].replace('"', " ").replace("rpy=", " ").replace("<", " ")
    found = numbers(" ".join(words.split("/")[0].split()[:6]))
    flip = np.array([1.0, -1.0, -1.0])
    mounted = BOAT.actuators["starboard"]
    np.testing.assert_allclose(found[:3], flip * mounted.place, atol=1e-6)
    np.testing.assert_allclose(turned(found[3:]), flip * mounted.pointing, atol=1e-5)


@pytest.mark.parametrize("target", ["uuv", "stonefish"])
def test_static_thrusters_are_tables_of_their_commands(target):
    craft = dft.layouts.BLUEROV2.craft().replace({"t2.strength": 0.7}) + "command_deadband"
    tree, _ = parts_of(craft, target)
    found = []
    for part in tree:
        if target == "uuv":
            assert part.find("plugin/dynamics/type").text == "ZeroOrder"
            inner = part.find("plugin/conversion")
            texts = [inner.find(n).text for n in ("inputValues", "outputValues")]
        else:
            assert part.find("rotor_dynamics").get("type") == "zero_order"
            assert float(part.find("specs").get("max_setpoint")) == 1.0
            texts = [part.find(f"thrust_model/{n}").get("value") for n in ("input", "output")]
        found.append([numbers(text) for text in texts])
    assert len(found) == 6
    dead = craft.parameters["command_deadband.half_width"].value
    commands, forces = found[1]
    past = np.maximum(np.abs(commands) - dead, 0.0)
    wanted = 0.7 * 51.5 * np.sign(commands) * past**1.6 * np.where(commands < 0, 0.776, 1.0)
    np.testing.assert_allclose(forces, wanted, atol=1e-5)


def test_gz_takes_the_forces_of_static_thrusters():
    tree, exported = parts_of(dft.layouts.BLUEBOAT.craft(), "gz")
    plugin = tree.findall("plugin")[1]
    assert plugin.find("use_angvel_cmd").text == "false"
    ends = [float(plugin.find(f"{end}_thrust_cmd").text) for end in ("min", "max")]
    assert ends == pytest.approx([-0.8 * 45.0, 45.0])
    assert any("cmd_thrust" in note for note in exported.notes)


def test_a_thruster_without_a_place_in_a_simulator_is_named():
    with pytest.raises(
        dft.InputError, match="bow: Simulators have no place for the model 'azimuth"
    ):
        parts_of(dft.layouts.FERRY.craft(), "uuv")
