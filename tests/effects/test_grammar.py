"""What an expression may be: nothing but a formula, or an `InputError`."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from diffthrust import InputError
from diffthrust.effects import Formula

NASTY = {
    "__import__('os').system('true')": 12,
    "speed.__class__": 1,
    "().__class__": 1,
    "(lambda: a)()": 8,
    "[a for a in speed]": 1,
    "a if speed else a": 1,
    "a and speed": 1,
    "not a": 1,
    "~a": 1,
    "a % 2": 3,
    "a // 2": 1,
    "a @ speed": 3,
    "a := 2": 3,
    "a; a": 2,
    "eval(a)": 1,
    "exec": None,
    "f(a)": 1,
    "a(2)": 1,
    "(a + 1)(2)": 1,
    "abs(*speed)": None,
    "abs(x=a)": 1,
    "abs(a, a)": 1,
    "where(a, 1)": 1,
    "abs": 1,
    "a * 1j": 5,
    "a * True": 5,
    "a * None": 5,
    "a * ...": None,
    "a * 'x'": 5,
    "a * 1e999": 5,
    "a * 10**10**10": None,
    "a *": None,
    "a * (speed": None,
    "a * ä": 5,
    "a * \uff53peed": 5,  # which Python takes for an s
    "a\n* 2": 2,
    "a # b": 3,
    "a\x00": 2,
    "a" + " + a" * 200: None,
    "-" * 200 + "a": None,
    "(" * 300 + "a" + ")" * 300: None,
    "a" + "**2" * 60: None,
    "": None,
    "   ": None,
    "9" * 450 + " * a": 1,
}


@pytest.mark.parametrize("text", NASTY, ids=[text[:20] for text in NASTY])
def test_what_is_not_allowed_is_refused_with_a_mark(text):
    with pytest.raises(InputError) as refused:
        Formula("shaft", text, a={"value": 1.0}) if "a" in text else Formula("shaft", text)
    problem = str(refused.value)
    assert "\nMend: " in problem
    if NASTY[text]:
        lines = problem.splitlines()
        assert f"character {NASTY[text]}:" in lines[0]
        assert lines[2].strip() == "^"
        assert lines[2].index("^") == 3 + NASTY[text]


def test_a_word_that_is_nearly_one_is_told():
    with pytest.raises(InputError, match=r"'sqr' is not known; the nearest is 'sqrt'"):
        Formula("shaft", "a * sqr(speed)", a="")


def test_what_is_long_is_shown_around_the_mark():
    with pytest.raises(InputError) as refused:
        Formula("shaft", "a * speed + " * 30 + "a $ 2", a="")
    _, shown, mark, _ = str(refused.value).splitlines()
    assert len(shown) < 110
    assert shown[mark.index("^")] == "$"


names = st.sampled_from(["a", "p", "speed", "time", "value", "pi", "_", "os", "self"])
numbers = st.one_of(st.integers(-3, 10**25).map(str), st.floats(allow_nan=False).map(repr))
words = st.sampled_from([
    *("abs", "sign", "sqrt", "exp", "log", "tanh", "sin", "cos", "min", "max", "where", "eval"),
])  # fmt: skip
marks = st.sampled_from(["+", "-", "*", "/", "**", "<", "<=", "==", "!=", "(", ")", ",", ".", " "])
pieces = st.lists(st.one_of(names, numbers, words, marks), max_size=25).map("".join)


def _extended(inner):
    return st.one_of(
        st.tuples(inner, marks, inner).map("".join),
        st.tuples(words, inner).map(lambda part: f"{part[0]}({part[1]})"),
        inner.map(lambda text: f"({text})"),
        inner.map(lambda text: f"-{text}"),
    )


nested = st.recursive(st.one_of(names, numbers), _extended, max_leaves=20)


@pytest.mark.thorough
@settings(max_examples=400, deadline=None, derandomize=True)
@given(st.one_of(pieces, nested, st.text(max_size=40)))
@example("-(speed**time)")  # as large as numbers get, and beyond
def test_any_text_is_a_formula_or_an_input_error(text):
    loaded, effect = set(sys.modules), formula_or_none(text)
    assert set(sys.modules) == loaded
    if effect is not None:
        value = np.linspace(-2.0, 2.0, 5)
        signals = type("Signals", (), {name: value + 0.3 for name in effect.reads})
        left = effect.at_null()(value, signals)
        assert np.allclose(left, value, equal_nan=True) or not np.all(np.isfinite(left))


def formula_or_none(text):
    """The formula, or nothing where it is refused; by an `InputError` with a mend."""
    for names in (("a", "p"), ("a",)):
        try:
            return Formula("shaft", f"a * ({text})", **{n: {"value": 1.2} for n in names})
        except InputError as refused:
            told = str(refused)
        assert "\nMend: " in told
    return None


def test_the_texts_that_are_drawn_are_often_formulas():
    drawn = [f"{a} * ({b} - {c})" for a in ("speed", "sqrt(time)") for b in "ap" for c in "a3"]
    assert all(formula_or_none(text) for text in drawn)
