"""Run the work of many members, with one outcome for each, in this process or in several."""

from __future__ import annotations

import os
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from functools import partial
from inspect import Parameter, signature
from typing import Any

import jax
import numpy as np

from diffthrust._support._running.batching import SharedRuns, padded_to
from diffthrust._support._running.digest import default_device
from diffthrust._support._running.pool import WorkerPool, as_done, own_worker
from diffthrust._support._running.process import NotSent, ProcessDied, Worker
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import Progress
from diffthrust._support.validation import whole_number
from diffthrust.logs._log import Log
from diffthrust.many._batch.result import Many, Outcome, gathered
from diffthrust.simulation._record import bridged

WIDTH = 8
"""Rows per run on a processor: enough to fill its vector units, few enough for its cache."""
ACCELERATED = 256
"""Rows per run on an accelerator."""
_MEMBERS_AT_A_TIME = 64
"""Members sent to a process at once: enough to keep its batched runs full."""


def lengths_of(logs: Iterable[Log]) -> list[int]:
    """The lengths to which these logs are padded."""
    return ladder(len(bridged(log)[0]) for log in logs)


def each(
    work: Callable[[int], Any],
    names: Sequence[str],
    lengths: Sequence[int] = (),
    *,
    width: int | None = None,
    devices: Sequence[Any] | None = None,
    runs: int | None = None,
    progress: Progress | None = None,
) -> Many:
    """Call ``work(i)`` for every name; an exception becomes the error of that member."""
    chosen = () if devices is None else _checked(devices)
    processor = (chosen[0] if chosen else default_device()).platform == "cpu"
    runs = runs or (min(os.cpu_count() or 1, 4) + 1 if processor else 2)
    if width is None:
        runner = SharedRuns(WIDTH if processor else ACCELERATED, chosen, len(names), runs)
    else:
        runner = SharedRuns(whole_number("width", width), chosen, runs=runs)
    started = time.monotonic()
    outcomes: list[Outcome] = [(None, None, 0.0)] * len(names)

    def one_member(i: int) -> None:
        result, failure, started_member = None, None, time.monotonic()
        try:
            with padded_to(lengths):
                result = work(i)
        except Exception as error:  # of any kind: it belongs to this member, the others continue
            _forget(error)
            failure = error
        outcomes[i] = result, failure, time.monotonic() - started_member

    with closing(runner.drive(partial(one_member, i) for i in range(len(names)))) as ended:
        for finished, _ in enumerate(ended, 1):
            if progress:
                progress(f"{finished} of {len(names)}", finished / len(names))
    return gathered(names, outcomes, started)


def divided(
    work: Callable[..., Many],
    members: Sequence[tuple[Any, ...]],
    names: Sequence[str],
    common: Any,
    *,
    processes: int,
    progress: Progress,
) -> Many:
    """Call ``work(members, names, common)`` in several processes, some members at a time."""
    started, count, finished = time.monotonic(), len(members), 0
    share = max(1, min(_MEMBERS_AT_A_TIME, -(-count // processes)))
    chunks = [slice(at, min(at + share, count)) for at in range(0, count, share)]
    outcomes: list[Outcome] = [(None, None, 0.0)] * count

    def ask(chunk: slice) -> list[Outcome]:
        try:
            many: Many = own_worker().ask(members[chunk], names[chunk], common)
            return list(zip(many.results, many.errors, many.seconds, strict=True))
        except ProcessDied as how:
            error = InputError(
                f"The process that worked on it died ({how}).",
                "Try it alone; if memory was short, take fewer processes.",
            )
            return [(None, error, 0.0)] * (chunk.stop - chunk.start)
        except NotSent as why:
            raise InputError(
                f"processes: another process cannot do this ({why}).",
                "Put models, effects and functions of your own in a module, or leave processes "
                "out.",
            ) from None

    with WorkerPool([Worker(work) for _ in range(min(processes, len(chunks)))]) as pool:
        for i, answer in as_done(pool, ask, chunks):
            outcomes[chunks[i]] = answer.result()
            finished += chunks[i].stop - chunks[i].start
            progress(f"{finished} of {count}", finished / count)
    return gathered(names, outcomes, started)


def keyword_defaults(call: Callable[..., Any]) -> dict[str, Any]:
    """The keyword arguments of a function, with their defaults."""
    every = signature(call).parameters.values()
    return {p.name: p.default for p in every if p.kind is Parameter.KEYWORD_ONLY}


def check_options(call: Callable[..., Any], options: Iterable[str]) -> None:
    """Raise `InputError` for an unknown option, which would fail for every member."""
    names = keyword_defaults(call)
    for name in options:
        if name not in names:
            raise InputError(
                f"dft.{call.__name__} has no option '{name}'; it has {listing(names)}.",
                "Correct or leave out the option.",
            )


def _forget(error: Exception) -> None:
    """Release the locals in an error's frames: thousands of kept errors would hold their arrays."""
    for exception in (error, error.__cause__, error.__context__):
        if exception is not None:
            traceback.clear_frames(exception.__traceback__)


def _checked(devices: Any) -> tuple[Any, ...]:
    listed = tuple(devices) if isinstance(devices, Sequence) else ()
    fine = listed and all(isinstance(device, jax.Device) for device in listed)
    if not fine or len(set(listed)) < len(listed):
        raise InputError(
            f"devices: expected a list of JAX's devices, each once, found {devices!r}.",
            "Give jax.devices() or a subset.",
        )
    return listed


PROGRAM = 4_000_000
"""Cost of compiling for one more length, in samples that could be fitted in that time."""
_MOST = 512  # distinct lengths; more are merged first


def ladder(lengths: Iterable[int], program: float = PROGRAM) -> list[int]:
    """The lengths to pad to, ascending, of least total cost; each log is padded to the next."""
    sizes, counts = np.unique(np.asarray(list(lengths), int), return_counts=True)
    if sizes.size > _MOST:
        edges = np.unique(np.linspace(0, sizes.size - 1, _MOST).astype(int))
        place = np.searchsorted(edges, np.arange(sizes.size))
        sizes, counts = sizes[edges], np.bincount(place, weights=counts)
    below = np.concatenate([[0.0], np.cumsum(counts)])
    # best[i]: least cost of the i shortest logs, the longest of which is in the set
    # Dynamic programming over the sorted lengths: exact in n^2 steps, where greedy merging is not.
    best, cut = np.zeros(sizes.size + 1), np.zeros(sizes.size + 1, int)
    for i in range(1, sizes.size + 1):
        costs = best[:i] + program + sizes[i - 1] * (below[i] - below[:i])
        cut[i] = int(np.argmin(costs))
        best[i] = costs[cut[i]]
    out, i = [], sizes.size
    while i > 0:
        out.append(int(sizes[i - 1]))
        i = int(cut[i])
    return out[::-1]
