"""A profile and a row of intervals: their units, arms and sentences, at each limit."""

from dataclasses import replace

import numpy as np
import pytest
from posterior_cases import PROFILE, Interval, Row, scaled


def test_the_unit_for_people():
    told = PROFILE.shown
    assert (told.unit, told.value, told.low, told.high) == ("mV", 2000.0, 1500.0, 2600.0)
    assert (told.std_error, told.bounds, told.per) == (300.0, (500.0, None), 1.0)
    np.testing.assert_array_equal(told.grid, [1400.0, 2000.0, 2700.0])
    assert told.shown is told
    assert replace(PROFILE, std_error=None).shown.std_error is None
    written = PROFILE.to_json()["written"]
    ends = {"value": 2000.0, "unit": "mV", "low": 1500.0, "high": 2600.0, "std_error": 300.0}
    assert written == ends
    assert scaled((2.0, None), 3.0) == (6.0, None)
    assert scaled((None, -2.0), 3.0) == (None, -6.0)
    row = Row("a", "V", 2.0, {"profile": Interval(1.5, None)}, "profile", (), (None, 3.0),
              1000.0, "mV")  # fmt: skip
    assert row.shown.value == 2000.0
    assert row.shown.best == (1500.0, None)
    assert row.shown.bounds == (None, 3000.0)
    assert row.shown.shown is row.shown or row.shown.shown == row.shown
    data = row.to_json()
    assert data["written"] == {
        "value": 2000.0,
        "unit": "mV",
        "intervals": {"profile": [1500, None]},
    }
    assert data["value"] == 2.0


def test_what_lies_within():
    for inside in (1.0, 2.0, 3.0):
        assert Interval(1.0, 3.0).holds(inside)
    assert not Interval(1.0, 3.0).holds(0.999)
    assert not Interval(1.0, 3.0).holds(3.001)
    assert Interval(None, 3.0).holds(-9.0)
    assert Interval(1.0, None).holds(9.0)
    assert not Interval(1.0, None).holds(0.0)


def test_the_arms_of_a_profile():
    assert PROFILE.lopsided == pytest.approx(0.6 / 0.5)
    assert replace(PROFILE, low=None).lopsided is None
    assert replace(PROFILE, high=None).lopsided is None
    assert replace(PROFILE, low=2.0).lopsided is None
    even = replace(PROFILE, high=2.5, shown_unit="")
    assert even.sentence == "a lies between 1.50 and 2.50 V (90 %)."
    assert replace(even, high=2.57).sentence.endswith("(90 %).")  # 1.14 times as far
    told = "reaching 1.2 times as far up as the other way."
    assert replace(even, high=2.58).sentence.endswith(told)
    assert replace(even, high=2.44).sentence.endswith("(90 %).")
    told = "reaching 1.2 times as far down as the other way."
    assert replace(even, high=2.43).sentence.endswith(told)
    assert replace(even, high=None, open_high="it goes on").sentence == (
        "a is at least 1.50 V (90 %); upwards it goes on."
    )
    assert replace(even, low=None, open_low="it goes on", unit="").sentence == (
        "a is at most 2.50 (90 %); downwards it goes on."
    )
    assert replace(even, low=None, high=None, open_low="x", open_high="y").sentence == (
        "a is not bounded by these logs: downwards x, upwards y."
    )
