"""Numbers of a run: its errors, where it fails, how fine its step is, where it began."""

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from stored_logs import thruster_logs, vessel_logs
from trajectories import (
    Key,
    are_tables,
    bind,
    checked_initial,
    errors,
    fewest_steps,
    overflow,
    point_in,
    pooled_errors,
    runs_over,
    runs_step_choice,
    sensor_noise,
    slopes,
    slopes_at,
    starting_states,
    starts_module,
    step_size_module,
    too_large,
    trajectory_module,
    unwrapped,
    wrapped,
)

import diffthrust as dft
from diffthrust import InputError, Log
from diffthrust.simulation import CoarseStepWarning

RNG = np.random.default_rng(6)


def test_errors_are_pooled_over_runs():
    measured = [RNG.normal(3.0, 2.0, 40), RNG.normal(-1.0, 1.0, 25)]
    rests = [RNG.normal(size=40), RNG.normal(0.5, 1.0, 25)]
    measured[0][3:6] = np.nan
    pairs = {"a": list(zip(measured, rests, strict=True)), "b": [(np.full(4, 2.0), np.ones(4))]}
    pairs["c"] = [(np.full(3, np.nan), np.zeros(3))]
    found = errors(pairs, {"a": "V"})
    seen = np.isfinite(np.concatenate(measured))
    y, rest = np.concatenate(measured)[seen], np.concatenate(rests)[seen]
    a = found.channels["a"]
    assert a.rmse == pytest.approx(np.sqrt(np.mean(rest**2)), rel=1e-12)
    assert a.nrmse == pytest.approx(a.rmse / np.std(y), rel=1e-12)
    away = 1.0 - np.linalg.norm(rest) / np.linalg.norm(y - y.mean())
    assert a.fit_percent == pytest.approx(100.0 * away, rel=1e-9)
    assert (a.samples, a.unit, a.shown) == (62, "V", (a.rmse, "V"))
    b = found.channels["b"]
    assert (b.rmse, b.samples) == (1.0, 4)
    assert np.isnan([b.nrmse, b.fit_percent, found.nrmse]).all()
    assert set(found.channels) == {"a", "b"}
    two = errors({"a": pairs["a"], "d": [(y, 2.0 * rest)]})
    assert two.nrmse == pytest.approx(a.nrmse * np.sqrt(2.5), rel=1e-12)
    assert np.isnan(errors({}).nrmse)


def test_an_error_that_is_not_finite_is_infinite():
    y = np.arange(4.0)
    lost = errors({"a": [(y, np.array([0.0, np.nan, 0.0, 0.0]))]}).channels["a"]
    assert (lost.rmse, lost.nrmse, lost.fit_percent, lost.samples) == (np.inf, np.inf, -np.inf, 4)
    y[1] = np.nan
    assert np.isfinite(errors({"a": [(y, np.array([0.0, np.nan, 0.0, 1.0]))]}).nrmse)


def test_angles():
    angle = np.array([-9.0, -3.2, -3.1, 0.4, 3.1, 3.2, 6.0, 50.0])
    np.testing.assert_allclose(wrapped(angle), np.angle(np.exp(1j * angle)), rtol=1e-9)
    turning = np.linspace(0.0, 20.0, 60)
    seen = np.angle(np.exp(1j * turning))
    seen[7] = np.nan
    np.testing.assert_allclose(np.delete(unwrapped(seen) - turning, 7), 0.0, atol=1e-12)
    assert np.isnan(unwrapped(seen)[7])
    assert np.isnan(seen[7])
    assert np.isnan(wrapped(np.array([np.inf]))).all()  # in silence: a diagnosis printed warnings


@pytest.mark.parametrize("count", [3, 4, 12, 51])
def test_the_noise_of_a_sensor_is_the_median_of_its_bends(count):
    y = RNG.normal(size=count)
    y = np.insert(y, 2, np.nan)
    bends = np.abs(np.diff(np.delete(y, 2), 2))
    assert sensor_noise(y) == pytest.approx(np.median(bends) / 0.6745 / np.sqrt(6.0), rel=1e-12)


def test_a_sensor_without_noise_has_a_scale_too():
    line = np.linspace(2.0, 5.0, 31)
    assert sensor_noise(line) == pytest.approx(1e-4 * np.std(line), rel=1e-9)
    assert sensor_noise(np.full(9, -40.0)) == pytest.approx(4e-8)
    assert sensor_noise(np.zeros(9)) == 1.0
    assert sensor_noise(np.array([1.0, 4.0])) == 3.0
    assert sensor_noise(np.array([4.0])) == 1.0


def test_steps_are_halved_until_the_error_is_a_hundredth_of_the_noise(monkeypatch):
    asked = []

    def simulated(model, log, initial, substeps):
        asked.append(substeps)
        return {"speed": np.full(5, 16.0 / substeps**4), "thrust": np.zeros(5)}

    monkeypatch.setattr(step_size_module, "simulate_fixed", simulated)
    log = Log(0.1 * np.arange(5), {"command": np.ones(5)}, {"speed": RNG.normal(size=5)},
              noise={"speed": 0.5})  # fmt: skip
    (record,) = bind(dft.Thruster(), [log])

    def chosen(*args, **more):
        return fewest_steps(dft.Thruster(), record, *args, **more)[:2]

    # between k and 2 k steps they differ by 15 / k^4: 30, 1.9, 0.12, 0.0073 of the noise
    assert chosen(None) == (8, {"speed": pytest.approx(30.0 / 8**4)})
    assert asked == [1, 2, 4, 8, 16]
    assert chosen(None, tolerance=0.5)[0] == 4
    assert chosen(None, tolerance=30.0)[0] == 1
    most = {"speed": pytest.approx(30.0 / 32**4)}
    assert chosen(None, tolerance=1e-9) == (32, most)
    asked.clear()
    chosen(None, {1: {"speed": np.full(5, 2.0)}}, tolerance=3.0)
    assert asked == [2]  # the first was given
    table = Log(np.arange(5.0), {"depth": np.ones(5)}, {"reading": np.ones(5)})
    sensor = dft.LinearSensor()
    assert fewest_steps(sensor, bind(sensor, [table])[0], None) == (1, {}, None)
    (short,) = bind(dft.Thruster(), [log.slice(0.0, 0.05)], compared=False)
    assert fewest_steps(dft.Thruster(), short, None) == (1, {}, None)
    with pytest.warns(CoarseStepWarning, match=r"with 32 .* of 'speed' is still 2\.9e-05"):
        assert step_size_module.choose_substeps(dft.Thruster(), log, tolerance=1e-9) == 32
    assert step_size_module.choose_substeps(dft.Thruster(), log, tolerance=1e-9, warn=False) == 32


def test_where_a_simulation_leaves_the_finite_numbers():
    model = dft.Thruster()
    log = Log(0.5 * np.arange(6), {"command": np.ones(6)}, name="run")
    fine = {"speed": np.arange(6.0), "thrust": np.arange(6.0)}
    assert overflow(model, bind(model, [log], compared=False)[0], fine) == ""
    lost = {"speed": np.array([0.0, 1.5, 9e9, np.inf, 0.0, 0.0]), "thrust": np.full(6, np.nan)}
    assert overflow(
        model, bind(model, [log], compared=False)[0], {**fine, "speed": lost["speed"]}
    ) == (
        "run: the simulation leaves the finite numbers at t = 1.5 s, where the state 'speed' is "
        "infinite (one sample earlier speed 9e+09 rad/s)."
    )
    assert overflow(
        model, bind(model, [log], compared=False)[0], {**fine, "thrust": lost["thrust"]}
    ) == (
        "run: the simulation leaves the finite numbers at t = 0 s, where the output 'thrust' is "
        "no number (speed 0 rad/s)."
    )
    first = {"speed": np.array([np.nan, *np.ones(5)]), "thrust": np.array([np.nan, *np.ones(5)])}
    assert "at t = 0 s, where the state 'speed' is no number." in overflow(
        model, bind(model, [log], compared=False)[0], first
    )


def test_numbers_too_large_to_be_squared():
    model, y = dft.Thruster(), np.array([1.0, -1e200, np.nan])
    log = Log([0.0, 0.1, 0.2], {"command": np.ones(3)}, {"speed": y}, name="run")
    found = too_large(
        model, bind(model, [log], compared=False)[0], {"speed": np.array([0.0, -3e5, 0.0])}
    )
    assert found == (
        "run: numbers of speed are too large to be squared: measured up to 1e+200 rad/s, simulated "
        "up to 3e+05 rad/s. Is its unit right?"
    )
    small = log.replaced(measured={"speed": np.ones(3)})
    assert too_large(model, bind(model, [small], compared=False)[0], {"speed": np.ones(3)}) == ""
    assert "simulated up to 1e+170" in too_large(
        model, bind(model, [small], compared=False)[0], {"speed": np.full(3, 1e170)}
    )
    both = Log([0.0, 0.1], {"command": np.ones(2)}, {"speed": np.ones(2), "thrust": np.ones(2)})
    second = {"speed": np.ones(2), "thrust": np.full(2, 1e170)}
    assert "numbers of thrust are too large" in too_large(
        model, bind(model, [both], compared=False)[0], second
    )
    alone = Log([0.0, 0.1], {"command": np.ones(2)}, {"thrust": np.ones(2)})
    assert "numbers of thrust" in too_large(model, bind(model, [alone], compared=False)[0], second)


def test_steps_that_are_chosen_hand_on_their_simulation(monkeypatch):
    log = Log(0.1 * np.arange(5), {"command": np.ones(5)}, {"speed": np.linspace(0.0, 9.0, 5)})
    (record,) = bind(dft.Thruster(), [log])
    plain, asked = step_size_module.simulate_fixed, []

    def simulated(model, record, initial, substeps):
        asked.append(substeps)
        return plain(model, record, initial, substeps)

    monkeypatch.setattr(step_size_module, "simulate_fixed", simulated)
    choice = step_size_module.sufficient_steps(dft.Thruster(), record, None)
    series = step_size_module.simulate_chosen(dft.Thruster(), record, None, choice)
    assert asked == [2**k for k in range(len(asked))]  # none twice
    assert choice.substeps == asked[-2]
    for name, values in plain(dft.Thruster(), record, None, choice.substeps).items():
        np.testing.assert_array_equal(series[name], values)


# Initial states.


def test_initial_states_that_are_given():
    model = dft.Thruster()
    assert checked_initial(model, None) == {}
    assert checked_initial(model, {"speed": np.float32(2.5)}) == {"speed": 2.5}
    for wrong in (True, "3", np.nan, np.inf, [1.0], None):
        with pytest.raises(InputError, match="finite number for the state 'speed'"):
            checked_initial(model, {"speed": wrong})
    with pytest.raises(InputError, match="no state 'spede'"):
        checked_initial(model, {"spede": 1.0})
    with pytest.raises(InputError, match="a mapping from states to values"):
        checked_initial(model, [("speed", 1.0)])


def test_where_states_begin_that_nobody_gives():
    log = Log([0.0, 0.1, 0.2], {"command": [3.0, 1.0, 1.0]}, {"speed": [7.0, 8.0, 9.0]})
    model = dft.DCMotorThruster()
    begin = starting_states(model, bind(model, [log], compared=False)[0])
    assert begin == {"current": 0.0, "speed": 7.0}  # a motor that was just switched on
    bare = Log([0.0, 0.1, 0.2], {"command": [3.0, 1.0, 1.0]})
    assert starting_states(model, bind(model, [bare], compared=False)[0])["speed"] == 0.0


def test_the_start_with_which_a_run_errs_least():
    time = np.linspace(0.0, 3.0, 40)
    measured = 5.0 * np.exp(-0.8 * time) + 2.0 * np.exp(-3.0 * time)

    asked = []

    def errors(x):
        asked.append(x)
        modelled = x[0] * np.exp(-0.8 * time) + x[1] * np.exp(-3.0 * time)
        return (measured - modelled) / 0.01

    sizes, free = np.array([1.0, 4.0]), np.array([[-np.inf], [np.inf]])
    found = starts_module._least_squares(errors, np.array([1.0, -4.0]), sizes, 10.0 * sizes, free)
    # a start ten sizes away counts like one sample that errs by the spread of its channel
    rows = np.stack([np.exp(-0.8 * time), np.exp(-3.0 * time)], axis=1) / 0.01
    pull = np.diag(1.0 / (10.0 * sizes))
    held = pull @ [1.0, -4.0]
    best = np.linalg.lstsq(np.vstack([rows, pull]), np.append(measured / 0.01, held), rcond=None)
    np.testing.assert_allclose(found, best[0], rtol=1e-6)
    assert len(asked) < 15  # of three runs a step

    def single(errors, first, far):
        one = np.array([first])
        return starts_module._least_squares(errors, one, np.abs(one), np.array([far]), free)[0]

    assert single(lambda x: x - 90.0, 1.0, 10.0) == pytest.approx((90.0 + 0.01) / 1.01, rel=1e-6)
    assert single(lambda x: 1e3 * (x**3 - 27.0), 0.5, 5.0) == pytest.approx(3.0, rel=1e-5)
    assert single(lambda x: np.full(1, np.nan), 0.5, 5.0) == 0.5


# Runs.


def straight(count, offset=0.0, name="log"):
    depth = np.linspace(0.0, 2.0, count)
    return Log(np.arange(float(count)), {"depth": depth}, {"reading": 0.2 * depth + offset},
               name=name)  # fmt: skip


def test_runs_and_their_errors():
    model = dft.LinearSensor(slope=0.2, offset=0.0)
    logs = [straight(5, 0.1, "one"), straight(9, 0.3, "two")]
    runs = runs_over(model, bind(model, logs))
    assert [run.name for run in runs] == ["one", "two"]
    assert runs[0].channels["reading"].residual == pytest.approx(np.full(5, 0.1))
    assert runs[1].errors.channels["reading"].rmse == pytest.approx(0.3)
    pooled = pooled_errors(runs).channels["reading"]
    assert pooled.rmse == pytest.approx(np.sqrt((5 * 0.01 + 9 * 0.09) / 14))
    assert pooled.samples == 14
    assert pooled_errors(runs[:1]) is runs[0].errors
    assert not are_tables(run.record for run in runs)  # a log counted by chance is no table
    tables = [log.replaced(static=True) for log in logs]
    assert are_tables(bind(model, tables))
    assert not are_tables(bind(model, [tables[0], logs[1]]))
    for wrong in ([{}], {"speed": 1.0}, [{}] * 3):
        with pytest.raises(InputError, match="initial states for each of 2 logs"):
            runs_over(model, bind(model, logs), initial=wrong)


def test_an_angle_is_modelled_between_its_readings_too():
    """It was NaN there, and doubts of a heading that was left out for a while ended in NumPy."""
    model, time = dft.Vessel(drive="twin"), 0.1 * np.arange(300)
    inputs = {"left_force": 3.0 + np.sin(time), "right_force": np.ones(300)}
    moved = dft.simulate(model, Log(time, inputs, units=dict(model.inputs)), substeps=2)
    heading = (moved["heading"] + np.pi) % (2.0 * np.pi) - np.pi + 0.01 * np.sin(40.0 * time)
    assert np.ptp(moved["heading"]) > 3.0 * np.pi
    heading[100:160] = np.nan  # nearly a turn
    heading[201::2] = np.nan
    measured = {"surge": moved["surge"], "heading": heading}
    log = Log(time, inputs, measured, units={**model.inputs, "surge": "m/s", "heading": "rad"})
    (run,) = runs_over(model, bind(model, [log]), substeps=2)
    trace, read = run.channels["heading"], np.isfinite(heading)
    assert np.abs(trace.residual[read]).max() < 0.02
    np.testing.assert_array_equal(
        trace.modelled[read], (trace.measured - trace.residual)[read], strict=True
    )
    turns = (trace.modelled - moved["heading"]) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-4)
    assert np.isfinite(turns).all()


def test_what_no_log_measures_cannot_be_run():
    log = Log(np.arange(5.0), {"depth": np.ones(5)})
    with pytest.raises(InputError, match="No log measures an output"):
        runs_over(dft.LinearSensor(), bind(dft.LinearSensor(), [log]))


def test_slopes_of_rates_and_outputs():
    log = Log(0.1 * np.arange(3), {"command": [1.0, -2.0, 0.5]}, {"speed": np.ones(3)})
    model = dft.Thruster(alpha=0.05, beta=30.0, ct=0.02)
    rates, outputs = slopes_at(model, bind(model, [log])[0])
    speed = float(np.random.default_rng(0).uniform(0.3, 0.7))
    state, port, given = rates["speed"]
    assert float(state["speed"]) == pytest.approx(-0.1 * speed)
    expected = {"drive": 1.0, "load": -1.0, "shaft": 1.0, "propeller": 0.0}
    assert {n: float(v) for n, v in port.items()} == expected
    assert float(given["command"]) == 30.0
    by_state, by_port, _ = outputs["thrust"]
    assert float(by_state["speed"]) == pytest.approx(0.04 * speed)
    assert float(by_port["propeller"]) == 1.0
    assert set(rates) == {"speed"}
    assert set(outputs) == {"speed", "thrust"}
    assert isinstance(by_state["speed"], np.ndarray)


@pytest.mark.parametrize(
    "model",
    [
        dft.Thruster(),
        dft.SpeedLoopThruster(),
        dft.Vessel(lever_arm=1.5),
        dft.Vessel(drive="twin", lever_arm=0.3, m11=2.0, m22=2.0),
        dft.AxisVehicle(),
        dft.layouts.OTTER.craft(),
    ],
    ids=str,
)
def test_compiled_slopes_are_nothing_where_those_are_that_run_one_by_one(model):
    log = Log(0.1 * np.arange(3), {name: [1.0, -2.0, 0.5] for name in model.inputs})
    record = bind(model, [log], compared=False)[0]
    one_by_one = slopes.function(Key(model), *point_in(model, record))
    for found, expected in zip(
        jax.tree.leaves(slopes_at(model, record)), jax.tree.leaves(one_by_one), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        assert bool(found == 0) == bool(expected == 0)


def test_a_run_in_the_units_of_its_log():
    log = Log([0.0, 1.0, 2.0], {"depth": np.ones(3)}, {"reading": np.array([100.0, 120.0, 90.0])},
              units={"reading": "mV"})  # fmt: skip
    model = dft.LinearSensor(slope=0.1, offset=0.0)
    (run,) = runs_over(model, bind(model, [log]))
    ours = run.channels["reading"]
    np.testing.assert_allclose(ours.residual, [0.0, 0.02, -0.01], atol=1e-15)
    assert ours.unit == "V"


@pytest.mark.parametrize(
    ("model", "read"),
    [
        (dft.Thruster(), thruster_logs),
        pytest.param(dft.Vessel(), vessel_logs, marks=pytest.mark.slow),
    ],
)
def test_on_the_shipped_logs_the_error_is_below_a_hundredth_of_the_noise(model, read, capsys):
    fit = dft.fit(model, read())
    with capsys.disabled():
        for log in read():
            errors = dft.simulation.step_error(fit.model, log, fit.substeps)
            told = ", ".join(f"{name} {error:.1e}" for name, error in errors.items())
            print(f"\n{log.name}: integration error over sensor noise: {told}", end="")
            assert max(errors.values()) < 0.01


def test_the_estimate_agrees_with_an_independent_integrator():
    log = thruster_logs()[0].slice(stop=10.0)
    model = dft.Thruster()
    coarse = dft.simulate(model, log, substeps=1, initial={"speed": 0.0})["speed"]
    exact, omega = [0.0], 0.0
    for t0, t1, c in zip(log.time[:-1], log.time[1:], log.inputs["command"], strict=False):
        solved = solve_ivp(
            lambda _, w, c=c: 42.0 * c - 0.037 * w * abs(w),
            (t0, t1), [omega], method="DOP853", rtol=1e-11, atol=1e-12,
        )  # fmt: skip
        omega = solved.y[0, -1]
        exact.append(omega)
    true = np.sqrt(np.mean((coarse - exact) ** 2)) / sensor_noise(log.measured["speed"])
    told = dft.simulation.step_error(model, log, 1, initial={"speed": 0.0})["speed"]
    assert told == pytest.approx(true, rel=0.15)  # halving leaves a sixteenth of the error


def test_sensor_noise_is_that_of_the_sensor_not_of_the_signal():
    rng = np.random.default_rng(0)
    time = np.linspace(0, 20, 4001)
    slow = 30 * np.sin(time)
    assert sensor_noise(slow + rng.normal(0, 0.3, time.size)) == pytest.approx(0.3, rel=0.05)
    assert sensor_noise(slow) < 0.01


def test_a_model_too_fast_for_the_log_warns_and_more_substeps_are_chosen_first():
    time = np.arange(0, 10, 0.1)
    command = np.where(np.sin(time) > 0, 2.0, -1.0)
    speed = np.random.default_rng(0).normal(0, 0.1, time.size)
    log = dft.Log(time=time, inputs={"command": command}, measured={"speed": speed})
    assert dft.simulation.choose_substeps(dft.Thruster(), log) == 1
    assert dft.simulation.choose_substeps(dft.Thruster(alpha=0.1, beta=200.0), log) > 1
    with pytest.warns(CoarseStepWarning, match="too fast for the log's sample rate"):
        dft.simulation.choose_substeps(dft.Thruster(alpha=30.0, beta=30000.0), log)


def stiff_log(samples: int, step: float = 0.2) -> Log:
    """Half a sine of revolutions, and surge that no vessel makes of them."""
    time = step * np.arange(samples)
    given = {"propeller_speed": 60.0 * np.sin(time), "rudder_angle": 0.2 * np.sin(0.7 * time)}
    surge = np.cos(2.0 * time) + 1e-4 * np.random.default_rng(3).standard_normal(samples)
    return Log(time, given, {"surge": surge}, noise={"surge": 1e-4})


def test_steps_are_as_fine_as_the_errors_of_a_model_ask_for():
    model = dft.Vessel(d11=40.0)
    (record,) = bind(model, [stiff_log(120, 0.3)])
    (run,) = runs_over(model, [record], substeps=8)
    residual = {name: error.rmse for name, error in run.errors.channels.items()}
    strict = fewest_steps(model, record, None)
    chosen = fewest_steps(model, record, None, residual=residual)
    assert chosen.substeps < strict.substeps
    assert chosen.substeps == runs_step_choice(model, run).substeps
    assert chosen.simulated is not None
    (fine,) = runs_over(model, [record], substeps=64)
    moved = chosen.simulated["surge"] - fine.signals["surge"]
    assert np.sqrt(np.mean(moved**2)) < 0.01 / 3.0 * residual["surge"]


def test_logs_of_several_lengths_and_numbers_of_steps_share_one_program():
    program, model = trajectory_module.compiled_simulation, dft.Vessel(d11=4.5, drive="propeller")
    before = program.traces
    for samples, substeps in [(60, 1), (100, 1), (60, 2), (256, 3), (100, 8), (200, 32)]:
        log = stiff_log(samples, 0.05)
        modelled = dft.simulate(model, log, substeps=substeps)
        exact = dft.simulate(model, log, substeps=64)
        np.testing.assert_allclose(modelled["surge"], exact["surge"], atol=1e-4 / substeps**3)
    assert program.traces - before <= 1
    assert dft.simulate(model, stiff_log(300, 0.05), substeps=2)["surge"].shape == (300,)
    assert program.traces - before <= 2
