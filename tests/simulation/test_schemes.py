"""One step of the integrator written out in NumPy, and what its parts make of their inputs."""

from decimal import Decimal, getcontext
from math import factorial

import numpy as np
import pytest
from trajectories import (
    SERIES,
    TURN,
    advance,
    exponential_weights,
    integrate,
    plain_rate,
    with_push,
    within,
)

from diffthrust.models import Relaxing

H = 0.13
INPUTS = {"u": (0.4, -0.7, 1.9), "w": (0.3, 0.8), "v": (1.1,)}


def at(share):
    """The inputs at a share of the step: by three values, by a line, held."""
    return {
        "u": {0.0: 0.4, 0.5: -0.7, 1.0: 1.9}[share],
        "w": 0.3 + 0.5 * share,
        "v": 1.1,
    }


def plain(s, u):
    return {"x": u["u"] * s["y"] - s["x"] ** 2, "y": u["w"] + u["v"] * np.sin(s["x"]) - s["y"]}


def classical(x, h=H):
    """The Runge-Kutta step of the textbooks."""

    def slope(state, share):
        return plain(state, at(share))

    def moved(by, k):
        return {n: x[n] + by * k[n] for n in x}

    k1 = slope(x, 0.0)
    k2 = slope(moved(h / 2, k1), 0.5)
    k3 = slope(moved(h / 2, k2), 0.5)
    k4 = slope(moved(h, k3), 1.0)
    return {n: x[n] + h / 6 * (k1[n] + 2 * k2[n] + 2 * k3[n] + k4[n]) for n in x}


def test_a_step_of_plain_states_is_that_of_the_textbooks():
    x = {"x": 0.6, "y": -1.2}
    found, expected = advance(plain, x, INPUTS, H, {}), classical(x)
    for name in x:
        assert float(found[name]) == pytest.approx(expected[name], rel=1e-13)


DECAY = 5.3


def mixed(s, u):
    rates = plain(s, u)
    target = 2.0 * u["u"] + 0.3 * s["x"]
    fast = DECAY * (target - s["fast"])
    return {"x": rates["x"] + 0.7 * s["fast"], "y": rates["y"], "fast": Relaxing(fast, DECAY)}


def exponential(x, h=H):
    """The step with one relaxing state: a look at the start, one ahead, and four stages."""
    w = {n: float(v) for n, v in exponential_weights(np.array(h), np.array(DECAY)).items()}
    half, rise = w["half"], 0.5 * w["grown"]
    names = [n for n in x if n != "fast"]

    def slope(state, share):
        found = mixed(state, at(share))
        out = {n: found[n] for n in names}
        return {**out, "fast": found["fast"].rate + DECAY * state["fast"]}

    def state(fast, plain_part):
        return {**plain_part, "fast": fast}

    still = {n: x[n] for n in names}
    k0 = mixed(x, at(0.0))["fast"].rate
    f0 = x["fast"]
    s1 = state(f0 + h * w["start"] * k0, still)
    n1 = slope(s1, 0.0)
    ahead = {n: x[n] + h / 2 * n1[n] for n in names}
    low = h * w["mean"] * k0
    s2 = state(half * f0 - low + h * rise * n1["fast"], ahead)
    n2 = slope(s2, 0.5)
    fast3 = half * f0 - low + h * (w["ramp"] * n2["fast"] + (rise - w["ramp"]) * n1["fast"])
    s3 = state(fast3, ahead)
    n3 = slope(s3, 0.5)
    s4 = state(half * f0 - low + h * rise * n3["fast"], {n: x[n] + h / 2 * n3[n] for n in names})
    n4 = slope(s4, 0.5)
    fast5 = half**2 * f0 + h * rise * (2 * n4["fast"] + (half - 1.0) * n1["fast"])
    s5 = state(fast5, {n: x[n] + h * n4[n] for n in names})
    n5 = slope(s5, 1.0)
    out = {n: x[n] + h / 6 * (n1[n] + 2 * n3[n] + 2 * n4[n] + n5[n]) for n in names}
    out["fast"] = w["kept"] * f0 + h * (
        w["first"] * n1["fast"] + 2 * w["both"] * (n3["fast"] + n4["fast"]) + w["last"] * n5["fast"]
    )
    return out


def test_a_step_with_a_relaxing_state_stage_by_stage():
    x = {"x": 0.6, "y": -1.2, "fast": 2.1}
    weights = {"fast": exponential_weights(np.array(H), np.array(DECAY))}
    found, expected = advance(mixed, x, INPUTS, H, weights), exponential(x)
    for name in x:
        assert float(found[name]) == pytest.approx(expected[name], rel=1e-12), name


getcontext().prec = 60


@pytest.mark.parametrize("ratio", [1e-7, 1e-3, 0.2, 0.97, 1.0, 1.03, 2.5, 12.0, 400.0])
def test_the_weight_that_looks_ahead(ratio):
    r = Decimal(ratio)
    z, e, eh = -r, (-r).exp(), (-r / 2).exp()
    half = Decimal("0.5")
    exact = 6 * (-half / z - 1 / z**2 - (1 - e) / z**3) + 2 * (1 - eh) / z
    found = exponential_weights(np.array(0.25), np.array(4.0 * ratio))
    assert float(found["ramp"]) == pytest.approx(float(exact), rel=2e-12, abs=1e-13)
    assert float(found["decay"]) == 4.0 * ratio
    assert TURN == 81.0


def test_the_series_go_far_enough():
    assert {name: len(terms) for name, terms in SERIES.items()} == {
        "first": 16, "both": 16, "last": 16, "ramp": 16, "mean": 15,
    }  # fmt: skip
    for terms in SERIES.values():
        assert 0 < abs(terms[-1]) < 1e-13
        assert abs(terms[-1]) > 1.0 / factorial(22)


def test_an_input_over_a_part_of_a_step():
    assert within((2.0,), 1, 4) == (2.0,)
    assert within((2.0, 6.0), 0, 1) == (2.0, 6.0)
    assert within((2.0, 5.0), 1, 4) == (2.75, 3.5)
    assert within((2.0, 5.0), 3, 4) == (4.25, 5.0)


def test_what_is_pushed_and_plain():
    assert plain_rate(Relaxing(3.0, 2.0)) == plain_rate(3.0) == 3.0
    assert with_push(Relaxing(3.0, 2.0), 0.5) == Relaxing(3.5, 2.0)
    assert with_push(3.0, 0.5) == 3.5


def test_corrections_and_restarts_come_before_their_step():
    seen = []

    def correct(state, u, row):
        seen.append((row, u))
        return {"x": state["x"] + row["by"]}

    path = integrate(
        lambda s, u: {"x": u["u"] + 0.0 * s["x"]},
        {"x": 1.0},
        {"u": (np.array([2.0, 3.0, 4.0]),)},
        np.array([0.5, 0.25, 0.5]),
        {"x": (np.array([np.nan, 10.0, np.nan]), False)},
        correct,
        {"by": np.array([0.1, 0.2, 0.3])},
    )["x"]
    # 1 + .1 + 2 * .5, then 10 + .2 + 3 * .25, then + .3 + 4 * .5
    np.testing.assert_allclose(path, [1.0, 2.1, 10.95, 13.25], rtol=1e-13)
