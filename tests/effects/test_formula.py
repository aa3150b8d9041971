"""Effects that are written as an expression of one line."""

from __future__ import annotations

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import diffthrust as dft
from diffthrust import InputError
from diffthrust.effects import Formula

TEXT = "-a * speed * abs(speed)**p"
ALPHA, BETA = 0.037, 42.0


class Drag(dft.Effect):
    """The same law, written by hand."""

    name = "by_hand"
    port = "shaft"
    a: float = dft.parameter(0.01, "rad/s^2", null=0.0)
    p: float = dft.parameter(0.7)

    def __call__(self, value, s):
        return value - self.a * s.speed * jnp.abs(s.speed) ** self.p


def drag(name="drag", a="rad/s^2", p="", **more):
    return Formula("shaft", TEXT, name=name, a=a, p=p, **more)


def valued(a=0.01, p=0.7):
    return drag(a={"unit": "rad/s^2", "value": a}, p={"value": p})


def swinging(count=301, **measured):
    time = 0.04 * np.arange(count)
    command = 4.0 * np.sin(0.9 * time) + 2.0 * np.sin(2.3 * time)
    return dft.Log(time=time, inputs={"command": command}, measured=measured)


# -- what it computes ------------------------------------------------------------------------------


def test_it_simulates_as_the_class_written_by_hand():
    log = swinging()
    ours, theirs = (dft.simulate(dft.Thruster() + e, log) for e in (valued(), Drag()))
    for name, series in theirs.items():
        np.testing.assert_allclose(ours[name], series, rtol=1e-12, atol=1e-12)
    assert np.ptp(dft.simulate(dft.Thruster(), log)["speed"] - ours["speed"]) > 1.0


def test_it_reads_the_signals_of_a_part_of_a_craft():
    """A craft that was not explained ended its diagnosis in "this is not allowed"."""
    law = dft.actuators.StaticThruster()
    boat = dft.Craft(dft.bodies.Planar(), port=law.at((0, -0.3, 0)), starboard=law.at((0, 0.3, 0)))
    pull = Formula("yaw_moment", "a * port.command * abs(port.command)", a={"value": 2.0})
    value, command = np.zeros(3), np.array([-0.5, 0.0, 1.0])
    signals = dft.models.Signals({"time": value, "port.command": command})
    np.testing.assert_allclose(pull(value, signals), 2.0 * command * np.abs(command))
    assert pull.reads == ("port.command",)
    assert str(boat + pull) == "craft + formula"


def test_it_agrees_with_another_integrator():
    log = swinging(101)
    a, p = 0.05, 0.6

    def rate(time, x):
        command = np.interp(time, log.time, log.inputs["command"])
        return BETA * command - ALPHA * x * np.abs(x) - a * x * np.abs(x) ** p

    held = dft.Log(log.time, dict(log.inputs), {}, hold={"command": "linear"})
    model = dft.Thruster(alpha=ALPHA, beta=BETA) + valued(a, p)
    ours = dft.simulate(model, held, initial={"speed": 5.0}, substeps=8)["speed"]
    tight = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "max_step": 0.01}
    theirs = solve_ivp(rate, (0.0, log.time[-1]), [5.0], t_eval=log.time, **tight)
    np.testing.assert_allclose(ours, theirs.y[0], atol=1e-5)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("b * (1 < x <= 3)", lambda x: 2.0 * ((x > 1) & (x <= 3))),
        ("b * where(x != 1, max(x, 0), -min(x, 2))",
         lambda x: 2 * np.where(x != 1, np.maximum(x, 0), -1)),
        ("b * x**3 - b * x**2 / 4", lambda x: 2 * x**3 - x**2 / 2),
        ("b * sign(x) * sqrt(abs(x)) * cos(pi * x)",
         lambda x: 2 * np.sign(x) * np.sqrt(np.abs(x)) * np.cos(np.pi * x)),
        ("value * (1 + b * tanh(x)) + 0 * value", lambda x: 5 * (1 + 2 * np.tanh(x)) - 5),
        ("b * (x == 1) - b * exp(-x) + b * log(abs(x) + 1) + b * sin(x)",
         lambda x: 2 * ((x == 1) - np.exp(-x) + np.log(np.abs(x) + 1) + np.sin(x))),
        ("-b**2 / (1 + x**2) * b", lambda x: -4 / (1 + x**2) * 2),
    ],
)  # fmt: skip
def test_each_word_means_what_numpy_means(text, wanted):
    x = np.array([-2.5, -1.0, 0.0, 1.0, 2.0, 3.5])
    effect = Formula("shaft", text, b={"value": 2.0})
    found = effect(jnp.full(6, 5.0), dft.models.Signals({"x": jnp.asarray(x)}))
    np.testing.assert_allclose(found - 5.0, wanted(x), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "a * speed**p", "a * abs(speed)**p", "a * sqrt(speed)", "a * log(speed)", "a / speed",
        "a * speed / abs(speed)", "a * exp(p * speed)", "a * speed**-2", "a * (speed**2)**p",
        "a * sqrt(speed**2)", "a * speed**0",
    ],
)  # fmt: skip
@pytest.mark.parametrize("p", [0.1, 1.0, 4.0])
def test_values_and_slopes_are_finite_at_rest_and_backwards(text, p):
    power = {"p": {"value": p}} if re.search(r"\bp\b", text) else {}
    effect = Formula("shaft", text, a={"value": 1.5}, **power)

    def left(effect, speed):
        return effect(jnp.zeros(()), dft.models.Signals({"speed": speed}))

    for speed in (0.0, -0.0, 1e-9, -3.0, 300.0):
        value, slopes = jax.value_and_grad(left, argnums=(0, 1))(effect, speed)
        assert np.all(np.isfinite([value, *jax.tree_util.tree_leaves(slopes)])), speed


# -- parameters ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "nulls"),
    [
        (TEXT, {"a"}),
        ("a * speed + p * speed**2", {"a", "p"}),
        ("value * (1 + a * command)", {"a"}),
        ("where(abs(value) < a, 0, value)", {"a"}),
        ("a * p * speed", {"a"}),
        ("a * sin(p * speed)", {"a"}),
        ("value * exp(-a * time)", {"a"}),
    ],
)
def test_the_null_is_found_by_evaluation(text, nulls):
    p = {"p": {"value": 1.2}} if re.search(r"\bp\b", text) else {}
    effect = Formula("shaft", text, a={"value": 1.3}, **p)
    assert {n for n, described in effect.declared.items() if described.null == 0.0} == nulls
    value = jnp.linspace(-3, 3, 7)
    signals = dft.models.Signals(dict.fromkeys(("speed", "command", "time"), value + 0.1))
    np.testing.assert_allclose(effect.at_null()(value, signals), value, rtol=1e-14)
    assert not np.allclose(effect(value, signals), value)


@pytest.mark.parametrize("text", ["tanh(speed / a)", "a + speed", "min(value, a)", "a * value"])
def test_one_that_always_acts_needs_a_null(text):
    with pytest.raises(InputError, match=r"(?s)whatever its parameters.*Mend: .*null"):
        Formula("shaft", text, a={"value": 2.0})


def test_a_null_that_is_given_is_held_to_its_word():
    infinite = {"unit": "rad/s^2", "value": 50.0, "null": np.inf}
    assert Formula("load", "min(value, m)", m=infinite).declared["m"].null == np.inf
    with pytest.raises(InputError, match="also where a = 2"):
        Formula("shaft", "a * speed", a={"value": 1.0, "null": 2.0})


def test_what_a_unit_alone_says():
    a, p = drag().declared.values()
    assert (a.value, a.unit, a.bounds, a.null) == (0.0, "rad/s^2", (None, None), 0.0)
    assert (p.value, p.bounds, p.null, p.probes) == (1.0, (0.1, 4.0), None, (0.5, 1.0, 2.0))
    with pytest.raises(InputError) as refused:
        Formula("shaft", "-a * max(speed - limit, 0)", a="1/s", limit="rad/s")
    assert str(refused.value) == (
        "The expression, character 18: nothing says where 'limit' begins.\n"
        "    -a * max(speed - limit, 0)\n"
        "                     ^\n"
        'Mend: Give it a value: limit={"unit": "rad/s", "value": ...}.'
    )


def test_parameters_are_described_in_three_ways():
    described = dft.parameter(
        1.5, "", bounds=(0.5, 3), prior=dft.models.Normal(1.5, 0.2), doc="power"
    )
    ours = drag(p=described).declared["p"]
    fields = {"value": 1.5, "bounds": [0.5, 3], "prior": {"mean": 1.5, "std": 0.2}, "doc": "power"}
    theirs = drag(p={"unit": "", **fields}).declared["p"]
    assert ours == theirs
    assert ours.prior == dft.models.Normal(1.5, 0.2)
    tried = dft.models.relative_to("drive", 0.1, 0.3)
    assert drag(a=dft.parameter(0.0, "rad/s^2", probes=tried)).declared["a"].probes == tried


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"a": 0.3, "p": ""}, "expected a unit, a dft.parameter or a table with a unit, found 0.3"),
        ({"a": "radz", "p": ""}, "'radz' is not a known unit"),
        ({"a": {"valeu": 1}, "p": ""}, "no field 'valeu'; the nearest is 'value'"),
        ({"a": {"value": "x"}, "p": ""}, "describe no parameter"),
        ({"a": {"value": 1, "probes": ["x"]}, "p": ""}, "describe no parameter"),
        ({"a": {"value": 1, "prior": {"mean": 1}}, "p": ""}, "describe no parameter"),
        ({"a": {"value": 5, "bounds": [0, 1]}, "p": ""}, "expected a value within [0, 1]"),
        ({"a": "", "p": "", "b": ""}, "'b' does not occur in"),
        ({"a": "", "p": "", "pi": ""}, "'pi' does not occur in"),
    ],
)
def test_descriptions_that_are_none_are_told(parameters, told):
    with pytest.raises(InputError) as refused:
        drag(**parameters)
    assert told in str(refused.value)
    assert "\nMend: " in str(refused.value)


@pytest.mark.parametrize("taken", ["rates", "value", "form", "_parameters", "declared"])
def test_a_parameter_may_not_take_the_name_of_something_else(taken):
    with pytest.raises(InputError, match=f"cannot be called '{taken}'"):
        Formula("shaft", f"a * {taken} * speed", **{"a": "", taken: {"value": 1.0}})


@pytest.mark.parametrize("name", ["two words", "", 3, "größe", "a.b"])
def test_names_are_those_of_python(name):
    with pytest.raises(InputError, match="letters, digits and underscores"):
        drag(name=name)


# -- in a model ------------------------------------------------------------------------------------


def test_several_stand_in_one_model_under_their_names():
    model = dft.Thruster() + drag() + drag("more") + Formula("load", "value*(1+c)", c="")
    assert [n for n in model.parameters if "." in n] == [
        "drag.a", "drag.p", "more.a", "more.p", "formula.c",
    ]  # fmt: skip
    assert str(model - "drag") == "thruster + more + formula"
    with pytest.raises(InputError, match="already has the effect 'drag'"):
        _ = model + drag()
    assert repr(model.replace({"drag.a": 0.25}).effects[0]) == (
        f"Formula(port='shaft', expression='{TEXT}', name='drag', a=0.25, p=1)"
    )


def test_compiled_programs_are_told_apart():
    tree = jax.tree_util.tree_structure
    same = dft.Thruster() + drag()
    assert tree(same) == tree(dft.Thruster() + drag())
    other = Formula("shaft", "-a * speed**p", name="drag", a="rad/s^2", p="")
    for effect in (drag("x"), other, Formula("load", TEXT, name="drag", a="rad/s^2", p="")):
        assert tree(same) != tree(dft.Thruster() + effect)
    values = jax.tree_util.tree_leaves(same.replace({"drag.a": 0.5}))
    assert values == [0.037, 42.0, 0.019, 0.5, 1.0]


def test_a_name_that_is_no_signal_is_marked():
    with pytest.raises(InputError) as refused:
        _ = dft.Thruster() + Formula("shaft", "-a * sped", name="drag", a="1/s")
    problem, shown, mark, mend = str(refused.value).splitlines()
    assert "'sped' is no parameter of 'drag', and no signal at the port 'shaft'" in problem
    assert "the nearest is 'speed'" in problem
    assert shown[mark.index("^") :] == "sped"
    assert "'time', 'command', 'speed', 'inflow', 'supply_voltage'" in mend


@pytest.mark.parametrize(
    ("model", "port", "names", "unknown"),
    [
        (
            dft.Vessel(drive="twin"),
            "surge_force",
            ("surge", "surge_through_water", "m22"),
            "rudder",
        ),
        (dft.Vessel(drive="twin"), "surge_through_water", ("surge",), "m22"),
        (dft.Thruster(), "command", ("command", "inflow"), "speed_alone"),
        (dft.Thruster(), "thrust", ("thrust", "speed", "command"), "drive"),
    ],
)
def test_what_may_be_read_depends_on_the_port(model, port, names, unknown):
    text = "a * (" + " + ".join(("time", *names)) + ")"
    added = model + Formula(port, text, a={"value": 0.1})
    inputs = {name: 0.1 * np.ones(20) for name in model.inputs}
    inputs |= {name: np.ones(20) for name in added.effects[0].needs}
    log = dft.Log(0.1 * np.arange(20), inputs, {})
    first, second = (dft.simulate(m, log) for m in (model, added))
    assert any(not np.allclose(first[name], second[name]) for name in first)
    with pytest.raises(InputError, match=f"'{unknown}' is no parameter"):
        _ = model + Formula(port, f"a * {unknown}", a="")


def test_a_channel_that_is_optional_is_needed_by_what_reads_it():
    sag = Formula("drive", "value * (1 + k * (supply_voltage - 24))", name="sag", k="1/V")
    assert sag.needs == ()
    model = dft.Thruster() + sag
    assert model.effects[0].needs == ("supply_voltage",)
    with pytest.raises(InputError, match="'sag' needs the input 'supply_voltage'"):
        dft.simulate(model, swinging())


# -- in a fit --------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [1.0, 1e-5])
def test_a_fit_finds_what_was_put_in_whatever_the_unit(unit):
    """Amplitudes of any magnitude begin at zero and take their size from the logs."""
    truth = dft.Thruster() + valued(0.3, 0.5)
    clean = dft.simulate(truth, swinging())["speed"]
    rng = np.random.default_rng(5)
    log = swinging(speed=clean + rng.normal(0.0, 0.1, clean.size))
    text = f"-a * {unit!r} * speed * abs(speed)**p"
    model = dft.Thruster().fix("alpha", "beta", "ct")
    fit = dft.fit(model + Formula("shaft", text, name="drag", a="", p=""), log, starts=4)
    assert fit.status.ok
    for name, value in (("drag.a", 0.3 / unit), ("drag.p", 0.5)):
        found = fit.parameters[name]
        assert abs(found.value - value) < 4 * found.std_error  # 1 in 8000 each
        assert found.std_error < 0.2 * value


def test_the_size_is_a_tenth_of_what_passes_the_port():
    levels = {"shaft": 50.0, "speed": 20.0, "duration": 12.0}
    sized = Formula("shaft", "-a * speed", a="1/s").scaled(lambda: levels).declared
    assert sized["a"].size is None  # what was declared stays as it was
    a = Formula("shaft", "-a * speed", a="1/s").scaled(lambda: levels)._parameters["a"]
    # the 90th percentile of |speed| where it is uniform within its level is 18 rad/s
    assert a.size == pytest.approx(0.1 * 50.0 / 18.0, rel=0.1)
    assert a.probes == (a.size, -a.size)
    for effect in (drag(a={"value": 0.2}), drag(a={"size": 3.0}), drag(a={"probes": [1.0]})):
        assert effect.scaled(lambda: levels)._parameters == effect._parameters
    unknown = Formula("shaft", "-a * inflow", a="1/s")
    assert unknown.scaled(lambda: levels)._parameters["a"].size is None
