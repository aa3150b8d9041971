"""The linear response of one-step errors, against derivatives of whole passes."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from problems import jacobians
from reference import inputs, noise, thruster
from steps import (
    CandidateFitter,
    Clock,
    CurrentModel,
    FittedStage,
    Refit,
    Refusal,
    SearchContext,
    SearchState,
    Worth,
    bind,
    change_between,
    error_changes,
    fitted_beside,
    fitted_to_runs,
    near_over_whole_runs,
    predicted_gains,
    refitted_rivals,
    search_start_module,
    shift_of,
    simulation_errors,
    told_apart,
    trial_programs_module,
    unrefuted,
    why_untestable,
    with_equivalents,
    with_finer_steps,
    worth_between,
)
from trajectories import runs_over

import diffthrust as dft

TIME = np.arange(400) * 0.05
NAMES = ("linear_damping", "speed_sensor_scale", "command_offset", "actuator_lag", "axial_flow")
BESIDE = ("thrust_sensor_offset", "reverse_thrust_asymmetry")


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(3)
    logs = []
    for _ in range(2):
        command = inputs.low_passed_random(TIME, 2.0, rng)
        record = thruster.simulate(TIME, command, method="rk4", coulomb_friction=20.0)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        seen = {n: np.where(rng.random(TIME.size) < 0.1, np.nan, v)
                for n, v in record.measured.items()}  # fmt: skip
        logs.append(dft.Log(record.time, record.inputs, seen))
    made = CandidateFitter(
        dft.Thruster(),
        [dft.effects.EFFECTS[n]() for n in (*NAMES, *BESIDE)],
        bind(dft.Thruster(), logs),
        [],
        substeps=2,
    )
    return made, made.base()


@pytest.fixture(scope="module")
def simulated(trials):
    made, _ = trials
    return made.simulating().base()


@pytest.mark.thorough
@pytest.mark.parametrize("which", ["innovations", "simulated"])
def test_derivatives_by_parameters_and_starts_are_those_of_whole_passes(trials, simulated, which):
    base = simulated if which == "simulated" else trials[1]
    there = base.at_values
    by_scan = jax.jit(jacobians, static_argnums=0)(there.layout, there.numbers, there.start())
    for (errors, jacobian), ours, slopes in zip(
        by_scan, base.response.errors, base.response.slopes, strict=True
    ):
        np.testing.assert_allclose(ours, errors, atol=1e-12)
        size = np.abs(jacobian).max()
        np.testing.assert_allclose(slopes.jacobian, jacobian, atol=1e-9 * size)

    q = base.response.quadratic()
    np.testing.assert_allclose(q.information, base.quadratic.information, rtol=1e-9, atol=1e-6)
    assert float(q.cost) == pytest.approx(base.cost, abs=1e-9)
    more = [np.ones((len(e), 1, *e.shape[1:])) for e in base.response.errors]
    information, scores = base.response.scores([0, 2], more)
    whole, kept = base.response.quadratic(more), [0, 2, base.response.problem.shared]
    np.testing.assert_allclose(information, whole.information[np.ix_(kept, kept)], rtol=1e-9)
    np.testing.assert_allclose(scores.sum(axis=1), whole.gradient[kept], rtol=1e-9, atol=1e-9)


@pytest.mark.thorough
def test_trials_of_whole_runs_err_as_a_plain_simulation_does(trials, simulated):
    made, _ = trials
    model = made.model.replace({n: simulated.values[n] for n in made.free})
    starts = simulated.at_values.numbers_by_log(simulated.at_values.start())
    runs = runs_over(model, made.records, initial=starts, substeps=2)
    assert not made.simulating().nuisance
    for run, passed in zip(runs, simulated.passed, strict=True):
        for name, errors in zip(made.channels, passed.errors, strict=True):
            np.testing.assert_allclose(errors, run.channels[name].residual, atol=1e-9)


@pytest.mark.thorough
def test_a_trial_of_many_effects_over_whole_runs_has_a_response(trials, monkeypatch):
    """The map of a T200 with six effects had none: a problem with room for four numbers of them.

    As over longer logs, where the response has a problem of its own.
    """
    monkeypatch.setattr(trial_programs_module, "_SHORT", 0)
    made, base = trials
    apart = made.model, list(made.candidates.values()), made.records, []
    made = CandidateFitter(*apart, substeps=2)
    names = (*NAMES, *BESIDE)
    values = {n: p.value for n, p in made.ready(names).problem.named.items()}
    full = made.simulating().solve(names, {**values, **base.values}, None, base.clip, 1)
    assert len(full.names) > len(made.free) + len(names) - 1
    assert np.isfinite(full.response.cost)


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_the_answer_to_an_effect_is_its_derivative_in_a_pass(trials, name):
    made, base = trials
    effect = made.candidates[name]
    own = next(n for n, p in effect._parameters.items() if p.null is not None)
    full, p = f"{name}.{own}", effect._parameters[own]
    step = 1e-4 * p.scale if name != "actuator_lag" else 0.02
    values = {f"{name}.{n}": q.value for n, q in effect._parameters.items() if not q.fixed}
    names = (*base.names, full)
    costs = [
        made.ready(NAMES).problem.focus(
            names, {**base.values, **values, full: value}, base.initial_states
        )
        for value in (step, 0.0)
    ]
    by_scan = [
        [errors for errors, _ in jax.jit(jacobians, static_argnums=0)(
            one.layout, base.clip.on(one).numbers, one.start())]
        for one in costs
    ]  # fmt: skip
    exact = np.concatenate([(a - b).ravel() for a, b in zip(*by_scan, strict=True)])
    theirs = {n: q.value for n, q in effect._parameters.items() if not q.fixed}
    shift = shift_of(base.response, effect, {**theirs, own: step})
    answer = np.concatenate([part.ravel() for part in error_changes(base.response, [shift])])
    alike = exact @ answer / np.linalg.norm(exact) / np.linalg.norm(answer)
    assert alike > 0.99
    assert np.linalg.norm(answer) == pytest.approx(np.linalg.norm(exact), rel=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "point"),
    [("linear_damping", {"rate": 1e-5}), ("speed_sensor_scale", {"change": 1e-6})],
)
def test_a_promise_tells_what_is_worth_a_fit(trials, name, point):
    made, base = trials
    point = {f"{name}.{n}": value for n, value in point.items()}
    (promised,) = predicted_gains(base.response, made.candidates[name], [point], [])
    fitted = made.solve((name,), {**base.values, **point}, base.initial_states, base.clip)
    gained = base.cost - fitted.cost
    assert (promised.gain > 20) == (gained > 20)  # a damping is there, a wrong scale is not
    assert promised.gain == pytest.approx(gained, rel=0.7, abs=1.5)


NOT_FINITE = "its influence on what is measured is not finite along these logs"


@pytest.mark.parametrize(
    ("information", "why"),
    [
        ([[4.0, 1.0], [1.0, 1.0]], ""),
        ([[4.0, 0.0], [0.0, 0.0]], "it changes nothing that is measured in these logs"),
        ([[4.0, 0.0], [0.0, np.inf]], NOT_FINITE),
        ([[4.0, np.nan], [np.nan, np.nan]], NOT_FINITE),
        ([[4.0, 2.0], [2.0, 1.0]], "other parameters do the same to what is measured"),
    ],
)
def test_why_an_effect_cannot_be_tested(information, why):
    """A tanker that never goes astern says nothing of its propeller there; no parameter does."""
    q = SimpleNamespace(information=np.array(information))
    assert why_untestable(q, ("beta", "friction.level"), "friction") == why


MOMENTS = np.arange(500) * 0.05


@pytest.fixture(scope="module")
def known():
    """A shaft with Coulomb friction: logs, the model without it, and its trials."""
    rng, logs = np.random.default_rng(5), []
    for _ in range(3):
        command = inputs.low_passed_random(MOMENTS, 2.0, rng)
        record = thruster.simulate(MOMENTS, command, method="rk4", coulomb_friction=20.0)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        logs.append(dft.Log(record.time, record.inputs, record.measured))
    train, unseen = logs[:2], logs[2:]
    fit = dft.fit(dft.Thruster(), train, holdout=unseen, starts=2)
    names = ("coulomb_friction", "actuator_lag")
    effects = [dft.effects.EFFECTS[n]() for n in names]
    trials = CandidateFitter(fit.model, effects, bind(fit.model, train), bind(fit.model, unseen), 2)
    return SimpleNamespace(
        train=train, unseen=unseen, trials=trials, stage=SimpleNamespace(effects=(), fit=fit)
    )


def settled_trial(trials, name):
    base = trials.base()
    return trials.settled((name,), base.values, base.initial_states, base.clip)


@pytest.mark.thorough
def test_a_trial_over_whole_runs_errs_as_a_fit_does(known):
    trials, stage, name = known.trials, known.stage, "coulomb_friction"
    before = fitted_to_runs(trials, stage)
    after = fitted_beside(trials, stage, settled_trial(trials, name), (name,))
    change = change_between(trials, before, after)
    with_it = dft.fit(dft.Thruster() + name, known.train, holdout=known.unseen, starts=2)
    for trial, fit in ((before, stage.fit), (after, with_it)):
        errors = simulation_errors(trials.simulating(), trial)
        assert errors == pytest.approx((fit.train.nrmse, fit.holdout.nrmse), rel=0.02)
    squares = [fit.holdout.nrmse**2 for fit in (stage.fit, with_it)]
    assert change.share == pytest.approx(1 - squares[1] / squares[0], abs=0.02)
    assert change.low > 0.1


@pytest.mark.thorough
def test_what_is_not_there_is_worth_nothing(known):
    trials, name = known.trials, "actuator_lag"
    before = fitted_to_runs(trials, known.stage)
    after = fitted_beside(trials, known.stage, settled_trial(trials, name), (name,))
    assert abs(change_between(trials, before, after).share) < 0.05


@pytest.mark.thorough
def test_a_rival_that_lowers_nothing_over_whole_runs_is_told_from_an_effect(known):
    """By one-step errors alone it would have been named as what the effect may be."""
    trials, name, rival = known.trials, "coulomb_friction", "actuator_lag"
    fit = dft.fit(dft.Thruster() + name, known.train, holdout=known.unseen, starts=2)
    stage = SimpleNamespace(effects=(name,), fit=fit)
    context, lag = SimpleNamespace(fitter=trials), {rival: settled_trial(trials, rival)}

    def worth(share):
        return Worth(share, share, share, dict.fromkeys(trials.channels, Worth(share, 0.0, 1.0)))

    assert unrefuted(context, stage, name, worth(0.5), lag) == []
    without = SimpleNamespace(effects=(rival,), fit=known.stage.fit)
    # a lag of zero does nothing to whole runs: they have no say in what else it may be
    friction = {name: settled_trial(trials, name)}
    assert unrefuted(context, without, rival, worth(0.0), friction) == [name]


@pytest.mark.thorough
def test_trials_take_as_many_integrator_steps_as_the_last_stage_needs():
    """The moving water of an NGS thruster needs 16, and its trials had one: all ran away."""
    given, rng, effect = dft.Thruster(), np.random.default_rng(7), "axial_flow"
    truth = (given + effect).replace({f"{effect}.loss": 1.0, f"{effect}.mass": 1.0})
    logs = []
    for _ in range(3):
        command = inputs.low_passed_random(MOMENTS, 2.0, rng)
        run = dft.simulate(truth, dft.Log(MOMENTS, {"command": command}), substeps=16)
        seen = {n: run[n] + size * rng.standard_normal(MOMENTS.size)
                for n, size in (("speed", 0.3), ("thrust", 0.2))}  # fmt: skip
        logs.append(dft.Log(MOMENTS, {"command": command}, seen))
    train, unseen = (tuple(bind(given, each)) for each in (logs[:2], logs[2:]))
    refit = Refit(train, unseen, {"seed": 0}, Clock())
    first, stage = FittedStage((), *refit(given)), FittedStage((effect,), *refit(truth, starts=1))
    coarse = CandidateFitter(given, [dft.effects.EFFECTS[effect]()], train, unseen, 1)
    context = SearchContext(given, coarse, unseen, refit, {}, lambda *_: None)
    current = CurrentModel(coarse, settled_trial(coarse, effect))
    state = SearchState(current, (first, stage), {})

    finer, updated = with_finer_steps(context, state)
    assert 1 < finer.fitter.substeps <= stage.fit.substeps
    assert updated.current.trial.cost < state.current.trial.cost - 10.0
    trial = fitted_to_runs(finer.fitter, stage)
    trained, _ = simulation_errors(finer.fitter.simulating(), trial)
    assert trained == pytest.approx(stage.train.nrmse, rel=0.02)
    assert with_finer_steps(finer, updated) == (finer, updated)


@pytest.mark.thorough
def test_a_rival_that_was_as_good_is_fitted_anew_in_the_last_stage(known, monkeypatch):
    """So of a T200 a linear damping, which was refused by one-step errors, for a load exponent."""
    monkeypatch.setattr("diffthrust.diagnosis._equivalence.simulation_is_poor", lambda *_: True)
    given, trials, (name, rival) = (
        dft.Thruster(),
        known.trials,
        ("coulomb_friction", "actuator_lag"),
    )
    logs = tuple(bind(given, each) for each in (known.train, known.unseen))
    refit = Refit(*logs, {"seed": 0}, Clock())
    context = SimpleNamespace(given=given, fitter=trials, refit=refit, say=lambda *_: None)
    for effect, other, alike in ((name, rival, []), (rival, name, [name])):
        stages = [FittedStage(names, *refit(given + list(names))) for names in ((), (effect,))]
        ranking = [SimpleNamespace(effect=other, stage=0, delta_bic=-50.0)]
        state = SimpleNamespace(stages=stages, ranking=ranking)
        assert [*near_over_whole_runs(context, state, effect, ())] == alike
        both = SimpleNamespace(effects=(name, rival))  # the rival was added later
        later = SimpleNamespace(stages=[*stages, both], ranking=ranking)
        assert near_over_whole_runs(context, later, effect, ()) == {}
        rivals = {other: settled_trial(trials, other)}
        refitted = refitted_rivals(context, stages[1], effect, rivals)
        worths = {rival: worth_between(s, stages[1]) for rival, s in refitted.items()}
        assert [
            r for r, ahead in worths.items() if not told_apart(None, ahead, ahead.of_all)
        ] == alike


@pytest.mark.thorough
def test_a_rival_that_whole_runs_prove_better_takes_the_place_of_an_effect(known, monkeypatch):
    """Of a tanker a sway drag for a rudder inflow, which did nothing over whole runs."""
    monkeypatch.setattr("diffthrust.diagnosis._equivalence.simulation_is_poor", lambda *_: True)
    given, names = dft.Thruster(), ("coulomb_friction", "actuator_lag")
    logs = tuple(bind(given, each) for each in (known.train, known.unseen))
    context, state = search_start_module.start_search(given, *logs, names, 0, lambda *_: None)
    first = state.current.trial
    rated = [SimpleNamespace(effect=name, stage=0, delta_bic=-50.0) for name in names]
    friction, lag = names

    def with_(name):
        trial = settled_trial(context.fitter, name)
        stage = FittedStage((name,), *context.refit(given + name))
        current = CurrentModel(context.fitter, trial)
        stages = (*state.stages, stage)
        return replace(state, stages=stages, current=current, ranking=rated, exhausted=True)

    state_with_lag = with_(lag)
    exchanged = with_equivalents(context, state_with_lag, first).exchanged
    assert exchanged is not None
    assert exchanged.current.trial.effects == exchanged.stages[-1].effects == (friction,)
    assert exchanged.exchanged == {lag: friction}
    assert exchanged.turned_down[lag] == (Refusal.EXCHANGED, (friction,))
    assert not exchanged.exhausted
    # the lag is only detectable, and keeps the friction out
    kept_out = replace(state_with_lag, stages=state.stages, detectable=(lag,))
    exchanged = with_equivalents(context, kept_out, first).exchanged
    assert exchanged is not None
    assert (exchanged.stages[-1].effects, exchanged.detectable) == ((friction,), ())
    # what has given way does not come back, and a search comes to an end
    for done in ({friction: lag}, {lag: friction}, {"one": "another", "third": "fourth"}):
        again = replace(state_with_lag, exchanged=done)
        assert with_equivalents(context, again, first).exchanged is None
    # a friction that explains the next sample far better is not what it cannot tell from the lag
    told = with_equivalents(context, replace(kept_out, exchanged={friction: lag}), first)
    assert told.detectable_groups == ((lag,),)
    right = with_equivalents(context, with_(friction), first)
    assert right.exchanged is None
    assert right.groups == ((friction,),)


@pytest.mark.thorough
def test_a_value_that_one_step_errors_want_is_kept_where_whole_runs_are_asked(known):
    trials, stage, name = known.trials, known.stage, "coulomb_friction"
    trial = settled_trial(trials, name)
    own = f"{name}.level"
    trial = replace(trial, values={**trial.values, own: 5.0, "beta": 444.0})
    ended = fitted_beside(trials, stage, trial, (name,), still=[own, "beta"])
    assert (ended.values[own], ended.values["beta"]) == (5.0, 444.0)
    instead = fitted_beside(trials, stage, trial, ("actuator_lag",))
    assert ended.values["ct"] != stage.fit.model.parameters["ct"].value
    assert instead.values[own] == 0.0  # it is in place of the friction
