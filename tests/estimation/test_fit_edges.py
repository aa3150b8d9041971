"""Fits in corners where a plausible but wrong answer would be easy to give."""

import numpy as np
import pytest
from reference import axis
from test_fit import TRUE, log_of, record

import diffthrust as dft


def rng(seed=0):
    return np.random.default_rng(seed)


def within(fit, name, true, errors=4.0):
    estimate = fit.parameters[name]
    return abs(estimate.value - true) < errors * estimate.std_error


def test_an_unsigned_log_beside_a_signed_one():
    signed, unsigned = record(seed=1), record(seed=2)
    measured = {**unsigned.measured, "speed": np.abs(unsigned.measured["speed"])}
    both = [log_of(signed), log_of(unsigned, measured=measured, unsigned=("speed",))]
    fit = dft.fit(dft.Thruster(), both)
    assert fit.status.ok
    assert all(abs(fit.parameters[n].value / true - 1) < 0.01 for n, true in TRUE.items())


def test_a_log_without_the_sensor_of_a_state_beside_one_with_it():
    first, second = (record(seed=s).truth for s in (3, 4))
    made = [record(seed=s) for s in (3, 4)]
    late = slice(60, None)  # both begin while the shaft turns
    whole = dft.Log(
        time=made[0].time[late],
        inputs={"command": made[0].inputs["command"][late]},
        measured={n: made[0].measured[n][late] for n in ("speed", "thrust")},
    )
    blind = dft.Log(
        time=made[1].time[late],
        inputs={"command": made[1].inputs["command"][late]},
        measured={"thrust": made[1].measured["thrust"][late]},
    )
    fit = dft.fit(dft.Thruster(), [whole, blind])
    assert fit.status.ok
    assert all(within(fit, name, true) for name, true in TRUE.items())
    assert fit.initial[0]["speed"] == pytest.approx(first["speed"][60], abs=0.5)
    assert fit.initial[1]["speed"] == pytest.approx(second["speed"][60], abs=3.0)


def test_the_initial_speed_of_a_vehicle_is_found_from_its_position():
    time = np.arange(0, 60, 0.1)
    thrust = 40.0 * np.sign(np.sin(2 * np.pi * time / 20))
    made = axis.simulate(time, thrust, mass=340.0, drag=67.0, initial_velocity=0.5)
    position = made.truth["position"] + rng().normal(0, 0.005, time.size)
    log = dft.Log(time=time, inputs={"thrust": thrust}, measured={"position": position})
    fit = dft.fit(dft.AxisVehicle(mass=200.0, drag=100.0), log)
    assert fit.status.ok, fit.message
    assert within(fit, "mass", 340.0)
    assert within(fit, "drag", 67.0)
    assert fit.initial[0]["velocity"] == pytest.approx(0.5, abs=0.02)


def test_an_unsigned_sensor_on_a_log_that_begins_in_reverse():
    made = record(seed=5)
    begin = int(np.argmin(made.truth["speed"]))
    cut = slice(begin, None)
    speed, thrust = made.measured["speed"][cut], made.measured["thrust"][cut]
    log = dft.Log(
        time=made.time[cut],
        inputs={"command": made.inputs["command"][cut]},
        measured={"speed": np.abs(speed), "thrust": np.abs(thrust)},
        unsigned=("speed", "thrust"),
    )
    fit = dft.fit(dft.Thruster(), log)
    assert fit.status.ok, fit.message
    assert fit.initial[0]["speed"] == pytest.approx(made.truth["speed"][begin], abs=2.0)
    assert all(abs(fit.parameters[n].value / true - 1) < 0.03 for n, true in TRUE.items())


@pytest.mark.slow
def test_standard_errors_of_a_short_table_allow_for_the_parameters_used_up():
    """Five points, two parameters, 300 repetitions.

    With the noise estimated from three degrees of freedom the ratio of error to standard error
    has the variance of Student's t with 3 degrees of freedom, 3; without the correction, 5.
    The middle half of t3 lies within 0.765: its share is 0.5 +- 0.1 (3.5 standard deviations).
    """
    depth = np.linspace(0, 4, 5)
    ratios = []
    for seed in range(300):
        reading = 0.16 * depth + 1.6 + rng(seed).normal(0, 0.01, 5)
        log = dft.Log(time=np.arange(5.0), inputs={"depth": depth}, measured={"reading": reading})
        slope = dft.fit(dft.LinearSensor(), log, starts=1).parameters["slope"]
        ratios.append((slope.value - 0.16) / slope.std_error)
    assert 0.4 < np.mean(np.abs(ratios) < 0.765) < 0.6


def test_as_many_unknowns_as_samples_are_not_a_result():
    log = dft.Log(time=[0.0, 1.0], inputs={"depth": [0.0, 1.0]}, measured={"reading": [1.6, 1.76]})
    fit = dft.fit(dft.LinearSensor(), log)
    assert fit.status is dft.estimation.Status.NOT_IDENTIFIABLE
    assert "2 samples cannot determine 2 unknowns" in fit.message
    assert fit.parameters["slope"].std_error is None


@pytest.mark.slow
def test_student_t_standard_errors_match_the_spread():
    """60 repetitions, three parameters: the root mean square of error over standard error is
    1 +- 0.25 (180 ratios, partly dependent; four standard deviations of a mean square)."""
    ratios = []
    for seed in range(60):
        made = record(seed=seed, duration=10.0, speed=0.0, thrust=0.0)
        noise = rng(1000 + seed)
        measured = {
            "speed": made.truth["speed"] + 0.3 * noise.standard_t(4, made.time.size),
            "thrust": made.truth["thrust"] + 0.5 * noise.standard_t(4, made.time.size),
        }
        log = log_of(made, measured=measured)
        fit = dft.fit(dft.Thruster(**TRUE), log, loss="student_t", starts=1)
        ratios += [
            (fit.parameters[n].value - true) / fit.parameters[n].std_error
            for n, true in TRUE.items()
        ]
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25


def test_exact_data_converge():
    made = record(seed=6)
    speed = dft.simulate(dft.Thruster(), log_of(made), substeps=1, initial={"speed": 0.0})
    log = log_of(made, measured={n: speed[n] for n in ("speed", "thrust")})
    fit = dft.fit(dft.Thruster(), log)
    assert fit.status.ok, fit.message
    assert fit.train.nrmse < 1e-7


class EvenGain(dft.Effect):
    """A thrust gain that depends on the square of its parameter: two values fit equally well."""

    name = "even_gain"
    port = "propeller"
    gain: float = dft.parameter(0.5, bounds=(-5.0, 5.0))

    def __call__(self, value, s):
        return value * self.gain**2


def test_two_optima_of_equal_likelihood_are_told():
    model = (dft.Thruster(**TRUE) + EvenGain()).fix("ct")
    fit = dft.fit(model.replace({"even_gain.gain": {"transform": "linear"}}), log_of(record()))
    assert fit.status is dft.estimation.Status.NOT_IDENTIFIABLE
    assert "even_gain.gain" in fit.message


class SpeedScale(dft.Effect):
    """A speed sensor that reads a share too much."""

    name = "speed_scale"
    port = "speed"
    scale: float = dft.parameter(1.0, bounds=(0.5, 2.0), null=1.0)

    def __call__(self, value, s):
        return self.scale * value


def test_no_restart_from_a_sensor_that_an_effect_corrects():
    made = record(seed=7)
    log = log_of(made, measured={**made.measured, "speed": 1.2 * made.measured["speed"]})
    fit = dft.fit(dft.Thruster() + SpeedScale(), log, horizon=2.0)
    assert fit.horizon is None
    assert any("whole runs" in note for note in fit.notes)
    assert fit.status is dft.estimation.Status.NOT_IDENTIFIABLE


def test_coloured_residuals_are_told():
    made = record(seed=8, speed=0.0)
    colour = np.zeros(made.time.size)
    shocks = rng(9).normal(0, 0.3, made.time.size)
    for i in range(1, colour.size):
        colour[i] = 0.95 * colour[i - 1] + shocks[i]
    log = log_of(made, measured={**made.measured, "speed": made.truth["speed"] + colour})
    fit = dft.fit(dft.Thruster(), log)
    assert any("Residuals are correlated" in n and "speed 0.9" in n for n in fit.notes)
    white = dft.fit(dft.Thruster(), log_of(record(seed=8)))
    assert not any("correlated" in note for note in white.notes)


def test_wrong_kinds_of_things():
    log = log_of(record(duration=3.0))
    with pytest.raises(dft.InputError, match="a list with initial states"):
        dft.compare(dft.Thruster(), log, initial={"speed": 1.0})
    lame = dft.Log(time=log.time, inputs={}, measured={"speed": log.measured["speed"]})
    with pytest.raises(dft.InputError, match="needs the input 'command'"):
        dft.fit(dft.Thruster(), log, holdout=[lame])
    assert dft.fit(dft.Thruster(), log, holdout=[]).holdout is None


@pytest.mark.parametrize("first", [60, 400])
def test_sensors_that_begin_when_the_start_is_forgotten(first):
    noise = 0.2 * rng().normal(size=(2, 600))
    time = 0.05 * np.arange(600)
    inputs = {"command": np.where((time // 5) % 2 == 0, 1.5, -1.0) + 0.3 * np.sin(time)}
    true = {"alpha": 0.05, "beta": 60.0, "ct": 0.02}
    empty = dft.Log(time, inputs)
    clean = dft.simulate(dft.Thruster(**true), empty, initial={"speed": 0.0}, substeps=4)
    measured = {name: clean[name] + noise[i] for i, name in enumerate(("speed", "thrust"))}
    for values in measured.values():
        values[:first] = np.nan
    fit = dft.fit(dft.Thruster(), dft.Log(time, inputs, measured))
    assert fit.status.ok, fit.message
    assert all(within(fit, name, value) for name, value in true.items())
    assert abs(fit.initial[0]["speed"]) < 6.0 * np.nanmax(np.abs(measured["speed"]))
