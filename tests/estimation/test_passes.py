"""Passes of an observer over several logs: their order, their cost, and where they begin best."""

from typing import ClassVar

import numpy as np
import pytest
from compilations import compilations
from observers import cost, passes, settled_start, with_clip
from problems import build, errors_at, innovations_of

import diffthrust as dft
from diffthrust import Log


class Both(dft.Model):
    """Two lags under one input, each measured."""

    name = "two_lags"
    inputs: ClassVar = {"u": "V"}
    states: ClassVar = {"x": "m", "y": "m"}
    outputs: ClassVar = {"x": "m", "y": "m"}
    a: float = dft.parameter(0.9, "1/s", bounds=(0, None))
    b: float = dft.parameter(2.3, "1/s", bounds=(0, None))

    def equations(self, s, port):
        return {"x": self.a * (s.u - s.x), "y": self.b * (s.u - s.y)}, {"x": s.x, "y": s.y}


def log(count, seed):
    rng = np.random.default_rng(seed)
    measured = {n: rng.normal(scale=0.4, size=count) for n in ("x", "y")}
    measured["y"][5:9] = np.nan
    return Log(0.1 * np.arange(count), {"u": rng.normal(size=count)}, measured, name=f"run{seed}")


@pytest.fixture(scope="module")
def problem():
    """Two logs that share a batch in the order of their lengths, with limits that none meets."""
    logs = [log(25, 1), log(31, 2)]
    made = build(Both(), logs, likelihood=innovations_of(Both(), logs), width=4)
    assert made.order == ((1, 0),)
    made = made.focus(("a", "b", "noise.x.gain.x"), {n: p.value for n, p in made.named.items()})
    return with_clip(made, [50.0, 80.0])


@pytest.mark.thorough
def test_passes_are_in_the_order_of_the_logs(problem):
    z = problem.start()
    found = passes(problem, z)
    for one, told, given in zip(found, errors_at(problem, z), problem.records, strict=True):
        assert one.errors.shape == one.measured.shape == (2, len(given))
        np.testing.assert_array_equal(one.measured, [given.measured["x"], given.measured["y"]])
        np.testing.assert_allclose(one.errors, [told["x"], told["y"]], rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(one.path["time"], given.time)
        np.testing.assert_array_equal(one.path["u"], given.inputs["u"])
    np.testing.assert_array_equal(passes(problem)[0].errors, found[0].errors)


def made_of(logs):
    return build(Both(a=0.8), logs, likelihood=innovations_of(Both(), logs))


def test_few_logs_one_by_one_and_many_at_once_have_the_same_passes():
    logs = [log(20 + i, i) for i in range(10)]
    before = compilations("_pass")
    few = [found for part in (logs[:7], logs[7:]) for found in passes(made_of(part))]
    assert compilations("_pass") - before == 1  # for all of them
    many = passes(made_of(logs))
    assert compilations("_pass") - before == 2
    for one, other in zip(few, many, strict=True):
        np.testing.assert_allclose(one.errors, other.errors, rtol=1e-12, atol=1e-14)
        for name, series in one.path.items():
            np.testing.assert_allclose(series, other.path[name], rtol=1e-12, atol=1e-14)


def test_the_cost_is_that_of_the_errors(problem):
    errors = np.concatenate([one.errors for one in passes(problem)], axis=1)
    expected = sum(np.sum(np.isfinite(e)) * 0.5 * np.log(np.nanmean(e**2)) for e in errors)
    assert cost(problem) == pytest.approx(expected, rel=1e-9)


def test_runs_begin_where_they_err_least(problem):
    begun = settled_start(problem)
    z = problem.start()
    now = passes(problem, z)
    expected = {}
    for i, given in enumerate(problem.records):
        for c, name in enumerate(("x", "y")):
            at = problem.shared + 2 * problem.order[0].index(i) + c
            moved = z.copy()
            moved[at] += 1.0
            slope = passes(problem, moved)[i].errors[c] - now[i].errors[c]
            seen = np.isfinite(slope)
            e = now[i].errors[c]
            expected[i, name] = z[at] - (slope[seen] @ e[seen]) / (slope[seen] @ slope[seen])
            assert len(given)
    for i, states in enumerate(begun.numbers_by_log(begun.start())):
        for name in ("x", "y"):
            # the limits bend errors a little: 1e-8 at a hundredth of them
            assert states[name] == pytest.approx(expected[i, name], rel=1e-5)
    np.testing.assert_array_equal(begun.start()[:4], z[:4])
    assert cost(begun) < cost(problem) - 0.1
