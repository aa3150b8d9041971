"""What speaks for a trial and what against a stage, on made-up trials and errors."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from diffthrust.diagnosis._criteria import (  # private: each criterion alone
    criterion,
    missed,
    no_better,
    noises,
    wald,
)
from diffthrust.simulation._errors import ChannelError, Errors  # private: made by hand


def errors(**nrmse):
    channels = {n: ChannelError(10 * e, e, 100 * (1 - e), 500) for n, e in nrmse.items()}
    return Errors(float(np.sqrt(np.mean(np.square([*nrmse.values()])))), channels)


def stage(train, unseen=None):
    return SimpleNamespace(train=train, holdout=unseen)


BEFORE = stage(errors(speed=0.5, thrust=0.020), errors(speed=0.5, thrust=0.020))


@pytest.mark.parametrize(
    ("train", "unseen", "why"),
    [
        ((0.5, 0.019), (0.5, 0.019), None),  # the small channel alone gains
        ((0.506, 0.010), (0.506, 0.010), None),  # one grows a little, the other is halved
        ((0.5, 0.020), (0.5, 0.020), None),  # nothing changes: it may be detectable, not spoilt
        ((0.49, 0.019), (0.61, 0.019), "whole unseen runs worse"),
        ((0.51, 0.021), (0.51, 0.021), "unseen and training ones"),
        ((0.51, 0.021), (0.49, 0.019), None),
        ((0.495, 0.0198), (0.52, 0.0208), "unseen and training ones"),
        ((np.inf, np.inf), (0.5, 0.020), "cannot be carried"),
    ],
)
def test_simulations_speak_against_a_stage(train, unseen, why):
    new = stage(*(errors(speed=a, thrust=b) for a, b in (train, unseen)))
    told = no_better(BEFORE, new)
    assert told is None if why is None else why in told


def test_without_unseen_logs_only_training_runs_speak():
    before = stage(errors(speed=0.5))
    assert no_better(before, stage(errors(speed=0.6))) is None
    assert "cannot be carried" in no_better(before, stage(errors(speed=np.inf)))


def test_a_dropped_effect_is_missed_where_training_runs_grow_worse():
    assert missed(BEFORE, stage(errors(speed=0.52, thrust=0.020)))
    assert not missed(BEFORE, stage(errors(speed=0.501, thrust=0.020)))


# -- the information criterion ---------------------------------------------------------------------

SAMPLES = 1000.0
NOISE = ("noise.speed.drift.speed", "noise.speed.memory", "noise.thrust.colour",
         "noise.thrust.correlation")  # fmt: skip


def test_noises_are_gains_with_their_memory():
    found = noises(NOISE)
    assert [noise.parameters for noise in found] == [NOISE[:2], NOISE[2:]]


@dataclass(frozen=True)
class Made:
    """A trial with as much of `Trial` as the criterion reads."""

    cost: float
    values: dict = field(default_factory=dict)
    names: tuple = ("alpha", "effect.size", *NOISE)
    effects: tuple = ("effect",)
    begin: None = None
    limit: None = None
    known: float = 0.0

    @property
    def quadratic(self):
        return SimpleNamespace(information=self.known * np.eye(len(self.names)))

    @property
    def problem(self):
        return SimpleNamespace(named={name: SimpleNamespace(scale=0.1) for name in self.names})


class Costs:
    """Trials in which taking out each noise costs what was said."""

    nuisance = NOISE
    samples = SAMPLES

    def __init__(self, drift, colour):
        self.rise = {"noise.speed.drift.speed": drift, "noise.thrust.colour": colour}

    def solve(self, effects, values, begin, limit, budget, still=()):
        lost = sum(rise for name, rise in self.rise.items() if values[name] == 0.0)
        names = tuple(n for n in Made.names if n not in still)
        return Made(100.0 + lost, dict(values), names, effects)


@pytest.mark.parametrize(
    ("drift", "colour", "kept"), [(50.0, 50.0, 4), (1.0, 50.0, 2), (1.0, 1.0, 0), (5.0, 5.0, 0)]
)
def test_the_criterion_takes_out_the_noise_that_is_not_worth_its_price(drift, colour, kept):
    """A noise of two parameters is worth it where it gains more than ln(1000) = 6.9."""
    values = {"noise.speed.drift.speed": 0.1, "noise.thrust.colour": 0.2}
    values |= {"noise.speed.memory": 1.0, "noise.thrust.correlation": 1.0}
    lost = sum(rise for rise in (drift, colour) if rise < np.log(SAMPLES))
    expected = 2 * (100.0 + lost) + (2 + kept) * np.log(SAMPLES)
    found = criterion(Costs(drift, colour), Made(100.0, values))
    assert found == pytest.approx(expected)


def test_a_noise_that_is_plainly_there_is_not_taken_out():
    """With drift 0.1, a coordinate of 1, known to 0.05, Wald's statistic is 400."""
    values = dict.fromkeys(NOISE, 0.1)
    trial = Made(100.0, values, known=400.0)
    assert wald(trial, NOISE[:1]) == pytest.approx(400.0)
    assert wald(trial, NOISE[::2]) == pytest.approx(800.0)
    nothing_may_be_tried = SimpleNamespace(nuisance=NOISE, samples=SAMPLES)
    assert criterion(nothing_may_be_tried, trial) == pytest.approx(200 + 6 * np.log(SAMPLES))
