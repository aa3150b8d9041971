"""How large errors are limited where a law forgives, and what an observer's values are told as."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from error_laws import Gaussian, StudentT
from problems import Innovations, SimulationError, White, bind, refine_module

import diffthrust as dft
from diffthrust import Log


@dataclass(frozen=True)
class Numbers:
    clip: Any = None
    reach: Any = 1.0


@dataclass(frozen=True)
class Posed:
    layout: Any
    numbers: Numbers = Numbers()


def posed(law, *, corrects=True):
    return Posed(SimpleNamespace(likelihood=SimpleNamespace(law=law, corrects=corrects)))


class Searched:
    """A search whose next costs are known; its noise doubles each time."""

    def __init__(self, problem, costs, sigma=0.5, asked=None):
        self.problem = problem
        self.costs, self.asked = costs, [] if asked is None else asked
        q = SimpleNamespace(sigma=np.array([sigma, 3.0 * sigma]))
        self.best, self.sigma = SimpleNamespace(quadratic=q, cost=costs[0]), sigma

    def followed(self, problem):
        self.asked.append((problem.numbers.clip.tolist(), float(problem.numbers.reach)))
        return Searched(problem, self.costs[1:], 2.0 * self.sigma, self.asked)


@pytest.mark.parametrize(("law", "corrects"), [(Gaussian(), True), (StudentT(), False)])
def test_without_a_law_that_forgives_or_a_correction_nothing_is_limited(law, corrects):
    search = Searched(posed(law, corrects=corrects), [1.0])
    assert refine_module.refined(search) is search
    assert search.asked == []


@pytest.mark.parametrize(("wide", "reach"), [(89.9, 5.0), (90.1, 1.0)])
def test_errors_are_limited_at_four_standard_deviations_or_at_twenty(wide, reach):
    search = Searched(posed(StudentT()), [500.0, 300.0, 100.0, wide])
    found = refine_module.refined(search)
    assert search.asked == [([2.0, 6.0], 1.0), ([4.0, 12.0], 1.0), ([4.0, 12.0], 5.0)]
    assert float(found.problem.numbers.reach) == reach
    assert found.problem.numbers.clip.tolist() == [4.0, 12.0]
    assert found.best.cost == (wide if reach == 5.0 else 100.0)


def test_gains_and_memories_without_standard_errors():
    named = {
        "a.memory": dft.Parameter(1.0, "s", (0.5, 40.0)),
        "a.gain": dft.Parameter(0.2, "", (0.0, 1.0)),
        "b.gain": dft.Parameter(0.2, "", (0.0, 1.0)),
        "c.gain": dft.Parameter(0.2, "", (0.0, 1.0)),
    }
    values = {"a.memory": 40.0 * (1 - 0.5e-9), "a.gain": 0.5e-9, "b.gain": 2e-9, "c.gain": 0.4}
    problem = SimpleNamespace(values=lambda z: values, nuisance=named)
    found = refine_module.disturbance_of(problem, np.zeros(4))
    assert {n: e.at_bound for n, e in found.items()} == {
        "a.memory": True, "a.gain": True, "b.gain": False, "c.gain": False,
    }  # fmt: skip
    for name, e in found.items():
        assert (e.value, e.std_error, e.unit, e.fixed) == (
            values[name], None, named[name].unit, False,
        )  # fmt: skip
    layout = SimpleNamespace(channels=("x", "y"))
    told = SimpleNamespace(layout=layout, numbers=Numbers(np.array([2.0, 3.0])))
    assert refine_module.limits_of(told) == {"x": 2.0, "y": 3.0}


def test_what_each_likelihood_estimates_and_where_it_begins():
    def log(count, step, **measured):
        return Log(step * np.arange(count), {"command": np.ones(count)},
                   {n: np.ones(count) for n in measured})  # fmt: skip

    model = dft.Thruster()
    logs = bind(model, [log(11, 0.2, speed=1), log(31, 0.1, speed=1, thrust=1)])
    simulated = SimulationError.of(model, logs, White(), Gaussian())
    assert simulated.parameters(("speed", "thrust"), logs) == {}
    assert simulated.guesses(()) == ({},)
    assert simulated.starts(model, logs) == ("speed",)
    given = Log([0.0, 0.1], {"speed": np.ones(2)}, {"thrust": np.ones(2)})
    assert simulated.starts(model, bind(model, [given])) == ()
    assert simulated.whiteness(True).limit == 0.5
    corrected = Innovations.of(model, logs, White(), Gaussian())
    assert corrected.starts(model, logs) == ("speed",)
    named = corrected.parameters(("speed", "thrust"), logs)
    # memories within half the shortest step and ten times the longest log
    assert named["noise.speed.memory"].bounds == pytest.approx((0.05, 30.0))
    assert named["noise.speed.memory"].value == 1.0
    assert len(corrected.guesses(tuple(named))) == 3
    assert corrected.whiteness(True).limit == 0.1
    assert (simulated.corrects, corrected.corrects) == (False, True)
