"""Divide members among processes, since the GIL lets one process run one thread of Python."""

from __future__ import annotations

import pickle
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from diffthrust._support._running.pool import on_processes
from diffthrust._support._running.process import LineProcess, ProcessDied
from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress
from diffthrust.many._batch.result import Many

_MEMBERS_AT_A_TIME = 64
"""Members sent to a process at once: enough to keep its batched runs full."""


def divided(
    work: Any,
    members: Sequence[tuple[Any, ...]],
    names: Sequence[str],
    common: Any,
    *,
    processes: int,
    progress: Progress | None,
) -> Many:
    """Call ``work(members, names, common)`` in several processes, some members at a time.

    Arguments and results are exchanged by files in a temporary folder.

    Args:
        work: a module-level function that returns a `Many`.
        members: arguments of each member.
        names: of the members.
        common: arguments common to all.
        processes: number of processes.
        progress: called with a message and the share done.

    Raises:
        InputError: an argument cannot be sent to another process, such as a model defined in the
            main script.
    """
    started, count = time.monotonic(), len(members)
    share = max(1, min(_MEMBERS_AT_A_TIME, -(-count // processes)))
    chunks = [range(at, min(at + share, count)) for at in range(0, count, share)]
    lines = [LineProcess(f"{__name__}:run_pickled") for _ in range(min(processes, len(chunks)))]
    outcomes: list[tuple[Any, Exception | None, float]] = [(None, None, 0.0)] * count
    finished = 0
    with tempfile.TemporaryDirectory(prefix="diffthrust-") as folder:

        def ask(process: LineProcess, chunk: range) -> list[tuple[Any, Exception | None, float]]:
            # Files, since a line of JSON through the pipe cannot hold pickled arrays.
            request, reply = (Path(folder) / f"{chunk.start}.{end}" for end in ("in", "out"))
            question = [members[i] for i in chunk], [names[i] for i in chunk], common
            request.write_bytes(pickle.dumps((work, *question)))
            try:
                failed = process.ask([str(request), str(reply)])
            except ProcessDied as how:
                error = InputError(
                    f"The process that worked on it died ({how}).",
                    "Try it alone; if memory was short, take fewer processes.",
                )
                return [(None, error, 0.0)] * len(chunk)
            if failed:
                raise InputError(
                    f"processes: another process cannot do this ({failed}).",
                    "Put models, effects and functions of your own in a module, or leave processes "
                    "out.",
                )
            answer = pickle.loads(reply.read_bytes())
            request.unlink()
            reply.unlink()
            return list(zip(answer.results, answer.errors, answer.seconds, strict=True))

        with closing(on_processes(chunks, [0] * len(chunks), lines, ask)) as each:
            for outcome in each:
                if outcome is None:
                    continue
                chunk = chunks[outcome[0]]
                outcomes[chunk.start : chunk.stop] = outcome[1]
                finished += len(chunk)
                if progress:
                    progress(f"{finished} of {count}", finished / count)
    return Many(
        names=tuple(names),
        results=tuple(result for result, _, _ in outcomes),
        errors=tuple(error for _, error, _ in outcomes),
        seconds=tuple(seconds for _, _, seconds in outcomes),
        wall=time.monotonic() - started,
    )


def run_pickled(question: Sequence[str]) -> str:
    """Read arguments from a file, write the result to another; returns an error message, if any."""
    request, reply = map(Path, question)
    try:
        work, *arguments = pickle.loads(request.read_bytes())
    except (AttributeError, ImportError, pickle.UnpicklingError) as error:
        return str(error)
    reply.write_bytes(pickle.dumps(work(*arguments)))
    return ""
