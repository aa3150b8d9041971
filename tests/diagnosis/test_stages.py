"""The bounds on the work of a stage: screens, and the fits that tell what an effect is worth."""

import itertools
import math
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from compilations import compilations
from gusty_runs import gusty_runs, model_of
from hidden import sets
from steps import (
    SCREENS,
    SETTINGS,
    CandidateFitter,
    Clock,
    CurrentModel,
    FittedStage,
    Refit,
    Refusal,
    SearchState,
    TriedEffect,
    Worth,
    admission_module,
    bind,
    done,
    effect_shares_module,
    from_simulation,
    matters,
    next_stage,
    other_values,
    plainest_first,
    ranked,
    refusing,
    runs_lead,
    search_start_module,
    search_state_module,
    shares_by_effect,
    stage_fit_module,
    step,
    still_refused,
    stopped,
    untested,
)

import diffthrust as dft

PLAIN = SETTINGS.admission.plain_bic_gain


def test_of_candidates_that_are_tied_that_of_fewest_parameters_comes_first():
    """One thruster of eight is weak, or lost its thrust a moment before the log began."""

    def tried(name, delta_bic, count):
        trial = SimpleNamespace(parameters_of=lambda: [None] * count, count=len)
        return SimpleNamespace(
            candidate=SimpleNamespace(effect=name, delta_bic=delta_bic), trial=trial
        )

    late, weak = tried("thrust_degradation", -2194.7, 2), tried("strength", -2193.8, 1)
    far, worse = tried("far", -2190.0, 1), tried("worse", -9.0, 1)
    assert plainest_first([worse, late, far, weak]) == [weak, late, far, worse]
    assert plainest_first([]) == []


GIVEN = SimpleNamespace(effects=())


@pytest.fixture
def restless(monkeypatch):
    """What is asked of each round where a better noise comes to light in the first so many."""

    def asked_of(better):
        asked = []

        def one_round(tools, known, again):
            asked.append(again)
            return replace(known, current=object()) if len(asked) <= better else known

        monkeypatch.setattr("diffthrust.diagnosis._stepwise.one_round", one_round)
        known = SearchState(object(), (GIVEN,), {})
        assert next_stage(None, known).number == known.number
        return asked

    return asked_of


def test_candidates_are_screened_once_where_no_better_noise_is_found(restless):
    assert restless(better=0) == [True]


def test_a_better_noise_has_the_candidates_screened_anew(restless):
    assert restless(better=1) == [True, True]


def test_screens_end_however_often_a_better_noise_is_found_and_the_last_looks_for_none(restless):
    assert restless(better=99) == [True] * (SCREENS - 1) + [False]


def without(loss, promise):
    """What is solved when an effect is taken out that costs ``loss`` to leave out."""
    solved = []

    def result(budget):
        solved.append(budget)
        cost = 100.0 + loss
        return SimpleNamespace(cost=cost, predicted_gain=promise, expected=cost - promise)

    trial = SimpleNamespace(
        effects=("a", "b"), values={}, initial_states=None, clip=None, cost=100.0
    )
    trials = SimpleNamespace(
        absent=lambda name, values: values,
        solve=lambda rest, values, initial_states, limit, budget: result(budget),
        further=lambda trial: result("to the end"),
    )
    present = CurrentModel(trials, trial)
    fewer = present.without("a")
    assert present.without("a") is fewer  # and not fitted again
    return solved


def test_a_fit_without_an_effect_ends_early_where_much_is_lost():
    assert without(loss=PLAIN + 50.0, promise=1.0) == [12]


def test_it_is_carried_to_the_end_where_the_loss_may_be_small():
    assert without(loss=PLAIN + 50.0, promise=60.0) == [
        12,
        "to the end",
    ]
    assert without(loss=3.0, promise=1.0) == [12, "to the end"]


def test_it_is_not_where_it_has_come_to_its_end():
    assert without(loss=3.0, promise=0.0) == [12]


def values_besides(nrmse, beta, guess):
    """What effects are tried with where the trials have come to some ``beta``; 42 in the fit."""
    model = dft.Thruster(beta=42.0).fix("ct")
    fit = SimpleNamespace(model=model)
    stage = SimpleNamespace(fit=fit, train=SimpleNamespace(nrmse=nrmse))
    tools = SimpleNamespace(
        guess=guess, fitter=SimpleNamespace(free=("alpha", "beta"), model=model)
    )
    trial = SimpleNamespace(values={"alpha": 0.037, "beta": beta})
    return other_values(tools, SearchState(SimpleNamespace(trial=trial), (stage,), {}))


def test_effects_are_tried_with_other_values_where_the_model_has_gone_astray():
    guess = {"alpha": 1.0, "beta": 1.0}
    assert values_besides(0.2, 30.0, guess) is None
    assert values_besides(0.8, 30.0, guess) == guess
    # an observer that explains all by random forces leaves the model nothing to do
    assert values_besides(0.2, 1e-6, guess) == {"alpha": 0.037, "beta": 42.0}
    assert values_besides(0.8, 1e-6, {}) == {"alpha": 0.037, "beta": 42.0}


@pytest.mark.parametrize(
    ("since", "why", "still"),
    [
        ((), Refusal.ALL_RUNS, True),
        (("thrust_sensor_lag",), Refusal.ALL_RUNS, True),  # at another port
        (("linear_damping",), Refusal.ALL_RUNS, False),  # at the same
        (("ct",), Refusal.ALL_RUNS, False),  # a constant, which may act anywhere
        ((), Refusal.UNSEEN_LOGS, False),  # what costs no fit to whole runs is asked again
    ],
)
def test_what_was_refused_is_not_fitted_again_unless_something_changed(since, why, still):
    candidates = {n: dft.effects.EFFECTS[n]() for n in ("coulomb_friction", *since) if n != "ct"}
    tools = SimpleNamespace(fitter=SimpleNamespace(candidates=candidates))
    before = SimpleNamespace(trial=SimpleNamespace(effects=()))
    known = refusing(SearchState(before, (None,), {}), "coulomb_friction", why)
    after = SimpleNamespace(trial=SimpleNamespace(effects=since))
    told = still_refused(tools, replace(known, current=after), "coulomb_friction")
    assert told == (why if still else None)
    assert known.refused == {"coulomb_friction": why}


def test_a_bound_stops_a_parameter_where_the_effect_is_not_gone():
    rim = dft.parameter(4.0, "cm", bounds=(0, 5), null=0.0)
    assert stopped(rim, 5.0)
    assert not stopped(rim, 4.9)
    assert not stopped(rim, 0.0)  # its null
    assert not stopped(dft.parameter(1.0, null=0.0), 1e9)


def test_beside_a_detectable_effect_its_rivals_keep_what_they_explained():
    def tried(effect, delta_bic):
        return TriedEffect(0, effect, 0.0, delta_bic, 0.0, 0.0, None, None, {})

    before = tried("command_delay", -50.0), tried("actuator_lag", -49.0)
    now = [tried("speed_sensor_offset", -1.0), tried("actuator_lag", 6.0)]
    known = SearchState(object(), (object(),), {}, ranking=before, detectable=("command_delay",))
    assert ranked(known, now) == (*before, now[0])
    assert ranked(replace(known, detectable=()), now) == tuple(now)


STEPWISE = "diffthrust.diagnosis._stepwise"


def test_effects_that_change_nothing_do_not_end_a_search(monkeypatch):
    """On the maps of a T200 five of them ended it before the sag of the supply was tried."""
    asked = []
    for way in ("next_stage", "from_simulation"):
        monkeypatch.setattr(
            f"{STEPWISE}.{way}", lambda _, state, way=way: asked.append(way) or state
        )
    leading = iter([False, False, True])
    monkeypatch.setattr(f"{STEPWISE}.runs_lead", lambda *_: next(leading))
    most = SETTINGS.admission.most_effects
    state = SearchState(None, (GIVEN,), {}, detectable=("lag",) * most)
    assert not done(state)
    assert done(step(None, state))
    assert asked == ["from_simulation"]
    asked.clear()
    step(None, replace(state, detectable=("lag",) * (most - 1)))
    assert asked == ["next_stage", "from_simulation"]
    asked.clear()
    step(None, replace(state, detectable=()))
    assert asked == ["from_simulation", "next_stage"]
    assert done(replace(state, stages=(GIVEN,) * (most + 1)))


@pytest.mark.parametrize(
    ("matters", "superfluous", "last"),
    [
        ("", "", ["b c", "c", ""]),
        ("c", "", ["b c", ""]),
        ("", "c", ["b c", "", "c", ""]),  # where it proves so once, all are screened again
    ],
)
def test_beside_several_that_change_nothing_those_that_gained_are_screened_first(
    monkeypatch, matters, superfluous, last
):
    """Each of a BlueBoat's seven screens was of all 36 candidates, in programs of its own."""
    gains, screened = {"a": -30.0, "b": -20.0, "c": -10.0, "d": 5.0}, []

    def screen(context, state):
        screened.append(" ".join(state.gained))
        present = {*state.detectable, *(state.stages[-1].effects)}
        names = [name for name in state.gained or gains if name not in present]
        rated = [SimpleNamespace(effect=n, delta_bic=gains[n], p_value=1.0, stage=0) for n in names]
        sized = [
            SimpleNamespace(
                effects=(n,), values={n: gains[n], "x": 0.0}, parameters_of=lambda n=n: [n]
            )
            for n in names
        ]
        assert all(of == {name: gains[name]} for name, of in state.gained.items())
        return state, list(zip(rated, sized, strict=True))

    def admit(context, state, tried):
        name = tried.candidate.effect
        if name == superfluous and state.current is current:
            return replace(state, current=SimpleNamespace(trial=current.trial))
        if name == matters:
            stage = SimpleNamespace(effects=(name,))
            return replace(state, stages=(*state.stages, stage))
        return replace(state, detectable=(*state.detectable, name))

    for name, stand_in in {"screen": screen, "admit": admit}.items():
        monkeypatch.setattr(f"{STEPWISE}.{name}", stand_in)
    monkeypatch.setattr(f"{STEPWISE}.from_simulation", lambda _, state: state)
    monkeypatch.setattr(f"{STEPWISE}.runs_lead", lambda _: False)
    fitter = SimpleNamespace(least_gain=4.0)
    context = SimpleNamespace(fitter=fitter, clock=lambda _: nullcontext())
    current = SimpleNamespace(trial=SimpleNamespace(effects=()))
    monkeypatch.setattr(f"{STEPWISE}.better_noise", lambda *_: None)
    state = SearchState(current, (GIVEN,), {})
    while not done(state):
        state = step(context, state)
    # beside the first of them all are screened again
    assert screened == ["", "", *last]
    assert state.detectable == tuple(name for name in "abc" if name != matters)


def leaving_out(**ways):
    """Fits of trials that can leave effects out, by given ways to fit."""
    fitter = SimpleNamespace(**ways)
    fitter.settled_without = partial(CandidateFitter.settled_without, fitter)
    return fitter


@pytest.mark.parametrize(
    ("name", "low", "unseen"),
    [("sag", 0.2, ("C",)), ("sag", 0.05, ("C",)), ("sag", 0.2, ()), ("lag", 0.05, ())],
)
def test_what_whole_unseen_runs_prove_is_tried_without_what_changes_nothing(
    monkeypatch, name, low, unseen
):
    """So is again what changed nothing: of a T200 the weaker thrust astern, before the sag."""
    tried = []

    def admitted(context, state, name, simulated, proven):
        tried.append((state.detectable, state.current.trial.effects))

    def settled(effects, values, states, clip):
        return SimpleNamespace(effects=effects, values=values, initial_states=states, clip=clip)

    def absent(names, values):
        return {**values, **dict.fromkeys(names, 0.0)}

    fitter = leaving_out(settled=settled, absent=absent)
    words = {"given": None, "unseen": unseen, "say": lambda *_: None}
    words["clock"] = lambda _: nullcontext()
    context = SimpleNamespace(fitter=fitter, **words)
    monkeypatch.setattr(f"{STEPWISE}._admitted", admitted)
    monkeypatch.setattr(f"{STEPWISE}.runs_lead", lambda *_: False)
    monkeypatch.setattr(f"{STEPWISE}.simulation_is_poor", lambda *_: True)
    trials = SimpleNamespace(singles={name: None}, lowering={name: Worth(0.5, low, 0.8)})
    made = []
    monkeypatch.setattr(f"{STEPWISE}._trials", lambda *_: made.append(1) or trials)
    monkeypatch.setattr(f"{STEPWISE}.with_proven", lambda context, state, *_: state)
    trial = settled(("exponent", "lag"), {"lag": 0.1}, None, None)
    last = object()
    state = SearchState(CurrentModel(fitter, trial), (last,), {}, detectable=("lag",))
    ended = from_simulation(context, state)
    assert ended.detectable == ("lag",)  # where nothing is added
    beside, alone = (("lag",), ("exponent", "lag")), ((), ("exponent",))
    proven = [beside, alone] if unseen and low > 0.1 else [beside]
    assert tried == ([alone] if name == "lag" else proven)
    trials.are_of = lambda stage, programs: stage is last and programs is fitter
    assert from_simulation(context, ended).trials is trials
    assert len(made) == 1  # beside the same stage, with the same programs
    other = leaving_out(settled=settled, absent=absent)
    from_simulation(SimpleNamespace(fitter=other, **words), ended)
    from_simulation(context, replace(ended, stages=(last, object())))
    assert len(made) == 3


def test_whole_runs_try_constants_too_from_all_numbers_of_the_model(monkeypatch):
    """An azimuth turned in 1.3 s where 0.3 was held: from sample to sample its angle is corrected.

    Beside the true values of the other numbers: those of a craft's thrusters have a place before
    their names, as those of an effect do.
    """
    kept = {"m22": 75.0, "bow.gain": 30.0, "bow.slew_time": 1.3}
    nulls = {"noise.sway.gain.sway": 0.0, "wind.along": 0.0, "bow.command_delay.delay": 0.02}
    single = SimpleNamespace(values={**kept, **nulls}, initial_states=None)
    screens, starts = [], []

    class Fitter:
        candidates = {"wind": SimpleNamespace(of_user=False)}
        constants, least_gain, unclipped = ("bow.slew_time",), 4.0, None

        def settled(self, effects, values, states, clip):
            starts.append((effects, values))
            return SimpleNamespace(effects=effects)

    fitter, stage = Fitter(), SimpleNamespace(effects=("bow.command_delay",))
    runs = SimpleNamespace(fitter=fitter, near=lambda *_: single, far=lambda near: near)
    for name, stand_in in {
        "simulation_is_poor": lambda *_: True,
        "runs_lead": lambda *_: False,
        "Runs": lambda *_: runs,
        "values_of": lambda *_: {},
        "levels_of": lambda *_: {},
        "screened": lambda of, names, *_: screens.append(names) or {"bow.slew_time": single},
        "share_between": lambda *_: Worth(0.9, 0.8, 0.95),
        "rate": lambda *_: SimpleNamespace(delta_bic=0.0),
        "with_proven": lambda context, state, *_: state,
    }.items():
        monkeypatch.setattr(f"{STEPWISE}.{name}", stand_in)
    context = SimpleNamespace(
        fitter=fitter, given=SimpleNamespace(parameters=kept), unseen=(), say=lambda *_: None,
        clock=lambda _: nullcontext(),
    )  # fmt: skip
    present = SimpleNamespace(
        effects=stage.effects, values={"d11": 20.0}, initial_states=None, clip=None
    )
    current = SimpleNamespace(trial=present, criterion=0.0)
    state = SearchState(current, (stage,), {})
    assert from_simulation(context, state).possible.keys() == {"bow.slew_time"}
    assert screens == [["wind", "bow.slew_time"]]
    ((effects, start),) = starts
    assert effects == ("bow.command_delay", "bow.slew_time")
    assert start == {"d11": 20.0, **kept, "bow.command_delay.delay": 0.02}


ROV = dft.Craft(dft.bodies.SixDegrees(), ahead=dft.actuators.StaticThruster().at((0.0, 0.0, 0.0)))
VELOCITIES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")


@pytest.mark.parametrize(
    ("model", "measured", "seconds", "lead"),
    [
        (dft.Vessel(), ("north", "east", "heading", "yaw_rate"), 50.0, True),  # surge, sway are not
        (dft.Vessel(), ("north", "east", "heading", "yaw_rate"), 30.0, False),  # too short to err
        (dft.Vessel(), ("surge", "sway", "yaw_rate"), 50.0, False),  # nothing else acts on these
        (dft.Vessel(), ("surge", "yaw_rate"), 50.0, True),
        (dft.AxisVehicle(), ("position",), 50.0, False),  # its errors do not accumulate
        (ROV, (*VELOCITIES, "roll", "pitch", "heading"), 50.0, False),  # these tell a quaternion
        (ROV, (*VELOCITIES, "roll", "heading"), 50.0, True),
    ],
)
def test_whole_runs_are_asked_first_where_errors_accumulate_in_states_that_are_not_read(
    model, measured, seconds, lead
):
    time = np.linspace(0.0, seconds, 51)
    inputs = {name: np.sin(time) for name in model.inputs}
    log = dft.Log(time, inputs, {name: np.cos(time) for name in measured}, units={**model.inputs})
    fitter = SimpleNamespace(channels=measured)
    context = SimpleNamespace(given=model, fitter=fitter, records=bind(model, [log]))
    assert runs_lead(context) is lead


RNG = np.random.default_rng(0)
MEASURED, REST = RNG.standard_normal(600), RNG.standard_normal(600)


@pytest.fixture
def recorded():
    """What a search knows after an effect by which errors over whole runs shrink to so much."""

    def after(left, effects=("lag", "wind"), unseen=("C",), held=()):
        def stage(size, *names):
            error = SimpleNamespace(nrmse=size)
            trace = SimpleNamespace(measured=MEASURED, residual=size * REST)
            run = SimpleNamespace(channels={"speed": trace})
            fit = SimpleNamespace(train=error, holdout=error)
            return FittedStage(names, fit, (run, run), tuple(run for _ in unseen))

        trials = SimpleNamespace(constants=held)
        tools = SimpleNamespace(fitter=trials, unseen=unseen)
        known = SearchState(None, (stage(2.0), stage(1.0, "lag")), {})
        return admission_module.record_stage(tools, known, stage(left, *effects), "wind")

    return after


@pytest.mark.parametrize("unseen", [("C",), ()])
def test_what_matters_fills_a_stage(recorded, unseen):
    known = recorded(0.5, unseen=unseen)
    assert [stage.effects for stage in known.stages] == [(), ("lag",), ("lag", "wind")]
    worth = shares_by_effect(known.stages)
    assert worth["lag"].share == pytest.approx(0.75)
    assert worth["wind"].share == pytest.approx(0.75 / 4)  # the lag left a quarter
    assert known.detectable == ()


def test_what_changes_nothing_is_detectable_and_fills_none(recorded):
    known = recorded(0.995)
    assert [stage.effects for stage in known.stages] == [(), ("lag",)]
    assert known.detectable == ("wind",)
    assert known.accepted == (((), ("lag",)), ("wind",))  # the search goes on from there


def test_a_search_that_comes_to_what_it_had_before_ends(recorded, monkeypatch):
    """Three effects that change nothing came and went for ever beside a thrust lost in a hollow."""
    steps = itertools.cycle([("wind",), ("wind", "drag"), ("drag",)])

    def way(context, state):
        return replace(state, detectable=next(steps))

    for name in ("next_stage", "from_simulation"):
        monkeypatch.setattr(f"{STEPWISE}.{name}", way)
    monkeypatch.setattr(f"{STEPWISE}.runs_lead", lambda context: False)
    state, count = recorded(0.5), 0
    while not done(state) and count < 20:
        state, count = step(None, state), count + 1
    assert (count, state.detectable) == (4, ("wind",))


def test_a_constant_fills_a_stage_whatever_it_changes(recorded):
    assert recorded(0.995, held=("wind",)).stages[-1].effects == ("lag", "wind")


def test_what_takes_the_place_of_another_effect_is_worth_what_both_are(recorded):
    known = recorded(0.995, effects=("wind",))
    assert known.stages[-1].effects == ("wind",)
    worth = shares_by_effect(known.stages)
    assert {*worth} == {"wind"}
    assert worth["wind"].share == pytest.approx(1 - (0.995 / 2.0) ** 2)


def stages_of(*sizes):
    """Stages whose errors are so many times the same residual, by channel of one unseen log."""
    made = []
    for effects, *by_channel in sizes:
        channels = {
            name: SimpleNamespace(measured=MEASURED, residual=size * REST)
            for name, size in zip(("speed", "thrust"), by_channel, strict=False)
        }
        run = SimpleNamespace(channels=channels)
        made.append(FittedStage(effects, SimpleNamespace(), (run,), (run,)))
    return made


def test_shares_side_by_side_are_parts_of_one_whole_whatever_took_the_place_of_what():
    """Taken beside all others, the wind that replaced the lag had 0.99, and the sag 0.19 more."""
    worth = shares_by_effect(
        stages_of(((), 2.0), (("lag",), 1.0), (("lag", "sag"), 0.5), (("sag", "wind"), 0.2))
    )
    assert {name: round(share.share, 4) for name, share in worth.items()} == {
        "sag": 0.1875,
        "wind": 0.8025,
    }
    assert all(share.everywhere and not share.together for share in worth.values())


class Sizes:
    """A search whose fits end with errors of sizes that are known for each set of effects."""

    unseen = ("C",)
    fitter = SimpleNamespace(candidates={"lag", "wind", "sag"}, constants=())

    def __init__(self, monkeypatch, sizes):
        self.sizes, self.fitted = sizes, []
        monkeypatch.setattr(effect_shares_module, "refitted_stage", self.refitted)
        monkeypatch.setattr(effect_shares_module, "_without", self.without)

    def stage(self, *effects):
        (made,) = stages_of((effects, self.sizes[effects]))
        size = self.sizes[effects]
        channels = {"speed": SimpleNamespace(rmse=size, nrmse=size)}
        error = SimpleNamespace(nrmse=size, channels=channels)
        fit = SimpleNamespace(train=error, holdout=error, substeps=2, horizon=20.0)
        return replace(made, fit=fit)

    def refitted(self, context, state, **_):
        left_out = {*state.detectable}
        self.fitted.append(tuple(n for n in state.current.trial.effects if n not in left_out))
        return self.stage(*self.fitted[-1])

    def without(self, context, state, name):
        return self.stage(*(n for n in state.stages[-1].effects if n != name))

    def ended(self, effects, detectable=()):
        stages = tuple(self.stage(*effects[:k]) for k in range(len(effects) + 1))
        trial = SimpleNamespace(effects=(*effects, *detectable))
        state = SearchState(SimpleNamespace(trial=trial), stages, {}, detectable=detectable)
        return effect_shares_module.with_shares_beside_others(self, state)


def test_each_effect_is_left_out_of_the_last_model_whatever_came_first(monkeypatch):
    sizes = {(): 2.0, ("lag",): 1.0, ("wind",): 1.0, ("lag", "wind"): 0.5}
    beside = Sizes(monkeypatch, sizes).ended(("lag", "wind")).beside
    assert {n: w.share for n, w in beside.items()} == pytest.approx({"lag": 0.75, "wind": 0.75})
    assert beside["lag"].everywhere.share == pytest.approx(0.75)
    assert Sizes(monkeypatch, sizes).ended(("lag",)).beside == {}  # its share as given says it


def test_runs_that_overflow_without_an_effect_give_it_no_share(monkeypatch):
    """Of a thruster's bench dry friction was told to remove 100 % for want of it alone."""
    sizes = {(): 2.0, ("lag",): 1.0, ("wind",): np.inf, ("lag", "wind"): 0.5}
    beside = Sizes(monkeypatch, sizes).ended(("lag", "wind")).beside
    assert {n: w.share for n, w in beside.items()} == pytest.approx({"wind": 0.75})


def test_a_fit_that_ended_worse_is_no_share(monkeypatch):
    """Of a Kingfisher a yaw drag, whose null errs as before, "removed" -706 to -202 %."""
    sizes = {(): 2.0, ("lag",): 1.0, ("lag", "wind"): 2.7}
    ended = Sizes(monkeypatch, sizes).ended(("lag",), detectable=("wind",))
    assert (ended.beside, ended.detectable) == ({}, ("wind",))


@pytest.mark.parametrize(("size", "added"), [(0.9, True), (0.97, False)])
def test_what_was_left_out_is_added_at_the_end_if_it_removes_a_tenth(monkeypatch, size, added):
    sizes = {(): 2.0, ("lag",): 1.0, ("lag", "wind"): size, ("wind",): 1.5}
    tools = Sizes(monkeypatch, sizes)
    ended = tools.ended(("lag",), detectable=("wind",))
    assert (ended.stages[-1].effects == ("lag", "wind")) is added
    assert ended.detectable == (() if added else ("wind",))
    assert tools.fitted == [("lag", "wind")] * (2 if added else 1)  # to its end, if it is added
    left = 1.0 - (size / 1.5) ** 2 if added else None  # of what is left without the lag
    assert ended.beside["wind"].share == pytest.approx(1.0 - size**2)
    assert ended.beside.get("lag", ended.beside["wind"]).share == pytest.approx(
        left if added else 1.0 - size**2
    )


@pytest.mark.parametrize(("without", "kept"), [(0.501, False), (0.6, True)])
def test_what_a_later_effect_made_superfluous_is_only_detectable(monkeypatch, without, kept):
    """Of a boat: the inflow of a propeller, which had stood in for two drags before they came."""
    sizes = {(): 2.0, ("lag",): 1.0, ("lag", "wind"): 0.5, ("wind",): without}
    ended = Sizes(monkeypatch, sizes).ended(("lag", "wind"))
    assert ended.stages[-1].effects == (("lag", "wind") if kept else ("wind",))
    assert ended.detectable == (() if kept else ("lag",))
    assert [s.effects for s in ended.stages[:-1]] == ([(), ("lag",)] if kept else [()])
    removed = 1.0 - (0.5 / without) ** 2
    if kept:
        assert ended.beside["lag"].share == pytest.approx(removed)


def test_an_effect_held_at_its_null_is_left_out_and_nothing_is_compiled_for_it():
    """Each share beside others took 5 s of processor time to compile before."""
    held_at_null = effect_shares_module._held_at_null
    base = dft.Thruster() + dft.effects.CommandDeadband(half_width=0.4)
    model = base + dft.effects.ReverseThrustAsymmetry(change=-0.2)
    time, rng = 0.05 * np.arange(400), np.random.default_rng(3)
    command = np.repeat(rng.uniform(-4.0, 4.0, 20), 20)
    made = dft.simulate(model, dft.Log(time, {"command": command}, {}))
    measured = {n: made[n] + rng.normal(0.0, 0.2, 400) for n in ("speed", "thrust")}
    log = dft.Log(time, {"command": command}, measured)
    with_both = dft.fit(model, log, starts=1)
    before = compilations("solved_by_passes")
    held = held_at_null(with_both.model, "reverse_thrust_asymmetry")
    without = dft.fit(held, log, starts=1)
    assert compilations("solved_by_passes") == before
    plain = dft.fit(base, log, starts=1)
    assert without.train.nrmse == pytest.approx(plain.train.nrmse, rel=1e-9)
    assert without.train.nrmse > 1.2 * with_both.train.nrmse
    limited = model + dft.effects.CommandSaturation()
    assert held_at_null(limited, "command_saturation") is None  # its null has no end


def test_a_fit_without_an_effect_begins_at_the_last_stage_and_at_the_given_model():
    """Without its dry friction a bench of the NGS overflowed at the values of the last stage."""
    given, asked = dft.Thruster(), []
    effects = {"coulomb_friction": dft.effects.CoulombFriction(level=5.0),
               "load_exponent": dft.effects.LoadExponent()}  # fmt: skip
    model = (given + list(effects.values())).replace(alpha=0.5)
    fit = SimpleNamespace(model=model, substeps=2)
    last = FittedStage(("coulomb_friction", "load_exponent"), fit, (), ())

    def refit(model, guesses, starts, like):
        asked.append((model, guesses, like))
        return fit, (), ()

    context = SimpleNamespace(fitter=SimpleNamespace(candidates=effects), given=given,
                              refit=refit, say=lambda *_: None)  # fmt: skip
    state = SearchState(SimpleNamespace(), (last,), {})
    fewer = effect_shares_module._without(context, state, "coulomb_friction")
    assert fewer.effects == ("load_exponent",)
    ((held, guesses, like),) = asked
    assert held.parameters["coulomb_friction.level"].value == 0.0
    assert [guess["alpha"] for guess in guesses] == [0.5, given.alpha]
    assert like is fit


@pytest.mark.parametrize("horizon", [20.0, None])
def test_a_fit_that_is_compared_has_the_horizon_and_the_steps_of_the_other(horizon):
    model = model_of(6.0)
    records = bind(model, gusty_runs(24, "nothing", 6.0, 30.0, 0.1, count=2))
    refit = Refit(records, (), {"seed": 0}, Clock())
    like = SimpleNamespace(horizon=horizon, substeps=2)
    for words, substeps in (({"starts": 1}, 2), ({"starts": 2, "substeps": 3}, 3)):
        fit = refit(model, like=like, **words).fit
        assert (fit.horizon, fit.substeps) == (horizon, substeps)


@pytest.mark.parametrize(
    ("end", "starts", "horizons"),
    [(None, 1, (20, None)), (20, 1, (20,)), (60, 1, (20, 60)),
     (None, 2, (2, 7, 20, None)), (20, 2, (2, 7, 20)), (7, 2, (2, 7))],
)  # fmt: skip
def test_several_starts_go_through_short_segments_too(end, starts, horizons):
    like = SimpleNamespace(horizon=end)
    assert search_state_module._to_that_of(like, (2, 7, 20), starts) == horizons
    without = search_state_module._to_that_of(SimpleNamespace(horizon=None), (None,), starts)
    assert without == (None,)


def test_a_fit_that_failed_has_its_own_steps(monkeypatch):
    """Its errors are infinite with any: of no step it could be said that it leaves them alike."""
    errors = SimpleNamespace(nrmse=math.inf)
    fit = SimpleNamespace(substeps=16, model=None, initial=(), train=errors)
    monkeypatch.setattr(search_start_module, "runs_over", lambda *_, **__: ())
    monkeypatch.setattr(search_start_module, "pooled_errors", lambda _: errors)
    assert search_start_module.few_substeps(fit, ()) == 16
    assert search_start_module.trial_substeps(fit, ()) == 16


@pytest.mark.parametrize("effect", [dft.effects.CommandRateLimit(), dft.effects.CommandDeadband()])
def test_a_first_guess_has_each_effect_where_it_does_nothing(effect):
    """A limit's null is infinite: far more than there is in the logs stands for it."""
    model, log = dft.Thruster(), sets.draw("clear/command_deadband", 3).train[0]
    with_it = (model + effect).replace(stage_fit_module._at_null(effect))
    plain, there = (dft.compare(each, log).errors.nrmse for each in (model, with_it))
    assert there == pytest.approx(plain, rel=1e-9)


@pytest.mark.parametrize("size", [float("inf"), float("nan")])
def test_a_fit_without_an_effect_that_cannot_be_simulated_gives_no_share(monkeypatch, size):
    sizes = {(): 2.0, ("lag",): 1.0, ("lag", "wind"): 0.5, ("wind",): size}
    assert {*Sizes(monkeypatch, sizes).ended(("lag", "wind")).beside} == {"wind"}


def test_what_does_harm_without_another_has_one_share_with_it():
    """113 % and -13 % were said of a pair of which the first alone did harm."""
    worth = shares_by_effect(stages_of(((), 1.0), (("lag",), 1.1), (("lag", "sag"), 0.1)))
    assert {*worth} == {"lag", "sag"}
    assert worth["lag"] == worth["sag"]
    assert worth["lag"].together == ("lag", "sag")
    assert worth["lag"].share == pytest.approx(0.99)


def test_what_comes_in_one_stage_has_one_share():
    worth = shares_by_effect(stages_of(((), 1.0), (("lag", "sag"), 0.1)))
    assert worth["lag"].together == worth["sag"].together == ("lag", "sag")


def test_an_effect_of_one_channel_keeps_its_share_where_others_grow():
    worth = shares_by_effect(
        stages_of(((), 1.0, 9.0), (("lag",), 0.1, 9.1), (("lag", "sag"), 0.1, 1.0))
    )
    assert worth["lag"].together == ()
    assert worth["lag"].share < 0
    assert worth["lag"].channels["speed"].share == pytest.approx(0.99)


def test_a_law_is_judged_as_an_effect_is():
    """An arm's unseen run, begun a noisy reading off, goes a turn astray by its true law, too.

    Of all runs the law surely removes two thirds.
    """
    of_all = Worth(0.67, 0.3, 0.9)
    assert matters(Worth(0.41, -0.16, 0.77, everywhere=of_all))
    assert not matters(Worth(0.41, -0.16, 0.77))
    assert not matters(Worth(0.001, -0.16, 0.2, everywhere=of_all))
    alone = {"surge": Worth(0.5, 0.2, 0.8), "sway": Worth(0.0, -0.1, 0.1)}
    drowned = Worth(0.07, -0.01, 0.2, alone)
    assert matters(Worth(0.1, -0.3, 0.4, alone, everywhere=drowned))
    assert not matters(Worth(-math.inf, -math.inf, 0.4, alone, everywhere=drowned))  # diverges


def test_a_law_must_help_in_the_channel_in_which_it_enters():
    """A curve in a BlueBoat's surge removed a quarter of the squared yaw rate error, and none of
    its own surely."""
    alone = {"surge": Worth(0.31, -0.12, 0.89), "yaw_rate": Worth(0.24, 0.1, 0.4)}
    drowned = Worth(0.07, -0.01, 0.2, alone)
    worth = Worth(0.1, -0.3, 0.4, alone, everywhere=drowned)
    assert matters(worth)
    assert matters(worth, "yaw_rate")
    assert not matters(worth, "surge")
    assert matters(Worth(0.2, 0.1, 0.3, alone), "surge")  # in all channels it is sure


@pytest.mark.parametrize(("low", "refusal"), [(-0.01, Refusal.NO_BETTER_RUNS), (0.005, None)])
def test_a_constant_needs_whole_runs_that_bear_its_value_out(monkeypatch, low, refusal):
    """A T200's maps wanted a rate of 0.03 1/s for 0.1; whole runs err the same from 0.1 to 0.75."""
    held = []

    def fitted_beside(fitter, last, trial, effects, still):
        held.append((effects, still))

    change = Worth(0.02, low, 0.05)
    for name, work in (("fitted_to_runs", lambda *_: None), ("fitted_beside", fitted_beside),
                       ("change_between", lambda *_: change)):  # fmt: skip
        monkeypatch.setattr(admission_module, name, work)
    context = SimpleNamespace(fitter=SimpleNamespace(constants=("alpha",)),
                              clock=lambda _: nullcontext())  # fmt: skip
    trial = SimpleNamespace(effects=("lag", "alpha"))
    state = SearchState(SimpleNamespace(trial=trial), (SimpleNamespace(effects=("lag",)),), {})
    assert admission_module.reject_if_unborne(context, state, "alpha") is refusal
    assert held == [(("lag", "alpha"), ["alpha"])]
    assert admission_module.reject_if_unborne(context, state, "lag") is None  # an effect


@pytest.mark.parametrize(
    ("substeps", "outcomes", "made"),
    [(2, ["kept"], ["refitted"]), (2, ["detectable"], ["refitted"]),
     (16, ["kept", "kept"], ["compared", "ended"]), (16, ["detectable"], ["compared"]),
     (16, ["refused"], ["compared"]), (16, ["kept", "refused"], ["compared", "ended"]),
     (16, ["kept", "detectable"], ["compared", "ended"])],
)  # fmt: skip
def test_beside_a_stage_of_many_steps_an_effect_is_fitted_to_its_end_where_it_is_kept(
    monkeypatch, substeps, outcomes, made
):
    """Beside a Kingfisher's dead band five effects took a minute or two each to be detectable.

    What only few steps make of an effect is judged once more with those that it needs.
    """
    fits, left = [], [*outcomes]
    last = SimpleNamespace(fit=SimpleNamespace(substeps=substeps))
    state = SearchState(SimpleNamespace(), (last,), {})

    def fitting(kind, steps):
        def fit(*_, anew=False):
            assert anew == (kind == "compared")
            fits.append(kind)
            return SimpleNamespace(kind=kind, fit=SimpleNamespace(substeps=steps))

        return fit

    def record_stage(context, state, fitted, name):
        if left.pop(0) == "kept":
            return replace(state, stages=(*state.stages, fitted))
        return replace(state, detectable=("wind",))

    def no_better(last, fitted):
        if left[0] != "refused":
            return None
        left.pop(0)
        return Refusal.UNSEEN_RUNS

    for name, work in (
        ("few_substeps", lambda *_: 2), ("refitted_stage", fitting("refitted", substeps)),
        ("compared_stage", fitting("compared", 2)), ("fitted_to_its_end", fitting("ended", 16)),
        ("no_better", no_better), ("record_stage", record_stage),
        ("without_idle", lambda context, state: state),
    ):  # fmt: skip
        monkeypatch.setattr(admission_module, name, work)
    context = SimpleNamespace(records=())
    outcome = admission_module._fitted_and_recorded(context, state, "wind", None)
    assert fits == made
    assert not left
    if outcomes[-1] == "kept":
        assert outcome.stages[-1].kind == made[-1]
    elif outcomes[-1] == "refused":
        assert outcome is Refusal.UNSEEN_RUNS
    else:
        assert outcome.detectable == ("wind",)


def test_an_effect_that_is_tried_again_from_other_values_is_fitted_again(monkeypatch):
    """A trial from whole runs begins elsewhere than one from one-step errors, beside one stage."""
    made = []

    def fit(context, state, starts, substeps):
        made.append(state.current)
        return SimpleNamespace(train=SimpleNamespace(nrmse=0.1), values=state.current)

    for name, work in (
        ("few_substeps", lambda *_: 2), ("_alike_or_apart", fit),
        ("stage_effects", lambda state: ("wind",)),
    ):  # fmt: skip
        monkeypatch.setattr(stage_fit_module, name, work)
    last, context = FittedStage((), None, (), ()), SimpleNamespace(records=())
    for values in ("first", "second"):
        state = SearchState(values, (last,), {})
        assert stage_fit_module.compared_stage(context, state, anew=True).values == values
    assert stage_fit_module.compared_stage(context, state).values == "second"
    assert stage_fit_module.compared_stage(context, state) is last.rivals[("wind",), 0, 2]
    assert made == ["first", "second", "second"]


def ended(errors, log_likelihood, horizon=None, substeps=1):
    channels = {n: SimpleNamespace(rmse=rmse) for n, rmse in errors.items()}
    train = SimpleNamespace(nrmse=sum(errors.values()), channels=channels)
    fit = SimpleNamespace(log_likelihood=log_likelihood, horizon=horizon, substeps=substeps)
    return SimpleNamespace(train=train, fit=fit)


def test_a_fit_ended_worse_where_what_it_maximises_is_lower():
    # yaw rate and heading are read at 10 Hz, the position at 5
    grown, fallen = ({"yaw_rate": 0.281, "heading": 1.36, "east": e} for e in (4.10, 1.35))
    errors = {"yaw_rate": 0.443, "heading": 1.48, "east": 1.35}
    before = ended(errors, -65.0)
    for after, worse in (
        (ended(grown, 183.0), False),
        (ended(errors, -65.3), False),
        (ended({**errors, "east": 1.30}, -70.0), True),
        (ended({**errors, "east": float("inf")}, 183.0), True),
        (ended(grown, 183.0, horizon=20.0), True),  # of something else: errors decide
        (ended(fallen, -183.0, horizon=20.0), False),
        (ended(grown, 183.0, substeps=4), True),
    ):
        assert stage_fit_module.ended_worse(after, before) is worse
    assert stage_fit_module.ended_worse(ended(errors, -65.3), before, by=0.0)


def flowing(loss, nrmse):
    """A stage with an axial flow of some loss, and a dead band, and its errors."""
    model = dft.Thruster() + dft.effects.AxialFlow(loss=loss) + "command_deadband"
    channels = {"speed": SimpleNamespace(rmse=nrmse)}
    train = SimpleNamespace(nrmse=nrmse, channels=channels)
    fit = SimpleNamespace(model=model, parameters=model.parameters)
    names = tuple(effect.name for effect in model.effects)
    return SimpleNamespace(fit=fit, effects=names, train=train, holdout=None)


@pytest.mark.parametrize(
    ("loss", "again", "left"), [(0.0, 0.2, True), (0.0, 0.3, False), (0.1, 0.2, False)]
)
def test_an_older_effect_that_a_fit_to_whole_runs_returns_to_its_null_leaves(
    monkeypatch, loss, again, left
):
    fitted = flowing(loss, 0.2)
    smaller = SimpleNamespace(effects=("command_deadband",), train=flowing(0.0, again).train)
    smaller.holdout = None
    monkeypatch.setattr(admission_module, "refitted_stage", lambda context, state: smaller)
    trial = SimpleNamespace(
        effects=fitted.effects, values={"axial_flow.loss": 0.4}, initial_states=None, clip=None
    )
    fitter = leaving_out(
        absent=lambda names, values: {**values, **{f"{name}.loss": 0.0 for name in names}},
        settled=lambda names, values, *further: SimpleNamespace(effects=names, values=values),
    )
    before = SimpleNamespace(effects=("axial_flow",), train=flowing(0.1, 0.5).train, holdout=None)
    known = SearchState(SimpleNamespace(trial=trial), (before, fitted), {})
    after = admission_module.without_idle(SimpleNamespace(fitter=fitter), known)
    if not left:  # it does something, or the model errs more without it
        assert after is known
        return
    assert after.stages == (before, smaller)
    assert after.current.trial.effects == ("command_deadband",)
    assert after.current.trial.values == {"axial_flow.loss": 0.0}
    assert after.turned_down == {"axial_flow": (Refusal.IDLE, ("command_deadband",))}


def test_what_one_stage_could_test_was_tried():
    """A rudder inflow that was tried beside no wind was listed as untestable, too."""
    tried = TriedEffect(0, "rudder_inflow", 20.6, -11.7, 1e-4, np.nan, 0.46, 0.57, {})
    why = "other parameters do the same to what is measured"
    names = ("rudder_inflow", "propeller_inflow", "wind")
    trial = SimpleNamespace(effects=("wind",))
    state = SearchState(SimpleNamespace(trial=trial), (), dict.fromkeys(names, why))
    assert untested(replace(state, ranking=(tried,))) == {"propeller_inflow": why}


@pytest.mark.parametrize(("noise", "substeps", "compared"), [(3.0, 2, 2), (0.6, 4, 2), (0.3, 4, 4)])
def test_trials_have_steps_whose_error_within_a_sample_is_lost_in_the_noise(
    noise, substeps, compared
):
    """Fits to whole runs that are compared have as many as leave their errors where they were."""
    # by whole runs two steps would do for both: the error is white beside what a run errs
    rng, time = np.random.default_rng(4), 0.9 * np.arange(400)
    command = np.repeat(rng.uniform(-1.0, 1.0, 40), 10)
    true, log = dft.Thruster(alpha=0.05, beta=60.0), dft.Log(time, {"command": command})
    speed = np.asarray(dft.simulate(true, log, substeps=32)["speed"])
    log = dft.Log(time, {"command": command}, {"speed": speed + rng.normal(0.0, noise, 400)})
    fit = dft.fit(true.fix("ct"), log, starts=1, substeps=8)
    coarse = dft.simulate(fit.model, log, initial=fit.initial[0], substeps=2)["speed"]
    rmse = float(np.sqrt(np.mean((log.measured["speed"] - np.asarray(coarse)) ** 2)))
    assert rmse == pytest.approx(fit.train.channels["speed"].rmse, rel=0.02)
    records = bind(fit.model, [log])
    assert search_start_module.trial_substeps(fit, records) == substeps
    assert search_start_module.few_substeps(fit, records) == compared
