"""A parameter's coordinates, checks, words and units, case by case."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diffthrust import InputError, Parameter, parameter
from diffthrust.models import Normal


@pytest.mark.parametrize(
    ("p", "scale"),
    [
        (Parameter(3.0, size=0.5), 0.5),
        (Parameter(3.0, bounds=(1.0, 5.0)), 2.0),
        (Parameter(3.0, bounds=(1.0, 5.0), size=0.7), 0.7),
        (Parameter(-3.0, bounds=(None, 5.0)), 3.0),
        (Parameter(3.0, bounds=(1.0, None)), 3.0),
        (Parameter(0.0), 1.0),
    ],
)
def test_the_unit_length_of_a_coordinate(p, scale):
    assert p.scale == scale
    assert p.to_coordinate(2.6) == pytest.approx(2.6 / scale)
    assert p.from_coordinate(2.6) == pytest.approx(2.6 * scale)
    low, high = p.limits
    assert p.coordinate_limits() == (low / scale, high / scale)


def test_a_logarithm_is_stopped_fifteen_decades_away():
    p = Parameter(2.0, bounds=(0.0, None), transform="log")
    at = math.log(2.0)
    assert p.coordinate_limits() == (at - 35.0, at + 35.0)
    assert Parameter(2.0, bounds=(0.5, 8.0), transform="log").coordinate_limits() == (
        math.log(0.5),
        math.log(8.0),
    )
    assert p.to_coordinate(5.0) == pytest.approx(math.log(5.0))
    assert p.from_coordinate(np.array([0.3])) == pytest.approx(math.exp(0.3))
    assert isinstance(p.to_coordinate(jnp.asarray(5.0)), jax.Array)
    assert not isinstance(p.to_coordinate(5.0), jax.Array)


@pytest.mark.parametrize(
    ("bounds", "unit", "text"),
    [
        ((None, None), "", "(-inf, inf)"),
        ((0, None), "1/s", "[0, inf) 1/s"),
        ((None, 2.5), "", "(-inf, 2.5]"),
        ((-1, 1), "V", "[-1, 1] V"),
    ],
)
def test_bounds_for_people(bounds, unit, text):
    assert Parameter(0.5, unit, bounds).range_text() == text


WRONG = [
    ({"value": True}, "value: expected a number in no unit"),
    ({"value": "3"}, "value: expected a number"),
    ({"bounds": (0.0,)}, "bounds: expected a pair"),
    ({"bounds": (0.0, "a")}, "bounds: expected a pair"),
    ({"bounds": 3}, "bounds: expected a pair"),
    ({"fixed": 1}, "fixed: expected true or false"),
    ({"prior": 3.0}, "prior: expected a dft.models.Normal or None"),
    ({"transform": "cubic"}, "transform: expected 'linear' or 'log'"),
    ({"size": 0.0}, "size: expected a positive finite number"),
    ({"size": math.inf}, "size: expected a positive finite number"),
    ({"size": -1.0}, "size: expected a positive finite number"),
    ({"bounds": (2.0, 2.0)}, "the lower bound 2 is not below the upper one 2"),
    ({"value": math.inf}, "expected a value within"),
    ({"value": math.nan}, "expected a value within"),
    ({"bounds": (1.51, 2.0)}, "expected a value within [1.51, 2], found 1.5"),
    ({"bounds": (1.0, 1.49)}, "expected a value within [1, 1.49], found 1.5"),
    ({"value": 0.0, "transform": "log"}, "expected a positive value, found 0"),
    ({"value": -1.0, "transform": "log"}, "expected a positive value, found -1"),
]


@pytest.mark.parametrize(("fields", "words"), WRONG)
def test_what_describes_no_parameter(fields, words):
    with pytest.raises(InputError) as refused:
        Parameter(**{"value": 1.5, **fields}).check("a")
    assert words in str(refused.value)
    assert "Parameter 'a'" in str(refused.value)


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"bounds": (1.5, 2.0)},
        {"bounds": (1.0, 1.5)},
        {"bounds": [1.0, 2.0]},
        {"size": 1e-9, "prior": Normal(0.0, 1.0), "fixed": True},
        {"value": math.inf, "null": math.inf},
        {"value": 1e-300, "transform": "log"},
        {"value": np.float32(1.0)},
    ],
)
def test_what_describes_one(fields):
    Parameter(**{"value": 1.5, **fields}).check("a")


@pytest.mark.parametrize(
    ("pattern", "units", "spelt"),
    [
        ("{command}", {"command": "V"}, "V"),
        ("{command}/s", {"command": "rad/s"}, "rad/s/s"),
        ("{command}/s", {"command": ""}, ""),
        ("rad/({command} s^2)", {"command": "V"}, "rad/(V s^2)"),
        ("rad/({command} s^2)", {"command": "effort"}, "rad/s^2 per full effort"),
        ("rad/({command} s^2)", {"command": "rad/s"}, "rad/s^2 per rad/s"),
        ("rad/({command} s^2)", {"command": "N m"}, "rad/s^2 per N m"),
        ("rad/({command} s^2)", {"command": ""}, "rad/s^2 per the unit of command"),
        ("rad/({command} s^2)", {}, "rad/s^2 per the unit of command"),
        ("N/{command}", {"command": "rad/s"}, "N per rad/s"),
        ("N/{command}", {"command": "effort"}, "N per full effort"),
        ("kg", {"command": "V"}, "kg"),
    ],
)
def test_units_that_follow_a_channel(pattern, units, spelt):
    p = Parameter(1.0, pattern).in_units(units)
    assert p.unit == spelt
    again = p.in_units({"command": "mV"})
    assert again == Parameter(1.0, pattern).in_units({"command": "mV"})


def test_the_channel_whose_unit_it_has():
    def channel(pattern):
        return Parameter(1.0, pattern).in_units({"command": "V"}).channel

    assert channel("{command}") == "command"
    assert channel("{command}/s") == "command"
    assert channel("rad/({command} s)") == ""
    assert channel("kg") == ""


def test_the_transform_that_is_taken():
    assert parameter(1.0).transform == "linear"
    assert parameter(1.0, bounds=(0, None)).transform == "log"
    assert parameter(1.0, bounds=(0.5, 2)).transform == "log"
    assert parameter(1.0, bounds=(-0.1, 2)).transform == "linear"
    assert parameter(1.0, bounds=(None, 2)).transform == "linear"
    assert parameter(0.0, bounds=(0, 2)).transform == "linear"
    assert parameter(1.0, bounds=(0, None), null=0.0).transform == "linear"
    assert parameter(1.0, bounds=(0, None), null=1.0).transform == "linear"
    assert parameter(1.0, bounds=(0, None), null=1.0, transform="log").transform == "log"
    assert parameter(1.0, bounds=(True, None)).transform == "linear"
    assert parameter("x", bounds=(0, None)).value == "x"  # refused where it is checked
    assert isinstance(parameter(2).value, float)
