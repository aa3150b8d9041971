"""Effects of spec files that are written as tables: formulas."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lines_to_copy import effect_of, effects_line, python_lines, spec_lines

import diffthrust as dft
from diffthrust import InputError
from diffthrust.checks import check
from diffthrust.effects import Formula
from diffthrust.specs import load_spec

DRAG = (
    '{ formula = "-a * speed * abs(speed)**p", port = "shaft", a = "rad/s^2", '
    'p = { value = 1.5, bounds = [0.5, 3] }, name = "drag" }'
)
TEXT = """\
model = "thruster"
effects = {effects}

[logs]
train = "a.csv"
time = {{ column = "time", unit = "s" }}

[channels]
command = {{ column = "command", unit = "V" }}
speed = {{ column = "speed", unit = "rad/s" }}

[parameters]
ct = {{ fixed = true }}
{parameters}

[fit]
starts = 1
"""


@pytest.fixture
def written(tmp_path):
    def write(effects, parameters=""):
        text = TEXT.format(effects=effects, parameters=parameters)
        (tmp_path / "fit.toml").write_text(text)
        return tmp_path

    time = 0.05 * np.arange(200)
    log = dft.Log(time, {"command": 5 * np.sin(time)}, {})
    speed = dft.simulate(dft.Thruster() + Formula("shaft", "-0.5*speed*a", a={"value": 1}), log)
    noisy = speed["speed"] + np.random.default_rng(0).normal(0, 0.1, 200)
    table = np.c_[time, log.inputs["command"], noisy]
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="time,command,speed", comments="")
    return write


def refused(folder):
    with pytest.raises(InputError) as error:
        load_spec(folder)
    return str(error.value)


def test_a_formula_stands_among_the_effects(written):
    spec = load_spec(written(f'["command_deadband", {DRAG}]', "drag.a = 0.2"))
    assert str(spec.model) == "thruster + command_deadband + drag"
    parameters = spec.model.parameters
    assert (parameters["drag.a"].value, parameters["drag.a"].unit) == (0.2, "rad/s^2")
    assert (parameters["drag.p"].value, parameters["drag.p"].bounds) == (1.5, (0.5, 3.0))
    alone = load_spec(written('{ formula = "-a * speed", port = "shaft", a = "1/s" }'))
    assert str(alone.model) == "thruster + formula"
    assert spec.sha256 != alone.sha256


@pytest.mark.parametrize(
    "parameters",
    [
        "drag.p = { fixed = true }",
        '"drag.p" = { fixed = true }',
        "[parameters.drag.p]\nfixed = true",
    ],
)
def test_its_parameters_are_given_as_those_of_others(written, parameters):
    assert load_spec(written(f"[{DRAG}]", parameters)).model.parameters["drag.p"].fixed


def test_what_a_report_says_to_copy_makes_the_same_model(written):
    infinite = {"unit": "rad/s^2", "value": 50.0, "null": np.inf, "prior": {"mean": 50, "std": 5}}
    power = dft.parameter(0.5, bounds=(0, None), probes=dft.models.relative_to("speed", 0.1))
    model = (
        dft.Thruster()
        + "command_delay"
        + Formula("shaft", "-a * speed**p", name="drag", a="rad/s^2", p=power)
        + Formula("load", "min(value, m)", name="top", m=infinite)
        + Formula("thrust", "k", name="offset", k="{thrust}")
    )
    bounded = {"value": 0.45, "bounds": (0.1, 2.0)}
    model = model.replace({"ct": {"fixed": True}, "alpha": 0.031, "drag.p": bounded})
    effects, _, numbers = spec_lines(model).partition("\n[parameters]\n")
    assert tomllib.loads(effects)["effects"][0] == "command_delay"
    assert "ct = { fixed = true }" in numbers  # as the file has it
    numbers = numbers.replace("ct = { fixed = true }", "")
    spec = load_spec(written(effects.removeprefix("effects = "), numbers))
    scope = {"dft": dft}
    exec(python_lines(model), scope)
    for again in (spec.model, scope["model"]):
        assert str(again) == str(model)
        for one, other in zip(again.effects, model.effects, strict=True):
            assert one.declared == other.declared
            assert one.structure == other.structure
        assert again.parameters == model.parameters


def test_a_check_keeps_it(written):
    folder = written(f"[{DRAG}]")
    assert check(folder, update=True).ok
    text = (folder / "fit.toml").read_text()
    assert DRAG in text
    assert "drag.a" in tomllib.loads(text)["expected"]["parameters"]
    assert check(folder).ok


@pytest.mark.parametrize(
    ("effects", "told"),
    [
        ('[{ formul = "-a", port = "shaft" }]', "found 'formul', 'port'; the nearest is 'formula'"),
        ('[{ formula = "-a * speed", a = "1/s" }]', "formula: missing a required argument: 'port'"),
        ('[{ formula = "-a", port = "shaft", expression = "b" }]', "'formula' stands for it"),
        ('[{ formula = "-a*sped", port = "shaft", a = "" }]', "the nearest is 'speed'"),
        ('[{ formula = "-a*speed", port = "shft", a = "" }]', "acts at the port 'shft', which"),
        ('[{ formula = "-a*speed", port = "shaft", a = 3 }]', "expected a unit"),
        ('[{ formula = 3, port = "shaft" }]', "expected an expression as text, found 3"),
        (f"[{DRAG}, {DRAG}]", "already has the effect 'drag'"),
        ("[3]", "expected a list of names and tables"),
        ("3", "expected a list of names and tables"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(written, effects, told):
    message = refused(written(effects))
    assert "fit.toml, line 2, effects: " in message
    assert told in message
    assert "\nMend: " in message


values = st.recursive(
    st.one_of(
        st.none(), st.booleans(), st.integers(-(2**63), 2**63), st.floats(), st.text(max_size=6),
        st.sampled_from(["rad/s", "{speed}", "{", "}{", "{ }", "1/(s", "inf", "drag", "shaft"]),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(
            st.sampled_from([
                *("unit", "value", "bounds", "fixed", "prior", "transform", "size", "null", "doc"),
                *("probes", "mean", "std", "signal", "factors", "power", "other"),
            ]), inner, max_size=4,
        ),
    ),
    max_leaves=6,
)  # fmt: skip


@pytest.mark.thorough
@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.fixed_dictionaries({"a": values}, optional={k: values for k in ("name", "port", "formula")}),
    st.sampled_from(["-a * speed", "value * (1 + a)", "min(value, a)", "speed**a - 1"]),
)
def test_any_table_is_an_effect_or_an_input_error(table, law):
    try:
        effect = effect_of({"port": "shaft", "formula": law, **table}, Path(), ())
        model = dft.Thruster() + effect
    except InputError as refused:
        told = str(refused)
        assert "\nMend: " in told
    else:
        again = effect_of(tomllib.loads(effects_line(model.effects))["effects"][0], Path(), ())
        assert again.structure == effect.structure
        assert repr(again.declared) == repr(effect.declared)  # NaN is not equal to itself
