"""What goes in as pulses, rpm and kgf comes out so: in tables, figures and JSON."""

import json

import numpy as np
import pytest
from written_fits import KGF, RPM, TRUTH

import diffthrust as dft
from diffthrust import Column


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    logs = []
    for i in range(2):
        rng = np.random.default_rng(i)
        command = np.repeat(rng.uniform(-0.9, 0.9, 30), 40)
        log = dft.Log(0.02 * np.arange(command.size), {"command": command})
        log = log.replaced(units={"command": "effort"})
        out = dft.simulate(TRUTH, log)
        noise = rng.standard_normal((2, command.size))
        rows = [
            1000 * log.time,
            1500 + 400 * command,
            RPM * out["speed"] + 20 * noise[0],
            KGF * out["thrust"] + 0.05 * noise[1],
        ]
        path = folder / f"run{i}.csv"
        head = {"delimiter": ",", "header": "t_ms,pwm,rpm,load", "comments": ""}
        np.savetxt(path, np.column_stack(rows), **head)
        logs.append(
            dft.read_log(
                path,
                time=Column("t_ms", unit="ms"),
                inputs={"command": Column("pwm", pwm={"stop": 1500, "full": 1900})},
                measured={
                    "speed": Column("rpm", unit="rpm"),
                    "thrust": Column("load", unit="kgf"),
                },
            )
        )
    return logs


@pytest.fixture(scope="module")
def fit(logs):
    return dft.fit(dft.SpeedLoopThruster() + "command_deadband", logs[0], holdout=logs[1])


def test_a_dead_band_is_told_in_microseconds_and_kept_in_efforts(fit):
    width = fit.parameters["command_deadband.half_width"]
    assert width.unit == "effort"
    assert width.value == pytest.approx(0.0625, abs=5 * width.std_error)
    value, error, unit = width.shown
    assert (value, error, unit) == (400 * width.value, 400 * width.std_error, "us")
    (line,) = (line for line in fit.report().splitlines() if "deadband.half_width" in line)
    assert line.split()[-1] == "us"
    assert float(line.split()[1]) == pytest.approx(25.0, abs=1.0)


def test_errors_are_in_rpm_and_kgf_and_in_si_beside(fit):
    speed, thrust = fit.holdout.channels["speed"], fit.holdout.channels["thrust"]
    assert speed.shown == (pytest.approx(RPM * speed.rmse, rel=1e-12), "rpm")
    assert speed.shown.value == pytest.approx(20.0, rel=0.1)
    assert thrust.shown == (pytest.approx(KGF * thrust.rmse, rel=1e-12), "kgf")
    data = json.loads(json.dumps(fit.to_json()))["holdout"]["channels"]["speed"]
    assert data["unit"] == "rad/s"
    assert data["written"] == {"rmse": pytest.approx(RPM * data["rmse"]), "unit": "rpm"}
    assert "rad/s " not in "".join(line for line in fit.report().splitlines() if "speed" in line)


def test_a_figure_shows_the_pulses_on_top_and_speaks_the_units_of_the_log(fit, logs):
    comparison = dft.compare(fit, logs)
    figure = comparison.plot()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[0] == "command\n[us]"
    assert {"speed [rpm]", "thrust [kgf]", "residual [rpm]"} <= set(labels)
    drawn = figure.axes[0].get_lines()[0].get_ydata()
    assert 1100 < np.min(drawn) < 1300
    assert 1700 < np.max(drawn) < 1900
    (residual,) = (axes for axes in figure.axes[:5] if axes.get_ylabel() == "residual [rpm]")
    trace = comparison.runs[0].channels["speed"]
    np.testing.assert_allclose(
        np.std(residual.get_lines()[-1].get_ydata()), RPM * np.std(trace.residual), rtol=1e-9
    )


def test_regimes_and_tests_speak_them_too(fit, logs):
    plain = dft.fit(dft.SpeedLoopThruster(exponent=1.0).fix("exponent"), logs[0])
    comparison = dft.compare(plain, logs)
    told = json.dumps(comparison.to_json()) + comparison.report()
    assert "rad/s" not in comparison.report()
    assert " effort" not in comparison.report()
    assert '"unit": "rpm"' in told


@pytest.mark.thorough
def test_intervals_profiles_and_predictions_speak_them_too(fit, logs):
    table = dft.intervals(fit, logs[0])
    row = table.rows["command_deadband.half_width"]
    assert row.unit == "effort"
    assert row.shown.best.low == pytest.approx(400 * row.best.low)
    assert "command_deadband.half_width [us]" in table.report()
    profile = dft.uncertainty.profile(fit, logs[0], ["command_deadband.half_width"])
    curve = profile["command_deadband.half_width"]
    assert curve.value == pytest.approx(0.0625, rel=0.05)
    assert curve.shown.high == pytest.approx(400 * curve.high)
    assert " us (" in curve.sentence
    figure = profile.plot()
    assert figure.axes[0].get_xlabel() == "command_deadband.half_width [us]"
    band = dft.predict(fit, logs[1]).channels["speed"]
    np.testing.assert_allclose(band.shown.median, RPM * band.median, rtol=1e-12)
    assert dft.predict(fit, logs[1]).plot().axes[0].get_ylabel() == "speed [rpm]"


def test_where_a_log_names_no_unit_the_models_are_told():
    log = dft.Log([0.0, 0.1, 0.2], {"command": [0.0, 1.0, 1.0]}, {"speed": [0.0, 3.0, 5.0]})
    error = dft.compare(dft.Thruster(), log).errors.channels["speed"]
    assert error.shown == (error.rmse, "rad/s")
