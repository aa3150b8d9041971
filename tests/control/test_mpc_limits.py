"""Limits of states and of the inputs' rates in predictive control, and the point that follows."""

import math

import jax
import numpy as np
import pytest
from bounded_squares import least_squares_below
from paper_vessel import AT_SEA, LIMITS, PAPER, mpc, rates, tracked
from scipy.integrate import solve_ivp
from scipy.optimize import LinearConstraint, minimize

from diffthrust import InputError
from diffthrust.control import HarmonicPath, StraightPath

SLEW = {"propeller_speed": 40.0, "rudder_angle": 0.3}


def wide(**states):
    """Limits of states of which those that are not named do not matter: one compilation for all."""
    far = {"surge": (-math.inf, 9.0), "yaw_rate": (-9.0, 9.0), "north": (-math.inf, 99.0)}
    return {**LIMITS, **far, **states}


# -- least squares with limits on combinations -----------------------------------------------------


def test_least_squares_with_hard_and_soft_limits_against_scipy():
    """SLSQP has a variable more for each soft limit: its excess, which is squared as well."""
    rng, solve, hit = np.random.default_rng(0), jax.jit(least_squares_below), 0
    n, soft = 6, 8
    for _ in range(20):
        jacobian, residual = rng.standard_normal((9, n)), 3.0 * rng.standard_normal(9)
        box = rng.uniform(0.1, 1.0, 2 * n)
        rows = np.vstack([np.eye(n), -np.eye(n), rng.standard_normal((soft, n))])
        limits = np.concatenate([box, rng.uniform(-0.3, 0.5, soft)])
        give = np.concatenate([np.zeros(2 * n), 10.0 ** rng.uniform(-2, 0, soft)])
        x = np.asarray(solve(jacobian, residual, rows, limits, give))
        assert np.all(rows[: 2 * n] @ x <= box + 1e-9)

        def cost(z, jacobian=jacobian, residual=residual, give=give[-soft:]):
            off, excess = jacobian @ z[:n] + residual, z[n:] / give
            slope = np.concatenate([jacobian.T @ off, excess / give])
            return 0.5 * (off @ off + excess @ excess), slope

        wide = np.hstack([rows, np.vstack([np.zeros((2 * n, soft)), -np.eye(soft)])])
        kept = LinearConstraint(wide, -np.inf, limits)
        start = np.concatenate([np.zeros(n), np.maximum(0.0, -limits[-soft:])])
        truth = minimize(cost, start, jac=True, method="SLSQP", constraints=kept,
                         options={"ftol": 1e-13, "maxiter": 500})  # fmt: skip
        excess = np.maximum(rows[-soft:] @ x - limits[-soft:], 0.0)
        assert cost(np.concatenate([x, excess]))[0] == pytest.approx(truth.fun, rel=1e-6)
        np.testing.assert_allclose(x, truth.x[:n], atol=1e-4)
        hit += int(np.sum(excess > 0)) + int(np.sum(rows[: 2 * n] @ x > box - 1e-8))
    assert hit > 60  # the limits did matter


def test_a_limit_that_is_none_and_a_column_without_slope_do_no_harm():
    rng = np.random.default_rng(1)
    jacobian, residual = rng.standard_normal((6, 3)), rng.standard_normal(6)
    free = least_squares_below(jacobian, residual, np.eye(3), np.full(3, np.inf), np.zeros(3))
    np.testing.assert_allclose(free, np.linalg.lstsq(jacobian, -residual)[0], atol=1e-9)
    jacobian[:, 1] = 0.0
    box = np.vstack([np.eye(3), -np.eye(3)])
    x = least_squares_below(jacobian, residual, box, np.full(6, 0.2), np.zeros(6))
    assert np.all(np.abs(x) <= 0.2 + 1e-9)


# -- one plan against an independent optimum -------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("point", [0.0, 0.4])
def test_a_limited_plan_is_the_best_one_there_is(point):
    """The same problem for SLSQP, with the equations written out and DOP853."""
    turn, fastest = 0.12, 0.72
    controller = mpc(limits={**LIMITS, "yaw_rate": (-turn, turn), "surge": (-math.inf, fastest)},
                     slew=SLEW, point=point, horizon=5, rate=2.0, iterations=60)  # fmt: skip
    start = np.array([0.7, 0.02, -0.05, 0.3, 0.7, 0.1])
    wanted = StraightPath(0.8).at(controller.ahead)
    measured = dict(zip(AT_SEA, start, strict=True))
    plan = controller.step(controller.start(measured), measured, wanted)
    assert plan.settled
    low, high = np.array(list(LIMITS.values())).T
    before, known = np.array([75.0, 0.0]), {}

    def path(flat):
        key = flat.tobytes()
        if key not in known:
            state, states = start, []
            for n, a in low + flat.reshape(-1, 2) * (high - low):
                found = solve_ivp(rates, (0.0, 0.5), state, "DOP853", args=(n, a), rtol=1e-9)
                state = found.y[:, -1]
                states.append(state)
            known[key] = np.array(states)
        return known[key]

    def changes(flat):
        return np.diff(np.vstack([before, low + flat.reshape(-1, 2) * (high - low)]), axis=0)

    def cost(flat):
        states = path(flat)
        north = states[:, 3] + point * np.cos(states[:, 5]) - wanted.north
        east = states[:, 4] + point * np.sin(states[:, 5]) - wanted.east
        weighed = changes(flat) / ((high - low) / controller.rate)
        return np.sum(north**2 + east**2) / 0.3**2 + np.sum(weighed**2)

    def room(flat):
        states, most = path(flat), np.array([40.0, 0.3]) / controller.rate
        moved = changes(flat) / most
        turning = [turn - states[:, 2], turn + states[:, 2]]
        return np.concatenate([(1.0 - moved).ravel(), (1.0 + moved).ravel(), *turning,
                               fastest - states[:, 0]])  # fmt: skip

    planned = np.asarray(plan.planned).ravel()
    slack = room(planned)
    assert np.min(slack[:20]) > -1e-9  # rates hold
    assert np.min(slack[20:]) > -1e-3  # states to a thousandth
    assert max(np.min(slack[:20]), np.min(slack[20:])) < 1e-4  # and both matter
    truth = minimize(cost, np.clip(planned + 0.02, 0.05, 0.95), method="SLSQP",
                     bounds=[(0, 1)] * planned.size, constraints={"type": "ineq", "fun": room},
                     options={"ftol": 1e-10, "maxiter": 200})  # fmt: skip
    assert cost(planned) == pytest.approx(truth.fun, rel=2e-3)
    np.testing.assert_allclose(path(planned)[:, 3:5], path(truth.x)[:, 3:5], atol=2e-3)


# -- along paths -----------------------------------------------------------------------------------


@pytest.mark.thorough
def test_rates_of_inputs_are_kept_and_cost_no_precision_in_the_end():
    free, slow = tracked(duration=25.0), tracked(duration=25.0, slew=SLEW)
    for name, fastest in SLEW.items():
        most = [np.max(np.abs(np.diff(run[name]))) * 5.0 for run in (free, slow)]
        assert most[0] > 1.3 * fastest  # otherwise the limit would be none
        assert 0.999 * fastest < most[1] <= fastest * (1 + 1e-9)
    assert abs(slow["propeller_speed"][0] - 75.0) <= 8.0 + 1e-9  # the first one, too
    assert slow.across(20.0).largest < 2e-3


@pytest.mark.thorough
def test_limits_of_states_are_kept_where_the_model_is_right():
    limits = wide(yaw_rate=(-0.1, 0.1), surge=(-math.inf, 0.84))
    free, kept = tracked(duration=25.0), tracked(duration=25.0, limits=limits)
    assert np.max(np.abs(free["yaw_rate"])) > 0.15
    assert 0.0999 < np.max(np.abs(kept["yaw_rate"])) < 0.1001
    assert np.max(free["surge"]) > 0.842
    assert np.max(kept["surge"]) < 0.8401
    assert kept.across(20.0).largest < 2e-3
    assert kept["settled"].mean() > 0.9


@pytest.mark.thorough
def test_a_wall_beside_the_path_is_not_crossed():
    """The path weaves 1.5 m to either side, and the water ends 1 m to the north."""
    path = HarmonicPath(0.8, amplitude=1.5, wavelength=15.0, course=math.pi / 2)
    run = tracked(path, duration=30.0, initial=None, limits=wide(north=(-math.inf, 1.0)))
    assert run["reference.north"].max() > 1.4
    assert 0.995 < run["north"].max() < 1.001


def sailed(run):
    """North and east of a run's inputs, with the equations written out and DOP853."""
    n, a = run["propeller_speed"], run["rudder_angle"]
    state, track = [run[name][0] for name in AT_SEA], []
    for k in range(run.time.size):
        track.append(state[3:5])
        state = solve_ivp(rates, (0.0, 0.2), state, "DOP853", args=(n[k], a[k]), rtol=1e-9).y[:, -1]
    return np.array(track).T


@pytest.mark.thorough
def test_a_path_that_is_too_fast_waits_and_the_vessel_stays_on_it():
    """A surge of 0.6 m/s at most, on a path of 0.8: the boat left it at 0.022 m/s."""
    run = tracked(duration=40.0, limits=wide(surge=(-math.inf, 0.6)))
    north, east = sailed(run)
    settled = run.time > 20.0
    np.testing.assert_allclose(north, run["north"], atol=1e-3)
    assert np.max(np.abs(north[settled])) < 0.03
    assert np.polyfit(run.time[settled], east[settled], 1)[0] == pytest.approx(0.6, abs=2e-3)
    # the place that is wanted keeps the boat's pace, and says how late it is
    waited = np.diff(run["late"])[settled[1:]].mean() * 5.0
    assert waited == pytest.approx(1.0 - 0.6 / 0.8, abs=2e-3)
    np.testing.assert_allclose(run["reference.east"], 0.8 * (run.time - run["late"]))
    assert run.along(20.0).largest < 0.6
    assert run["settled"][settled].all()


def test_a_path_does_not_wait_for_a_vessel_that_catches_up():
    run = tracked(duration=25.0, initial={"surge": 0.0}, limits=wide())
    assert run["along"].min() < -0.6  # from rest
    assert not run["late"].any()
    assert run.along(20.0).largest < 0.05


def test_a_state_that_begins_beyond_its_limit_comes_back():
    run = tracked(initial={**PAPER, "surge": 1.1}, duration=15.0,
                  limits=wide(surge=(-math.inf, 0.82)))  # fmt: skip
    assert run["surge"][0] == pytest.approx(1.1)
    assert np.max(run["surge"][run.time > 3.0]) < 0.8202
    assert run.across(12.0).largest < 5e-3


def test_the_control_point_follows_the_path_and_the_centre_of_gravity_cuts_the_corner():
    """Figure 1 of the paper: the point that is controlled lies ahead of the centre of gravity."""
    path = HarmonicPath(0.8, amplitude=1.5, wavelength=15.0, course=math.pi / 2)
    run = tracked(path, duration=30.0, initial=None, point=0.4)
    east = run["east"] + 0.4 * np.sin(run["heading"])
    north = run["north"] + 0.4 * np.cos(run["heading"])
    np.testing.assert_allclose(run["point.east"], east)
    np.testing.assert_allclose((north[0], east[0]), (0.0, 0.0), atol=1e-12)  # it begins there
    off = np.hypot(north - run["reference.north"], east - run["reference.east"])
    behind = np.hypot(run["north"] - run["reference.north"], run["east"] - run["reference.east"])
    late = run.time > 10.0
    np.testing.assert_allclose(np.hypot(run["along"], run["across"]), off, atol=1e-9)
    assert np.max(off[late]) < 0.1
    assert np.min(behind[late]) > 0.3
    assert run.plot().axes[0].get_legend_handles_labels()[1] == ["path", "control point", "start"]


@pytest.mark.thorough
def test_compiling_is_told_apart_from_solving(nothing_stored):
    run = tracked(duration=3.0, horizon=7)  # of a length that nothing else has compiled
    took = run.solve_time
    assert took.compiling > 10.0 * took.largest
    assert run["solve_time"].size == run.time.size
    assert took.largest == np.max(run["solve_time"])
    assert "s to compile before them" in str(took)


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"limits": {**LIMITS, "surge": (0.9, 0.1)}}, "highest value of 'surge' .m/s."),
        ({"limits": {**LIMITS, "surge": (-math.inf, math.inf)}}, "highest value of 'surge'"),
        ({"limits": {**LIMITS, "surg": (0, 1)}}, "has no 'surg'.*'surge'"),
        ({"limits": {**LIMITS, "propeller_speed": (0.0, math.inf)}}, "of 'propeller_speed'"),
        ({"slew": {"rudder_angle": 0.0}}, "slew of 'rudder_angle': expected a number above zero"),
        ({"slew": {"rudder": 1.0}}, "slew: the model has no 'rudder'"),
        ({"slew": 0.3}, "slew: expected a dictionary"),
        ({"point": math.nan}, "point: expected metres ahead"),
    ],
)
def test_limits_that_cannot_be_meant_are_refused(change, words):
    with pytest.raises(InputError, match=f"(?s){words}"):
        mpc(**change)
