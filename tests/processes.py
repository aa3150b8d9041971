"""Processes that answer a line with a line: what campaigns and checks run in, made to fail here."""

from diffthrust._support._running import (  # private: the programs alone
    cache,
    programs,
)
from diffthrust._support._running import (  # private: what must fix a program on disk
    digest as digests,
)
from diffthrust._support._running.batching import (  # private: runs is_unbatched
    SharedRuns,
    run_stacked,
)
from diffthrust._support._running.digest import (  # private: likewise
    NoDigest,
    digest,
    environment,
)
from diffthrust._support._running.pool import (  # private: likewise
    Groups,
    on_processes,
)
from diffthrust._support._running.process import (  # private: users see what they compute
    LineProcess,
    ProcessDied,
    ProcessLate,
    ProcessNotStarted,
)
from diffthrust._support._running.programs import (  # private: what is asked for
    KEPT,
    program,
)
from diffthrust._support._running.stored import (  # private: users see what it saves them
    ProgramStore,
)

__all__ = [
    "KEPT",
    "Groups",
    "LineProcess",
    "NoDigest",
    "ProcessDied",
    "ProcessLate",
    "ProcessNotStarted",
    "ProgramStore",
    "SharedRuns",
    "cache",
    "digest",
    "digests",
    "environment",
    "on_processes",
    "program",
    "programs",
    "run_stacked",
]
