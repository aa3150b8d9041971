"""Regimes: found where they are, not found where they are not, and said in words."""

from __future__ import annotations

import json

import numpy as np
import pytest
from residuals import Regime, Samples, SignalRange, derived_signals, worst_range, worst_regimes
from test_residual_tests import coloured

import diffthrust as dft

UNITS = {"command": "V", "speed": "rad/s"}
STEP = 0.05


def run(seed: int, n: int = 500, staircase: bool = False) -> dict[str, np.ndarray]:
    """A command and the speed that follows it."""
    rng = np.random.default_rng(seed)
    command = 1.5 * coloured(rng, n, 0.98)
    if staircase:
        command = np.repeat(rng.permutation(np.linspace(-2, 2, n // 50)), 50)
    speed = np.zeros(n)
    for i in range(1, n):
        speed[i] = 0.9 * speed[i - 1] + command[i - 1]
    return {"command": command, "speed": speed}


def found(runs: list[dict[str, np.ndarray]], residuals: list[np.ndarray], **options):
    times = [np.arange(rest.size) * STEP for rest in residuals]
    return worst_regimes("speed", residuals, times, runs, UNITS, inputs=("command",), **options)


def test_a_dead_zone_is_found_and_said_in_words():
    runs = [run(seed) for seed in range(3)]
    rng = np.random.default_rng(9)
    rests = [
        0.3 * coloured(rng, 500, 0.9) + (np.abs(s["command"]) < 0.3) * rng.choice([-1.0, 1.0])
        for s in runs
    ]
    regime = found(runs, rests)[0]
    assert regime.signal == "|command|"
    assert regime.low == -np.inf
    assert regime.high == pytest.approx(0.3, abs=0.06)
    inside = np.concatenate([np.abs(s["command"]) < regime.high for s in runs])
    energy = np.concatenate(rests) ** 2
    assert regime.share_of_samples == pytest.approx(inside.mean(), abs=0.02)
    assert not regime.modelled
    assert regime.share_of_error == pytest.approx(energy[inside].sum() / energy.sum(), abs=0.05)
    assert regime.p_value <= 0.05
    share = f"{100 * regime.share_of_error:.0f} %"
    assert regime.sentence.startswith(f"{share} of the squared speed error lies in ")
    assert " % of the samples: |command| < " in regime.sentence


def test_the_time_after_a_jump_is_found():
    runs = [run(seed, staircase=True) for seed in range(4)]
    late = np.arange(500) % 50 < 6
    rests = [0.2 * coloured(np.random.default_rng(i), 500, 0.5) + late for i in range(4)]
    regime = found(runs, rests)[0]
    assert regime.signal == "time since command jumped"
    assert regime.high == pytest.approx(0.3, abs=0.06)


def test_two_conditions_where_they_say_clearly_more():
    runs = [run(seed) for seed in range(4)]
    rng = np.random.default_rng(1)
    rests = []
    for s in runs:
        at = (s["command"] > 0.3) & (s["speed"] < 0.0)
        rests.append(0.2 * coloured(rng, 500, 0.5) + 2.0 * at)
    regime = found(runs, rests)[0]
    assert {interval.signal for interval in regime.where} == {"command", "speed"}
    assert " and " in regime.sentence
    assert regime.share_of_error > 0.7


@pytest.mark.slow
def test_noise_alone_names_no_regime():
    alarms, cases = 0, 0
    for seed in range(200):
        pole, staircase = (0.0, 0.95)[seed % 2], seed % 4 > 1
        rng = np.random.default_rng(50_000 + seed)
        runs = [run(2 * seed + i, 300, staircase) for i in range(2)]
        rests = [coloured(rng, 300, pole) for _ in runs]
        alarms += bool(found(runs, rests))
        cases += 1
    assert cases == 200
    assert alarms <= 10


@pytest.mark.thorough
def test_the_p_value_keeps_its_level_whatever_the_size_of_the_regime():
    alarms = 0
    for seed in range(200):
        pole = (0.0, 0.95)[seed % 2]
        rest = coloured(np.random.default_rng(90_000 + seed), 400, pole)
        signals = run(seed, 400)
        samples = Samples(rest**2, np.zeros(400, int), signals, UNITS)
        block = 5 if pole == 0 else 100
        alarms += worst_range(samples, block, np.random.default_rng(0), 1, 0.0) is not None
    assert alarms <= 20  # 5 % and three standard deviations


def test_one_bad_run_is_not_a_regime():
    runs = [run(seed) for seed in range(4)]
    rests = [
        coloured(np.random.default_rng(i), 500, 0.5) * (8.0 if i == 2 else 1.0) for i in range(4)
    ]
    assert found(runs, rests) == ()


def test_equal_seeds_give_equal_regimes_and_channels_count():
    runs, rests = (
        [run(0)],
        [np.abs(run(0)["command"] > 1.0) + coloured(np.random.default_rng(0), 500, 0.2)],
    )
    once = found(runs, rests)
    assert once == found(runs, rests)
    if once:
        p = found(runs, rests, channels=3)
        assert not p or p[0].p_value == pytest.approx(3 * once[0].p_value)


def test_no_regime_where_the_simulation_failed_or_nothing_is_left():
    assert found([run(0)], [np.full(500, np.inf)]) == ()
    assert found([run(0)], [np.zeros(500)]) == ()
    assert found([run(0)], [np.full(500, np.nan)]) == ()


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        (SignalRange("|command|", -np.inf, 0.2, "V"), "|command| < 0.2 V"),
        (SignalRange("speed", 3.0, np.inf, "rad/s"), "speed > 3 rad/s"),
        (SignalRange("speed", -1.0, 2.5, "rad/s"), "-1 < speed < 2.5 rad/s"),
        (SignalRange("ratio", 0.0, np.inf, ""), "ratio > 0"),
    ],
)
def test_intervals_in_words(interval, words):
    assert interval.phrase() == words


def test_a_signal_of_the_model_is_named_as_such():
    """Of the NGS's bench it read as if the measured speed had been below 70 rad/s."""
    where = SignalRange("speed", -np.inf, 70.0, "rad/s"), SignalRange("command", 0.2, np.inf, "V")
    regime = Regime("speed", where, 0.62, 0.1, 0.005, modelled=("speed",))
    words = "lies in 10 % of the samples: modelled speed < 70 rad/s and command > 0.2 V."
    assert words in regime.sentence


def test_a_regime_as_plain_data():
    regime = Regime("speed", (SignalRange("command", -np.inf, 0.2, "V"),), 0.617, 0.004, 0.005)
    data = json.loads(json.dumps(regime.to_json(), allow_nan=False))
    assert data["where"] == [{"signal": "command", "low": None, "high": 0.2, "unit": "V"}]
    assert data["sentence"] == (
        "62 % of the squared speed error lies in 0.4 % of the samples: command < 0.2 V."
    )


def test_derived_signals_have_values_and_units():
    time = np.arange(6) * 0.5
    speed = np.array([-2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
    command = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])
    got = derived_signals(time, {"speed": speed, "command": command}, UNITS, plain=())
    np.testing.assert_allclose(got["|speed|"][0], np.abs(speed))
    np.testing.assert_allclose(got["d(speed)/dt"][0], 2.0)
    np.testing.assert_allclose(got["d|speed|/dt"][0], 2.0 * np.sign(speed))
    np.testing.assert_allclose(got["time since command jumped"][0], [0, 0.5, 0, 0.5, 1.0, 0])
    assert got["d|speed|/dt"][1] == "rad/s^2"
    assert got["|d(command)/dt|"][1] == "V/s"
    assert "|command|" not in got
    plain = derived_signals(time, {"speed": speed}, UNITS, plain=("speed",))
    assert list(plain) == ["speed", "time since the start"]
    assert list(derived_signals(None, {"speed": speed}, UNITS)) == ["speed", "|speed|"]


def logs(count: int = 3, dead: float = 0.6, **changes: float) -> list[dft.Log]:
    """Logs of a thruster whose controller ignores small commands; the model lacks that."""
    made = []
    for seed in range(count):
        time = np.arange(400) * 0.05
        command = 1.2 * coloured(np.random.default_rng(seed), 400, 0.97)
        through = np.where(np.abs(command) > dead, command, 0.0)
        truth = dft.Log(time, {"command": through}, units={"command": "V"})
        speed = dft.simulate(dft.Thruster(**changes), truth, substeps=2)["speed"]
        noise = 0.3 * np.random.default_rng(200 + seed).standard_normal(400)
        measured = {"speed": speed + noise}
        made.append(dft.Log(time, {"command": command}, measured, UNITS, name=f"run {seed}"))
    return made


def test_a_comparison_says_where_the_error_sits():
    comparison = dft.compare(dft.Thruster(), logs())
    assert comparison.regimes
    assert "command" in comparison.regimes[0].signal or "speed" in comparison.regimes[0].signal
    assert comparison.regimes is comparison.regimes  # worked out once
    assert not comparison.tests["speed"].white
    assert comparison.hints == comparison.outstanding == ()
    report = comparison.report()
    assert "of the squared speed error lies in" in report.replace("\n", " ")
    assert "Is the residual noise?" in report
    data = json.loads(json.dumps(comparison.to_json(), allow_nan=False))
    assert {"schema", "model", "effects", "errors", "runs"} < set(data)
    assert data["regimes"][0]["sentence"] == comparison.regimes[0].sentence
    assert data["tests"]["speed"]["signals"]["command"]["band"] > 0
    assert data["agreement"]["speed"]["correlation"] > 0.9


def test_a_true_model_shows_no_regime_and_white_residuals():
    start = [{"speed": 0.0}] * 3  # the first measurement, with its noise, is not where it begins
    comparison = dft.compare(dft.Thruster(), logs(dead=0.0), initial=start, substeps=2)
    assert comparison.regimes == ()
    assert comparison.tests["speed"].white
    assert "No regime stands out" in comparison.report()


def test_one_bad_run_stands_out():
    made = logs(4, dead=0.0)
    rough = made[1].measured["speed"] + 5 * np.random.default_rng(0).standard_normal(400)
    made[1] = made[1].replaced(measured={"speed": rough})
    (hint,) = dft.compare(dft.Thruster(), made).outstanding
    assert hint.startswith("run 1: its speed error (RMSE 4.98 rad/s)")
    assert hint.endswith("% of the squared error of all runs.")


def test_a_run_without_a_reading_of_a_channel_does_not_stand_out():
    made = logs(3, dead=0.0)
    made[0] = made[0].replaced(measured={"speed": np.full(400, np.nan)})
    comparison = dft.compare(dft.Thruster(), made)
    assert comparison.outstanding == ()
    assert comparison.to_json()["hints"] == []


def test_the_residual_figure_shows_every_channel():
    figure = dft.compare(dft.Thruster(), logs()).plot_residuals()
    assert len(figure.axes) == 4
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert "of the squared" in titles[1]
    assert titles[2].startswith("Autocorrelation")
    assert titles[3].startswith("Correlation with")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["residual [rad/s]", "residual [rad/s]", "correlation", "correlation"]


def test_a_table_has_regimes_by_value_only():
    depth = np.linspace(0, 5, 60)
    table = dft.Log(
        time=np.arange(60.0),
        inputs={"depth": depth},
        measured={"reading": 0.1901 * depth - 0.0973},
        static=True,
    )
    comparison = dft.compare(dft.LinearSensor(), table)
    assert comparison.tabular
    assert comparison.tests == {}
    assert "time" not in comparison.report()
    assert len(comparison.plot_residuals().axes) == 2


def test_a_second_regime_says_that_it_leaves_out_the_first():
    rng = np.random.default_rng(3)
    runs = [run(seed) for seed in range(4)]
    level = np.quantile(np.concatenate([s["command"] for s in runs]), 0.8)
    sizes = [4.0 * (np.abs(s["command"]) < 0.3) + 2.0 * (s["command"] > level) + 0.3 for s in runs]
    rests = [size * rng.standard_normal(size.size) for size in sizes]
    first, second = found(runs, rests)
    assert not first.sentence.startswith("Outside")
    assert second.sentence.startswith("Outside that, ")
    energy = np.concatenate(rests) ** 2
    commands = np.concatenate([s["command"] for s in runs])
    inside = first.where[0].holds(np.abs(commands))
    later = second.where[0].holds(commands) & ~inside
    assert second.share_of_error == pytest.approx(energy[later].sum() / energy.sum(), abs=0.05)
