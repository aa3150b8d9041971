"""What equations must give, what an output feels, and how inputs run between their samples."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from trajectories import Key, equations_of, starting_point, states_behind

import diffthrust as dft
from diffthrust import InputError, Log
from diffthrust.models import Relaxing, Signals
from diffthrust.simulation import simulate


class Given(dft.Model):
    """Gives what it is told to."""

    name = "given"
    inputs: ClassVar = {"u": "V"}
    states: ClassVar = {"x": "m"}
    outputs: ClassVar = {"x": "m"}
    parts: ClassVar = ({}, {})

    def equations(self, s, port):
        return self.parts


def of(*parts, raw=None):
    return type("Form", (Given,), {"parts": parts if raw is None else raw})()


@pytest.mark.parametrize(
    ("model", "found"),
    [
        (of({}), r"\['dict'\]"),
        (of({}, {}, {}), r"\['dict', 'dict', 'dict'\]"),
        (of({}, 3.0), r"\['dict', 'float'\]"),
        (of(3.0, {}), r"\['float', 'dict'\]"),
        (of(raw=3.0), "found 3.0"),
        (of(raw=[{}, {}]), "found "),
    ],
)
def test_equations_that_are_no_two_mappings(model, found):
    with pytest.raises(InputError, match=rf"expected two mappings.*{found}"):
        equations_of(model, Signals({}), None)


@pytest.mark.parametrize("value", ["1", [1.0], None])
def test_values_that_are_no_signals(value):
    for model in (of({"x": value}, {}), of({}, {"x": value})):
        with pytest.raises(InputError, match="expected a number or an array for 'x', found"):
            equations_of(model, Signals({}), None)
    for fine in (1, 1.0, np.ones(2), jnp.ones(2), Relaxing(1.0, 2.0)):
        assert equations_of(of({"x": fine}, {}), Signals({}), None) == ({"x": fine}, {})


LOG = Log([0.0, 0.1, 0.2], {"u": np.ones(3)})


def test_rates_and_outputs_that_are_missing():
    with pytest.raises(InputError, match=r"equations: expected a rate of the state 'x'"):
        simulate(of({}, {"x": 0.0}), LOG, substeps=1)
    with pytest.raises(InputError, match=r"equations: expected a output 'x', found 'y'"):
        simulate(of({"x": 0.0}, {"y": 0.0}), LOG, substeps=1)


def test_an_output_that_is_one_number_is_one_series():
    found = simulate(of({"x": 2.0}, {"x": 7.0}), LOG, initial={"x": 1.0}, substeps=1)
    np.testing.assert_array_equal(found["x"], np.full(3, 7.0))


class Chain(dft.Model):
    """A slow state behind a fast one, and one that only gathers."""

    name = "fast_chain"
    inputs: ClassVar = {"u": "V"}
    states: ClassVar = {"slow": "m", "fast": "m", "gathered": "m", "alone": "m"}
    outputs: ClassVar = {"slow": "m", "fast": "m", "all": "m", "none": "m"}

    def equations(self, s, port):
        rates = {
            "slow": s.fast - s.slow,
            "fast": Relaxing(5.0 * (s.u - s.fast), 5.0),
            "gathered": s.slow,
            "alone": Relaxing(-s.alone * s.time, s.time),
        }
        told = {"slow": s.slow, "fast": s.fast, "all": s.gathered + s.alone, "none": 2.0 * s.u}
        return rates, told

    def initial(self, s):
        return {"fast": 3.0 * s.u, "alone": 0.5}


class Cascade(dft.Model):
    """Three tanks in a row, written down from the last one to the first."""

    name = "cascade"
    inputs: ClassVar = {"flow": "m"}
    states: ClassVar = {"last": "m", "middle": "m", "first": "m"}
    outputs: ClassVar = {"lowest": "m", "between": "m", "highest": "m", "poured": "m"}
    rate: float = dft.parameter(0.5, "1/s", bounds=(0, None))

    def equations(self, s, port):
        rates = {
            "last": self.rate * (s.middle - s.last),
            "middle": self.rate * (s.first - s.middle),
            "first": self.rate * (s.flow - s.first),
        }
        told = {"lowest": s.last, "between": s.middle, "highest": s.first, "poured": s.flow}
        return rates, told


@pytest.mark.parametrize(
    ("model", "output", "behind"),
    [
        (Chain(), "slow", ("slow", "fast")),
        (Chain(), "fast", ("fast",)),
        (Chain(), "all", ("slow", "fast", "gathered", "alone")),
        (Chain(), "none", ()),
        (Cascade(), "lowest", ("last", "middle", "first")),
        (Cascade(), "between", ("middle", "first")),
        (Cascade(), "highest", ("first",)),
        (Cascade(), "poured", ()),
    ],
)
def test_an_output_feels_the_states_upstream_of_it(model, output, behind):
    signals = {"time": 0.3, **dict.fromkeys(model.inputs, 1.0)}
    assert states_behind(model, output, tuple(model.states), signals) == behind


def test_where_states_begin():
    model = Chain()
    begin = starting_point(model, Signals({"u": 2.0, "time": 0.0}), {"slow": 9.0})
    assert begin == {"slow": 9.0, "fast": 6.0, "gathered": 0.0, "alone": 0.5}
    lagged = dft.Thruster() + "actuator_lag"
    first = Signals({"command": 2.0, "time": 0.0})
    begin = starting_point(lagged, first, {})
    assert begin == {"speed": 0.0, "actuator_lag.response": 84.0}
    begin = starting_point(lagged, first, {"actuator_lag.response": 1.0})
    assert begin["actuator_lag.response"] == 1.0
    assert starting_point(dft.Thruster(), Signals({"speed": 2.0, "time": 0.0}), {}) == {}


def test_models_of_one_structure_are_one_key():
    assert Key(dft.Thruster(alpha=0.1)) == Key(dft.Thruster())
    assert Key(dft.Thruster()) != Key(dft.Thruster() + "actuator_lag")
    assert hash(Key(dft.Thruster(alpha=0.1))) == hash(Key(dft.Thruster()))
    assert Key(dft.Thruster()) != dft.Thruster().structure


class Clocked(dft.Model):
    """dx/dt = -a x + u v + sin(time)."""

    name = "clocked"
    inputs: ClassVar = {"u": "V", "v": ""}
    states: ClassVar = {"x": "m"}
    outputs: ClassVar = {"x": "m"}

    def equations(self, s, port):
        return {"x": -0.7 * s.x + s.u * s.v + jnp.sin(s.time)}, {"x": s.x}


def test_held_and_linear_inputs_and_the_time_between_samples():
    rng = np.random.default_rng(2)
    time = np.cumsum(rng.uniform(0.05, 0.2, 20))
    u, v = rng.normal(size=(2, 20))
    log = Log(time, {"u": u, "v": v}, hold={"u": "zero", "v": "linear"})
    found = simulate(Clocked(), log, initial={"x": 0.4}, substeps=8)["x"]
    x, exact = 0.4, [0.4]
    for k in range(19):

        def rate(t, x, k=k):
            share = (t - time[k]) / (time[k + 1] - time[k])
            return -0.7 * x + u[k] * (v[k] + share * (v[k + 1] - v[k])) + np.sin(t)

        span = time[k : k + 2]
        x = solve_ivp(rate, span, [x], "DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
        exact.append(x)
    np.testing.assert_allclose(found, exact, rtol=2e-8)
