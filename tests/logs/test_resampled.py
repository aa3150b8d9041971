"""Logs brought to an even rate, from tables as from robots' logs."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import Column, InputError, Log, read_log
from tests.robot_files import write_dataflash


def merged_table(folder: Path) -> Path:
    """A thruster in a table with a row for each message: commands at 25 Hz, readings at 33 Hz."""
    rng = np.random.default_rng(3)
    stamps = [np.arange(0, 40, 0.04), np.arange(0.003, 40, 0.03), np.arange(0.007, 40, 0.03)]
    command = np.repeat(rng.uniform(-8, 8, 40), 25)
    fine = np.arange(20_000) * 0.002
    held = command[np.minimum((fine * 25 + 1e-9).astype(int), command.size - 1)]
    run = dft.simulate(dft.Thruster(command="V"), Log(fine, {"command": held}))
    speed = np.interp(stamps[1], fine, run["speed"]) + rng.normal(0, 0.3, stamps[1].size)
    thrust = np.interp(stamps[2], fine, run["thrust"]) + rng.normal(0, 0.5, stamps[2].size)
    rows = [(t, f"{t:.4f},{u:.4f},,") for t, u in zip(stamps[0], command, strict=True)]
    rows += [
        (t, f"{t:.4f},{u:.4f},{n:.4f},")
        for t, n in zip(stamps[1], speed, strict=True)
        for u in [command[int(t * 25 + 1e-9)]]
    ]
    rows += [
        (t, f"{t:.4f},{u:.4f},,{f:.4f}")
        for t, f in zip(stamps[2], thrust, strict=True)
        for u in [command[int(t * 25 + 1e-9)]]
    ]
    path = folder / "merged.csv"
    path.write_text("time,u,speed,thrust\n" + "\n".join(line for _, line in sorted(rows)) + "\n")
    return path


def test_a_merged_table_at_a_rate_gives_the_parameters_of_all_its_rows(tmp_path: Path) -> None:
    path = merged_table(tmp_path)
    options = {
        "inputs": {"command": Column("u", unit="V")},
        "measured": {"speed": Column("speed", "rad/s"), "thrust": Column("thrust", "N")},
    }
    every, even = read_log(path, **options), read_log(path, rate=25, **options)
    assert len(even) < 0.3 * len(every)
    assert even.even
    assert f"{len(every)} rows were averaged to {len(even)} at 25 Hz" in even.notes[-1]
    rows, rate = (dft.fit(dft.Thruster(), log, starts=2) for log in (every, even))
    for name, estimate in rows.parameters.items():
        assert rate.parameters[name].value == pytest.approx(estimate.value, rel=0.01)


def test_a_rate_may_be_any_kind_of_number() -> None:
    time = np.arange(12) * 0.25
    log = Log(time, {"command": time}, {"speed": time})
    assert "to 3 at 1 Hz." in log.resampled(Decimal("1.0")).notes[-1]


def test_a_step_of_a_held_input_keeps_its_integral_and_is_not_smeared() -> None:
    time = np.arange(12) * 0.1
    command = np.where(time < 0.55, 0.0, 4.0)  # a step at 0.6 s
    log = Log(time, {"command": command}, {"speed": time})
    even = log.resampled(2.5)  # steps of 0.4 s, middles at 0.15, 0.55, 0.95
    np.testing.assert_allclose(even.time, [0.15, 0.55, 0.95])
    # of the means until the next middle only that in which the step lies is between
    np.testing.assert_allclose(even.inputs["command"], [0.0, 3.5, 4.0])
    assert even.hold["command"] == "zero"


def test_a_ramp_stays_a_ramp_however_few_samples_a_step_has() -> None:
    time = np.arange(400) * 0.01
    sparse = np.where(np.arange(400) % 20 == 3, time, np.nan)  # one reading at 5 Hz, at 0.03 s
    log = Log(time, {"command": time}, {"speed": time, "surge": sparse}, hold="linear")
    even = log.resampled(10)
    np.testing.assert_allclose(even.inputs["command"][1:-1], even.time[1:-1])
    np.testing.assert_allclose(even.measured["speed"][1:-1], even.time[1:-1])
    seen = np.isfinite(even.measured["surge"])
    assert seen.sum() == 20
    # a reading moved to the middle of its step as it is would be late by 0.02 s
    np.testing.assert_allclose(even.measured["surge"][seen][:-1], even.time[seen][:-1])


def test_angles_noise_and_gaps() -> None:
    time = np.append(np.arange(8) * 0.1, 5 + np.arange(8) * 0.1)
    heading = np.rad2deg(np.unwrap(np.deg2rad(350 + 3 * np.arange(16)))) % 360
    log = Log(
        time,
        {"command": time},
        {"heading": heading, "speed": time},
        units={"heading": "deg"},
        noise={"speed": 0.2},
    )
    even = log.resampled(2.5)
    turned = np.rad2deg(even.values("heading", "rad"))
    np.testing.assert_allclose(np.diff(turned)[0], 12.0)  # across the jump at 360
    assert even.noise["speed"] == pytest.approx(0.1)
    np.testing.assert_allclose(np.diff(even.time).max(), 4.4)  # nothing was recorded in between


def test_a_rate_that_cannot_be_is_refused(tmp_path: Path) -> None:
    log = Log(np.arange(20) * 0.1, {"command": np.ones(20)}, {"speed": np.ones(20)})
    with pytest.raises(InputError, match=r"rows come at 10 Hz, found rate = 20"):
        log.resampled(20)
    with pytest.raises(InputError, match=r"above zero in Hz, found 0"):
        log.resampled(0)
    with pytest.raises(InputError, match=r"fewer than 3 samples"):
        log.resampled(1.0)
    (tmp_path / "table.csv").write_text("u,n\n1,2\n2,3\n3,4\n4,5\n")
    with pytest.raises(InputError, match="a static table has no rate"):
        read_log(
            tmp_path / "table.csv",
            time=None,
            inputs={"command": "u"},
            measured={"speed": "n"},
            rate=1.0,
        )


def test_robots_logs_and_tables_take_the_same_key_of_a_spec(tmp_path: Path) -> None:
    text = (
        'model = "thruster"\n[logs]\nrate = 20\ntrain = ["{}"]\n[channels.command]\ncolumn = "{}"\n'
        '[channels.speed]\ncolumn = "{}"\n'
    )
    merged_table(tmp_path)
    formats = {"RCOU": ("QH", ["TimeUS", "C1"]), "ESC": ("Qf", ["TimeUS", "RPM"])}
    rows = [("RCOU", (40_000 * i, 1500 + i % 100)) for i in range(200)]
    rows += [("ESC", (33_000 * i, 10.0 * i)) for i in range(240)]
    write_dataflash(tmp_path / "flight.bin", formats, sorted(rows, key=lambda row: row[1][0]))
    for file, command, speed in (
        ("merged.csv", "u", "speed"),
        ("flight.bin", "RCOU.C1", "ESC.RPM"),
    ):
        spec = tmp_path / "fit.toml"
        spec.write_text(text.format(file, command, speed))
        (log,) = dft.load_spec(spec).train_logs()
        assert log.step == pytest.approx(0.05)
    assert "# rate = 10" in dft.look(tmp_path / "merged.csv").spec
