import numpy as np
import pytest
from presentation import listing, nearest

from diffthrust import InputError
from diffthrust.logs import _units  # private: what is read without pint
from diffthrust.logs._units import (  # private: units alone
    CHANNEL_UNITS,
    convert,
    convert_scale,
    same_quantity,
    si_unit,
    unit_in,
)

# Written by hand, independently of pint.
FACTORS = [
    ("rpm", "rev/s", 1 / 60),
    ("rpm", "rad/s", 2 * np.pi / 60),
    ("rev/min", "rad/s", 2 * np.pi / 60),
    ("rps", "rad/s", 2 * np.pi),
    ("rev/s", "rad/s", 2 * np.pi),
    ("deg/s", "rad/s", np.pi / 180),
    ("deg", "rad", np.pi / 180),
    ("rev", "rad", 2 * np.pi),
    ("us", "s", 1e-6),
    ("µs", "s", 1e-6),
    ("ms", "s", 1e-3),
    ("kN", "N", 1e3),
    ("kgf", "N", 9.80665),
    ("lbf", "N", 4.4482216152605),
    ("knot", "m/s", 1852 / 3600),
    ("kn", "m/s", 1852 / 3600),
    ("Nm", "N*m", 1.0),
    ("N·m", "N m", 1.0),
    ("kg m^2", "kg*m**2", 1.0),
    ("km/h", "m/s", 1 / 3.6),
    ("mV", "V", 1e-3),
    ("1/min", "1/s", 1 / 60),
    ("%", "", 0.01),
    ("1", "", 1.0),
    ("N/(m/s)^2", "kg/m", 1.0),
]


@pytest.mark.parametrize(("source", "target", "factor"), FACTORS)
def test_factors(source, target, factor):
    values = np.array([-3.0, 0.0, 7.5, np.nan])
    np.testing.assert_allclose(
        convert(values, source, target, where="here"), values * factor, rtol=1e-12
    )
    back = convert(values * factor, target, source, where="here")
    np.testing.assert_allclose(back, values, rtol=1e-12)


def test_common_units_are_those_of_pint():
    registry = _units._registry()
    for si, units in _units._FACTORS.items():
        for unit, factor in units.items():
            assert registry.Quantity(1.0, unit).to(si).magnitude == pytest.approx(factor, rel=1e-15)


def test_common_units_do_not_load_pint(monkeypatch):
    monkeypatch.setattr(_units, "_registry", lambda: pytest.fail("pint was asked"))
    for cached in (_units._parse, _units._base, _units._mend_unknown):
        cached.cache_clear()
    for si, units in _units._FACTORS.items():
        for unit in units:
            assert si_unit(unit) == si
            assert same_quantity(unit, si)
            assert not same_quantity(unit, "m" if si != "m" else "s")
            assert convert(1.0, unit, si, where="here").shape == ()
    assert si_unit("rpm", "propeller_speed") == "rev/s"
    assert si_unit("rpm", "speed") == "rad/s"
    assert [unit_in(f"[{text}]") for text in ("-0.051", "1376", "...")] == [""] * 3


def test_a_unit_that_is_no_text_is_refused_in_words():
    with pytest.raises(InputError, match="expected a unit as text, found"):
        si_unit(["rpm"], "speed")


def test_offset_counts_for_values_and_not_for_widths():
    assert convert([20.0], "degC", "K", where="here")[0] == pytest.approx(293.15)
    assert convert_scale(2.0, "degC", "K", where="here") == pytest.approx(2.0)
    assert convert_scale(9.0, "degF", "degC", where="here") == pytest.approx(5.0)


def test_convert_copies():
    values = np.ones(3)
    assert convert(values, "V", "V", where="here") is not values


@pytest.mark.parametrize("unit", ["Hz", "1/s", "cps", "count/s", "kHz", "1/min"])
@pytest.mark.parametrize("target", ["rad/s", "rev/s", "rpm"])
def test_plain_frequency_is_ambiguous_for_a_speed_of_rotation(unit, target):
    for pair in ((unit, target), (target, unit)):
        with pytest.raises(InputError, match="ambiguous") as caught:
            convert([1.0], *pair, where="run1.csv, column 'n'")
        assert "'rev/s' or 'rad/s'" in caught.value.mend
        assert caught.value.problem.startswith("run1.csv, column 'n': ")


def test_angle_is_not_a_plain_number():
    with pytest.raises(InputError, match="plain number"):
        convert([1.0], "%", "rad", where="here")


def test_wrong_dimension_names_both_units():
    with pytest.raises(InputError) as caught:
        convert([1.0], "kN", "rad/s", where="run1.csv, column 'n'")
    message = str(caught.value)
    assert "'kN'" in message
    assert "'rad/s'" in message
    assert "run1.csv, column 'n'" in message


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [("rad/sec0", "rad/s"), ("newtn", "newton"), ("RPm", "rpm"), ("Volt", "volt")],
)
def test_unknown_unit_names_the_nearest(wrong, meant):
    with pytest.raises(InputError) as caught:
        convert([1.0], wrong, "N", where="here")
    assert meant in caught.value.mend


@pytest.mark.parametrize(
    "nonsense",
    [
        *["9**9**9", "m^9^9^9", "(m^9)^99", "2*m", '"', "m;s", "import os", "(", "m//s", "\n"],
        *["__class__", "lambda", "m^", "1e999", "m**1e999", "[m]", "dB", "Δ", "delta_degC*dB"],
        "m" * 500,
    ],
)
def test_nonsense_is_refused_quickly(nonsense):
    with pytest.raises(InputError):
        convert([1.0], nonsense, "N", where="here")


def test_unit_must_be_text():
    with pytest.raises(InputError, match="as text"):
        convert([1.0], 3, "N", where="here")  # type: ignore[arg-type]


def test_si_unit_of_a_standard_channel_is_its_own():
    assert si_unit("rpm", "speed") == "rad/s"
    assert si_unit("rpm", "propeller_speed") == "rev/s"
    assert si_unit("deg", "rudder_angle") == "rad"
    assert si_unit("kgf", "thrust") == "N"
    assert si_unit("", "speed") == ""


def test_si_unit_of_other_quantities():
    assert si_unit("us", "command") == "s"  # pulse widths, for a model commanded in them
    assert si_unit("mV", "my_channel") == "V"
    assert si_unit("%") == "dimensionless"
    with pytest.raises(InputError, match="ambiguous"):
        si_unit("Hz", "speed")


@pytest.mark.parametrize("unit", ["N s/m", "1/min", "ml/min", "kWh", "uT", "V/(rad/s)", "count"])
def test_si_unit_is_coherent_and_readable(unit):
    inside = si_unit(unit)
    there = convert([2.0, 3.0], unit, inside, where="here")
    np.testing.assert_allclose(convert(there, inside, unit, where="here"), [2.0, 3.0])
    assert si_unit(inside) == inside


def test_channels_have_units_that_convert():
    for name, unit in CHANNEL_UNITS.items():
        assert si_unit(unit, name) == unit
        convert([1.0], unit, f"{unit}*m/m", where=name)


def test_nearest_and_listing():
    assert nearest("Sped", ["speed", "thrust"]) == "the nearest is 'speed'"
    assert nearest("xyz", ["speed"]) == ""
    assert listing([]) == "none"
    assert listing("abc", limit=2) == "'a', 'b' and 1 more"
