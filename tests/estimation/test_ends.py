"""Where an optimisation ends: at the minimum, at what rounding resolves, or at zero."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from problems import GRADIENT_LIMIT, build, examine, judge, solve
from reference import inputs
from test_fit import TRUE, log_of, record

import diffthrust as dft
from diffthrust.estimation._multistart import Search  # private: a search that stopped early
from diffthrust.estimation._polish import polished, rounding_of  # private: the end alone


def stopped(problem, budget):
    return solve(problem, problem.start(), budget=budget)


def test_newtons_method_ends_a_search_that_stopped_early():
    problem = build(dft.Thruster(alpha=0.05, beta=50.0), [log_of(record())])
    short = stopped(problem, 3)
    assert examine(problem, short.z, short.quadratic).gradient > 1e-4
    ended = polished(Search(((short, 1),), 1), problem).best
    full = stopped(problem, 300)
    assert examine(problem, ended.z, ended.quadratic).gradient < 1e-6
    assert float(ended.quadratic.cost) <= float(full.quadratic.cost) + 1e-9


def test_a_planted_point_beside_the_minimum_is_not_converged():
    """A share of a standard error away, also where its rounding is asked for."""
    problem = build(dft.Thruster(), [log_of(record())])
    full = stopped(problem, 300)
    length = np.sqrt(np.diagonal(full.quadratic.information))
    for share in (0.5, 0.01):
        z = full.z.copy()
        z[0] += share / length[0]
        beside = solve(problem, z, budget=1)
        local = examine(problem, z, beside.quadratic)
        local = replace(local, rounding=rounding_of(problem, beside))
        assert local.rounding < 1e-8
        assert judge(local, float(beside.quadratic.cost), 1, 1)[0] is dft.Status.NOT_CONVERGED


class Offset(dft.Model):
    """A slope upon a level that takes most of the digits."""

    name = "offset"
    inputs: ClassVar = {"command": ""}
    states: ClassVar = {}
    outputs: ClassVar = {"level": "m"}
    slope: float = dft.parameter(1.0, "m")
    level: float = dft.parameter(3e9, "m", fixed=True)

    def equations(self, s, port):
        return {}, {"level": (self.level + self.slope * s.command) - 0.0}


@pytest.mark.parametrize("seed", range(4))
def test_what_rounding_leaves_of_the_gradient_is_no_reason_to_go_on(seed):
    rng = np.random.default_rng(seed)
    command = rng.uniform(-1.0, 1.0, 200)
    level = 3e9 + 2.0 * command + 1e-4 * rng.standard_normal(200)
    log = dft.Log(0.1 * np.arange(200), {"command": command}, {"level": level})
    fit = dft.fit(Offset(), log, starts=2)
    assert fit.checks.gradient > GRADIENT_LIMIT
    assert fit.status.ok, fit.message
    problem = build(Offset(), [log])
    aside = solve(problem, stopped(problem, 300).z + 3e-5, budget=1)  # two standard errors
    steep = examine(problem, aside.z, aside.quadratic)
    steep = replace(steep, rounding=rounding_of(problem, aside))
    assert judge(steep, float(aside.quadratic.cost), 1, 1)[0] is dft.Status.NOT_CONVERGED


def made_without_load():
    time = inputs.grid(20.0, 0.05)
    rng = np.random.default_rng(3)
    command = inputs.low_passed_random(time, 1.5, rng)
    speed = np.zeros(time.size)
    for i in range(time.size - 1):  # what pushes on instead of holding back
        rate = 42.0 * command[i] + 1e-3 * speed[i] * abs(speed[i])
        speed[i + 1] = speed[i] + 0.05 * rate
    noisy = speed + 0.3 * rng.standard_normal(time.size)
    return dft.Log(time, {"command": command}, {"speed": noisy})


def test_a_load_that_the_logs_push_to_zero_is_told():
    log = made_without_load()
    fit = dft.fit(dft.Thruster().fix("ct"), log)
    assert fit.status is dft.Status.AT_BOUND
    assert "alpha at zero" in fit.message
    assert fit.parameters["alpha"].at_bound
    assert fit.parameters["alpha"].value < 1e-10
    assert any("alpha vanished" in note and "propeller load" in note for note in fit.notes)
    for value in (fit.parameters["alpha"].value, 1e-169):  # where a later fit begins
        again = dft.fit(fit.model.replace(alpha=value), log)
        assert again.status is dft.Status.AT_BOUND, again.message
        assert 1e-25 < again.parameters["alpha"].value < 1e-10
        assert again.log_likelihood == pytest.approx(fit.log_likelihood, abs=1e-6)
    assert not any(
        "vanished" in note for note in dft.fit(dft.Thruster(**TRUE), log_of(record())).notes
    )
