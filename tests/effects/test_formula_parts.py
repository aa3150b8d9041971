"""What formulas and curves are made of: finite functions, limits, starts, priors, their text."""

import numpy as np
import pytest
from expressions import expression_of

import diffthrust as dft
from diffthrust import InputError
from diffthrust.effects import (
    Curve,
    Formula,
    finite,
)
from diffthrust.models import Normal, Relaxing, Signals


def test_powers_roots_and_quotients_are_finite():
    x = np.array([-4.0, -1e-6, -2e-7, 0.0, 3e-7, 1e-6, 9.0])
    size = np.abs(x)
    line = np.where(size < 1e-6, size * 1e6 * 1e-6**1.7, size**1.7)
    np.testing.assert_allclose(finite.raised(x, 1.7, np), line, rtol=1e-12)
    root = np.where(x < 1e-6, np.maximum(x, 0.0) * 1e3, np.sqrt(size))
    np.testing.assert_allclose(finite.square_root(x, np), root, rtol=1e-12)
    logs = np.log([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 9.0])
    np.testing.assert_allclose(finite.logarithm(x, np), logs, rtol=1e-12)
    exps = finite.exponential(np.array([-3.0, 79.0, 80.0, 81.0, 1e9]), np)
    np.testing.assert_allclose(exps, np.exp([-3.0, 79.0, 80.0, 80.0, 80.0]))
    below = np.array([-2.0, -1e-12, -0.9e-12, 0.0, 0.9e-12, 1e-12, 2.0])
    least = np.array([-2.0, -1e-12, -1e-12, 1e-12, 1e-12, 1e-12, 2.0])
    np.testing.assert_allclose(finite.quotient(3.0, below, np), 3.0 / least, rtol=1e-12)


def worked_out(text, **names):
    return expression_of(text)(names.__getitem__, np)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("x**3", -8.0), ("x**12", 4096.0), ("x**0", 1.0), ("x**13", 8192.0), ("x**2.5", 2**2.5),
        ("x**-2", 0.25), ("x**p", 2**1.5), ("7 - x - 1", 8.0), ("7 / x / 4", -0.875),
        ("-x + +x", 0.0), ("1 < 2 < 3", 1.0), ("1 < 3 < 2", 0.0), ("x <= -2", 1.0),
        ("x < -2", 0.0), ("x >= -2", 1.0), ("x > -2", 0.0), ("x == -2", 1.0), ("x != -2", 0.0),
        ("min(x, 3) + max(x, 3)", 1.0), ("minimum(x, 3) - maximum(x, 3)", -5.0),
        ("where(x, 5, 7)", 5.0), ("where(x + 2, 5, 7)", 7.0), ("pi * 2", 2 * np.pi),
        ("2e3 * p", 3000.0), ("where(x < 0, 1, 2) ** p", 1.0),
    ],
)  # fmt: skip
def test_what_an_expression_is_worth(text, value):
    assert float(worked_out(text, x=-2.0, p=1.5)) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "place"), [("a * * speed", 5), ("  a * * speed", 7), ("   a *", 4)]
)
def test_where_a_text_cannot_be_read(text, place):
    with pytest.raises(InputError, match=f"character {place}: this cannot be read"):
        expression_of(text)


def test_a_long_text_is_shown_from_fifty_before_its_mark():
    text = "a + " * 40 + "$" + " + b" * 40
    with pytest.raises(InputError) as refused:
        expression_of(text)
    _, shown, mark, _ = str(refused.value).splitlines()
    assert (shown, mark) == (f"    {text[110:210]}", " " * 54 + "^")


def test_expressions_of_the_same_text_are_the_same():
    one, other = expression_of("a * speed"), expression_of("a * speed ")
    assert one != other
    assert hash(one) == hash(expression_of("a * speed"))


def test_how_long_and_how_deep_an_expression_may_be():
    assert expression_of("a" + "+1" * 38).text
    with pytest.raises(InputError, match="nested more than 40 deep"):
        expression_of("a" + "+1" * 40)
    assert expression_of("-" * 39 + "a").places == {"a": 39}
    with pytest.raises(InputError, match="nested more than 40 deep"):
        expression_of("-" * 40 + "a")
    assert expression_of("a" + " " * 499).places == {"a": 0}
    with pytest.raises(InputError, match="has 501 characters, allowed are 500"):
        expression_of("a" + " " * 500)
    found = expression_of("  b + a**(p + 2*q) + a")
    assert found.places == {"b": 2, "a": 6, "p": 10, "q": 16}
    assert found.exponents == {"p", "q"}


@pytest.mark.parametrize(
    ("text", "mend"),
    [
        ("a * where", "Write where(x, y, z)."),
        ("a * max", "Write max(x, y)."),
        ("a * abs", "Write abs(x)."),
        ("a * max(a)", "Write max(x, y)."),
        ("a * tanh(a, a)", "Write tanh(x)."),
    ],
)
def test_how_a_function_is_written(text, mend):
    with pytest.raises(InputError) as refused:
        Formula("shaft", text, a="")
    assert refused.value.mend == mend


# Curves.


def test_the_coefficients_of_a_curve_and_their_priors():
    curve = Curve("load", "speed", -2.0, 3.0, pieces=4, size=5.0, bend=0.4, unit="N",
                  shape=(1.5, -2.0, 0.25), held=("slope", "bend2"))  # fmt: skip
    assert curve.coefficients == ("level", "slope", "bend1", "bend2", "bend3", "bend4", "bend5")
    assert curve.shape == (1.5, -2.0, 0.25, 0.0, 0.0, 0.0, 0.0)
    for name, p in curve.declared.items():
        width = {"level": 5.0, "slope": 10.0}.get(name, 2.0)
        assert (p.unit, p.null, p.size, p.prior) == ("N", 0.0, width, Normal(0.0, width))
        assert (p.fixed, p.bounds) == (name in ("slope", "bend2"), (None, None))
    assert curve.states == {}
    assert curve.reads == ("speed",)
    assert Curve("load", "value * speed", 0, 1, times="abs(inflow)").reads == ("inflow", "speed")
    assert len(Curve("load", "speed", -2.0, 3.0, pieces=3).coefficients) == 6
    full = Curve("load", "speed", -2.0, 3.0, pieces=3, shape=range(6))
    assert full.shape == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    with pytest.raises(InputError, match="at most 6 numbers, found 7"):
        Curve("load", "speed", -2.0, 3.0, pieces=3, shape=range(7))
    for wrong in ({"low": 3.0}, {"bend": 0.0}, {"size": -0.1}, {"pieces": 2}):
        with pytest.raises(InputError, match="expected"):
            Curve(**{"port": "load", "signal": "speed", "low": 0.0, "high": 3.0, **wrong})


def test_a_curve_of_a_lag_and_of_the_time():
    own = {"T": {"unit": "s", "value": 0.4}}
    late = Curve("load", "lag(speed**2, T)", 0.0, 9.0, shape=(3.0,), **own)
    assert (late.declared["T"].value, late.declared["T"].bounds) == (0.4, (0.0, None))
    s = Signals({"speed": np.array([1.5, -3.0]), "lag": np.array([2.0, 4.0])})
    rate = late.rates(np.zeros(2), s)["lag"]
    assert isinstance(rate, Relaxing)
    np.testing.assert_allclose(rate.rate, [0.25 / 0.4, 5.0 / 0.4])
    assert rate.decay == pytest.approx(2.5)
    np.testing.assert_allclose(late.initial(np.zeros(2), s)["lag"], [2.25, 9.0])
    np.testing.assert_allclose(late(np.array([10.0, 20.0]), s), [13.0, 23.0])
    clock = Curve("load", "integral(1)", 0.0, 9.0, shape=(3.0,), times="value")
    assert clock.reads == ()
    since = Signals({"integral": np.array([2.0, 4.0])})
    np.testing.assert_array_equal(clock.rates(np.zeros(2), since)["integral"], [1.0, 1.0])
    assert clock.initial(np.zeros(2), since) == {"integral": 0.0}
    np.testing.assert_allclose(clock(np.array([10.0, 20.0]), since), [40.0, 80.0])


def test_a_play_is_pushed_and_begins_as_if_from_zero():
    slack = Formula("load", "play(value, b)", b={"unit": "rad/s^2", "value": 2.0})
    s = Signals({"play": np.array([0.0, 5.0, -1.0])})
    value = np.array([1.0, 1.0, -8.0])
    np.testing.assert_allclose(slack(value, s), [0.0, 3.0, -6.0])
    rate = slack.rates(value, s)["play"]
    np.testing.assert_allclose(rate.rate, rate.decay * np.array([0.0, -2.0, -5.0]))
    assert rate.decay == 1e4
    np.testing.assert_allclose(slack.initial(value, s)["play"], [0.0, 0.0, -6.0])


def test_a_curve_follows_its_coefficients():
    curve = Curve("load", "speed", -2.0, 3.0, pieces=4, shape=(1.0,))
    model = (dft.Thruster() + curve).replace({"curve.level": 4.0, "curve.slope": 10.0})
    np.testing.assert_allclose(model.effects[0].at_signal(np.array([-2.0, 3.0])), [-1.0, 9.0])
    rows = curve.basis(np.linspace(-2.0, 3.0, 7))
    assert rows.shape == (7, 7)
    np.testing.assert_allclose(rows[:2], [np.ones(7), np.linspace(-0.5, 0.5, 7)], atol=1e-12)


# Formulas.


def test_an_amplitude_is_tried_where_it_makes_a_tenth_of_what_passes_the_port():
    def formula(law, unit):
        return Formula("shaft", law, a=unit)

    def size(law, unit, levels):
        return formula(law, unit).scaled(lambda: levels)._parameters["a"].size

    def drawn(law, unit, levels):  # 256 points within the levels, of the generator's first seed
        rng = np.random.default_rng(0)
        names = ("value", *formula(law, unit).reads)
        return {n: levels.get(n, 50.0) * rng.uniform(-1, 1, 256) for n in names}

    law, levels = "-a * speed * abs(speed) + 0 * time", {"shaft": 50.0, "speed": 20.0, "time": 30.0}
    added = np.quantile(drawn(law, "1/rad", levels)["speed"] ** 2, 0.9)
    assert size(law, "1/rad", levels) == pytest.approx(0.1 * 50.0 / added, rel=1e-12)
    assert size(law, "1/rad", {"shaft": 50.0, "speed": 20.0}) is None
    levels = {"shaft": 50.0, "time": 30.0}
    added = np.quantile(np.abs(drawn("a * time", "rad/s^3", levels)["time"]), 0.9)
    assert added == pytest.approx(0.9 * 30.0, rel=0.1)  # what a uniform law would give
    assert size("a * time", "rad/s^3", levels) == pytest.approx(0.1 * 50.0 / added, rel=1e-12)


def test_sizes_are_taken_only_where_there_are_none():
    levels = {"shaft": 50.0, "speed": 0.0}
    still = Formula("shaft", "-a * speed", a="1/s").scaled(lambda: levels)
    assert still._parameters["a"].size is None
    gone = Formula("shaft", "-a * speed", a="1/s").scaled(lambda: {"speed": 20.0})
    assert gone._parameters["a"].size is None


def test_what_is_linear_begins_at_zero_and_what_is_not_wants_a_value():
    both = Formula("shaft", "a * speed + b * speed**2", a="1/s", b="1/rad").declared
    assert [(p.value, p.null, p.transform) for p in both.values()] == [(0.0, 0.0, "linear")] * 2
    with pytest.raises(InputError, match="nothing says where 'c' begins"):
        Formula("shaft", "value * exp(-c * time)", c="1/s")
    given = Formula("shaft", "value * exp(-c * time)", c={"value": 2.0, "bounds": (0, None)})
    assert given.declared["c"].null == 0.0
    assert given.declared["c"].transform == "linear"
    fixed = Formula("shaft", "a * b * speed", a="1/s", b={"value": 2.0, "fixed": True}).declared
    assert (fixed["a"].null, fixed["b"].null) == (0.0, None)
    with pytest.raises(InputError, match="is nowhere finite"):
        Formula("shaft", "a * speed * 1e300 * 1e300 * (1 + speed**2)", a="")
