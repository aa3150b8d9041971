"""Members divided among processes: one interpreter runs the Python of one thread at a time."""

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
"""Members that a process is given at once: enough to keep its runs full."""


def divided(
    work: Any,
    members: Sequence[tuple[Any, ...]],
    names: Sequence[str],
    common: Any,
    *,
    processes: int,
    progress: Progress | None,
) -> Many:
    """``work(members, names, common)`` in several processes, each given some members at a time.

    What goes between the processes lies in a temporary folder.

    Args:
        work: a function of a module, which gives a `Many`.
        members: what is told of each.
        names: of the members.
        common: what is told to all.
        processes: how many.
        progress: called with a message and the share done.

    Raises:
        InputError: something that another process cannot know, such as a model that the script
            itself defines.
    """
    begun, count = time.monotonic(), len(members)
    share = max(1, min(_MEMBERS_AT_A_TIME, -(-count // processes)))
    chunks = [range(at, min(at + share, count)) for at in range(0, count, share)]
    lines = [LineProcess(f"{__name__}:run_pickled") for _ in range(min(processes, len(chunks)))]
    outcomes: list[tuple[Any, Exception | None, float]] = [(None, None, 0.0)] * count
    finished = 0
    with tempfile.TemporaryDirectory(prefix="diffthrust-") as folder:

        def ask(process: LineProcess, chunk: range) -> list[tuple[Any, Exception | None, float]]:
            asked, answered = (Path(folder) / f"{chunk.start}.{end}" for end in ("in", "out"))
            question = [members[i] for i in chunk], [names[i] for i in chunk], common
            asked.write_bytes(pickle.dumps((work, *question)))
            try:
                failed = process.ask([str(asked), str(answered)])
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
            part = pickle.loads(answered.read_bytes())
            asked.unlink()
            answered.unlink()
            return list(zip(part.results, part.errors, part.seconds, strict=True))

        with closing(on_processes(chunks, [0] * len(chunks), lines, ask)) as each:
            for one in each:
                if one is None:
                    continue
                chunk = chunks[one[0]]
                outcomes[chunk.start : chunk.stop] = one[1]
                finished += len(chunk)
                if progress:
                    progress(f"{finished} of {count}", finished / count)
    return Many(
        names=tuple(names),
        results=tuple(result for result, _, _ in outcomes),
        errors=tuple(error for _, error, _ in outcomes),
        seconds=tuple(seconds for _, _, seconds in outcomes),
        wall=time.monotonic() - begun,
    )


def run_pickled(question: Sequence[str]) -> str:
    """Do the work of a file, put what it gave in another, and say what is wrong with it, if so."""
    asked, answered = map(Path, question)
    try:
        work, *arguments = pickle.loads(asked.read_bytes())
    except (AttributeError, ImportError, pickle.UnpicklingError) as error:
        return str(error)
    answered.write_bytes(pickle.dumps(work(*arguments)))
    return ""
