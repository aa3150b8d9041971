"""The text of a class that is written from a formula, line by line."""

import pytest

from diffthrust.effects import (
    Formula,
)
from diffthrust.effects._class_test_text import effect_test_text  # private: as below
from diffthrust.effects._class_text import (  # private: written by the command
    class_name,
    effect_class_text,
)

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
