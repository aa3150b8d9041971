"""Classes that are written from formulas do the same, and their tests pass."""

from __future__ import annotations

import ast
import runpy
import sys
from itertools import product

import jax.numpy as jnp
import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError
from diffthrust.effects import Formula
from diffthrust.effects._class_text import (  # private: written by the command
    class_name,
    effect_class_text,
    effect_test_text,
)
from diffthrust.specs._new import (
    bound_to_model,
    new_effect,
    parse_parameter,
)  # private: as above

AMPLITUDE = {"unit": "rad/s^2", "value": 0.3, "null": 0.0}
LAWS = {
    "drag": ("-a * speed * abs(speed)**p", {"a": "rad/s^2", "p": ""}),
    "sum_of": ("-a * speed / 2 - p*(speed - -2)*cos(command) + 3*a", {"a": "1/s", "p": "1/s"}),
    "sag": ("value*(1 + a*(time > 3)*exp(-speed/10)/(1 + speed**2))", {"a": ""}),
    "hump": ("where(0 < value < a, pi, value) + a*sqrt(abs(speed))*log(speed)", {"a": AMPLITUDE}),
    "of_part": ("-a * port.command", {"a": "rad/s^2"}),
    "limit": (
        "min(value, m)",
        {"m": {"unit": "rad/s^2", "value": 50.0, "null": np.inf, "bounds": (0, None)}},
    ),
    "told": (
        "max(a * speed, 0) - max(0, a * speed) + a",
        {
            "a": dft.parameter(
                1.23456789,
                "N s/m",
                null=0.0,
                prior=dft.models.Normal(1, 0.5),
                probes=dft.models.relative_to("speed", 0.1, 0.2, power=-1),
                doc='a "strength" \\ of it',
            )
        },
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_class_does_what_the_formula_does(name):
    text, parameters = LAWS[name]
    formula = Formula("shaft", text, name=name, **parameters)
    code = effect_class_text(formula, name, 'Says """what""" happens.')
    assert max(map(len, code.splitlines())) <= 100
    scope: dict = {}
    exec(code, scope)
    effect = scope[class_name(name)]
    assert (effect.name, effect.port) == (name, "shaft")
    for key, p in formula.declared.items():
        ours = effect.declared[key]
        for field in ("unit", "bounds", "null", "prior", "probes", "transform", "doc", "fixed"):
            assert getattr(ours, field) == getattr(p, field), field
        assert ours.value == pytest.approx(p.value, rel=1e-3)
    rng = np.random.default_rng(1)
    value = jnp.asarray(rng.normal(size=50) * 40)
    signals = dft.models.Signals(
        {
            n: jnp.asarray(rng.normal(size=50) * 5)
            for n in ("speed", "command", "time", "port.command")
        }
    )
    values = {key: p.value + 0.25 for key, p in formula.declared.items()}
    made = Formula("shaft", text, **{
        key: {"unit": p.unit, "null": p.null, "value": values[key]}
        for key, p in formula.declared.items()
    })  # fmt: skip
    ours, theirs = (one(value, signals) for one in (effect(**values), made))
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)
    assert name == "limit" or not np.allclose(ours, value)


def test_the_files_run_and_their_tests_pass(tmp_path):
    text, parameters = LAWS["drag"]
    script, tests = new_effect(
        Formula("shaft", text, name="drag", **parameters), directory=tmp_path
    )
    assert (script.name, tests.name) == ("drag.py", "test_drag.py")
    assert ast.get_docstring(ast.parse(script.read_text())) == "The effect drag, of one's own."
    assert len(list(ran(tests))) == 6
    # the tests are some: with another law, one fails
    script.write_text(script.read_text().replace("value - self.a", "value + self.a"))
    with pytest.raises(AssertionError, match="Not equal"):
        list(ran(tests))


def ran(tests):
    """The tests of a file, run one by one as pytest would; in a process that has loaded JAX."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)  # it tells files apart by whole seconds
        patch.syspath_prepend(tests.parent)
        patch.delitem(sys.modules, tests.stem.removeprefix("test_"), raising=False)
        for name, test in runpy.run_path(str(tests)).items():
            if name.startswith("test_"):
                marks = [mark.args for mark in getattr(test, "pytestmark", ())]
                for values in product(*(choices for _, choices in marks)):
                    test(**dict(zip((key for key, _ in marks), values, strict=True)))
                    yield name


def test_nothing_is_overwritten_and_no_name_taken(tmp_path):
    def asked(name):
        return new_effect(Formula("shaft", "-a * speed", name=name, a="1/s"), directory=tmp_path)

    (tmp_path / "test_drag.py").write_text("# mine\n")
    with pytest.raises(InputError, match="nothing is overwritten"):
        asked("drag")
    assert [path.name for path in tmp_path.iterdir()] == ["test_drag.py"]
    for name in ("wind", "class"):
        with pytest.raises(InputError, match=f"'{name}' is taken"):
            asked(name)


def test_the_class_knows_which_channels_it_needs():
    formula = Formula("drive", "value * (1 + k * (supply_voltage - 24))", name="sag", k="1/V")
    assert 'needs = ("supply_voltage",)' in effect_class_text(bound_to_model(formula), "sag")
    with pytest.raises(InputError, match="'suply' is no parameter"):
        bound_to_model(Formula("drive", "value * (1 + k * suply)", k="1/V"))
    strange = Formula("of_my_own_model", "-k * depth", k="1/m")
    assert bound_to_model(strange) is strange


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a=rad/s^2", ("a", "rad/s^2")),
        ('a="rad/s^2"', ("a", "rad/s^2")),
        ("p=", ("p", "")),
        ("p = { value = 1.5, bounds = [0.5, 3] }", ("p", {"value": 1.5, "bounds": [0.5, 3]})),
    ],
)
def test_parameters_on_a_command_line(text, found):
    assert parse_parameter(text) == found


@pytest.mark.parametrize("text", ["a", "a={ value = }", "a={ value = 1"])
def test_parameters_that_are_none(text):
    with pytest.raises(InputError, match=r"--parameter a.*\nMend: Write --parameter"):
        parse_parameter(text)


@pytest.mark.parametrize(
    ("text", "parameters"),
    [
        (
            "value * (1 - loss * lag(lag(command**2, fast), slow))",
            {"loss": "1/V^2", "fast": {"unit": "s", "value": 2.0}, "slow": {"value": 20.0}},
        ),
        (
            "a * (speed - play(speed, b)) + k * integral(speed)",
            {"a": "1/s", "k": "1/s^2", "b": {"unit": "rad/s", "value": 3.0}},
        ),
    ],
)
def test_a_class_remembers_what_its_formula_remembers(text, parameters):
    formula = Formula("drive", text, name="slack", **parameters)
    code = effect_class_text(formula, "slack")
    assert max(map(len, code.splitlines())) <= 80
    scope: dict = {}
    exec(code, scope)
    moved = {name: 1.5 + p.value for name, p in formula.declared.items()}
    ours = scope["Slack"](**moved)
    told = {n: {"unit": p.unit, "value": moved[n]} for n, p in formula.declared.items()}
    law = Formula("drive", text, name="slack", **told)
    rng = np.random.default_rng(1)
    names = (*law.reads, *law.states)
    s = dft.models.Signals({name: jnp.asarray(rng.normal(size=50)) for name in names})
    value = jnp.asarray(rng.normal(size=50))
    np.testing.assert_allclose(ours(value, s), law(value, s), rtol=1e-12)
    for name in law.states:
        for one, other in zip(
            *(as_parts(e.rates(value, s)[name]) for e in (ours, law)), strict=True
        ):
            np.testing.assert_allclose(one, other, rtol=1e-12)
        starts = (np.broadcast_to(e.initial(value, s)[name], 50) for e in (ours, law))
        np.testing.assert_allclose(*starts, rtol=1e-12)


def as_parts(rate):
    return rate if isinstance(rate, tuple) else (rate,)


# The text of a class.

TEXT = '''"""The effect tip_loss, of one's own."""

import jax.numpy as jnp

import diffthrust as dft


class TipLoss(dft.Effect):
    """Lost at the tips.

    Acts at the port 'shaft', adding: -a * speed * abs(speed)**p + b / speed.
    Null: a = 0, b = 0.
    """

    name = "tip_loss"
    port = "shaft"
    a: float = dft.parameter(0.0, unit="rad/s^2", null=0.0, size=1.0)
    p: float = dft.parameter(
        1.0,
        unit="",
        bounds=(0.1, 4.0),
        probes=(0.5, 1.0, 2.0),
        transform="linear",
    )
    b: float = dft.parameter(0.12345678, unit="", null=0.0)

    def __call__(self, value, s):
        """What leaves the port where `value` arrives, with the signals `s`."""
        # a hint
        return (
            value - self.a * s.speed *
            dft.effects.finite.raised(jnp.abs(s.speed), self.p) +
            dft.effects.finite.quotient(self.b, s.speed)
        )
'''


def test_the_text_of_a_class():
    formula = Formula("shaft", "-a * speed * abs(speed)**p + b / speed", name="tip_loss",
                      a="rad/s^2", p="", b={"value": 0.12345678})  # fmt: skip
    assert effect_class_text(formula, "tip_loss", "Lost at the tips.", "a hint") == TEXT
    assert class_name("tip_loss") == "TipLoss"
    tests = effect_test_text(formula, "tip_loss")
    assert 'reads = ("speed",)' in tests or '("speed",)' in tests
    assert 'MOVED = {"a": 0.5, "p": 1.5, "b": 0.62' in tests.replace("0.62345678", "0.62")


def test_the_text_of_a_class_is_as_wide_as_a_terminal_and_no_wider():
    widest = set()
    for count in range(20):
        formula = Formula("shaft", "a * speed" + "*speed" * count, a="")
        text = effect_class_text(formula, "one")
        widest.add(max(map(len, text.partition('name = "one"')[0].splitlines())))
    assert max(widest) == 80


@pytest.mark.parametrize(
    ("law", "written"),
    [
        ("-a * speed", "value - self.a * s.speed"),
        ("a * speed - 2 * a", "value + self.a * s.speed - 2 * self.a"),
        ("-a", "value - self.a"),
        ("-a * speed / 2 + a", "value - self.a * s.speed / 2 + self.a"),
        ("value * (1 + a)", "value * (1 + self.a)"),
        ("a * speed**3", "value + self.a * s.speed ** 3"),
        ("a * speed**13", "value + self.a * dft.effects.finite.raised(s.speed, 13)"),
        ("a * min(speed, pi)", "value + self.a * jnp.minimum(s.speed, jnp.pi)"),
        ("a * where(speed, 1, 2)", "value + self.a * jnp.where(s.speed != 0, 1, 2)"),
        ("a * where(speed < 2, 1, 2)", "value + self.a * jnp.where(s.speed < 2, 1, 2)"),
        ("a * (1 < speed)", "value + self.a * jnp.where(1 < s.speed, 1.0, 0.0)"),
        ("a * exp(speed)", "value + self.a * dft.effects.finite.exponential(s.speed)"),
    ],
)
def test_a_law_as_an_effect_writes_it(law, written):
    code = effect_class_text(Formula("shaft", law, a=""), "one")
    assert f"        return {written}\n" in code


@pytest.mark.parametrize(
    ("fields", "moved"),
    [
        ({"value": 1.0}, 1.5),
        ({"value": 1.0, "bounds": (0.0, 1.2)}, 0.5),
        ({"value": 1.0, "bounds": (0.8, 1.2)}, 1.1),
        ({"value": 1.2, "bounds": (0.8, 1.2)}, 1.2),
        ({"value": 0.9, "bounds": (0.5, None)}, 1.4),
    ],
)
def test_another_value_is_within_the_bounds(fields, moved):
    formula = Formula("shaft", "c * speed * abs(speed)**a", c="", a=fields)
    assert f'"a": {moved!r}' in effect_test_text(formula, "one")


def test_a_law_of_more_than_65_characters_is_wrapped():
    for name, lines in (("ab", 1), ("abc", 2)):
        law = f"{name} * speed" + " * speed" * 4
        code = effect_class_text(Formula("shaft", law, **{name: ""}), "one")
        written = code.partition('`s`."""\n')[2].splitlines()
        assert (written[0].strip() == "return (") == (lines == 2)
        assert lines == 2 or len(written[0]) == 8 + len("return ") + 65
