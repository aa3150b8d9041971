"""Records of free sailing, sorted into steady, accelerating and turning portions."""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.papers import manoeuvres


def sailing() -> dft.Log:
    """At rest for 10 s, faster for 20 s, even for 20 s, a turn of 20 s, even again for 20 s."""
    time = np.arange(0.0, 90.0, 0.1)
    surge = np.interp(time, [10.0, 30.0], [0.0, 2.0])
    yaw_rate = np.where((time >= 50.0) & (time < 70.0), 0.4, 0.0)
    inputs = {"propeller_speed": np.ones_like(time), "rudder_angle": np.zeros_like(time)}
    return dft.Log(time, inputs, {"surge": surge, "yaw_rate": yaw_rate})


def test_each_portion_is_found_where_it_is():
    found = manoeuvres(sailing())
    assert [len(kind) for kind in (found.steady, found.accelerating, found.turning)] == [2, 1, 1]
    places = [(log.time[0], log.time[-1]) for kind in vars(found).values() for log in kind]
    expected = [(30.0, 50.0), (70.0, 90.0), (10.0, 30.0), (50.0, 70.0)]
    assert np.abs(np.array(places) - expected).max() < 3.0  # half of what it is smoothed over
    assert found.summary.startswith("2 steady (")


def test_what_is_shorter_than_asked_for_belongs_nowhere():
    found = manoeuvres(sailing(), least=19.0, smoothing=1.0)
    assert not any(log.duration < 19.0 for kind in vars(found).values() for log in kind)
    assert not manoeuvres(sailing(), least=50.0).turning


def test_gaps_in_the_measurement_do_not_matter():
    log = sailing()
    surge = log.measured["surge"].copy()
    surge[400:405] = np.nan
    gaps = dft.Log(log.time, log.inputs, {**log.measured, "surge": surge})
    assert manoeuvres(gaps).summary == manoeuvres(log).summary


def test_a_length_that_is_none_is_refused():
    with pytest.raises(dft.InputError, match=r"manoeuvres, least: expected seconds.*found 0"):
        manoeuvres(sailing(), least=0.0)
    with pytest.raises(dft.InputError, match="manoeuvres: no record was given"):
        manoeuvres([])
    with pytest.raises(dft.InputError, match="expected a channel 'surge'"):
        manoeuvres(dft.Log([0.0, 1.0], {"command": [0.0, 1.0]}))
