"""Crafts of autopilots' logs: from the file to a spec that loads and runs, unedited."""

import numpy as np
import pytest
from command_line import run

import diffthrust as dft
from diffthrust.layouts import ardupilot_layout
from diffthrust.specs import load_spec
from tests.robot_files import (
    dataflash_parameters,
    parameter,
    servos,
    write_dataflash,
    write_telemetry,
    write_ulog,
)

SUB = {
    "FRAME_CONFIG": 2.0,
    "MOT_2_DIRECTION": -1.0,
    "SERVO1_FUNCTION": 34.0,
    "SERVO2_FUNCTION": 33.0,
}
STEP, COUNT = 0.05, 400
ANGLES = ("roll", "pitch", "heading")


def commands(names, seed):
    rng = np.random.default_rng(seed)
    return {f"{n}.command": np.repeat(rng.uniform(-0.2, 0.2, COUNT // 40), 40) for n in names}


def simulated(craft, inputs):
    time = STEP * np.arange(COUNT)
    return dft.simulate(craft, dft.Log(time, inputs, units=dict(craft.inputs)), substeps=2)


@pytest.fixture(scope="module")
def dive(tmp_path_factory):
    """A dive of a BlueROV2 Heavy, one motor turned, two outputs exchanged."""
    layout = ardupilot_layout(SUB)
    inputs = commands(layout.thrusters, 3)
    out = simulated(layout.craft(), inputs)
    formats, rows = dataflash_parameters(SUB)
    formats |= {
        "RCOU": ("QHHHHHHHH", ["TimeUS", *(f"C{k}" for k in range(1, 9))]),
        "ATT": ("Qfff", ["TimeUS", "Roll", "Pitch", "Yaw"]),
        "IMU": ("QBfff", ["TimeUS", "I", "GyrX", "GyrY", "GyrZ"]),
        "CTUN": ("Qf", ["TimeUS", "Alt"]),
    }
    pulses = [1500 + 400 * inputs[f"m{k}.command"] for k in (2, 1, 3, 4, 5, 6, 7, 8)]
    for k in range(COUNT):
        stamp = 10_000_000 + int(1e6 * STEP * k)
        rows.append(("RCOU", (stamp, *(round(float(p[k])) for p in pulses))))
        angles = np.degrees([out[n][k] for n in ("roll", "pitch", "heading")])
        rows.append(("ATT", (stamp, *angles)))
        turns = [out[f"{n}_rate"][k] for n in ("roll", "pitch", "yaw")]
        rows += [("IMU", (stamp, i, *turns)) for i in (0, 1)]
        rows.append(("CTUN", (stamp, -out["depth"][k])))
    path = tmp_path_factory.mktemp("dive") / "dive.bin"
    return write_dataflash(path, formats, rows, instances={"IMU": "I"}), out


def test_a_dive_is_drafted_as_a_craft_that_runs(dive, tmp_path):
    path, out = dive
    seen = dft.look(path)
    assert seen.model == "craft"
    assert "# places of the BlueROV2 Heavy" in seen.spec
    assert any("weight is held" in doubt for doubt in seen.doubts)
    assert len(seen.plot().axes) >= 15
    spec = load_spec(seen.save_spec(tmp_path / "fit.toml"))
    assert spec.model.body.name == "six_degrees"
    assert spec.model.share == (tuple(f"m{k}" for k in range(1, 9)),)
    assert spec.inputs["m1.command"].column == "RCOU.C2"
    assert spec.measured["yaw_rate"].column == "IMU[0].GyrZ"
    (log,) = spec.train_logs()
    assert set(log.measured) == {
        "roll", "pitch", "heading", "roll_rate", "pitch_rate", "yaw_rate", "depth"
    }  # fmt: skip
    # the mean of the two samples in each tenth of a second; pulses are whole microseconds
    for name, values in log.measured.items():
        turned = np.unwrap(out[name]) if name in ANGLES else out[name]
        means = turned.reshape(-1, 2).mean(axis=1)
        span = max(np.ptp(means), 1e-3)
        np.testing.assert_allclose(values[: means.size], means[: values.size], atol=0.02 * span)
    found = dft.simulate(spec.model, log, substeps=4)
    for name in ("depth", "heading"):
        run_on = np.unwrap(found[name]) if name in ANGLES else found[name]
        error = np.sqrt(np.nanmean((run_on - log.measured[name]) ** 2))
        assert error < 0.1 * np.nanstd(log.measured[name]), name


def test_the_layout_is_shown_and_drawn(dive, tmp_path):
    path, _ = dive
    shown = run("look", "--craft", path, "--figure", tmp_path / "rov.png").stdout
    assert "ArduSub, FRAME_CONFIG 2 (vectored_6dof), eight thrusters" in shown
    assert (tmp_path / "rov.png").stat().st_size > 5000
    (tmp_path / "rov.param").write_text("FRAME_CLASS,1\n")
    told = run("look", "--craft", tmp_path / "rov.param", status=2).output
    assert "expected the settings of a craft" in told


def test_a_boat_of_telemetry(tmp_path):
    pytest.importorskip("pymavlink")
    settings = {"FRAME_CLASS": 2.0, "SERVO1_FUNCTION": 74.0, "SERVO3_FUNCTION": 73.0}
    layout = ardupilot_layout(settings)
    out = simulated(layout.craft(), inputs := commands(("port", "starboard"), 5))
    messages = [(0.0, 1, parameter(*pair)) for pair in settings.items()]

    def servo(k):
        right, left = (1500 + 400 * inputs[f"{n}.command"][k] for n in ("starboard", "port"))
        return lambda d: d.MAVLink_servo_output_raw_message(
            0, 0, round(right), 1500, round(left), *[1500] * 5
        )

    def turn(k):
        heading, rate = float(out["heading"][k]), float(out["yaw_rate"][k])
        return lambda d: d.MAVLink_attitude_message(0, 0.0, 0.0, heading, 0.0, 0.0, rate)

    for k in range(COUNT):
        messages += [(STEP * k, 1, servo(k)), (STEP * k, 1, turn(k))]
    seen = dft.look(write_telemetry(tmp_path / "lake.tlog", messages))
    spec = load_spec(seen.save_spec(tmp_path / "fit.toml"))
    assert spec.inputs["port.command"].column == "SERVO_OUTPUT_RAW.servo3_raw"
    assert spec.model.parameters["m11"].fixed
    assert set(spec.measured) == {"heading", "yaw_rate"}
    (log,) = spec.train_logs()
    found = dft.simulate(spec.model, log, substeps=4)["yaw_rate"]
    assert np.nanstd(found - log.measured["yaw_rate"]) < 0.1 * np.nanstd(found)


def test_a_vehicle_of_px4(tmp_path):
    pytest.importorskip("pyulog")
    settings = {"CA_AIRFRAME": 7, "CA_ROTOR_COUNT": 2}
    for k, side in enumerate((-0.3, 0.3)):
        settings |= {f"CA_ROTOR{k}_AX": 1.0, f"CA_ROTOR{k}_AZ": 0.0, f"CA_ROTOR{k}_PY": side}
    settings["CA_ROTOR1_CT"] = 5.2
    formats = {
        "actuator_motors": [("uint64_t", "timestamp"), ("float[12]", "control")],
        "vehicle_attitude": [("uint64_t", "timestamp"), ("float[4]", "q")],
        "vehicle_angular_velocity": [("uint64_t", "timestamp"), ("float[3]", "xyz")],
    }
    rng = np.random.default_rng(8)
    rows = []
    for k in range(100):
        stamp = 1_000_000 + 50_000 * k
        rows.append((0, (stamp, *rng.uniform(-1, 1, 2), *[float("nan")] * 10)))
        half = 0.01 * k
        rows.append((1, (stamp, np.cos(half), 0.001 * k, 0.0, np.sin(half))))
        rows.append((2, (stamp, 0.1, 0.0, 0.2 + 0.001 * k)))
    subscriptions = [(name, 0) for name in formats]
    path = tmp_path / "dive.ulg"
    write_ulog(path, formats, subscriptions, rows, parameters=settings)
    spec = load_spec(dft.look(path).save_spec(tmp_path / "fit.toml"))
    assert spec.inputs["m2.command"].column == "actuator_motors.control[1]"
    assert spec.model.parameters["m2.strength"].value == 0.8
    assert spec.model.actuators["m1"].reaction == -0.05
    assert {"qw", "qx", "qz", "yaw_rate"} <= set(spec.measured)
    (log,) = spec.train_logs()
    assert np.abs(log.inputs["m1.command"]).max() < 1.0


def test_a_craft_without_its_commands_is_a_doubt(tmp_path):
    formats, rows = dataflash_parameters({"FRAME_CONFIG": 4.0})
    formats["ATT"] = ("Qff", ["TimeUS", "Pitch", "Yaw"])
    rows += [("ATT", (1000 * k, 0.1 * k, float(k % 7))) for k in range(50)]
    seen = dft.look(write_dataflash(tmp_path / "dive.bin", formats, rows))
    assert seen.model is None
    words = "(simplerov_3), three thrusters), but the log lacks the commands of 'm1', 'm2', 'm3'"
    assert any(words in doubt for doubt in seen.doubts)


def test_settings_that_are_wrong_are_a_doubt(tmp_path):
    settings = {"FRAME_CLASS": 2.0, "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    formats, rows = dataflash_parameters({**settings, "SERVO1_TRIM": 1900.0})
    formats["ATT"] = ("Qff", ["TimeUS", "Pitch", "Yaw"])
    rows += [("ATT", (1000 * k, 0.1 * k, float(k % 7))) for k in range(50)]
    seen = dft.look(write_dataflash(tmp_path / "lake.bin", formats, rows))
    assert any("SERVO1_TRIM 1900" in doubt and "Mend: " in doubt for doubt in seen.doubts)


def test_servos_of_other_vehicles_are_looked_at_as_ever(tmp_path):
    pytest.importorskip("pymavlink")
    messages = [(0.1 * k, 1, servos(1500 + k)) for k in range(20)]
    messages.append((0.0, 1, parameter("FRAME_CLASS", 1.0)))
    assert dft.look(write_telemetry(tmp_path / "car.tlog", messages)).model is None
