"""Processes that answer a line with a line: what campaigns and checks run in, made to fail here."""

from diffthrust._support._running.pool import on_processes  # private: likewise
from diffthrust._support._running.process import (  # private: users see what they compute
    LineProcess,
    ProcessDied,
    ProcessLate,
    ProcessNotStarted,
)

__all__ = ["LineProcess", "ProcessDied", "ProcessLate", "ProcessNotStarted", "on_processes"]
