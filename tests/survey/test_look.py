"""From a raw file to a spec that fits, with nothing edited between."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from marks import slow_but
from shared_data import data_folder
from survey.strange_logs import ALPHA, BETA, CT, boat, thruster, write_table

import diffthrust as dft
from diffthrust.logs import PWM
from diffthrust.specs import load_spec


def drafted(seen, path):
    return load_spec(seen.save_spec(path))


def bench():
    """The columns of a bench by a PWM controller, a tachometer and a scale."""
    log = thruster()
    return {
        "t": log["time"],
        "pwm": 1500 + 400 * log["effort"],
        "rpm": log["speed"] * 60 / (2 * np.pi),
        "thrust_kgf": log["thrust"] / 9.80665,
    }


def test_pwm_rpm_and_kgf_are_fitted_from_the_draft_as_it_is(tmp_path):
    seen = dft.look(write_table(tmp_path / "run1.csv", bench()))
    assert seen.model == "thruster"
    assert {row.name: (row.channel, row.unit) for row in seen.columns} == {
        "t": ("time", "s"),
        "pwm": ("command", "us"),
        "rpm": ("speed", "rpm"),
        "thrust_kgf": ("thrust", "kgf"),
    }
    spec = drafted(seen, tmp_path / "fit.toml")
    assert PWM.of(spec.inputs["command"].pwm, "") == PWM(1500, 1900)
    fit = spec.fit()
    assert fit.status.ok
    found = {name: fit.parameters[name].value for name in ("alpha", "beta", "ct")}
    assert found == pytest.approx({"alpha": ALPHA, "beta": BETA, "ct": CT}, rel=0.02)


STRANGE = {
    "percent, milliseconds": lambda log: {
        "time_ms": 1000 * log["time"],
        "throttle": 100 * log["effort"],
        "omega": log["speed"],
    },
    "duty, stamps from 1970": lambda log: {
        "timestamp": 1_700_000_000 + log["time"],
        "duty cycle": log["effort"],
        "shaft_speed_rad_s": log["speed"],
    },
    "volts": lambda log: {
        "Time": log["time"],
        "u [V]": 12 * log["effort"],
        "n": log["speed"] / (2 * np.pi),
    },
    "no sign": lambda log: {
        "micros": 1e6 * log["time"],
        "ESC_us": 1500 + 400 * log["effort"],
        "RPM": np.abs(log["speed"]) * 60 / (2 * np.pi),
    },
    "turned, with words": lambda log: {
        "time": log["time"],
        "cmd": log["effort"],
        "rpm": ["n/a" if k % 97 == 5 else f"{x:.3f}" for k, x in enumerate(log["speed"] * 9.5493)],
        "note": ["ok"] * log["time"].size,
    },
}


@pytest.mark.parametrize("name", STRANGE)
def test_strange_files_are_fitted_from_the_draft_as_it_is(name, tmp_path):
    seen = dft.look(write_table(tmp_path / "run.csv", STRANGE[name](thruster())))
    spec = drafted(seen, tmp_path / "fit.toml")
    (log,) = spec.train_logs()
    assert log.step == pytest.approx(0.02, rel=1e-6)
    assert ("speed" in log.unsigned) == (name == "no sign")
    fit = spec.fit()
    assert fit.parameters["alpha"].value == pytest.approx(ALPHA, rel=0.02)
    assert fit.train.channels["speed"].fit_percent > 95


def test_stamps_coarser_than_the_rows_give_way_to_a_step(tmp_path):
    log = thruster()
    columns = {"t": np.floor(log["time"]), "cmd": log["effort"], "rpm": 10 * log["speed"]}
    seen = dft.look(write_table(tmp_path / "run.csv", columns))
    assert drafted(seen, tmp_path / "fit.toml").train_logs()[0].step == pytest.approx(0.02)
    assert any("coarser" in word for word in seen.doubts)


def test_a_table_without_time_holds_what_it_cannot_tell(tmp_path):
    log = thruster()
    table = {"pwm": 1500 + 400 * log["effort"], "rpm": 10 * log["speed"], "nr": np.arange(1500)}
    seen = dft.look(write_table(tmp_path / "run.csv", table))
    spec = drafted(seen, tmp_path / "fit.toml")
    assert spec.model.parameters["alpha"].fixed
    assert len(spec.train_logs()[0]) == 1500
    assert any("No column of times" in word for word in seen.doubts)


def test_the_set_point_of_a_speed_is_the_command_of_a_speed_loop(tmp_path):
    log = thruster()
    table = {"t": log["time"], "rpm_cmd": 2000 * log["effort"], "rpm_meas": 9.5 * log["speed"]}
    seen = dft.look(write_table(tmp_path / "run.csv", table))
    assert seen.model == "speed_loop_thruster"
    (read,) = drafted(seen, tmp_path / "fit.toml").train_logs()
    assert np.abs(read.inputs["command"] - table["rpm_cmd"] * np.pi / 30).max() < 1e-6


@pytest.mark.parametrize(
    ("low", "high", "stop"), [(1031, 1956, 1000), (1100, 1900, 1100), (1250, 1960, 1000)]
)
@pytest.mark.parametrize("measured", ["rpm", "thrust_N", "both"])
def test_pulses_of_a_drive_that_goes_one_way_begin_at_its_stop(low, high, stop, measured, tmp_path):
    width = np.round(np.interp(np.abs(thruster()["effort"]), (0, 1), (low, high)))
    width[:50], width[-50:] = low, high
    rng, speed = np.random.default_rng(3), np.zeros(1500)
    for k in range(1499):
        speed[k + 1] = speed[k] + 0.1 * (0.3 * max(width[k] - 1040, 0) - speed[k])
    table = {
        "t": 0.02 * np.arange(1500),
        "pwm": width,
        "rpm": 9.549 * speed + rng.normal(0, 30, 1500),  # as noisy as to be negative at rest
        "thrust_N": 1e-3 * speed**2 + rng.normal(0, 1.0, 1500),
    }
    if measured != "both":
        table = {name: table[name] for name in ("t", "pwm", measured)}
    spec = drafted(dft.look(write_table(tmp_path / "run.csv", table)), tmp_path / "fit.toml")
    assert PWM.of(spec.inputs["command"].pwm, "") == PWM(stop, 3000 - stop)
    assert not any(channel.unsigned for channel in spec.file.channels.values())


@pytest.mark.parametrize("least", [-1.0, -0.5, -0.3])
def test_pulses_of_a_drive_that_goes_both_ways_keep_their_middle(least, tmp_path):
    log = thruster()
    ahead = log["effort"] >= least  # how far astern it was driven
    for sign, speed in ((False, log["speed"]), (True, np.abs(log["speed"]))):
        columns = {"pwm": 1500 + 400 * log["effort"], "rpm": 9.549 * speed}
        table = {"t": log["time"], **columns}
        kept = {name: values[ahead] for name, values in table.items()}
        kept["t"] = log["time"][: ahead.sum()]
        seen = dft.look(write_table(tmp_path / "run.csv", kept))
        assert seen.choice.channels["command"].meaning.pwm == PWM(1500, 1900)
        assert seen.choice.channels["speed"].unsigned == sign


@pytest.mark.parametrize("name", ["rudder_pwm", "delta", "rudder [us]"])
def test_the_pulses_of_a_servo_are_an_angle_whose_reach_is_in_doubt(name, tmp_path):
    log = boat()
    width = np.round(1500 + 290 * log["left"])
    columns = {
        "t": log["time"],
        "prop_rpm": 1200 + 300 * log["right"],
        name: width,
        "u_mps": log["surge"],
        "v_mps": np.sin(log["time"]),
        "r_dps": -np.degrees(log["yaw_rate"]),
    }
    seen = dft.look(write_table(tmp_path / "boat.csv", columns))
    assert seen.model == "vessel"
    spec = drafted(seen, tmp_path / "fit.toml")
    rudder = spec.file.channels["rudder_angle"]
    assert PWM.of(spec.inputs["rudder_angle"].pwm, "") == PWM(1500, 1900)
    assert (rudder.scale, rudder.unit) == (35, "deg")
    assert {"surge", "sway", "yaw_rate"} < set(spec.file.channels)
    (read,) = spec.train_logs()
    assert read.inputs["rudder_angle"] == pytest.approx(np.radians(35 / 400 * (width - 1500)))
    assert any("35 deg at 1900 is a guess" in word for word in seen.doubts)


def test_a_data_frame_is_pointed_to_what_makes_a_log_of_it():
    with pytest.raises(dft.InputError, match=r"found a DataFrame.\n.*Log\.from_dataframe"):
        dft.look(pd.DataFrame(bench()))  # type: ignore[arg-type]


def test_the_static_curve_tells_a_speed_loop_from_a_torque(tmp_path):
    log = thruster()
    effort, held = log["effort"], np.zeros(1500)
    for k in range(1499):  # 25 us of dead band, then a first-order loop
        goal = 250 * np.sign(effort[k]) * max(abs(effort[k]) - 0.06, 0.0)
        held[k + 1] = held[k] + 0.02 * (goal - held[k]) / 0.2
    for speed, model in ((held, "speed_loop_thruster"), (log["speed"], "thruster")):
        for seen_as in (speed, np.abs(speed)):
            table = {"t": log["time"], "pwm": 1500 + 400 * effort, "rpm": 9.549 * seen_as}
            seen = dft.look(write_table(tmp_path / "run.csv", table))
            assert seen.model == model
        table = {
            "t": log["time"],
            "pwm": 1500 + 400 * effort,
            "thrust_N": 4e-4 * speed * abs(speed),
        }
        assert dft.look(write_table(tmp_path / "run.csv", table)).model == model


def test_an_axis_vehicle_takes_a_command_as_plain_numbers(tmp_path):
    log = thruster()
    table = {"t": log["time"], "pwm": 1500 + 400 * log["effort"], "vel [m/s]": log["speed"] / 200}
    spec = drafted(dft.look(write_table(tmp_path / "r.csv", table)), tmp_path / "fit.toml")
    (read,) = spec.train_logs()
    assert spec.model.name == "axis_vehicle"
    assert np.abs(read.inputs["thrust"] - log["effort"]).max() < 1e-8


def test_a_semicolon_table_of_a_german_excel_is_understood(tmp_path):
    log = thruster()
    columns = {
        "Zeit [s]": log["time"],
        "Stellgröße [%]": 100 * log["effort"],
        "Drehzahl [1/min]": log["speed"] * 60 / (2 * np.pi),
        "Schub [N]": log["thrust"],
    }
    seen = dft.look(write_table(tmp_path / "lauf.csv", columns, ";", ","))
    spec = drafted(seen, tmp_path / "fit.toml")
    assert list(spec.file.channels) == ["command", "speed", "thrust"]
    (read,) = spec.train_logs()
    assert read.units["command"] == "effort"
    assert np.abs(read.measured["speed"] - log["speed"]).max() < 1e-3


SETS = {
    "ngs_thruster/CL1stateStep.csv": ("thruster", {"command", "speed", "thrust"}),
    "ngs_thruster/open_loop_plus3V.csv": ("thruster", {"speed", "thrust"}),
    "blueboat/run_220.csv": (
        "vessel",
        {"left_force", "right_force", "surge", "sway", "yaw_rate"},
    ),
    "esso_osaka/zigzag_31-Jul-2020_13_04_24.csv": (
        "vessel",
        {"propeller_speed", "rudder_angle", "surge", "sway", "yaw_rate"},
    ),
    "emps/DATA_EMPS_SC.csv": ("axis_vehicle", {"thrust", "position", "velocity"}),
    "t200/T200-Public-Performance-Data-10-20V-September-2019.xlsx": (
        "speed_loop_thruster",
        {"command", "speed", "thrust"},
    ),
}


def measured(file, tmp_path):
    """The spec drafted of a measured log, which is what it is known to be."""
    folder, name = file.split("/")
    model, channels = SETS[file]
    seen = dft.look(data_folder(folder) / name)
    assert seen.model == model
    spec = drafted(seen, tmp_path / "fit.toml")
    assert set(spec.file.channels) == channels
    return spec


@pytest.mark.parametrize("file", SETS)
def test_measured_logs_are_known_and_read_from_the_draft_as_it_is(file, tmp_path):
    (log,) = measured(file, tmp_path).train_logs()
    assert {*log.inputs, *log.measured} == SETS[file][1]


FITTED = ("ngs_thruster/CL1stateStep.csv", "emps/DATA_EMPS_SC.csv")


@pytest.mark.thorough
@pytest.mark.filterwarnings(
    "ignore::diffthrust.simulation.CoarseStepWarning"
)  # what is fitted is rough
@pytest.mark.parametrize("file", slow_but(FITTED, SETS))
def test_measured_logs_are_fitted_from_the_draft_as_it_is(file, tmp_path):
    fit = measured(file, tmp_path).fit()
    assert all(np.isfinite(p.value) for p in fit.parameters.values())
    assert fit.train.nrmse < 1.5


def test_a_static_sensor_is_a_line(tmp_path):
    seen = dft.look(data_folder(".") / "aras_2013_table4_depth_sensor.csv")
    spec = drafted(seen, tmp_path / "fit.toml")
    assert spec.file.logs.time is None
    assert spec.fit().parameters["slope"].value == pytest.approx(0.16, abs=0.005)


def test_a_boat_whose_yaw_rate_goes_to_port_is_turned_round(tmp_path):
    log = boat()
    columns = {
        "t": log["time"],
        "left_thruster": log["left"],
        "right_thruster": log["right"],
        "u": log["surge"],
        "v": np.sin(log["time"]),
        "r": -log["yaw_rate"],
    }
    seen = dft.look(write_table(tmp_path / "boat.csv", columns))
    channels = drafted(seen, tmp_path / "fit.toml").file.channels
    assert channels["yaw_rate"].scale == -1
    assert channels["left_force"].column == "left_thruster"
    assert channels["surge"].column == "u"
    assert any("left exceeds right" in word for word in seen.doubts)
    upright = dft.look(write_table(tmp_path / "b.csv", {**columns, "r": log["yaw_rate"]}))
    assert "scale" not in upright.spec
    assert not any("left exceeds right" in word for word in upright.doubts)


def test_sides_are_exchanged_where_the_heading_vouches_for_the_yaw_rate(tmp_path):
    log = boat()
    columns = {
        "t": log["time"],
        "left_force": 30 * log["right"],
        "right_force": 30 * log["left"],
        "surge": log["surge"],
        "gyro_z": np.degrees(log["yaw_rate"]) / 2,
        "heading": log["heading"],
    }
    columns["gyro_z"] *= 2
    seen = dft.look(write_table(tmp_path / "boat.csv", columns))
    channels = drafted(seen, tmp_path / "fit.toml").file.channels
    assert channels["left_force"].column == "right_force"
    assert channels["yaw_rate"].unit == "deg/s"


def test_a_yaw_rate_without_a_unit_has_that_of_the_heading(tmp_path):
    log = boat()
    for factor, unit in ((1.0, "rad/s"), (np.degrees(1.0) / 20, ""), (np.degrees(1.0), "deg/s")):
        slow = 0.02 if unit == "deg/s" else 1.0  # so slow that its numbers alone tell no unit
        columns = {
            "t": log["time"] / slow,
            "left": log["left"],
            "right": log["right"],
            "surge": log["surge"],
            "yaw_rate": factor * slow * log["yaw_rate"],
            "heading": log["heading"],
        }
        columns = {**columns, "left cmd": columns.pop("left"), "right cmd": columns.pop("right")}
        seen = dft.look(write_table(tmp_path / "boat.csv", columns))
        row = next(row for row in seen.columns if row.name == "yaw_rate")
        open_ = any(word.startswith("yaw_rate: No unit") for word in seen.doubts)
        assert open_ == (unit == "")
        assert row.unit == (unit or "rad/s")


def test_a_folder_keeps_its_last_log_unseen_and_tells_what_it_leaves_out(tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    for k in (1, 2, 3):
        write_table(folder / f"run{k}.csv", bench())
    write_table(folder / "weather.csv", {"hour": np.arange(9.0), "rain": np.arange(9.0) ** 2})
    (folder / "notes.txt").write_text("The water was warm.\nWe had cake.\n")
    seen = dft.look(folder)
    assert [path.name for path in seen.train] == ["run1.csv", "run2.csv"]
    assert [path.name for path in seen.holdout] == ["run3.csv"]
    assert any("weather.csv" in word for word in seen.apart)
    assert any("notes.txt" in word for word in seen.apart)
    assert "Drafted from run1.csv and 2 more (CSV" in seen.spec
    spec = drafted(seen, folder / "fit.toml")
    assert spec.file.logs.train == ["run1.csv", "run2.csv"]
    assert len(spec.holdout_logs()) == 1
    assert dft.look([folder / "run1.csv", folder / "run2.csv"]).holdout[0].name == "run2.csv"
    (folder / "run1.csv").rename(folder / "my_holdout.csv")
    assert [path.name for path in dft.look(folder).holdout] == ["my_holdout.csv"]
    with pytest.raises(dft.InputError, match="expected a table with numbers"):
        dft.look(folder / "notes.txt")


def test_a_gap_in_an_input_is_bridged_in_the_draft_and_said(tmp_path):
    columns = {key: [*map(str, values)] for key, values in bench().items()}
    columns["pwm"][100:103] = ["", "", ""]
    columns = {key: [*values, ""] for key, values in columns.items()}  # a blank row is no gap
    seen = dft.look(write_table(tmp_path / "run.csv", columns))
    assert "interpolate_inputs = true" in seen.spec
    assert len(drafted(seen, tmp_path / "fit.toml").train_logs()) == 1
    columns["pwm"][100:103] = ["1500", "1500", "1500"]
    assert "interpolate" not in dft.look(write_table(tmp_path / "run.csv", columns)).spec


def test_a_file_that_no_model_suits_is_told_and_drafted_as_comments(tmp_path):
    table = {"time": np.arange(9) / 10, "foo": np.arange(9.0), "yaw": np.arange(9) / 10}
    seen = dft.look(write_table(tmp_path / "x.csv", table))
    assert seen.model is None
    assert any("No model suits" in word for word in seen.doubts)
    assert "# [channels.heading]" in seen.spec
    with pytest.raises(dft.InputError, match="expected the key 'model'"):
        load_spec(seen.save_spec(tmp_path / "fit.toml"))


def test_a_draft_is_never_written_over_a_file(tmp_path):
    seen = dft.look(write_table(tmp_path / "run1.csv", bench()))
    seen.save_spec(tmp_path / "fit.toml")
    before = (tmp_path / "fit.toml").read_text()
    with pytest.raises(dft.InputError, match="nothing is overwritten"):
        seen.save_spec(tmp_path / "fit.toml")
    with pytest.raises(dft.InputError, match="expected a file ending"):
        seen.save_spec(tmp_path / "fit.csv")
    assert (tmp_path / "fit.toml").read_text() == before


def test_a_look_is_told_as_text_data_figure_and_page(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    seen = dft.look(write_table(tmp_path / "run1.csv", bench()))
    report = seen.report()
    assert max(map(len, report.splitlines())) <= 80
    for word in ("run1.csv", "50.0 Hz", "pwm", "thrust_kgf", "Model: thruster", "In doubt"):
        assert word in report
    data = json.loads(json.dumps(seen.to_json()))
    assert data["model"] == "thruster"
    assert data["columns"][1]["channel"] == "command"
    titles = [axes.get_title(loc="left") for axes in seen.plot().axes]
    assert titles == ["command: 'pwm' [us]", "speed: 'rpm' [rpm]", "thrust: 'thrust_kgf' [kgf]"]
    assert "thrust_kgf" in seen._repr_html_()


def test_what_is_not_sound_is_told_before_anything_is_fitted(tmp_path):
    columns = bench()
    sound = dft.look(write_table(tmp_path / "run1.csv", columns))
    columns["thrust_kgf"] = -columns["thrust_kgf"]
    seen = dft.look(write_table(tmp_path / "run2.csv", columns))
    assert not any("opposes" in doubt for doubt in sound.doubts)
    (doubt,) = (doubt for doubt in seen.doubts if doubt.startswith("thrust: "))
    assert "opposes the square of the speed" in doubt
    assert "scale = -1" in doubt
    assert "# thrust: run2.csv: thrust opposes" in seen.spec


def test_a_file_of_several_that_cannot_be_read_is_told(tmp_path):
    for i in (1, 2, 3):
        path = write_table(tmp_path / f"run{i}.csv", bench())
        if i == 2:
            path.write_text(path.read_text() + "off\n")
    told = [doubt for doubt in dft.look(tmp_path).doubts if "run2.csv" in doubt]
    (doubt,) = (doubt for doubt in told if "expected" in doubt)
    assert f"run2.csv, line {len(bench()['t']) + 2}" in doubt
    assert "Mend: " in doubt


def test_every_file_of_several_is_looked_at(tmp_path):
    for i in (1, 2, 3):
        columns = bench()
        columns["pwm"] = np.round(columns["pwm"] + i)
        if i == 2:
            columns["thrust_kgf"] = -columns["thrust_kgf"]
        write_table(tmp_path / f"run{i}.csv", columns)
    seen = dft.look(tmp_path)
    assert any("run2.csv: thrust opposes" in doubt for doubt in seen.doubts)


@pytest.mark.parametrize("tail", ["", ","], ids=["short rows", "empty cells"])
def test_a_last_column_that_is_filled_at_the_top_only(tail, tmp_path):
    time = 0.1 * np.arange(60)
    rows = [f"{t:.1f},{1500 + 10 * k},{30 * k}{tail}" for k, t in enumerate(time)]
    rows[0] = rows[0].removesuffix(",") + ",3"
    file = tmp_path / "run.csv"
    file.write_text("\n".join(["t,pwm,rpm,battery_cells", *rows, ""]))
    seen = dft.look(file)
    assert [row.name for row in seen.columns] == ["t", "pwm", "rpm", "battery_cells"]
    assert all(row.samples == 60 for row in seen.columns)
    file.write_text("\n".join(rows))
    with pytest.raises(dft.InputError, match="expected names of columns, found numbers"):
        dft.look(file)
