"""Runs whose errors stand out from those of the others."""

from types import SimpleNamespace

import pytest

from diffthrust.comparison._outstanding import outstanding  # private: of errors made by hand


def runs(rmse, spread):
    """Runs of one channel with given errors, beside how much varies in each."""
    made = []
    for k, (error, size) in enumerate(zip(rmse, spread, strict=True)):
        one = SimpleNamespace(rmse=error, nrmse=error / size, samples=100, shown=(error, "rad/s"))
        errors = SimpleNamespace(channels={"speed": one})
        made.append(SimpleNamespace(name=f"run {k}", channels={"speed": None}, errors=errors))
    return made


def test_a_run_with_a_large_error_stands_out():
    (one,) = outstanding(runs([1.0, 1.2, 5.0, 0.9], [10.0, 10.0, 10.0, 10.0]))
    assert (one.place, one.run) == (2, "run 2")
    assert one.ratio == pytest.approx(5.0 / 1.1)
    assert one.share == pytest.approx(25.0 / 28.25)


@pytest.mark.parametrize("size", [8.0, 1 / 8.0])
def test_a_larger_or_smaller_manoeuvre_does_not(size):
    """A larger one errs by as large a share, a smaller one by as much."""
    error = max(size, 1.0)
    assert outstanding(runs([1.0, 1.0, error, 1.0], [10.0, 10.0, 10.0 * size, 10.0])) == []


def test_of_two_runs_none_stands_out():
    assert outstanding(runs([1.0, 9.0], [10.0, 10.0])) == []
