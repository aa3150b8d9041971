"""The horizon of a fit is chosen by whole runs of logs that are left out."""

from types import SimpleNamespace

import numpy as np
import pytest
from compilations import compilations
from gusty_runs import MISSING, gusty_runs, model_of
from problems import (
    Search,
    Solved,
    build,
    folds,
    horizons_module,
    multistart_module,
    restarts,
    solve,
    without,
)

import diffthrust as dft


def error(logs, horizon, length):
    fit = dft.fit(model_of(length), logs[:3], holdout=logs[3:], horizon=horizon, starts=2)
    return fit.holdout.nrmse, fit


@pytest.mark.thorough
def test_segments_are_kept_where_logs_that_are_left_out_say_so():
    logs = gusty_runs(21, "nothing", 6.0, 30.0, 0.15)
    chosen, fit = error(logs, "auto", 6.0)
    assert fit.horizon == 20.0
    assert any("left out" in note and "whole runs (NRMSE)" in note for note in fit.notes)
    segments, _ = error(logs, (2.0, 20.0 / 3, 20.0), 6.0)
    whole, _ = error(logs, (2.0, 20.0 / 3, 20.0, None), 6.0)
    assert chosen == pytest.approx(segments, rel=1e-3)
    assert chosen < 0.95 * whole


@pytest.mark.thorough
def test_a_log_alone_is_halved():
    log = gusty_runs(21, "nothing", 1.0, 3.0, 0.1, count=1)[0]
    first, second = folds([log])
    assert first[0][1] == second[0][0] == 100.0
    fit = dft.fit(model_of(1.0), log, starts=2)
    assert fit.status.ok, fit.message


@pytest.mark.thorough
def test_what_is_hidden_does_not_move_the_fit_and_compiles_nothing():
    logs = gusty_runs(22, "nothing", 1.0, 3.0, 0.1, count=3)
    spoiled = logs[1].replaced(measured={n: 9.0 * v for n, v in logs[1].measured.items()})
    ends = []
    for several in (logs, [logs[0], spoiled, logs[2]]):
        problem = build(model_of(1.0), several, initial="measured")
        solve(problem, problem.start(), budget=2)
        before = compilations("solved")
        rest = without(problem, {1: (-np.inf, np.inf)})
        ends.append(solve(rest, problem.start(), budget=20))
        assert compilations("solved") == before
        assert np.all(rest.numbers.counts == 2 * 401)
    k = len(problem.own)
    assert np.allclose(ends[0].z[:k], ends[1].z[:k], rtol=1e-12)


def test_the_choice_costs_no_program():
    """One program solves at all horizons and for all that is left out."""
    logs = gusty_runs(23, "nothing", 6.0, 30.0, 0.15, count=3)
    before = compilations("solved")
    fit = dft.fit(model_of(6.0), logs, starts=2, substeps=1)
    assert any("left out" in note for note in fit.notes)
    assert compilations("solved") <= before + 1


@pytest.mark.slow
@pytest.mark.parametrize("missing", MISSING)
@pytest.mark.parametrize(("length", "memory"), [(1.0, 3.0), (3.0, 10.0), (6.0, 5.0)])
def test_whole_runs_err_by_at_most_three_per_cent_more_than_at_the_better_horizon(
    missing, length, memory
):
    """Gusts that last 30 s and more leave too little in three runs to choose by."""
    for seed in (31, 32):
        logs = gusty_runs(seed, missing, length, memory, 0.1 if length < 6 else 0.15)
        chosen = error(logs, "auto", length)[0]
        better = min(error(logs, h, length)[0] for h in ((2, 6.7, 20), (2, 6.7, 20, None)))
        assert chosen < 1.03 * better, seed


def test_guesses_are_led_through_segments_and_end_where_several_starts_do():
    """Nothing has to agree with them there: they creep through no segments on their way."""
    logs = gusty_runs(24, "nothing", 6.0, 30.0, 0.1, count=2)
    problem = restarts(build(model_of(6.0), logs, segmented=True), 2.0, hold=True)
    first = solve(problem, problem.start(), budget=2)
    led = multistart_module.search(problem, 1, None, first=first, guesses=[first.z], passing=True)
    assert led.begun == 2
    assert all(0 < solved.steps <= 25 for solved, _ in led.optima)
    model, ways = model_of(6.0), {"horizon": (2.0, 20 / 3, 20.0), "substeps": 1}
    several = dft.fit(model, logs, starts=4, **ways)
    guess = {n: 1.2 * p.value for n, p in several.parameters.items() if not p.fixed}
    alone = dft.fit(model, logs, starts=1, guesses=[guess], **ways)
    assert alone.log_likelihood == pytest.approx(several.log_likelihood, abs=1e-3)


def test_a_start_without_a_guess_is_carried_to_its_end_on_the_way():
    """Led on for 25 steps alone, this one diverged at the next horizon."""
    logs = gusty_runs(24, "nothing", 6.0, 30.0, 0.1, count=2)
    far = {"m11": 76.7, "m22": 16.0, "i33": 42.4, "d11": 0.565, "d22": 30.1, "d33": 354.0}
    ways = {"starts": 1, "horizon": (2.0, 20 / 3, 20.0), "substeps": 1}
    with pytest.warns(dft.simulation.CoarseStepWarning):  # finer ones would begin anew
        fit = dft.fit(model_of(6.0).replace({**far, "exponent": 0.441}), logs, **ways)
    assert np.isfinite(fit.log_likelihood), fit.message


def search_of(cost, z, sigma, horizon=2.0):
    quadratic = SimpleNamespace(cost=cost, sigma=np.array([sigma]))
    best = Solved(np.array([z]), quadratic, done=True, steps=1, kinked=np.zeros(1, bool))
    problem = SimpleNamespace(horizon=horizon)
    return Search(problem, ((best, 1),), begun=1, guesses=("a user's guess",))


@pytest.fixture
def valleys(monkeypatch):
    """Followed to whole runs a search ends at 10, begun anew somewhere else."""

    def of(anew, sigma):
        followed, begun = search_of(10.0, 1.0, sigma), []

        def search(problem, starts, rng, guesses, once):
            begun.append((problem, starts, guesses))
            anew.problem.horizon = problem.horizon
            return anew

        def follow(ended, horizon):
            followed.problem.horizon = horizon
            return followed

        monkeypatch.setattr(horizons_module, "search", search)
        monkeypatch.setattr(horizons_module, "_followed", follow)
        return followed, begun

    return of


@pytest.mark.parametrize(("deeper", "taken"), [(5.0, "anew"), (0.5, "followed")])
def test_whole_runs_are_begun_anew_where_the_way_through_segments_missed_their_valley(
    valleys, deeper, taken
):
    anew = search_of(10.0 - deeper, 2.0, 1.0)
    followed, begun = valleys(anew, 2.0)
    end = horizons_module._begun_anew(followed, 4, None)
    assert end is {"anew": anew, "followed": followed}[taken]
    assert begun == [(followed.problem, 4, [followed.best.z])]  # the guess was followed there
    assert horizons_module._begun_anew(followed, 0, None) is followed  # none is drawn
    assert len(begun) == 1


@pytest.mark.parametrize(("sigma", "taken", "times"), [(2.0, "anew", 1), (1.05, "followed", 0)])
def test_whole_runs_are_not_begun_anew_where_errors_do_not_accumulate(valleys, sigma, taken, times):
    anew = search_of(5.0, 2.0, 1.0)
    followed, begun = valleys(anew, sigma)
    segments = search_of(-3.0, 1.0, 1.0, horizon=20.0)
    end, notes = horizons_module.by_left_out(segments, 4, None)
    assert end is {"anew": anew, "followed": followed}[taken]
    assert (end.problem.horizon, notes, len(begun)) == (None, (), times)


def test_a_way_to_whole_runs_ends_there_once():
    assert horizons_module.to_whole_runs((2.0, 20.0)) == (2.0, 20.0, None)
    assert horizons_module.to_whole_runs((None,)) == (None,)
