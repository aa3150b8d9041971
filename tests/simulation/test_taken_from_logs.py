"""What a simulation takes from a log: a time base without gaps, starts, ranges, levels, units."""

from itertools import pairwise
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from trajectories import (
    adopted,
    bare,
    bind,
    bridged,
    command_kind,
    felt,
    following,
    input_ranges,
    levels_over,
    levels_when_asked,
    measured_outputs,
    port_readings,
    unknown_starts,
)

import diffthrust as dft
from diffthrust import InputError, Log


def divided(time):
    """The stamps without gaps, by a loop: wide steps in even parts of at most the median."""
    usual, out = np.median(np.diff(time)), [time[0]]
    for a, b in pairwise(time):
        parts = int(np.ceil((b - a) / usual - 1e-6)) if b - a > 1.5 * usual else 1
        out += [a + (b - a) * (k + 1) / parts for k in range(parts)]
    return np.array(out)


STEPS = np.array([0.1, 0.1, 0.149, 0.1, 0.151, 0.1, 0.1, 0.3, 0.1, 0.1, 0.75, 0.1, 0.05, 0.2])


def gapped():
    time = 4.0 + np.concatenate([[0.0], np.cumsum(STEPS)])
    rng = np.random.default_rng(3)
    inputs = {"command": rng.normal(size=15), "inflow": rng.normal(size=15)}
    measured = {"speed": rng.normal(size=15)}
    return Log(time, inputs, measured, hold={"command": "zero", "inflow": "linear"})


def test_gaps_are_bridged_by_even_steps():
    log = gapped()
    longer, at = bridged(log)
    np.testing.assert_allclose(longer.time, divided(log.time), rtol=1e-13)
    np.testing.assert_allclose(longer.time[at], log.time, rtol=1e-15)
    for name in ("command", "inflow"):
        np.testing.assert_array_equal(longer.inputs[name][at], log.inputs[name])
    run_on = np.interp(longer.time, log.time, log.inputs["inflow"])
    np.testing.assert_allclose(longer.inputs["inflow"], run_on, rtol=1e-10)
    last = np.searchsorted(log.time, longer.time + 1e-9, side="right") - 1
    np.testing.assert_array_equal(longer.inputs["command"], log.inputs["command"][last])
    seen = np.isfinite(longer.measured["speed"])
    np.testing.assert_array_equal(np.flatnonzero(seen), at)
    np.testing.assert_array_equal(longer.measured["speed"][seen], log.measured["speed"])


def test_a_log_without_gaps_is_left_alone():
    time = np.cumsum([0.0, 0.1, 0.149, 0.1, 0.051, 0.1, 0.1])
    for log in (Log(time), Log(0.1 * np.arange(7.0))):
        same, at = bridged(log)
        assert same is log
        np.testing.assert_array_equal(at, np.arange(7))


def test_a_log_does_not_grow_more_than_tenfold():
    time = np.concatenate([0.1 * np.arange(10.0), [500.0], 600.0 + 0.1 * np.arange(9.0)])
    longer, at = bridged(Log(time, {"command": np.ones(20)}))
    assert 0.98 * 200 < len(longer) <= 200
    steps = np.diff(longer.time)
    np.testing.assert_allclose(steps[9:-8].min(), steps[9:-8].max(), rtol=0.04)
    np.testing.assert_array_equal(longer.time[at], time)


def test_the_start_is_the_first_measurement_if_it_comes_early_enough():
    def start(first, count=60, every=1):
        speed = np.full(count, np.nan)
        speed[first::every] = 3.0 + np.arange(count)[first::every]
        log = Log(0.1 * np.arange(count), {"command": np.ones(count)}, {"speed": speed})
        return bind(dft.Thruster(), [log])[0].start

    assert start(0) == {"speed": 3.0}
    assert start(9) == {"speed": 12.0}
    assert start(10) == {}
    # a slow sensor: its first reading comes as soon as the others follow each other
    assert start(14, every=15) == {"speed": 17.0}
    assert start(16, every=15) == {}


@pytest.mark.parametrize(
    ("told", "words", "mend"),
    [
        (
            (1.0, 2.0),
            r"Told.start_from: expected a mapping .*, found \(1.0, 2.0\)",
            "return {'surge': ",
        ),
        (1.0, "expected a mapping from states to numbers, found 1.0", "Write return"),
        ({"headin": 1.0}, "has no state 'headin'.*'heading'", "Correct the name"),
        ({"heading": "N"}, "a finite number for the state 'heading', found 'N'", "one number"),
    ],
)
def test_a_body_of_ones_own_tells_starts_by_the_names_of_its_states(told, words, mend):
    """Numbers alone ended in a TypeError, a misspelt state was passed over."""

    class Told(dft.bodies.Planar):
        def start_from(self, first):
            return told

    model = dft.Craft(Told(), screw=dft.Thruster().at((-0.3, 0.0, 0.0)))
    log = Log([0.0, 0.1, 0.2], {"screw.command": np.ones(3)}, units={"screw.command": "V"})
    with pytest.raises(InputError, match=words) as caught:
        bind(model, [log])
    assert mend in caught.value.mend


def test_what_a_body_tells_beside_the_states_of_its_model_is_passed_over():
    """Outputs handed on, a state that the log prescribes, one of an effect that is absent."""

    class Told(dft.bodies.Planar):
        def start_from(self, first):
            return {**first, "heading": np.nan, "actuator_lag.response": 0.5, "trim": 0.1}

    model = dft.Craft(Told(), screw=dft.Thruster().at((-0.3, 0.0, 0.0)))
    inputs = {"screw.command": np.ones(3), "heading": np.zeros(3)}
    units = {"screw.command": "V", "heading": "rad"}
    measured = {"screw.thrust": np.ones(3), "surge": np.ones(3)}
    log = Log([0.0, 0.1, 0.2], inputs, measured, units=units)
    (record,) = bind(model, [log])
    assert record.start["surge"] == record.start["screw.thrust"] == 1.0
    assert np.isfinite(dft.simulate(model, log)["surge"]).all()


def test_a_state_that_the_log_prescribes_has_no_start():
    log = Log([0.0, 0.1, 0.2], {"speed": np.ones(3)}, {"thrust": np.ones(3)})
    (record,) = bind(dft.Thruster(), [log])
    assert record.start == {}
    assert set(record.inputs_for(dft.Thruster())) == {"speed"}


def test_ranges_and_holds_of_inputs():
    logs = [gapped(), gapped().replaced(inputs={"command": np.array([9.0, *[np.nan] * 14])})]
    records = bind(dft.Thruster(), logs)
    ranges = input_ranges(dft.Thruster(), records)
    command = logs[0].inputs["command"]
    assert ranges == {"command": (command.min(), 9.0)}
    assert records[0].holds({"inflow": 1, "command": 2, "other": 3}) == (
        ("command", "zero"),
        ("inflow", "linear"),
        ("other", "zero"),
    )
    assert measured_outputs(dft.Thruster(), records) == ("speed",)


def test_a_log_needs_one_step_more_where_something_is_integrated():
    two = Log([0.0, 0.1], {"command": [1.0, 1.0]}, {"speed": [0.0, 1.0]})
    with pytest.raises(InputError, match=r"expected at least 3 samples .* found 2"):
        bind(dft.Thruster(), [two])
    given = Log([0.0, 0.1], {"speed": [1.0, 1.0]}, {"thrust": [0.0, 1.0]})
    bind(dft.Thruster(), [given])
    bind(dft.Thruster(), [two], compared=False)  # only simulated
    one = given.slice(0.0, 0.05)
    with pytest.raises(InputError, match=r"expected at least 2 samples .* found 1"):
        bind(dft.Thruster(), [one])


@pytest.mark.parametrize(
    ("step", "count", "told"),
    [
        (0.9999, 9, None),  # the slowest time constant, 4 s, is four steps
        (1.0, 9, "is it 'ms' rather than 's'"),
        (1.0e-4, 60, None),  # the fastest, 5 ms, is fifty of them
        (0.99e-4, 60, "a sample every 9.9e-05 s"),
        (0.99e-4, 40, "a whole log of 0.003861 s"),
        (0.99e-4, 3, "is it 's' rather than 'ms'"),
    ],
)
def test_a_time_base_that_such_a_system_cannot_have(step, count, told):
    log = Log(step * np.arange(count), {"command": np.ones(count)})
    if told is None:
        assert len(bind(dft.Thruster(), [log])[0]) == count
        return
    with pytest.raises(InputError) as caught:
        bind(dft.Thruster(), [log])
    assert told in f"{caught.value} {caught.value.mend}"


# How large signals are.


def test_levels_are_the_90th_percentile_of_the_size_and_the_longest_duration():
    rng = np.random.default_rng(1)
    series = [{"a": rng.normal(size=31), "b": np.full(31, np.nan), "c": np.ones(31)}]
    series += [{"a": rng.normal(size=17), "b": np.full(17, np.nan)}]
    logs = [Log(0.1 * np.arange(n), {"command": np.ones(n)}) for n in (31, 17)]
    levels = levels_over(series, bind(dft.Thruster(), logs))
    both = np.abs(np.concatenate([one["a"] for one in series]))
    assert levels == pytest.approx({"a": np.quantile(both, 0.9), "duration": 3.0})


def test_levels_of_a_model_are_those_of_its_ports_states_and_outputs():
    time = 0.05 * np.arange(80)
    speed, command = 30.0 * np.sin(time), 2.0 * np.cos(1.7 * time)
    log = Log(time, {"command": command}, {"speed": speed})
    model = dft.Thruster()
    levels = levels_when_asked(model, bind(model, [log]))()

    def level(x):
        return np.quantile(np.abs(x), 0.9)

    assert levels["command"] == pytest.approx(level(command))
    assert levels["speed"] == pytest.approx(level(speed))
    assert levels["drive"] == pytest.approx(level(42.0 * command))
    load = 0.037 * speed * np.abs(speed)
    assert levels["load"] == pytest.approx(level(load))
    assert levels["shaft"] == pytest.approx(level(42.0 * command - load))
    assert levels["propeller"] == pytest.approx(level(0.019 * speed**2))
    assert levels["duration"] == pytest.approx(time[-1])
    unmeasured = Log(time, {"command": command}, {"thrust": np.ones(80)})
    levels = levels_when_asked(model, bind(model, [unmeasured]))()
    path = dft.simulate(model, unmeasured, substeps=1)["speed"]
    assert levels["speed"] == pytest.approx(level(path))
    assert levels["thrust"] == 1.0


# In which unit a model is commanded.


def test_the_unit_of_a_command_is_the_one_that_measures_the_same():
    model = dft.Thruster()
    assert command_kind(model, "mV") == "V"
    assert command_kind(model, "rpm") == "rad/s"
    assert command_kind(model, "") == "V"
    assert command_kind(model, "kg") == "V"
    turning = dft.actuators.StaticThruster(command="rev/s", gain=0.0147).fix("gain")
    assert command_kind(turning, "rad/s") == command_kind(turning, "rpm") == "rev/s"
    craft = dft.Craft(dft.bodies.Planar(), stern=turning.at((-1, 0, 0)))
    log = Log([0.0, 0.1], {"stern.command": [10.0, 10.0]}, units={"stern.command": "rps"})
    assert adopted(craft, [log]) is craft  # "gain is held, in N/(rev/s)", of a log in "rad/s"
    assert command_kind(turning, "V") == "V"


def commanded(unit, count=4):
    return Log(
        0.1 * np.arange(count), {"command": np.ones(count)}, units={"command": unit}, name=unit
    )


def test_a_model_takes_its_command_as_the_logs_have_it():
    assert adopted(dft.Thruster(), [commanded("A")]).command == "A"
    assert adopted(dft.Thruster(), [commanded("mV")]).command == "V"
    assert adopted(dft.Thruster(), [Log([0.0, 0.1], {"speed": [1.0, 2.0]})]).command == "V"
    with pytest.raises(InputError, match=r"different units: .*A in A.*V in V"):
        adopted(dft.Thruster(), [commanded("A"), commanded("V")])
    held = dft.Thruster().fix("beta")
    with pytest.raises(InputError, match="beta is held or has a prior, in"):
        adopted(held, [commanded("A")])
    prior = dft.Thruster().replace(beta={"prior": dft.models.Normal(40.0, 1.0)})
    with pytest.raises(InputError, match="beta is held or has a prior, in"):
        adopted(prior, [commanded("A")])
    assert adopted(held, [commanded("V")]) is held
    assert adopted(dft.Thruster().fix("alpha"), [commanded("A")]).command == "A"
    null = (dft.Thruster() + "command_saturation").replace(
        {"command_saturation.limit": {"value": np.inf, "fixed": True}}
    )
    assert adopted(null, [commanded("A")]).command == "A"


class Twice(dft.Effect):
    """Acts inside and on a sensor."""

    name = "twice"
    ports: ClassVar = ("thrust", "propeller")
    size: float = dft.parameter(0.1, null=0.0)

    def at(self, port, value, s):
        return value + self.size


def test_a_bare_model_has_lost_what_only_its_sensors_do():
    names = ["command_offset", "speed_sensor_scale", "linear_damping"]
    model = dft.Thruster() + names + Twice()
    assert [effect.name for effect in bare(model).effects] == [
        "command_offset",
        "linear_damping",
        "twice",
    ]


TRUE = {"k1": 0.07, "k2": 0.06, "k3": 0.04}


class Tanks(dft.Model):
    """Two tanks, one above the other; the level of the lower one is measured."""

    name = "two_tanks"
    inputs = {"pump": "V"}
    states = {"upper": "m", "lower": "m", "spilt": "m"}
    outputs = {"lower": "m"}
    k1: float = dft.parameter(0.05, "1/s", bounds=(0, None))
    k2: float = dft.parameter(0.05, "1/s", bounds=(0, None))
    k3: float = dft.parameter(0.05, "1/s", bounds=(0, None))

    def equations(self, s, port):
        """Torricelli's law; what leaves the lower tank is gathered, and acts on nothing."""
        down = self.k1 * jnp.sqrt(jnp.maximum(s.upper, 1e-6))
        out = self.k2 * jnp.sqrt(jnp.maximum(s.lower, 1e-6))
        rates = {"upper": self.k3 * s.pump - down, "lower": down - out, "spilt": out}
        return rates, {"lower": s.lower}


class BegunTanks(Tanks):
    """The same, with a level to which the upper tank is filled before each run."""

    name = "begun_tanks"
    level: float = dft.parameter(1.0, "m", bounds=(0, None))

    def initial(self, s):
        """Filled to the mark."""
        return {"upper": self.level}


def run(seed, upper, noise=0.02, late=0):
    rng, time = np.random.default_rng(seed), np.arange(0.0, 400.0)
    inputs = {"pump": np.repeat(rng.uniform(0.5, 3, 20), 20)}
    blank = dft.Log(time, inputs, {"lower": np.zeros(time.size)})
    begin = {"upper": upper, "lower": 2.0}
    made = dft.simulate(Tanks(**TRUE), blank, initial=begin, substeps=4)["lower"]
    measured = made + noise * rng.standard_normal(time.size)
    measured[:late] = np.nan
    return dft.Log(time, inputs, {"lower": measured}, name=f"run{seed}")


@pytest.fixture(scope="module")
def train():
    return [run(0, 4.0), run(1, 4.0)]


def test_which_states_are_unknown(train):
    assert felt(Tanks(), bind(Tanks(), train)) == ("upper", "lower")
    assert unknown_starts(Tanks(), bind(Tanks(), [train[0]], compared=False)[0], {}) == ("upper",)
    assert (
        unknown_starts(Tanks(), bind(Tanks(), [train[0]], compared=False)[0], {"upper": 4.0}) == ()
    )
    assert unknown_starts(
        Tanks(), bind(Tanks(), [run(3, 4.0, late=30)], compared=False)[0], {}
    ) == ("upper", "lower")
    assert unknown_starts(BegunTanks(), bind(BegunTanks(), [train[0]], compared=False)[0], {}) == ()
    assert following(BegunTanks(), bind(BegunTanks(), train)) == ("upper",)
    assert following(BegunTanks().fix("level"), bind(BegunTanks().fix("level"), train)) == ()


def test_a_parameter_of_the_initial_state_is_estimated_for_all_logs_together(train):
    fit = dft.fit(BegunTanks(), train, starts=2)
    level = fit.parameters["level"]
    assert level.std_error is not None
    assert abs(level.value - 4.0) < 4 * level.std_error
    assert level.std_error < 0.2
    assert all(set(states) == {"lower"} for states in fit.initial)
    assert not any("nothing about" in note for note in fit.notes)
    again = dft.compare(fit, train, initial=fit.initial)
    assert again.errors.nrmse == pytest.approx(fit.train.nrmse, rel=1e-6)


def test_states_of_their_own_are_estimated_log_by_log(train):
    fit = dft.fit(Tanks(), [train[0], run(2, 7.0)], starts=2)
    assert [states["upper"] for states in fit.initial] == pytest.approx([4.0, 7.0], abs=0.4)
    assert not any("spilt" in states for states in fit.initial)  # no sensor feels it


@pytest.mark.parametrize("upper", [1.0, 9.0])
def test_unseen_runs_begin_where_they_err_least(train, upper):
    unseen = run(4, upper)
    comp = dft.compare(Tanks(**TRUE), unseen)
    assert comp.runs[0].estimated == ("upper",)
    assert comp.runs[0].start["upper"] == pytest.approx(upper, abs=0.5)
    assert comp.errors.channels["lower"].rmse == pytest.approx(0.02, rel=0.25)
    assert "'upper' begins" in comp.report()
    from_default = dft.compare(Tanks(**TRUE), unseen, initial=[{"upper": 0.0}])
    assert from_default.errors.nrmse > 2 * comp.errors.nrmse
    assert "'upper' begins" not in from_default.report()


def test_a_fit_says_what_it_estimated_of_unseen_runs(train):
    unseen = run(5, 8.0)
    fit = dft.fit(Tanks(), train, holdout=unseen, starts=2)
    assert fit.holdout.channels["lower"].rmse == pytest.approx(0.02, rel=0.25)
    assert any("'upper' begins" in note for note in fit.notes)


def test_a_late_sensor_tells_of_the_start(train):
    comp = dft.compare(Tanks(**TRUE), run(6, 5.0, late=30))
    assert comp.runs[0].start["lower"] == pytest.approx(2.0, abs=0.3)


class Sled(dft.Model):
    """Its position is measured, its speed is not."""

    name = "sled"
    inputs: ClassVar = {"force": "N"}
    states: ClassVar = {"speed": "m/s", "place": "m"}
    outputs: ClassVar = {"place": "m"}
    ports: ClassVar = {}
    mass: float = dft.parameter(10.0, "kg", bounds=(0.1, None))

    def equations(self, s, port):
        return {"speed": s.force / self.mass, "place": s.speed}, {"place": s.place}


def test_a_start_may_lie_far_beyond_what_the_inputs_move():
    """With masses of 1e10 kg a Kingfisher's hidden starts of 0.1 rad/s were held at nought."""
    time = 0.1 * np.arange(300)
    noise = 0.01 * np.random.default_rng(5).standard_normal(300)
    log = dft.Log(time, {"force": np.sin(time)}, {"place": 0.4 * time + noise})
    run = dft.compare(Sled(mass=1e10), log).runs[0]
    straight = np.polyfit(time, log.measured["place"] - log.measured["place"][0], 1)[0]
    assert run.start["speed"] == pytest.approx(straight, abs=0.002)
    assert run.errors.channels["place"].rmse < 0.03


def test_measured_states_cost_nothing_more():
    time = 0.05 * np.arange(200)
    speed = 40 * np.tanh(time)
    log = dft.Log(time, {"command": np.ones(200)}, {"speed": speed, "thrust": 0.02 * speed**2})
    assert (
        unknown_starts(
            dft.Thruster() + "axial_flow",
            bind(dft.Thruster() + "axial_flow", [log], compared=False)[0],
            {},
        )
        == ()
    )  # its flow is settled
    assert dft.compare(dft.Thruster(), log).runs[0].estimated == ()


@pytest.mark.thorough
def test_what_the_run_hardly_feels_stays_near(train):
    """Noise alone must not send the start of a fast state anywhere."""
    time = 0.1 * np.arange(300)
    command = np.where(time % 8 < 4, 3.0, 1.0)
    model = dft.DCMotorThruster()
    blank = dft.Log(time, {"command": command}, {"speed": np.zeros(300)})
    made = dft.simulate(model, blank, initial={"speed": 0.0})
    noise = 0.01 * np.std(made["speed"]) * np.random.default_rng(0).standard_normal(300)
    log = dft.Log(time, {"command": command}, {"speed": made["speed"] + noise})
    model = model.fix(*model.parameters)
    begun = dft.compare(model, log).runs[0].start
    assert abs(begun["current"]) < 2 * np.abs(made["current"]).max()


# -- equations over a whole log, not compiled ------------------------------------------------------


def test_logs_of_many_lengths_leave_no_code_behind():
    """JAX keeps the code of each operation for each length: 27 MB for each diagnosis of a thruster.

    One length of several samples was padded, and what is read there is as without that.
    """
    model = dft.Thruster() + "command_deadband"

    def read(samples):
        time = 0.1 * np.arange(samples)
        return port_readings(model, {"time": time, "command": np.sin(time), "speed": 10 * time})

    first, before = read(700), compilations()
    others = [read(samples) for samples in range(701, 720)]
    assert compilations() == before
    for name, values in first.items():
        assert all(np.array_equal(values, other[name][:700]) for other in others)
        assert [other[name].size for other in others] == list(range(701, 720))
