"""What a status is judged by, just within and just beyond each of its limits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from problems import GRADIENT_LIMIT, RANK_LIMIT, Local, examine, failed_over, judge, marginal_spread

import diffthrust as dft
from diffthrust.estimation import Status

FINE = Local(
    gradient=1e-9,
    rank=3,
    columns=3,
    samples=50,
    condition=10.0,
    at_bound=(),
    vanished=(),
    covariance=np.eye(3),
    spread=np.eye(3),
    combinations=(),
)


def status(starts=4, agreeing=3, cost=1.0, rivals=(), alone=False, **changed):
    return judge(replace(FINE, **changed), cost, starts, agreeing, rivals, alone)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({}, Status.CONVERGED),
        ({"cost": np.inf}, Status.SIMULATION_FAILED),
        ({"cost": np.nan}, Status.SIMULATION_FAILED),
        ({"gradient": 1.01e-5}, Status.NOT_CONVERGED),
        ({"gradient": 1e-5}, Status.CONVERGED),
        ({"gradient": 1e-3, "rounding": 1e-3}, Status.CONVERGED),
        ({"gradient": 1.01e-3, "rounding": 1e-3}, Status.NOT_CONVERGED),
        ({"gradient": 0.9e-5, "rounding": 1e-7}, Status.CONVERGED),
        ({"samples": 3}, Status.NOT_IDENTIFIABLE),
        ({"samples": 4}, Status.CONVERGED),
        ({"rank": 2}, Status.NOT_IDENTIFIABLE),
        ({"rivals": ("alpha",)}, Status.NOT_IDENTIFIABLE),
        ({"agreeing": 1}, Status.STARTS_DISAGREE),
        ({"agreeing": 2}, Status.CONVERGED),
        ({"agreeing": 1, "alone": True}, Status.CONVERGED),
        ({"at_bound": ("ct",)}, Status.AT_BOUND),
        # what weighs more is said first
        ({"gradient": 1.0, "samples": 2, "cost": np.inf}, Status.SIMULATION_FAILED),
        ({"gradient": 1.0, "rank": 1, "agreeing": 1}, Status.NOT_CONVERGED),
        ({"agreeing": 1, "at_bound": ("ct",)}, Status.STARTS_DISAGREE),
    ],
)
def test_each_status_on_either_side_of_its_limit(said, expected):
    assert status(**said)[0] is expected
    assert expected.ok == (expected.value in ("converged", "converged_at_bound"))


def test_the_limits_themselves():
    assert (GRADIENT_LIMIT, RANK_LIMIT) == (1e-5, 1e-13)


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({}, "3 of 4 starts agree."),
        ({"starts": 1, "alone": True, "agreeing": 1},
         "1 of 1 starts agree. A single start says nothing of other optima."),
        ({"gradient": 2e-4}, "(gradient 2.0e-04, allowed 1e-05)"),
        ({"gradient": 2e-4, "rounding": 5e-5}, "allowed 5e-05"),
        ({"samples": 2}, "2 samples cannot determine 3 unknowns and the noise"),
        ({"rank": 1, "combinations": ("a", "b")}, "some parameters apart: a; b. Fix one"),
        ({"rivals": ("alpha", "beta")}, "they differ in alpha, beta. Narrow"),
        ({"agreeing": 1}, "Of 4 starts only one reached"),
        ({"at_bound": ("a", "b"), "vanished": ("b",)}, "with a at a bound and b at zero, held"),
        ({"at_bound": ("b",), "vanished": ("b",)}, "Converged with b at zero, held"),
        ({"at_bound": ("a", "c")}, "Converged with a, c at a bound, held"),
    ],
)  # fmt: skip
def test_the_sentence_says_why(said, words):
    assert words in status(**said)[1]


def test_a_run_that_fails_is_told_with_at_most_three_sentences():
    told = ("One.", "Two.", "Three.", "Four.")
    assert failed_over(told, "Ended.", False) == (
        Status.SIMULATION_FAILED,
        "Ended. One. Two. Three.",
    )
    found = "The model that was found cannot be simulated over whole runs. (Ended.) One. Two."
    assert failed_over(told[:2], "Ended.", True)[1] == found


# The neighbourhood of an optimum.

NAMES = ("alpha", "beta", "ct")
INFORMATION = np.array(
    [
        [40.0, 3.0, -2.0, 1.0, 0.5],
        [3.0, 90.0, 5.0, -2.0, 0.0],
        [-2.0, 5.0, 20.0, 0.7, 1.5],
        [1.0, -2.0, 0.7, 8.0, 0.9],
        [0.5, 0.0, 1.5, 0.9, 6.0],
    ]
)
GRADIENT = np.array([0.3, -0.2, 0.05, 0.4, -0.1])
SLOPES = np.array([0.3, 2.0, 5.0, 0.7])


def problem(size=5, samples=(40.0, 30.0), known=(False, True), excess=1.0, at=1.0):
    """Three parameters of a model, one of its noise, and an initial state."""
    model = dft.Thruster(alpha=0.04, beta=40.0, ct=0.02)
    named = {**model.parameters, "noise.lag": dft.Parameter(0.5, "", (0.1, 0.9), size=0.2)}
    named["ct"] = replace(named["ct"], transform="linear", size=0.5)
    return SimpleNamespace(
        own=NAMES,
        free=(*NAMES, "noise.lag"),
        named=named,
        limits=lambda: (np.full(size, -at), np.full(size, at)),
        slopes=lambda z: SLOPES,
        shared=4,
        each=1,
        turn=None,
        numbers=SimpleNamespace(counts=np.array(samples)),
        layout=SimpleNamespace(
            known_noise=known,
            likelihood=SimpleNamespace(law=SimpleNamespace(excess=excess)),
            local=("speed",),
            starts=("speed",),
        ),
    )


def q(information=INFORMATION, gradient=GRADIENT, energy=64.0, cost=1.0):
    return SimpleNamespace(cost=cost, gradient=gradient, information=information, energy=energy)


def test_the_covariance_is_that_of_all_unknowns_in_the_parameters_units():
    local = examine(problem(), np.zeros(5), q())
    # those of the noise and the initial state are free, too; five columns are used up
    whole = np.linalg.inv(INFORMATION)[:3, :3] * 70.0 / (70.0 - 5.0)
    expected = whole * np.outer(SLOPES[:3], SLOPES[:3])
    np.testing.assert_allclose(local.covariance, expected, rtol=1e-10)
    assert (local.rank, local.columns, local.samples) == (4, 4, 70)
    assert (local.at_bound, local.vanished, local.combinations) == ((), (), ())


def test_known_noise_and_a_law_that_forgives():
    plain = examine(problem(), np.zeros(5), q()).covariance * 65.0 / 70.0
    known = examine(problem(known=(True, True), excess=1.4), np.zeros(5), q()).covariance
    np.testing.assert_allclose(known, 1.4 * plain, rtol=1e-10)
    few = examine(problem(samples=(3.0, 2.0)), np.zeros(5), q()).covariance
    assert np.all(np.isinf(few))
    assert np.isfinite(examine(problem(samples=(3.0, 3.0)), np.zeros(5), q()).covariance).all()


def spread():
    """Gradient and information of all but the noise, which follows; each over its length."""
    kept, other = [0, 1, 2, 4], 3
    cross = INFORMATION[kept, other]
    left = INFORMATION[np.ix_(kept, kept)] - np.outer(cross, cross) / INFORMATION[other, other]
    slope = GRADIENT[kept] - cross / INFORMATION[other, other] * GRADIENT[other]
    length = np.sqrt(np.diagonal(INFORMATION)[kept])
    return slope / length, left / np.outer(length, length)


def test_gradient_and_condition_are_of_what_is_left():
    slope, scaled = spread()
    local = examine(problem(), np.zeros(5), q())
    assert local.gradient == pytest.approx(np.max(np.abs(slope)) / 8.0, rel=1e-12)
    values = np.linalg.eigvalsh(scaled)
    assert local.condition == pytest.approx(np.sqrt(values[-1] / values[0]), rel=1e-9)
    # residuals at rounding have no direction: their energy is a hundredth of the samples' at least
    exact = examine(problem(), np.zeros(5), q(energy=1e-9))
    assert exact.gradient == pytest.approx(np.max(np.abs(slope)) / np.sqrt(0.7), rel=1e-12)


@pytest.mark.parametrize(
    ("place", "slope", "held"),
    [(1.0, -0.2, True), (1.0, 0.2, False), (-1.0, 0.2, True), (-1.0, -0.2, False),
     (1.0 - 2e-9, -0.2, False), (1.0 - 0.5e-9, -0.2, True), (-1.0 + 0.5e-9, 0.2, True),
     (-1.0 + 2e-9, 0.2, False), (1.0, 0.0, True), (-1.0, 0.0, True)],
)  # fmt: skip
def test_at_a_bound_is_what_the_data_push_against_it(place, slope, held):
    z, gradient = np.zeros(5), GRADIENT.copy()
    z[1], gradient[1] = place, slope
    local = examine(problem(), z, q(gradient=gradient))
    assert local.at_bound == (("beta",) if held else ())
    assert local.columns == 4 - held
    assert np.isnan(local.covariance[1]).all() == held
    if held:
        rest = [0, 2, 3, 4]
        expected = np.linalg.inv(INFORMATION[np.ix_(rest, rest)])[0, 0] * 70.0 / 66.0
        assert local.covariance[0, 0] == pytest.approx(expected * SLOPES[0] ** 2, rel=1e-10)


def test_a_logarithm_that_ran_off_to_zero():
    z = np.zeros(5)
    z[0] = np.log(0.04) - 23.5
    local = examine(problem(at=99.0), z, q())
    assert (local.at_bound, local.vanished, local.columns) == (("alpha",), ("alpha",), 3)
    z[0] = np.log(0.04) - 22.5
    assert examine(problem(at=99.0), z, q()).vanished == ()


def test_an_initial_state_that_nothing_depends_on_is_no_unknown():
    information = INFORMATION.copy()
    information[4], information[:, 4] = 0.0, 0.0
    gradient = np.append(GRADIENT[:4], 0.0)
    local = examine(problem(), np.zeros(5), q(information, gradient))
    assert (local.rank, local.columns) == (3, 3)
    whole = np.linalg.inv(INFORMATION[:4, :4])[:3, :3] * 70.0 / 66.0
    np.testing.assert_allclose(local.covariance, whole * np.outer(SLOPES[:3], SLOPES[:3]))


def alike(size):
    """Alpha and beta act as one, but for a share of the information."""
    information = np.diag([4.0, 9.0, 20.0, 8.0, 6.0])
    information[0, 1] = information[1, 0] = 6.0 * (1.0 - size)
    return information


def test_what_cannot_be_told_apart_is_named_with_its_steps():
    local = examine(problem(), np.zeros(5), q(alike(0.0)))
    assert (local.rank, local.columns) == (3, 4)
    assert np.isnan(local.covariance[:2]).all()
    assert local.covariance[2, 2] == pytest.approx(25.0 / 20.0 * 70.0 / 65.0)
    # their logarithms: one by three parts for two of the other, against each other
    (told,) = local.combinations
    assert told in (
        "changing alpha by +1 % and beta by -0.67 % together changes nothing that was measured",
        "changing alpha by -1 % and beta by +0.67 % together changes nothing that was measured",
    )
    information = INFORMATION.copy()
    information[2], information[:, 2] = 0.0, 0.0
    (told,) = examine(problem(), np.zeros(5), q(information)).combinations
    assert told == "ct changes nothing that was measured"


def test_a_linear_parameter_and_an_initial_state_in_words():
    information = np.diag([40.0, 90.0, 4.0, 8.0, 9.0])
    information[2, 4] = information[4, 2] = 6.0
    (told,) = examine(problem(), np.zeros(5), q(information)).combinations
    step = 0.01 * 0.5  # a hundredth of its size
    words = "and an initial state together changes nothing that was measured"
    assert told in (f"changing ct by {sign}{step:.2g} N s^2/rad^2 {words}" for sign in "+-")


def test_initial_states_that_only_each_other_replace_are_no_unknowns():
    """As two states are that only the sum of both tells of."""
    of_two = problem(size=6)
    of_two.each, of_two.layout.local = 2, ("speed", "turn")
    of_two.layout.starts = of_two.layout.local
    information = np.zeros((6, 6))
    information[:4, :4] = np.diag([40.0, 90.0, 20.0, 8.0])
    information[4:, 4:] = np.outer([3.0, 2.0], [3.0, 2.0])
    local = examine(of_two, np.zeros(6), q(information, np.zeros(6)))
    assert (local.rank, local.columns, local.combinations) == (4, 4, ())
    assert np.isfinite(local.covariance).all()
    assert local.condition == pytest.approx(np.sqrt(2.0))  # in unit columns: 2 of the pair, 1
    information[0, 1] = information[1, 0] = 60.0  # and alpha and beta beside them
    local = examine(of_two, np.zeros(6), q(information, np.zeros(6)))
    assert (local.rank, local.columns) == (3, 4)
    (told,) = local.combinations
    assert "alpha" in told
    assert "beta" in told
    assert "initial" not in told


@pytest.mark.parametrize(("share", "apart"), [(0.5e-13, False), (4e-13, True)])
def test_what_only_rounding_tells_apart(share, apart):
    # of the scaled information the eigenvalues of the pair are share and 2 - share
    local = examine(problem(), np.zeros(5), q(alike(share)))
    assert (local.rank == local.columns) == apart


def test_a_failed_simulation_has_no_neighbourhood():
    local = examine(problem(), np.zeros(5), q(cost=np.inf))
    assert (local.gradient, local.rank, local.columns, local.samples) == (np.inf, 0, 5, 0)
    assert np.isnan(local.covariance).all()
    assert local.covariance.shape == (3, 3)
    assert local.condition == np.inf


INSIDE, BESIDE = np.array([0, 1, 2]), np.array([3, 4])


def spread_information(rng):
    rows = rng.standard_normal((40, 5))
    return rows.T @ rows, rng.standard_normal(5)


def test_what_others_follow_leaves_the_covariance_and_the_step_as_they_are():
    information, slope = spread_information(np.random.default_rng(1))
    gradient, left = marginal_spread(slope, information, INSIDE, BESIDE)
    whole = np.linalg.inv(information)
    np.testing.assert_allclose(np.linalg.inv(left), whole[:3, :3], rtol=1e-10)
    np.testing.assert_allclose(np.linalg.solve(left, gradient), (whole @ slope)[:3], rtol=1e-10)
    np.testing.assert_array_equal(left, left.T)


def test_a_start_that_nothing_tells_of_takes_nothing_away():
    information, slope = spread_information(np.random.default_rng(2))
    information[3], information[:, 3], slope[3] = 0.0, 0.0, 0.0  # a state that no sensor feels
    gradient, left = marginal_spread(slope, information, INSIDE, BESIDE)
    expected = marginal_spread(slope, information, INSIDE, BESIDE[1:])
    np.testing.assert_allclose(gradient, expected[0], rtol=1e-9)
    np.testing.assert_allclose(left, expected[1], rtol=1e-9)
    alone = marginal_spread(slope, information, INSIDE, BESIDE[:0])
    np.testing.assert_array_equal(alone[1], information[:3, :3])
