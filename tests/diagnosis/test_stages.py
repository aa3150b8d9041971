"""The bounds on the work of a stage: screens, and the fits that tell what an effect is worth."""

from types import SimpleNamespace

import diffthrust as dft
from diffthrust.diagnosis._stages import PLAIN, SCREENS, Stages


class Restless(Stages):
    """A better noise comes to light at the first so many screens."""

    better = 0

    def _added(self, again):
        self.__dict__.setdefault("asked", []).append(again)
        if len(self.asked) <= self.better:
            self.present = object()
        return False


def restless(better):
    stages = Restless((), (), 0, lambda *_: None)
    stages.better, stages.present = better, object()
    assert not stages.advance()
    return stages.asked


def test_candidates_are_screened_once_where_no_better_noise_is_found():
    assert restless(better=0) == [True]


def test_a_better_noise_has_the_candidates_screened_anew():
    assert restless(better=1) == [True, True]


def test_screens_end_however_often_a_better_noise_is_found_and_the_last_looks_for_none():
    asked = restless(better=99)
    assert asked == [True] * (SCREENS - 1) + [False]


def without(loss, promise):
    """What is solved when an effect is taken out that costs ``loss`` to leave out."""
    solved = []

    def result(budget):
        solved.append(budget)
        cost = 100.0 + loss
        return SimpleNamespace(cost=cost, promise=promise, expected=cost - promise)

    stages = Stages((), (), 0, lambda *_: None)
    stages.present = SimpleNamespace(effects=("a", "b"), values={}, begin=None, cost=100.0)
    stages.trials = SimpleNamespace(
        absent=lambda name, values: values,
        solve=lambda rest, values, begin, budget: result(budget),
        further=lambda trial: result("to the end"),
    )
    found = stages.without("a")
    assert stages.without("a") is found  # and not fitted again
    return solved


def test_a_fit_without_an_effect_ends_early_where_much_is_lost():
    assert without(loss=PLAIN + 50.0, promise=1.0) == [12]


def test_it_is_carried_to_the_end_where_the_loss_may_be_small():
    assert without(loss=PLAIN + 50.0, promise=60.0) == [12, "to the end"]
    assert without(loss=3.0, promise=1.0) == [12, "to the end"]


def test_it_is_not_where_it_has_come_to_its_end():
    assert without(loss=3.0, promise=0.0) == [12]


def other_values(nrmse, beta, guess):
    """What effects are tried with where the trials have come to some ``beta``; 42 in the fit."""
    model = dft.Thruster(beta=42.0).fix("ct")
    stages = Stages((), (), 0, lambda *_: None, guess=guess)
    fit = SimpleNamespace(model=model)
    stages.stages = [SimpleNamespace(fit=fit, train=SimpleNamespace(nrmse=nrmse))]
    problem = SimpleNamespace(named=model.parameters)
    stages.trials = SimpleNamespace(own=("alpha", "beta"), problem=problem)
    stages.present = SimpleNamespace(values={"alpha": 0.037, "beta": beta})
    return stages._other_values()


def test_effects_are_tried_with_other_values_where_the_model_has_gone_astray():
    guess = {"alpha": 1.0, "beta": 1.0}
    assert other_values(0.2, 30.0, guess) is None
    assert other_values(0.8, 30.0, guess) == guess
    # an observer that explains all by random forces leaves the model nothing to do
    assert other_values(0.2, 1e-6, guess) == {"alpha": 0.037, "beta": 42.0}
    assert other_values(0.8, 1e-6, {}) == {"alpha": 0.037, "beta": 42.0}
