"""Channels that do not mean what their names say: found, explained, and acquitted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from shared_data import data_folder
from test_residual_tests import coloured

import diffthrust as dft
from diffthrust import Column

UNITS = {
    **{"left_force": "N", "right_force": "N", "surge": "m/s", "sway": "m/s", "yaw_rate": "rad/s"},
    **{"north": "m", "east": "m", "heading": "rad"},
}
VESSEL = dft.Vessel(drive="twin", lever_arm=0.3).replace(
    m11=20.0, m22=30.0, i33=2.0, d11=30.0, d22=60.0, d33=5.0
)
Channels = dict[str, np.ndarray]


def logs(
    inputs: Callable[[Channels], Channels] = dict,
    measured: Callable[[Channels], Channels] = dict,
    channels: tuple[str, ...] = ("surge", "sway", "yaw_rate", "north", "east", "heading"),
) -> list[dft.Log]:
    """Three runs of a boat, with inputs or measurements written down wrongly."""
    made = []
    for seed in range(3):
        rng, time = np.random.default_rng(seed), np.arange(600) * 0.1
        truth = {
            name: 8.0 + 8.0 * coloured(rng, 600, 0.97) for name in ("left_force", "right_force")
        }
        log = dft.Log(time=time, inputs=truth, measured={}, units=dict.fromkeys(truth, "N"))
        moved = dft.simulate(VESSEL, log, substeps=2)
        moved = {name: moved[name] + 0.01 * rng.standard_normal(600) for name in channels}
        written, seen = inputs(truth), measured(moved)
        units = {name: UNITS[name] for name in (*written, *seen)}
        made.append(dft.Log(time, written, seen, units, name=f"run {seed}"))
    return made


def exchanged(channels: Channels) -> Channels:
    return {"left_force": channels["right_force"], "right_force": channels["left_force"]}


def reversed_yaw(channels: Channels) -> Channels:
    return {**channels, "yaw_rate": -channels["yaw_rate"]}


def test_right_logs_give_no_hint():
    comparison = dft.compare(VESSEL, logs())
    assert comparison.hints == ()
    assert comparison.agreement["yaw_rate"].correlation > 0.99
    assert comparison.agreement["yaw_rate"].gain == pytest.approx(1.0, abs=0.02)


def test_exchanged_inputs_are_named_and_the_sensor_is_acquitted():
    hints = " ".join(dft.compare(VESSEL, logs(inputs=exchanged)).hints)
    assert "yaw_rate: the measurement moves opposite to the model (correlation -1.00" in hints
    assert "over 3 runs" in hints
    assert "Exchanging the inputs left_force and right_force turns the correlation" in hints
    assert "Reversing" not in hints
    assert "yaw_rate: it agrees with the rate of the measured heading" in hints
    assert "so not this channel but an input is the odd one" in hints


def test_a_reversed_sensor_is_accused():
    hints = " ".join(dft.compare(VESSEL, logs(measured=reversed_yaw)).hints)
    assert "yaw_rate: the measurement moves opposite to the model" in hints
    assert "yaw_rate: it opposes the rate of the measured heading" in hints
    assert "acquit" not in hints
    assert "so not this channel" not in hints


def test_without_a_heading_the_hint_says_what_would_tell():
    made = logs(inputs=exchanged, channels=("surge", "sway", "yaw_rate"))
    hints = dft.compare(VESSEL, made).hints
    assert any("a measured 'heading' would tell" in hint for hint in hints)


def test_a_reversed_input_is_named():
    def backwards(channels: Channels) -> Channels:
        return {"command": -channels["command"]}

    time = np.arange(400) * 0.05
    made = []
    for seed in range(2):
        truth = {"command": coloured(np.random.default_rng(seed), 400, 0.97)}
        log = dft.Log(time=time, inputs=truth, measured={}, units={"command": "V"})
        speed = dft.simulate(dft.Thruster(), log, substeps=2)["speed"]
        made.append(dft.Log(time, backwards(truth), {"speed": speed}, {"command": "V"}))
    hints = dft.compare(dft.Thruster(), made).hints
    assert hints[0].startswith("speed: the measurement moves opposite to the model (correlation -1")
    assert hints[1] == (
        "Reversing the sign of the input command turns the correlation positive: speed +1.00."
    )


def test_a_wrong_scale_is_named():
    def in_degrees(channels: Channels) -> Channels:
        return {**channels, "yaw_rate": np.rad2deg(channels["yaw_rate"])}

    made = logs(measured=in_degrees, channels=("surge", "sway", "yaw_rate"))
    (hint,) = [h for h in dft.compare(VESSEL, made).hints if h.startswith("yaw_rate")]
    assert "57 times as far" in hint


def test_unrelated_slow_series_are_not_called_opposed():
    opposed = 0
    for seed in range(40):
        rng, time = np.random.default_rng(seed), np.arange(400) * 0.05
        log = dft.Log(
            time, {"command": coloured(rng, 400, 0.99)}, {"speed": 20 * coloured(rng, 400, 0.99)}
        )
        found = dft.compare(dft.Thruster(), log).agreement["speed"]
        opposed += found.opposed
    assert opposed <= 3


def test_a_failed_simulation_gives_no_hint():
    comparison = dft.compare(VESSEL, logs())
    run = comparison.runs[0]
    gone = {name: np.full(run.time.size, np.inf) for name in run.signals}
    runs = (replace(run, signals=gone),)
    assert replace(comparison, runs=runs).hints == ()


def test_blueboat_has_its_force_channels_exchanged():
    def read(path):
        inputs = {name: Column(name, unit="N") for name in ("left_force", "right_force")}
        measured = {name: Column(name) for name in ("surge", "sway", "yaw_rate")}
        measured |= {
            "heading": Column("yaw", unit="deg"),
            "north": Column("x_ned", unit="m"),
            "east": Column("y_ned", unit="m"),
        }
        return dft.read_log(
            path, time=Column("original_timestamp", unit="ms"), inputs=inputs, measured=measured
        )

    paths = [data_folder("blueboat") / f"run_{number}.csv" for number in (228, 230, 232)]
    vessel = VESSEL.replace(lever_arm=0.285, i33=1.7)
    hints = " ".join(dft.compare(vessel, [read(path) for path in paths]).hints)
    assert "yaw_rate: the measurement moves opposite to the model" in hints
    assert "Exchanging the inputs left_force and right_force turns the correlation" in hints
    assert "yaw_rate: it agrees with the rate of the measured heading" in hints
