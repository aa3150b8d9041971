"""Effects that whole unseen runs prove: two that lower their errors only together, or one."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import claims
import numpy as np
import pytest
from hidden import users
from one_truth import contradictions
from steps import (
    Clock,
    FittedStage,
    Programs,
    SearchState,
    SimulationTrials,
    bind,
    pairs_module,
    shares_by_effect,
    stage_fit_module,
)

import diffthrust as dft

RNG = np.random.default_rng(0)
MEASURED, RESIDUAL = RNG.standard_normal(600), RNG.standard_normal(600)


def stage(size, *effects, unseen=True):
    """A stage whose errors over whole runs are so large; over unseen ones ``unseen`` times that."""
    sizes = (size, size, *([size * unseen] if unseen else []))
    errors = []
    for each in sizes:
        channel = SimpleNamespace(rmse=each, nrmse=each)
        errors.append(SimpleNamespace(nrmse=each, channels={"speed": channel}))
    traces = [SimpleNamespace(measured=MEASURED, residual=each * RESIDUAL) for each in sizes]
    runs = tuple(SimpleNamespace(channels={"speed": trace}) for trace in traces)
    model = SimpleNamespace(parameters={}, size=size, unseen=unseen)
    fit = SimpleNamespace(train=errors[0], holdout=errors[2] if unseen else None, model=model)
    return FittedStage(effects, fit, runs[:2], runs[2:])


@dataclass(frozen=True)
class Trial:
    """What a pair is judged by: the names of its effects."""

    effects: tuple[str, ...]
    values: dict[str, float] = field(default_factory=dict)
    clip: None = None
    expected: float = 0.0


@dataclass(frozen=True)
class Fitter:
    """Fits that end where they begin."""

    constants: tuple[str, ...] = ("arm",)

    def settled(self, effects, values, initial, clip):
        return Trial(effects, values)

    def absent(self, name, values):
        return values


class Runs:
    """Fits of which only the names of the effects count."""

    fitter = None

    def fitted(self, effects, starts, clip):
        return Trial(effects, starts[0])


@dataclass(frozen=True)
class Context:
    unseen: tuple[str, ...]
    mend_first: bool = False
    fitter: Fitter = field(default_factory=Fitter)
    records: tuple[str, ...] = ()
    clock: Clock = field(default_factory=Clock)
    ended: list[float] = field(default_factory=list)

    def refit(self, model, guesses, starts):
        """To the end, with the steps that it needs."""
        self.ended.append(model.size)
        ended = stage(model.size, unseen=model.unseen)
        return ended.fit, ended.runs, ended.unseen_runs

    def say(self, message, share):
        """Nobody listens."""


@pytest.fixture
def searched(monkeypatch):
    """The search after pairs, where whole runs err by so much with each set of effects."""

    def after(sizes, unseen=("C",), lowering=(), possible=(), astray=(), ahead=None, doubted=False):
        fitted = []

        def refitted(context, state, starts):
            effects = state.current.trial.effects
            fitted.append(effects)
            size = sizes.get(effects, 1.0)
            return stage(size, *effects, unseen=1.2 / size if effects in astray else True)

        def share_between(fitter, first, second):
            before, after = (stage(sizes.get(trial.effects, 1.0)) for trial in (first, second))
            return pairs_module.worth_between(before, after)

        def ended_worse(after, before):
            return after.fit.train.nrmse > before.fit.train.nrmse

        pairs = [Trial(names) for names in sizes if len(names) == 2]
        monkeypatch.setattr(pairs_module, "compared_stage", refitted)
        for module in (pairs_module, stage_fit_module):
            monkeypatch.setattr(module, "ended_worse", ended_worse)
        monkeypatch.setattr(pairs_module, "share_between", share_between)
        monkeypatch.setattr(pairs_module, "_fitted_pairs", lambda *_: pairs)
        given = SearchState(
            SimpleNamespace(trial=Trial(())),
            (stage(1.0, unseen=bool(unseen)),),
            {},
            possible=dict(possible),
        )
        singles = {name: Trial((name,)) for name in lowering}
        context = Context(unseen, doubted)
        trials = SimulationTrials(given.stages[-1], Runs(), Trial(()), singles, {}, {})
        asked = context, given, trials, lowering, ahead
        state = pairs_module.with_proven(*asked)
        if not ahead:
            assert context.ended == [s.fit.train.nrmse for s in state.stages[1:]]  # no other
        return state, fitted

    return after


def test_two_that_help_only_together_fill_one_stage_and_have_one_share(searched):
    state, _ = searched({("a", "b"): 0.3, ("a",): 1.0, ("b",): 1.1})
    assert [stage.effects for stage in state.stages] == [(), ("a", "b")]
    assert state.current.trial.effects == ("a", "b")
    worth = shares_by_effect(state.stages)
    assert worth["a"].together == worth["b"].together == ("a", "b")
    assert worth["a"].share == pytest.approx(0.91)


def test_two_that_help_alone_as_well_have_a_stage_and_a_share_each(searched):
    state, _ = searched({("a", "b"): 0.3, ("a",): 0.8, ("b",): 0.6})
    assert [stage.effects for stage in state.stages] == [(), ("b",), ("a", "b")]
    worth = shares_by_effect(state.stages)
    assert worth["b"].share == pytest.approx(0.64)
    assert worth["a"].share == pytest.approx(0.27)


@pytest.mark.parametrize(
    "sizes",
    [
        {("a", "b"): 0.97, ("a",): 1.0, ("b",): 1.0},  # removes too little of unseen errors
        {("a", "b"): 0.8, ("a",): 0.802, ("b",): 1.0},  # nor enough alone
        {("a", "b"): np.inf, ("a",): 1.0, ("b",): 1.0},  # its runs fail
    ],
)
def test_a_pair_that_is_not_proven_changes_nothing(searched, sizes):
    state, _ = searched(sizes)
    assert [stage.effects for stage in state.stages] == [()]
    assert state.current.trial.effects == ()


def test_a_pair_is_proven_where_all_runs_are_better_by_far_and_unseen_ones_surely():
    """0.95 to 0.30 in a boat's training runs, 0.54 to 0.43 in its only unseen one."""
    blocks = np.repeat(np.where(np.arange(24) % 3 == 0, 1.22, 0.6), 25)
    last, pair, hardly = stage(1.0), stage(0.2, "a", "b"), stage(0.9, "a", "b")
    for each, factor in ((last, 1.0), (pair, blocks), (hardly, blocks)):  # a third of it is worse
        trace = SimpleNamespace(measured=MEASURED, residual=0.5 * factor * RESIDUAL)
        each.unseen_runs[0].channels["speed"] = trace
    assert 0.0 < pairs_module.worth_between(last, pair).low < 0.1
    assert pairs_module._is_proven(last, pair)
    assert not pairs_module._is_proven(last, hardly)


def test_where_one_of_two_does_as_well_alone_it_is_added_alone(searched):
    state, _ = searched({("a", "b"): 0.3, ("a",): 0.302, ("b",): 1.0})
    assert [stage.effects for stage in state.stages] == [(), ("a",)]
    assert state.current.trial.effects == ("a",)


def test_where_no_pair_is_proven_the_best_single_is_added_if_it_is(searched):
    proven, _ = searched({("a", "b"): 0.97, ("a",): 0.6}, lowering=("a", "b"))
    assert [stage.effects for stage in proven.stages] == [(), ("a",)]
    refuted, fitted = searched({("a",): 0.8, ("b",): 0.5}, lowering=("a", "b"))
    assert [stage.effects for stage in refuted.stages] == [()]
    assert fitted == [("a",)]
    beside, _ = searched({("arm",): 0.3, ("a",): 0.6}, lowering=("arm", "a"))
    assert [stage.effects for stage in beside.stages] == [(), ("a",)]  # no constant alone


@pytest.mark.parametrize("why", [{"unseen": ()}, {"doubted": True}])
def test_without_unseen_logs_or_with_a_doubted_sign_no_pair_is_fitted(searched, why):
    state, fitted = searched({("a", "b"): 0.3, ("a",): 1.0, ("b",): 1.0}, **why)
    assert [stage.effects for stage in state.stages] == [()]
    assert fitted == []


@pytest.mark.parametrize(
    ("size", "unseen", "left"),
    [(0.8, ("C",), [0.36]), (1.1, ("C",), []), (1.1, (), [0.9])],
)
def test_what_a_fit_to_whole_runs_does_not_bear_out_is_not_possible(searched, size, unseen, left):
    """A trial promised 0.9; without unseen logs nothing can refute it."""
    promised = {"a": SimpleNamespace(share=0.9)}
    state, fitted = searched({("a",): size}, unseen, ("a",), possible=promised)
    assert [round(worth.share, 2) for worth in state.possible.values()] == left
    assert fitted == [("a",)] * len(unseen)  # once


def test_one_that_does_nothing_alone_is_not_fitted_from_more_starts(searched):
    _, fitted = searched({("a", "b"): 0.1, ("a",): 0.3, ("b",): 1.05})
    assert fitted == [("a", "b"), ("a",)]


def test_a_pair_that_ended_worse_than_one_of_it_is_fitted_from_there(searched):
    _, fitted = searched({("a", "b"): 0.1, ("a",): 0.09, ("b",): 1.0})
    assert fitted == [("a", "b"), ("a",), ("a", "b")]


def test_the_next_pair_is_fitted_where_the_first_is_not_proven(searched):
    sizes = {("a", "b"): 0.97, ("a", "c"): 0.3, ("a",): 1.0, ("b",): 1.0, ("c",): 1.0}
    state, fitted = searched(sizes)
    assert [stage.effects for stage in state.stages] == [(), ("a", "c")]
    assert fitted[0] == ("a", "b")


def test_how_fast_runs_forget_is_a_number_of_one_program():
    vessel = dft.Vessel(drive="twin", lever_arm=0.3)
    time = np.arange(0.0, 60.0, 0.1)
    inputs = {"left_force": np.ones_like(time), "right_force": np.zeros_like(time)}
    log = dft.Log(time, inputs, {n: np.zeros_like(time) for n in ("surge", "sway", "yaw_rate")})
    programs = Programs(vessel, [], bind(vessel, [log]), []).simulating(20.0)
    assert [*programs.gains(2.0).values()] == pytest.approx([0.05] * 3)  # a step of 2 s
    assert [*programs.gains(20.0).values()] == pytest.approx([0.005] * 3)
    assert programs.gains(0.01) == dict.fromkeys(programs.gains(2.0), 1.0)


@pytest.mark.parametrize(
    ("size", "then", "added"),
    [
        (0.1, 0.05, True),
        (0.1, 1.5, False),  # what comes next leaves the unseen run astray, too
        (0.9, 0.05, False),  # training runs do not ask for it by far
    ],
)
def test_a_pair_is_proven_by_what_comes_beside_it(searched, size, then, added):
    """Of a boat the only unseen run stayed astray until two drags stood beside the pair."""

    def ahead(state):
        effects = (*state.stages[-1].effects, "c")
        return replace(state, stages=(*state.stages, stage(then, *effects)))

    pair = ("a", "b")
    state, _ = searched({pair: size}, astray={pair}, ahead=ahead)
    assert [stage.effects for stage in state.stages[1:]] == ([pair, (*pair, "c")] if added else [])


@pytest.mark.slow
def test_a_current_and_a_weak_thruster_are_found_in_the_logs_of_a_boat():
    made = users.draw("boat", 0)
    *train, unseen = [log.averaged(10) for log in (*made.train, *made.unseen)]
    names = ["water_current", "differential_gain", "quadratic_surge_drag", "quadratic_yaw_drag"]
    diag = dft.diagnose(made.model, train, holdout=unseen, candidates=names, experiment=False)
    assert {"water_current", "differential_gain"} <= {*diag.added}
    assert not {"water_current", "differential_gain"} & {*diag.untestable}
    assert diag.stages[-1].holdout.nrmse < 0.1
    assert contradictions(diag) == []
    assert claims.contradictions(diag) == []
