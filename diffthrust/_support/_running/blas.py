"""Linear algebra on one thread, where matrices are of some hundred rows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of the environment that say on how many threads it works."""


_inside, _entering, _limited = 0, Lock(), ExitStack()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Give NumPy's and SciPy's linear algebra one thread, if the environment does not say how many.

    OpenBLAS shares each factorisation among all cores, whose threads spin while they wait for each
    other. Where a neighbour works on one of two, the headroom of `examples/bench`, 675
    factorisations of up to 730 rows, took 5.3 s of processor time in 3.0 s on two threads, and
    1.1 s in 1.1 s on one. The number is one of the whole process: threads of a process that work
    side by side have it together.
    """
    global _inside
    if any(os.environ.get(name) for name in THREADS):
        yield
        return
    import scipy.linalg  # noqa: F401  # has a library of its own, which must be there
    from threadpoolctl import threadpool_limits

    with _entering:
        _inside += 1
        if _inside == 1:
            _limited.enter_context(threadpool_limits(1, user_api="blas"))
    try:
        yield
    finally:
        with _entering:
            _inside -= 1
            if _inside == 0:
                _limited.close()
