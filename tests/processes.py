# ruff: noqa: F401  (what is imported here, tests import from here)
"""Processes that answer calls: what campaigns and checks run in, made to fail here."""

from diffthrust._support._running import (  # private: what must fix a program on disk
    digest as digests,
)
from diffthrust._support._running import programs  # private: the programs alone
from diffthrust._support._running.batching import (  # private: runs is_unbatched
    SharedRuns,
    run_stacked,
)
from diffthrust._support._running.blas import (  # private: users see the time it saves
    THREADS,
    one_blas_thread,
)
from diffthrust._support._running.cache import (  # private: users see what it saves them
    enable_compilation_cache,
)
from diffthrust._support._running.digest import NoDigest, digest, environment  # private: likewise
from diffthrust._support._running.pool import WorkerPool, as_done, own_worker  # private: likewise
from diffthrust._support._running.process import (  # private: users see what they compute
    NotSent,
    ProcessDied,
    ProcessLate,
    ProcessNotStarted,
    Worker,
)
from diffthrust._support._running.programs import KEPT, program  # private: what is asked for
from diffthrust._support._running.stored import ProgramStore  # private: as users see it
