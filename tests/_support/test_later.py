"""What is worked out at the first look: once, and equal to the same things worked out at once."""

import pickle
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from diffthrust._support.later import Later  # private: nothing public makes one
from diffthrust._support.saved_file import encoded  # private: as files are written


def counted():
    looks = []

    def work():
        looks.append(1)
        return [1, 2]

    return looks, Later(work)


def test_it_is_worked_out_at_the_first_look_and_once():
    looks, later = counted()
    assert not looks
    assert list(later) == [1, 2]
    assert (len(later), later[-1], 2 in later, bool(later)) == (2, 2, True, True)
    assert len(looks) == 1


def test_it_is_what_a_tuple_would_be():
    _, later = counted()
    assert later == (1, 2) == tuple(later)
    assert later not in ((1,), [1, 2])
    assert later == counted()[1]
    assert (hash(later), repr(later)) == (hash((1, 2)), "(1, 2)")
    assert (0, *later) == (0, 1, 2) == (0,) + later
    assert later + (3,) == (1, 2, 3)
    assert not Later(tuple)


def test_threads_that_look_at_once_wait_for_one_of_them():
    looks = []

    def work():
        looks.append(1)
        time.sleep(0.05)
        return [1, 2]

    later = Later(work)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: len(later), range(4))) == [2, 2, 2, 2]
    assert len(looks) == 1


def test_other_processes_and_files_get_the_items():
    _, later = counted()
    assert pickle.loads(pickle.dumps(later)) == (1, 2)
    assert encoded(later, {}) == [1, 2]


def test_work_that_fails_is_tried_again():
    def work():
        raise ValueError("no")

    later = Later(work)
    for _ in range(2):
        with pytest.raises(ValueError, match="no"):
            len(later)
