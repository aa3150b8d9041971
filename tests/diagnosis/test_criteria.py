"""What speaks for a trial and what against a stage, on made-up trials and errors."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from steps import ChannelError, Errors, criterion, missed, no_better, noises, score_test, wald


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
        ((0.51, 0.0201), (0.51, 0.021), "unseen and training ones"),
        ((0.51, 0.0201), (0.49, 0.019), None),
        ((0.51, 0.021), (0.26, 0.010), "has not come to its optimum"),
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
    assert no_better(before, stage(errors(speed=0.504))) is None
    assert "its optimum" in no_better(before, stage(errors(speed=0.6)))
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
    initial_states: None = None
    clip: None = None
    known: float = 0.0

    @property
    def quadratic(self):
        return SimpleNamespace(information=self.known * np.eye(len(self.names)))

    def count(self, names):
        return len(names)  # none of them differs by log

    @property
    def problem(self):
        return SimpleNamespace(named={name: SimpleNamespace(scale=0.1) for name in self.names})


class Costs:
    """Trials in which taking out each noise costs what was said."""

    nuisance = NOISE
    samples = SAMPLES

    def __init__(self, drift, colour):
        self.rise = {"noise.speed.drift.speed": drift, "noise.thrust.colour": colour}

    def solve(self, effects, values, initial_states, limit, budget, still=()):
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


BASE, MORE, BLOCKS, COUNT = 3, 4, 32, 1600


def sums(rng, effect=0.0, correlated=False):
    """A regression with unit noise, at the estimate of its first columns; sums by blocks."""
    rows = rng.standard_normal((BASE + MORE, COUNT))
    rows[BASE] += 0.8 * rows[0]  # the first new column leans on an estimated one
    noise = rng.standard_normal(COUNT)
    if correlated:  # errors that last within a block, larger in some blocks than in others
        shared = np.repeat(rng.standard_normal(BLOCKS), COUNT // BLOCKS)
        rows = rows + np.repeat(rng.standard_normal((BASE + MORE, BLOCKS)), COUNT // BLOCKS, 1)
        noise = 0.5 * noise + shared
    y = noise + effect * rows[BASE]
    fitted = rows[:BASE].T @ np.linalg.lstsq(rows[:BASE].T, y, rcond=None)[0]
    rest = y - fitted
    scores = -(rows * rest).reshape(BASE + MORE, BLOCKS, -1).sum(axis=-1)
    return rows @ rows.T, scores


@pytest.mark.parametrize("correlated", [False, True])
def test_false_alarms_come_as_often_as_stated(correlated):
    """5 % of 1000 tests; outside 3.2 to 7.2 % a right test falls once in 500 runs."""
    rng = np.random.default_rng(5)
    p = [score_test(*sums(rng, correlated=correlated), BASE)[0] for _ in range(1000)]
    assert 0.032 < np.mean(np.array(p) < 0.05) < 0.072


def test_an_effect_is_found_with_its_size():
    p, found, covariance = score_test(*sums(np.random.default_rng(2), 0.2), BASE)
    assert p < 1e-4
    assert found[0] == pytest.approx(0.2, abs=4 * np.sqrt(covariance[0, 0]))
    assert np.all(np.abs(found[1:]) < 4 * np.sqrt(np.diagonal(covariance)[1:]))


def test_what_the_estimated_columns_can_do_is_no_news():
    information, scores = sums(np.random.default_rng(3), 0.0)
    mix = np.eye(BASE + MORE)
    mix[BASE:, BASE:] = 0.0  # the new columns become copies of the first
    mix[BASE:, 0] = 1.0
    assert score_test(mix @ information @ mix.T, mix @ scores, BASE)[0] == 1.0


@pytest.mark.parametrize("size", [np.inf, np.nan])
def test_what_overflows_is_not_tested_and_the_others_are(size):
    """A diagnosis of a Kingfisher ended in "Eigenvalues did not converge"."""
    information, scores = sums(np.random.default_rng(2), 0.2)
    for lost in (0, BASE + MORE - 1):  # an estimated column, and a new one
        kept = [k for k in range(BASE + MORE) if k != lost]
        broken, beyond = information.copy(), scores.copy()
        broken[lost], broken[:, lost], beyond[lost] = size, size, size
        p, found, _ = score_test(broken, beyond, BASE)
        alone = score_test(information[np.ix_(kept, kept)], scores[kept], BASE - (lost < BASE))
        assert p == pytest.approx(alone[0])
        np.testing.assert_allclose(found[: len(alone[1])], alone[1])
    made = Made(100.0, dict.fromkeys(NOISE, 0.1), known=400.0)
    broken = made.quadratic.information
    broken[0, 0] = size
    trial = SimpleNamespace(names=made.names, values=made.values, problem=made.problem,
                            quadratic=SimpleNamespace(information=broken))  # fmt: skip
    assert wald(trial, NOISE[:1]) == pytest.approx(400.0)
