"""The score test of the diagnosis: its false alarms and its power, on made-up scores."""

import numpy as np
import pytest

from diffthrust.diagnosis._score_test import score_test  # private: the test alone

BASE, MORE, BLOCKS, SAMPLES = 3, 4, 32, 1600


def sums(rng, effect=0.0, correlated=False):
    """A regression with unit noise, at the estimate of its first columns; sums by blocks."""
    rows = rng.standard_normal((BASE + MORE, SAMPLES))
    rows[BASE] += 0.8 * rows[0]  # the first new column leans on an estimated one
    noise = rng.standard_normal(SAMPLES)
    if correlated:  # errors that last within a block, larger in some blocks than in others
        shared = np.repeat(rng.standard_normal(BLOCKS), SAMPLES // BLOCKS)
        rows = rows + np.repeat(rng.standard_normal((BASE + MORE, BLOCKS)), SAMPLES // BLOCKS, 1)
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
