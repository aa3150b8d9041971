"""What a user may get wrong, and logs that are not as they should be."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from trajectories import bind, bridged, starting_states

import diffthrust as dft
from diffthrust import InputError, Log, simulate
from diffthrust.effects import ActuatorLag, CommandDeadband

# The unit of time.


def recorded(model, step, count=500):
    return Log(step * np.arange(count), {name: np.ones(count) for name in model.inputs})


@pytest.mark.parametrize(
    ("model", "rate"),
    [(dft.Thruster(), 25), (dft.Thruster(), 200), (dft.Thruster(), 500), (dft.Vessel(), 10),
     (dft.Vessel(drive="twin"), 50), (dft.AxisVehicle(), 2), (dft.DCMotorThruster(), 1000)],
)  # fmt: skip
def test_a_thousand_times_too_long_or_too_short_is_refused(model, rate):
    bind(model, [recorded(model, 1.0 / rate)])
    with pytest.raises(InputError, match="is it 'ms' rather than 's'"):
        bind(model, [recorded(model, 1e3 / rate)])
    with pytest.raises(InputError, match="is it 's' rather than 'ms'"):
        bind(model, [recorded(model, 1e-3 / rate, 100)])


def test_a_static_table_may_have_any_time():
    time = 60.0 * np.arange(5)
    speed = np.arange(5.0)
    found = simulate(dft.Thruster(ct=2.0), Log(time, {"speed": speed}))
    np.testing.assert_allclose(found["thrust"], 2.0 * speed**2)
    simulate(dft.LinearSensor(), Log(1e-6 * time, {"depth": speed}))


# Gaps in time.


def gapped(hold, quiet=3.0):
    fine = 0.04 * np.arange(round((4.0 + quiet) / 0.04) + 1)
    keep = (fine < 2.0) | (fine > 2.0 + quiet)
    command = np.sin(2.0 * fine)
    log = Log(
        fine[keep], {"command": command[keep]}, {"speed": command[keep]}, hold=hold, name="cut",
        units={"speed": "rpm"}, unsigned=("speed",), noise={"speed": 2.0}, notes=("kept",),
    )  # fmt: skip
    last = np.flatnonzero(keep & (fine < 2.0))[-1]
    first = np.flatnonzero(keep & (fine > 2.0))[0]
    if hold == "zero":
        command[last:first] = command[last]
    else:
        command = np.interp(fine, fine[keep], command[keep])
    return log, Log(fine, {"command": command}, hold=hold), keep


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_gap_is_simulated_as_finely_as_the_rest(hold):
    log, dense, keep = gapped(hold)
    start = {"speed": 1.0}
    found = simulate(dft.Thruster(), log, initial=start, substeps=1)
    truth = simulate(dft.Thruster(), dense, initial=start, substeps=1)
    assert found["speed"].shape == log.time.shape
    for name, values in truth.items():
        np.testing.assert_allclose(found[name], values[keep], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_bridged_log_keeps_every_sample_and_all_else(hold):
    log, dense, _ = gapped(hold)
    full, original = bridged(log)
    assert np.max(np.diff(full.time)) <= log.step * (1 + 1e-6)
    np.testing.assert_allclose(full.time, dense.time, atol=1e-12)
    np.testing.assert_allclose(full.inputs["command"], dense.inputs["command"], atol=1e-12)
    np.testing.assert_array_equal(full.time[original], log.time)
    for side in ("inputs", "measured"):
        for name, values in getattr(log, side).items():
            np.testing.assert_array_equal(getattr(full, side)[name][original], values)
    assert np.isfinite(full.measured["speed"]).sum() == len(log)
    for field in ("name", "units", "unsigned", "noise", "hold", "notes"):
        assert getattr(full, field) == getattr(log, field)
    again, same = bridged(full)
    assert again is full
    np.testing.assert_array_equal(same, np.arange(len(full)))


def test_a_very_long_gap_grows_the_log_at_most_tenfold():
    time = np.append(0.04 * np.arange(50), 1e6)
    full, original = bridged(Log(time, {"command": np.ones(51)}))
    assert 5 * 51 < len(full) <= 10 * 51
    np.testing.assert_array_equal(full.time[original], time)
    assert np.all(np.diff(full.time) > 0)


@pytest.mark.parametrize("time", [[1.0], [1.0, 2.0], [0.0, 0.1, 0.2, 0.34]])
def test_a_log_without_gaps_stays(time):
    log = Log(time, {"command": np.ones(len(time))})
    assert bridged(log)[0] is log


# Equations and effects that are not complete.


class Cart(dft.Model):
    """A cart whose equations are to be spoilt."""

    name = "cart"
    inputs: ClassVar = {"push": "N"}
    states: ClassVar = {"velocity": "m/s"}
    outputs: ClassVar = {"velocity": "m/s", "grip": "N"}
    ports: ClassVar = {"force": "net force [N]"}

    def equations(self, s, port):
        return {"velocity": port("force", s.push)}, {"velocity": s.velocity, "grip": 4.0, "own": 1}


LOG = Log(0.1 * np.arange(6), {"push": np.ones(6), "command": np.ones(6)})


def test_a_constant_output_is_a_series_and_an_undeclared_one_is_left_out():
    found = simulate(Cart(), LOG)
    np.testing.assert_array_equal(found["grip"], np.full(6, 4.0))
    np.testing.assert_allclose(found["velocity"], LOG.time)
    assert set(found) == {"velocity", "grip"}


BOTH = {"velocity": 0.0, "grip": 0.0}


@pytest.mark.parametrize(
    ("equations", "message"),
    [
        (lambda self, s, port: None, r"Spoilt\.equations: expected two mappings"),
        (lambda self, s, port: {"velocity": 0.0}, r"Spoilt\.equations: expected two mappings"),
        (lambda self, s, port: (s.push, BOTH), r"Spoilt\.equations: expected two mappings"),
        (lambda self, s, port: ({"speed": 0.0}, BOTH), "rate of the state 'velocity', found 'sp"),
        (lambda self, s, port: (BOTH, {"velocity": 0.0, "gripp": 0.0}), "'grip', found .*'gripp'"),
        (
            lambda self, s, port: ({"velocity": s.push}, {**BOTH, "grip": [s.push, s.push]}),
            "number or an array for 'grip', found list",
        ),
        (lambda self, s, port: (BOTH if s.push > 0 else {}, BOTH), r"(?s)Python 'if'.*jnp\.where"),
        (lambda self, s, port: ({"velocity": np.sin(s.push)}, BOTH), r"(?s)Spoilt.*jax\.numpy"),
    ],
)
def test_equations_that_are_not_right_say_what_is_wrong(equations, message):
    spoilt = type("Spoilt", (Cart,), {"name": "spoilt", "equations": equations})
    with pytest.raises(InputError, match=message):
        simulate(spoilt(), LOG)


def test_an_effect_with_an_if_or_without_a_rate_is_named():
    class Hasty(dft.Effect):
        name = "hasty"
        port = "force"

        def __call__(self, value, s):
            return value if value > 0 else 0.0

    class Lost(ActuatorLag):
        name = "lost"
        port = "force"

        def rates(self, value, s):
            return {"respons": 0.0}

    with pytest.raises(InputError, match=r"(?s)Hasty: a Python 'if'.*jnp\.where"):
        simulate(Cart() + Hasty(), LOG)
    with pytest.raises(InputError, match=r"Lost\.rates: .*state 'response', found 'respons'"):
        simulate(Cart() + Lost(), LOG)


def test_a_port_may_not_be_named_like_a_channel():
    for name in ("push", "grip"):
        with pytest.raises(InputError, match=f"port '{name}' has the name of an input or output"):
            type("Twice", (Cart,), {"ports": {name: ""}})


# Initial states.


def test_a_state_measured_late_or_never_begins_at_the_models_own_value():
    def start(first, channel="speed"):
        seen = np.full(40, np.nan)
        seen[first:] = 7.0
        seen[20] = 7.0
        log = Log(0.05 * np.arange(40), {"command": np.ones(40)}, {channel: seen})
        (record,) = bind(dft.Thruster(), [log])
        return record.start, starting_states(dft.Thruster(), record)

    assert start(0) == ({"speed": 7.0}, {"speed": 7.0})
    assert start(9) == ({"speed": 7.0}, {"speed": 7.0})
    assert start(10) == ({}, {"speed": 0.0})
    assert start(0, "thrust") == ({}, {"speed": 0.0})


def test_starting_states_follow_the_model_where_nothing_is_measured():
    log = Log(0.001 * np.arange(40), {"command": np.full(40, 2.0)})
    motor = dft.DCMotorThruster(resistance=4.0)
    (record,) = bind(motor, [log])
    assert starting_states(motor, record) == {"current": 0.0, "speed": 0.0}
    (record,) = bind(dft.Thruster(), [Log([0.0, 0.1], {"speed": [1.0, 1.0]})])
    assert starting_states(dft.Thruster(), record) == {}


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        ([3.0], r"expected a mapping from states to values, found \[3.0\]"),
        (3.0, "expected a mapping"),
        ({"velocity": np.nan}, "a finite number for the state 'velocity', found nan"),
        ({"velocity": "1"}, "a finite number for the state 'velocity', found '1'"),
        ({"velocity": [1.0, 2.0]}, "a finite number for the state 'velocity'"),
        ({"velocity": None}, "a finite number for the state 'velocity'"),
        ({"velocity": object()}, "a finite number for the state 'velocity'"),
        ({3: 1.0}, "no state"),
    ],
)
def test_initial_states_that_cannot_be_are_refused(initial, message):
    with pytest.raises(InputError, match=message):
        simulate(Cart(), LOG, initial=initial)


# Parameters.


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"bounds": 3.0}, "alpha', bounds: expected a pair of numbers.* found 3.0"),
        ({"bounds": (0, 1, 2)}, "alpha', bounds: expected a pair"),
        ({"bounds": ("0", None)}, "alpha', bounds: expected a pair"),
        ({"bounds": None}, "alpha', bounds: expected a pair"),
        ({"transform": "ln"}, "alpha', transform: expected 'linear' or 'log', found 'ln'"),
        ({"size": -1}, "alpha', size: expected a positive finite number or None, found -1"),
        ({"size": np.inf}, "alpha', size: .* found inf"),
        ({"prior": 0.1}, "alpha', prior: expected a dft.models.Normal or None, found 0.1"),
        ({"prior": (0.1, 0.2)}, "alpha', prior: expected a dft.models.Normal or None"),
        ({"value": "1"}, "alpha', value: expected a number in 1/rad, found '1'"),
        ({"value": True}, "alpha', value: expected a number"),
        ({"value": np.nan}, "alpha': expected a value within"),
        ({"fixed": "no"}, "alpha', fixed: expected true or false"),
        ({"unit": "1/s"}, "the unit of a parameter belongs to its model"),
        ({"doc": "text"}, "no field 'doc'"),
    ],
)
def test_a_description_that_cannot_be_is_refused(fields, message):
    with pytest.raises(InputError, match=message):
        dft.Thruster(alpha=fields)
    with pytest.raises(InputError, match=message):
        dft.Thruster().replace(alpha=fields)


def test_a_declaration_that_cannot_be_is_refused_when_the_model_is_made():
    for fields in ({"value": "1"}, {"value": 1.0, "bounds": 3}, {"value": 1.0, "size": 0.0}):
        bad = type("Bad", (Cart,), {"mass": dft.parameter(**fields)})
        with pytest.raises(InputError, match="'mass', "):
            bad()


def test_a_parameter_of_another_unit_is_refused_and_the_null_value_stays():
    with pytest.raises(
        InputError, match="'half_width': expected a value in the unit of command, found"
    ):
        CommandDeadband(half_width=dft.Parameter(50.0, "mV"))
    assert CommandDeadband(half_width=dft.Parameter(0.2)).at_null().half_width == 0.0


# The dead band.


def test_the_dead_band_restores_the_command_over_an_edge_with_a_slope():
    value = jnp.array([-2.0, -0.48, -0.47, -0.3, 0.0, 0.3, 0.475, 0.5, 0.525, 2.0])
    lost = CommandDeadband(half_width=0.5)(value, None)
    np.testing.assert_allclose(lost, np.sign(value) * np.maximum(np.abs(value) - 0.5, 0.0))
    full = CommandDeadband(half_width=0.5, restored=1.0)(value, None)
    np.testing.assert_allclose(full[jnp.array([0, 8, 9])], [-2.0, 0.525, 2.0], rtol=1e-9)
    np.testing.assert_allclose(full[2:7], 0.0, atol=1e-9)
    assert float(full[7]) == pytest.approx(0.25)  # half of it, at the edge itself
    for restored in (0.0, 0.4, 1.0):
        none = CommandDeadband(half_width=0.0, restored=restored)(value, None)
        np.testing.assert_array_equal(none, value)

    def through(width, value):
        return CommandDeadband(restored=1.0)._bound({"half_width": width})(value, None)

    assert abs(float(jax.grad(through)(0.5, 0.52))) > 1.0  # the edge moves with the width
    assert np.isfinite(float(jax.grad(through)(0.0, 0.0)))
