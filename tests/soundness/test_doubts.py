"""Doubts about logs: single mistakes in simulated logs, and none where nothing is wrong."""

import dataclasses
import json
import warnings

import numpy as np
import pytest
from reference import inputs, thruster, vessel
from short_logs import made_log

import diffthrust as dft

from .measured import changed

MODEL = dft.Thruster()


def doubts(log, model=MODEL):
    return dft.soundness.doubts(log, model)


def kinds(log, model=MODEL):
    return {(d.channel, d.kind) for d in doubts(log, model)}


@pytest.fixture(scope="module")
def log():
    return made_log(seed=0, count=800)


@pytest.fixture(scope="module")
def boat():
    """A twin-thruster boat with its track; 60 s of steps at 10 Hz."""
    time, rng = inputs.grid(60.0, 0.1), np.random.default_rng(4)
    forces = {
        side: inputs.staircase(time, rng.uniform(-1.0, 2.5, 12), 5.0)
        for side in ("left_force", "right_force")
    }
    record = vessel.simulate(time, forces, parameters=vessel.SIRAMDASU, method="rk4")
    names = ("surge", "sway", "yaw_rate", "heading", "north", "east")
    noise = {name: 0.005 * rng.standard_normal(time.size) for name in names}
    measured = {n: v + noise[n] * np.ptp(v) for n, v in record.truth.items() if n in names}
    return dft.Log(time, forces, measured, name="boat")


BOAT = dft.Vessel("twin")


def negated(values):
    return -values


def test_sound_logs_are_not_doubted(log, boat):
    assert doubts(log) == ()
    assert doubts(boat, BOAT) == ()


def test_without_a_model_the_same_is_seen(boat):
    assert kinds(changed(boat, east=negated), None) == {("east", "sign")}


@pytest.mark.parametrize("channel", ["surge", "sway", "yaw_rate", "heading", "north", "east"])
def test_a_sign_is_named_with_the_line_that_mends_it(boat, channel):
    (doubt,) = doubts(changed(boat, **{channel: negated}), BOAT)
    assert (doubt.channel, doubt.kind) == (channel, "sign")
    assert f"[channels.{channel}] scale = -1" in doubt.mend


def test_of_thrust_and_command_the_other_is_told_where_none_says_which(log):
    log = log.replaced(measured={**log.measured, "speed": np.abs(log.measured["speed"])})
    log = log.replaced(unsigned=frozenset({"speed"}))
    for channel in ("thrust", "command"):
        (doubt,) = doubts(changed(log, **{channel: negated}))
        assert (doubt.channel, doubt.kind) == ("thrust", "sign")
        assert "the sign of command" in doubt.evidence


def test_of_three_that_hang_together_the_odd_one_is_named(log):
    for channel in ("command", "speed", "thrust"):
        assert kinds(changed(log, **{channel: negated})) == {(channel, "sign")}


@pytest.mark.parametrize(
    ("one", "two"), [("left_force", "right_force"), ("north", "east"), ("surge", "sway")]
)
def test_exchanged_channels_are_named(boat, one, two):
    values = {**boat.inputs, **boat.measured}
    swapped = changed(boat, **{one: lambda _: values[two], two: lambda _: values[one]})
    assert kinds(swapped, BOAT) == {(one, "exchanged")}


def test_a_wind_in_degrees_has_a_reading_in_degrees(boat):
    """The doubt stood, and a diagnosis had nothing to measure its mend by."""
    degrees = np.mod(330.0 + 60.0 * np.sin(0.3 * boat.time), 360.0)
    wind = {"wind_speed": np.full(len(boat), 4.0), "wind_direction": degrees}
    units = {"wind_speed": "m/s", "wind_direction": "rad"}
    (doubt,) = doubts(boat.replaced(inputs={**boat.inputs, **wind}, units=units), BOAT)
    assert (doubt.channel, doubt.kind) == ("wind_direction", "unit")
    (reading,) = doubt.readings
    assert reading.sources == {"wind_direction": ("wind_direction", np.pi / 180)}


def test_exchanged_sides_are_seen_where_only_the_heading_tells_how_a_boat_turns(boat):
    """A Kingfisher logs speed and heading; its inertia ran away, and no log was doubted."""
    seen = {name: boat.measured[name] for name in ("surge", "heading")}
    assert doubts(boat.replaced(measured=seen), BOAT) == ()
    left, right = (boat.inputs[side] for side in ("left_force", "right_force"))
    swapped = changed(boat, left_force=lambda _: right, right_force=lambda _: left)
    (doubt,) = doubts(swapped.replaced(measured=seen), BOAT)
    assert "the rate of the heading opposes the left force less the right one" in doubt.evidence
    told = {reading.words for reading in doubt.readings}
    assert any("left_force and right_force exchanged" in words for words in told)


def test_speed_and_thrust_exchanged_are_told_by_the_law_between_them(log):
    speed, thrust = log.measured["speed"], log.measured["thrust"]
    (doubt,) = doubts(log.replaced(measured={"speed": thrust, "thrust": speed}))
    assert (doubt.channel, doubt.kind) == ("speed", "exchanged")
    assert "root of the speed" in doubt.evidence


@pytest.mark.parametrize(
    ("channel", "factor", "unit"),
    [
        ("yaw_rate", 180 / np.pi, "deg/s"),
        ("heading", 180 / np.pi, "deg"),
        ("surge", 1 / 0.514444, "knot"),
    ],
)
def test_a_unit_of_a_boat_is_named(boat, channel, factor, unit):
    (doubt,) = doubts(changed(boat, **{channel: lambda v: factor * v}), BOAT)
    assert (doubt.channel, doubt.kind) == (channel, "unit")
    assert f'unit = "{unit}"' in doubt.mend


@pytest.mark.parametrize(("factor", "unit"), [(30 / np.pi, "rpm"), (0.5 / np.pi, "rev/s")])
def test_the_load_of_the_propeller_tells_the_unit_of_its_speed(log, factor, unit):
    (doubt,) = doubts(changed(log, speed=lambda v: factor * v))
    assert (doubt.channel, doubt.kind) == ("speed", "unit")
    assert f'unit = "{unit}"' in doubt.mend
    assert "alpha" in doubt.evidence


def test_the_unit_to_write_is_that_of_the_numbers_in_the_file(log):
    """Numbers in rad/s that are called rpm: neither what they are called nor what is stored."""
    called = dft.Log(
        log.time,
        dict(log.inputs),
        dict(log.measured),
        units={"command": "V", "speed": "rpm", "thrust": "N"},
    )
    (doubt,) = doubts(called)
    assert (doubt.channel, doubt.kind) == ("speed", "unit")
    assert 'unit = "rad/s"' in doubt.mend


def test_a_column_that_is_called_rpm_is_not_in_rad_per_second(tmp_path, log):
    path = tmp_path / "run.csv"
    rpm = log.measured["speed"] * 30 / np.pi
    rows = np.stack([log.time, log.inputs["command"], rpm], axis=1)
    np.savetxt(path, rows, delimiter=",", header="t,u,shaft_rpm", comments="")

    def read(**kwargs):
        speed = dft.Column("shaft_rpm", **kwargs)
        return dft.read_log(path, time="t", inputs={"command": "u"}, measured={"speed": speed})

    assert ("speed", "unit") in kinds(read(unit="rad/s"))
    assert "'shaft_rpm'" in doubts(read(unit="rad/s"))[0].evidence
    # whoever scales the numbers has seen to their unit
    assert kinds(read(unit="rad/s", scale=np.pi / 30)) == set()


def test_widths_of_pulses_are_no_voltage(log):
    pulses = changed(log, command=lambda v: 1500 + 150 * v)
    assert "pwm = { stop = 1500, full = 1900 }" in doubts(pulses)[0].mend


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "ms"), (0.001, "s")])
def test_a_time_base_is_named(log, factor, unit):
    (doubt,) = doubts(changed(log, time=lambda t: factor * t))
    assert (doubt.channel, doubt.kind) == ("time", "time_base")
    assert f'unit = "{unit}"' in doubt.mend


def test_a_clock_that_runs_three_times_too_fast_is_told_by_its_factor(boat):
    (doubt,) = doubts(changed(boat, time=lambda t: t / 3), BOAT)
    assert (doubt.channel, doubt.kind) == ("time", "time_base")
    assert "scale=3" in doubt.mend


def test_a_lag_is_told_in_seconds(log):
    late = changed(log, thrust=lambda v: np.interp(log.time - 0.5, log.time, v)).slice(1.0, None)
    (doubt,) = doubts(late)
    assert (doubt.channel, doubt.kind) == ("thrust", "lag")
    assert "comes 0.50 s after the square of the speed" in doubt.evidence


def frozen(v):
    v[300:500] = v[300]
    return v


def spiked(v):
    v[[100, 300, 500, 650]] += 300.0
    return v


def coded(code):
    def change(v):
        v[[50, 200, 201, 400, 601]] = code
        return v

    return change


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (frozen, "stuck"),
        (lambda v: np.clip(v, -20.0, 20.0), "saturated"),
        (lambda v: np.round(v / 12) * 12, "stuck"),
        (lambda v: v[np.arange(v.size) // 6 * 6], "stuck"),
        (coded(-999.0), "sentinel"),
        (coded(65535.0), "sentinel"),
        (spiked, "outliers"),
        (lambda v: 0 * v + 7.0, "silent"),
        (lambda v: np.random.default_rng(0).standard_normal(v.size), "silent"),
    ],
)
def test_a_bad_sensor_is_named(log, change, kind):
    assert kinds(changed(log, speed=change)) == {("speed", kind)}


def test_a_recorder_that_stands_still_is_one_doubt(boat):
    def still(v):
        v[300:400] = v[300]
        return v

    (doubt,) = doubts(changed(boat, surge=still, yaw_rate=still, heading=still), None)
    assert (doubt.channel, doubt.kind, doubt.also) == ("surge", "stuck", ("yaw_rate", "heading"))
    assert "for 100 samples from t = 30.00 s on surge at " in doubt.evidence
    assert doubt.evidence.endswith("stay as they are, while inputs or other readings move.")
    since_1970 = changed(boat, time=lambda t: t + 1.7e9, surge=still, yaw_rate=still, heading=still)
    (doubt,) = doubts(since_1970, None)
    assert "for 100 samples from 30.00 s after its start on surge at " in doubt.evidence


def test_a_sentinel_is_told_as_the_file_has_it(tmp_path, log):
    path = tmp_path / "run.csv"
    rpm = log.measured["speed"] * 30 / np.pi
    rpm[[50, 300, 700]] = -9999
    rows = np.stack([log.time, log.inputs["command"], rpm], axis=1)
    np.savetxt(path, rows, delimiter=",", header="t,u,n", comments="")
    measured = {"speed": dft.Column("n", unit="rpm")}
    read = dft.read_log(path, time="t", inputs={"command": "u"}, measured=measured)
    (doubt,) = doubts(read)
    assert 'missing_values = ["-9999"]' in doubt.mend


def test_a_table_of_readings_has_no_clock_to_be_doubted():
    depth = np.repeat(np.linspace(0.0, 50.0, 20), 5)
    log = dft.Log(10.0 * np.arange(100), {"depth": depth}, {"voltage": 0.02 * depth})
    assert dft.soundness.doubts(log, dft.LinearSensor()) == ()


def test_commands_may_hold_and_jump(log):
    """What a person does to a joystick is no defect of a sensor."""
    pulsed = changed(log, command=lambda v: np.where(np.arange(v.size) % 40 < 2, 0.0, np.round(v)))
    assert kinds(pulsed.replaced(measured={"thrust": log.measured["thrust"]})) <= {("thrust", "x")}


def test_gaps_are_named(log):
    lost = log.slice(0, 10)
    rest = log.slice(20, None)
    joined = {
        kind: {k: np.concatenate([v, getattr(rest, kind)[k]]) for k, v in values.items()}
        for kind, values in (("inputs", lost.inputs), ("measured", lost.measured))
    }
    gapped = log.replaced(time=np.concatenate([lost.time, rest.time]), **joined)
    assert kinds(gapped) == {("time", "gap")}

    def missing(v):
        v[200:300] = np.nan
        return v

    assert kinds(changed(log, thrust=missing)) == {("thrust", "gap")}


def test_what_was_left_out_is_no_gap(log):
    """One left a second of a receiver that stood still out, and was told to cut the log there."""
    without = log.leave_out(4.0, 9.0, "weed in the propeller")
    assert kinds(without) == set() < kinds(without.replaced(left_out=()))
    for edited in (without.slice(2.0, None), without.averaged(2), without.resampled(10.0)):
        assert kinds(edited) == set()

    def missing(v):
        v[300:400] = np.nan
        return v

    assert kinds(changed(without, thrust=missing)) == {("thrust", "gap")}


def test_a_log_unlike_its_companions_is_named():
    logs = [made_log(seed=k, count=600, name=f"run{k}") for k in range(4)]
    assert dft.soundness.doubts(logs, MODEL) == ()
    for factor, kind in ((1 / 9.80665, "unit"), (2.5, "odd_log")):
        odd = changed(logs[2], thrust=lambda v, factor=factor: factor * v)
        (doubt,) = dft.soundness.doubts([*logs[:2], odd, logs[3]], MODEL)
        assert (doubt.channel, doubt.kind) == ("thrust", kind)
        assert doubt.evidence.startswith("run2:")
    shifted = changed(logs[1], thrust=lambda v: v + 100.0)
    (doubt,) = dft.soundness.doubts([logs[0], shifted, *logs[2:]], MODEL)
    assert (doubt.channel, doubt.kind) == ("thrust", "odd_log")


def test_what_all_logs_have_wrong_alike_cannot_be_told():
    """Thrust in kgf called N changes one constant of the model, and nothing else."""
    logs = [changed(made_log(seed=k, count=600), thrust=lambda v: v / 9.80665) for k in range(3)]
    assert dft.soundness.doubts(logs, MODEL) == ()


def test_one_doubt_stands_for_what_several_logs_share():
    logs = [changed(made_log(seed=k, count=600), thrust=negated) for k in range(3)]
    (doubt,) = dft.soundness.doubts(logs, MODEL)
    assert "And so in 2 more." in doubt.evidence
    assert "[channels.thrust] scale = -1" in doubt.mend


def several(count, change, **channels):
    """So many logs, those in `change` with channels put through functions."""
    logs = [made_log(seed=k, count=600, name=f"run{k}") for k in range(count)]
    return [changed(log, **channels) if k in change else log for k, log in enumerate(logs)]


@pytest.mark.parametrize("channel", ["thrust", "speed", "command"])
def test_one_log_turned_among_three_is_mended_alone(channel):
    (doubt,) = dft.soundness.doubts(several(3, {1}, **{channel: negated}), MODEL)
    assert (doubt.channel, doubt.kind) == (channel, "sign")
    assert "for run1 alone" in doubt.mend
    assert "Column(..., scale=-1)" in doubt.mend
    assert "[channels" not in doubt.mend
    assert "more" not in doubt.evidence


def test_two_logs_turned_among_three_leave_the_third_as_it_is():
    (doubt,) = dft.soundness.doubts(several(3, {0, 2}, thrust=negated), MODEL)
    assert "And so in 1 more." in doubt.evidence
    assert "for run0 and run2 alone" in doubt.mend


def test_one_log_with_channels_exchanged_says_so_alone():
    logs = several(3, ())
    speed, thrust = logs[1].measured["speed"], logs[1].measured["thrust"]
    logs[1] = logs[1].replaced(measured={"speed": thrust, "thrust": speed})
    (doubt,) = dft.soundness.doubts(logs, MODEL)
    assert (doubt.channel, doubt.kind) == ("speed", "exchanged")
    assert "for run1 alone" in doubt.mend


def test_logs_are_counted_and_not_their_doubts(tmp_path):
    """The name of its column and its size both tell the unit of one channel."""
    logs = []
    for k in range(2):
        log = made_log(seed=k, count=600)
        rpm = 300 * log.measured["speed"]
        rows = np.stack([log.time, log.inputs["command"], rpm], axis=1)
        path = tmp_path / f"run{k}.csv"
        np.savetxt(path, rows, delimiter=",", header="t,u,rpm", comments="")
        speed = dft.Column("rpm", unit="rad/s")
        logs.append(
            dft.read_log(path, time="t", inputs={"command": "u"}, measured={"speed": speed})
        )
    (doubt,) = (d for d in dft.soundness.doubts(logs, MODEL) if d.kind == "unit")
    assert "And so in 1 more." in doubt.evidence


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 10.0])
def test_a_clock_of_one_log_is_told_by_its_companions(factor):
    logs = several(3, ())
    logs[1] = changed(logs[1], time=lambda t: factor * t)
    (doubt,) = dft.soundness.doubts(logs, MODEL)
    assert (doubt.channel, doubt.kind) == ("time", "time_base")
    assert f"Column(..., scale={1 / factor:g}) for the time" in doubt.mend
    assert "for run1 alone" in doubt.mend


def test_a_log_may_be_taken_at_another_rate():
    logs = several(3, ())
    for every in (2, 5):
        kept = {
            kind: {k: v[::every] for k, v in getattr(logs[1], kind).items()}
            for kind in ("inputs", "measured")
        }
        slower = logs[1].replaced(time=logs[1].time[::every], **kept)
        assert dft.soundness.doubts([logs[0], slower, logs[2]], MODEL) == ()


def test_a_thrust_that_is_cut_off_is_not_exchanged(log):
    most = 0.15 * np.abs(log.measured["thrust"]).max()
    cut = changed(log, thrust=lambda v: np.clip(v, -most, most))
    assert kinds(cut) == {("thrust", "saturated")}


def test_a_thrust_that_is_held_has_no_lag(log):
    held = changed(log, thrust=lambda v: v[np.arange(v.size) // 12 * 12])
    assert kinds(held) == {("thrust", "stuck")}


def test_the_last_of_broad_steps_is_not_the_end_of_a_range():
    time, rng = np.arange(1600) * 0.02, np.random.default_rng(2)
    command = np.repeat(rng.uniform(-1, 1, 20), rng.integers(20, 140, 20))[:1600]
    answer = np.convolve(command, np.exp(-np.arange(40) / 6))[:1600] / 6.5
    speed = 300 * np.round(8.3 * answer)
    log = dft.Log(time, {"command": command}, {"speed": speed}, units={"speed": "rpm"})
    (doubt,) = doubts(log, dft.SpeedLoopThruster())
    assert doubt.kind == "stuck"
    assert "300 rpm apart" in doubt.evidence
    assert "more digits" in doubt.mend


@pytest.mark.parametrize("driven", [True, False])
def test_zeros_while_the_drive_goes_on_are_no_speed(driven):
    rng = np.random.default_rng(3)
    command = np.repeat(rng.uniform(0.5, 1.0, 20) * rng.choice([-1, 1], 20), 40)
    speed = 1000.0 * command + 20.0 * rng.standard_normal(800)
    speed[405:435] = 0.0
    command[400:440] *= driven
    log = dft.Log(0.05 * np.arange(800), {"command": command}, {"speed": speed})
    found = [d for d in doubts(log, None) if d.kind == "sentinel"]
    assert len(found) == driven
    assert all("for 30 samples" in d.evidence and "(nan)" in d.mend for d in found)


def test_a_doubt_is_plain_data(log):
    (doubt,) = doubts(changed(log, thrust=negated))
    assert set(json.loads(json.dumps(doubt.to_json()))) == {"channel", "kind", "evidence", "mend"}
    with pytest.raises(dataclasses.FrozenInstanceError):
        doubt.kind = "lag"


@pytest.mark.parametrize("count", [1, 2, 3, 19, 20, 21, 39, 41, 60, 101, 2049, 4100])
def test_no_log_is_too_short_or_too_odd(count):
    rng = np.random.default_rng(count)
    time = np.cumsum(rng.uniform(0.05, 0.1, count))
    rare = np.where(np.arange(count) % 7, np.nan, np.sin(time))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for values in (np.zeros(count), np.sign(np.sin(time)), 1e9 * np.cos(time), rare):
            outputs = ("surge", "sway", "yaw_rate", "heading", "north", "east", "speed", "thrust")
            drives = ("command", "left_force", "right_force")
            drive = rng.normal(size=count)
            odd = dft.Log(time, dict.fromkeys(drives, drive), dict.fromkeys(outputs, values))
            for doubt in dft.soundness.doubts([odd, odd, odd], MODEL):
                assert doubt.mend


def test_a_fit_tells_its_doubts_first():
    log = changed(made_log(seed=0), thrust=negated)
    fit = dft.fit(MODEL, log, starts=1)
    (doubt,) = fit.doubts
    assert (doubt.channel, doubt.kind) == ("thrust", "sign")
    assert fit.to_json()["doubts"] == [doubt.to_json()]
    lines = fit.report().splitlines()
    assert lines[1].startswith("Doubt: thrust (sign)")
    assert "0 % of the variance of thrust: look at the doubts first" in fit.message
    assert dft.compare(fit, log).to_json()["doubts"] == [doubt.to_json()]
    assert dft.fit(MODEL, log, starts=1, doubts=False).doubts[0].kind == "silent"


def test_a_channel_that_is_hardly_explained_is_a_doubt_of_its_own():
    rng = np.random.default_rng(0)
    log = made_log(seed=0)
    wandering = np.cumsum(rng.standard_normal(len(log)))
    fit = dft.fit(MODEL, log.replaced(measured={**log.measured, "thrust": wandering}), starts=1)
    assert [d.channel for d in fit.doubts] == ["thrust"]
    assert "look at the doubts first" in fit.message


def test_a_good_fit_has_no_doubts():
    fit = dft.fit(MODEL, made_log(seed=0), starts=1)
    assert fit.doubts == ()
    assert "doubt" not in fit.report().lower()


def test_the_law_between_speed_and_thrust_holds_for_other_thrusters():
    time = inputs.grid(20.0, 0.05)
    command = inputs.staircase(time, np.random.default_rng(0).uniform(-2, 2, 20), 1.0)
    record = thruster.simulate(time, command, alpha=0.1, beta=300.0, ct=0.001, method="rk4")
    rng = np.random.default_rng(1)
    noisy = {k: v + 0.01 * np.ptp(v) * rng.standard_normal(v.size) for k, v in record.truth.items()}
    measured = {name: noisy[name] for name in ("speed", "thrust")}
    assert doubts(dft.Log(time, {"command": command}, measured)) == ()


@pytest.mark.parametrize("code", [-999.0, 65535.0])
def test_a_block_of_codes_is_told_also_within_the_range_of_the_channel(code):
    """A logger writes its code for as long as a sensor is away, not for a sample or two."""
    rng = np.random.default_rng(3)
    speed = 1000.0 * np.repeat(rng.uniform(-2.0, 2.0, 20), 40) + 20.0 * rng.standard_normal(800)
    speed[400:440] = 1500.0 + 20.0 * rng.standard_normal(40)
    speed[405:435] = code
    time, command = 0.05 * np.arange(800), np.repeat(rng.uniform(-1.0, 1.0, 20), 40)
    log = dft.Log(time, {"command": command}, {"speed": speed}, units={"speed": "rpm"})
    (doubt,) = (d for d in doubts(log) if d.kind == "sentinel")
    assert doubt.channel == "speed"
    assert f'missing_values = ["{code:g}"]' in doubt.mend
    assert "30 samples" in doubt.evidence


def test_the_noise_and_the_range_of_a_sensor_go_with_its_numbers():
    time = np.arange(50) * 0.1
    log = dft.Log(
        time,
        {"command": np.sin(time)},
        {"speed": np.cos(time), "thrust": 2.0 * np.sin(time)},
        noise={"speed": 0.1, "thrust": 0.5},
        rails={"speed": (-3.0, 4.0)},
    )
    sources = {"speed": ("thrust", -2.0), "thrust": ("speed", 1.0)}
    read = dft.soundness.Reading("exchanged, one of them turned", "", sources).log(log)
    assert dict(read.noise) == {"speed": 1.0, "thrust": 0.1}
    assert dict(read.rails) == {"thrust": (-3.0, 4.0)}
    assert np.array_equal(read.measured["speed"], -2.0 * log.measured["thrust"])
