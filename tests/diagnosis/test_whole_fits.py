"""Trials over whole runs, beside the fits of the same models."""

from types import SimpleNamespace

import numpy as np
import pytest
from reference import inputs, noise, thruster

import diffthrust as dft
from diffthrust.diagnosis._innovations_fit import CandidateFitter  # private: trials alone
from diffthrust.diagnosis._simulation_fit import (  # private: without a diagnosis around them
    change_between,
    fitted_beside,
    fitted_to_runs,
)

TIME = np.arange(500) * 0.05


@pytest.fixture(scope="module")
def known():
    """A shaft with Coulomb friction: logs, the model without it, and its trials."""
    rng, logs = np.random.default_rng(5), []
    for _ in range(3):
        command = inputs.low_passed_random(TIME, 2.0, rng)
        record = thruster.simulate(TIME, command, method="rk4", coulomb_friction=20.0)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        logs.append(dft.Log(record.time, record.inputs, record.measured))
    train, unseen = logs[:2], logs[2:]
    fit = dft.fit(dft.Thruster(), train, holdout=unseen, starts=2)
    names = ("coulomb_friction", "actuator_lag")
    trials = CandidateFitter(fit.model, [dft.effects.EFFECTS[n]() for n in names], train, unseen, 2)
    return SimpleNamespace(
        train=train, unseen=unseen, trials=trials, stage=SimpleNamespace(effects=(), fit=fit)
    )


def start_search(trials, name):
    base = trials.base()
    return trials.settled((name,), base.values, base.begin, base.limit)


def test_a_trial_over_whole_runs_errs_as_a_fit_does(known):
    trials, stage, name = known.trials, known.stage, "coulomb_friction"
    before = fitted_to_runs(trials, stage)
    after = fitted_beside(trials, stage, start_search(trials, name), (name,))
    change = change_between(trials, before, after)
    with_it = dft.fit(dft.Thruster() + name, known.train, holdout=known.unseen, starts=2)
    for trial, fit in ((change.before, stage.fit), (change.after, with_it)):
        assert trial.train.nrmse == pytest.approx(fit.train.nrmse, rel=0.02)
        assert trial.holdout.nrmse == pytest.approx(fit.holdout.nrmse, rel=0.02)
    squares = [fit.holdout.nrmse**2 for fit in (stage.fit, with_it)]
    assert change.worth.share == pytest.approx(1 - squares[1] / squares[0], abs=0.02)
    assert change.worth.low > 0.1


def test_what_is_not_there_is_worth_nothing(known):
    trials, name = known.trials, "actuator_lag"
    before = fitted_to_runs(trials, known.stage)
    after = fitted_beside(trials, known.stage, start_search(trials, name), (name,))
    assert abs(change_between(trials, before, after).worth.share) < 0.05
