"""Linear algebra on one thread, unless the environment says on how many."""

import made_diagnosis as made
import pytest
from processes import THREADS, one_blas_thread
from threadpoolctl import threadpool_info, threadpool_limits

import diffthrust as dft


def counts():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def unsaid(monkeypatch):
    """Two threads, of which the environment says nothing."""
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    with threadpool_limits(2, user_api="blas"):
        yield monkeypatch


def test_one_thread_where_the_environment_says_nothing_and_as_many_as_before_behind(unsaid):
    with one_blas_thread():
        assert counts() == {1}
    assert counts() == {2}
    unsaid.setenv("OPENBLAS_NUM_THREADS", "2")
    with one_blas_thread():
        assert counts() == {2}


def test_two_that_work_side_by_side_leave_as_many_as_before(unsaid):
    first, second = one_blas_thread(), one_blas_thread()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert counts() == {1}
    second.__exit__(None, None, None)
    assert counts() == {2}


def test_the_headroom_and_a_diagnosis_work_on_one(unsaid):
    train, unseen = made.logs()
    seen = []

    def look(message, share):
        seen.append(counts())

    dft.diagnosis.headroom(dft.Thruster(), train, holdout=unseen, progress=look)
    assert {1} in seen
    seen.clear()
    dft.diagnose(dft.Thruster(), train, candidates=[], experiment=False, progress=look)
    assert seen.count({1}) > 3
    assert counts() == {2}
