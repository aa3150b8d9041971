"""A bound that has stopped a parameter is to be widened only where that gains something."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from reference import inputs, noise, thruster
from steps import (
    Clock,
    FittedStage,
    Refit,
    bind,
    idle_bounds,
    is_whole,
    stopped_by_bound,
    vanished_parameters,
)

import diffthrust as dft

TIME = 0.05 * np.arange(600)


@pytest.fixture(scope="module")
def logs():
    rng, made = np.random.default_rng(7), []
    for _ in range(3):
        command = inputs.low_passed_random(TIME, 2.0, rng)
        record = thruster.simulate(TIME, command, method="rk4")
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        made.append(dft.Log(record.time, record.inputs, record.measured))
    return made[:2], made[2:]


@pytest.mark.parametrize(("share", "idle"), [(0.9999, ("beta",)), (0.5, ())])
def test_a_bound_is_idle_where_whole_runs_err_no_less_beyond_it(logs, share, idle):
    """Half of the drive costs a third of the speed; a ten thousandth less than the noise tells."""
    free = dft.fit(dft.Thruster(), logs[0], starts=1).parameters["beta"].value
    given = dft.Thruster().replace(beta={"value": 0.4 * free, "bounds": (0, share * free)})
    records = [bind(given, each) for each in logs]
    refit = Refit(*records, {"seed": 0}, Clock())
    last = FittedStage((), *refit(given, starts=1))
    assert last.fit.parameters["beta"].at_bound
    context = SimpleNamespace(given=given, refit=refit, say=lambda *_: None)
    assert idle_bounds(context, last, last) == idle


def test_no_fit_is_made_where_nothing_is_at_a_bound(logs):
    refit = Refit(*[bind(dft.Thruster(), each) for each in logs], {"seed": 0}, Clock())
    last = FittedStage((), *refit(dft.Thruster(), starts=1))
    assert idle_bounds(SimpleNamespace(given=dft.Thruster()), last, last) == ()


def test_bounds_that_only_hold_each_other_are_not_idle(logs):
    """Drive and thrust constant share no scale with the loss, but beta with alpha does."""
    free = dft.fit(dft.Thruster(), logs[0], starts=1).parameters
    bounds = {n: {"value": 0.4 * free[n].value, "bounds": (0, 0.5 * free[n].value)}
              for n in ("alpha", "beta")}  # fmt: skip
    given = dft.Thruster().replace(bounds)
    refit = Refit(*[bind(given, each) for each in logs], {"seed": 0}, Clock())
    last = FittedStage((), *refit(given, starts=1))
    assert last.fit.parameters["beta"].at_bound
    context = SimpleNamespace(given=given, refit=refit, say=lambda *_: None)
    assert idle_bounds(context, last, last) == ()
    # the free model errs less: to be found, it needs no wider bound but these
    free = FittedStage(("x",), *refit(dft.Thruster(), starts=1))
    assert idle_bounds(context, last, free) == ()
    held = dft.Thruster().replace(beta=bounds["beta"]).fix("alpha", "ct")
    poor = FittedStage((), *refit(held, starts=1))
    assert poor.fit.parameters["beta"].at_bound
    context = SimpleNamespace(given=held, refit=refit, say=lambda *_: None)
    assert idle_bounds(context, poor, free) == ("beta",)  # freed, it errs more than all free


def test_a_logarithm_that_ran_to_where_numbers_end_is_neither_at_a_bound_nor_gone(logs):
    """An inertia of 2e15 kg m^2 was told as gone to zero."""
    fit = dft.fit(dft.Thruster(), logs[0], starts=1)
    for value, gone in ((2e15, ()), (1e-15, ("beta",))):
        far = replace(fit.parameters["beta"], value=value, at_bound=True)
        ended = replace(fit, parameters={**fit.parameters, "beta": far})
        assert vanished_parameters(ended) == gone
        assert stopped_by_bound(ended) == ()


@pytest.mark.parametrize("scope", ["", "port."])
def test_a_full_share_is_whole_on_an_actuator_of_a_craft_as_well(scope):
    assert is_whole(f"{scope}supply_voltage_sag", "share", 1.0)
    assert not is_whole(f"{scope}supply_voltage_sag", "share", 0.8)
    assert not is_whole(f"{scope}command_deadband", "half_width", 1.0)
