"""Run the work of many members, with one outcome for each."""

from __future__ import annotations

import operator
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
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import Progress
from diffthrust.logs._log import Log
from diffthrust.many._batch.result import Many
from diffthrust.simulation._gaps import bridged

WIDTH = 8
"""Rows per run on a processor: enough to fill its vector units, few enough for its cache."""
ACCELERATED = 256
"""Rows per run on an accelerator."""


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
    """Call ``work(i)`` for every name; an exception becomes the error of that member.

    Args:
        work: the work of one member; its programs run batched with those of other members.
        names: of the members.
        lengths: lengths to which logs are padded, so that they share programs.
        width: rows per run and device; by default `WIDTH` on a processor, and on an accelerator
            `ACCELERATED`, or all members if fewer.
        devices: devices over which runs are divided; by default the one JAX would choose.
        runs: concurrent runs; by default one more than processors, so that none is idle.
        progress: called with a message and the share done.
    """
    chosen = () if devices is None else _checked(devices)
    on = chosen or jax.devices()[:1]
    processor = on[0].platform == "cpu"
    runs = runs or (min(os.cpu_count() or 1, 4) + 1 if processor else 2)
    if width is None:
        runner = SharedRuns(WIDTH if processor else ACCELERATED, chosen, len(names), runs)
    else:
        runner = SharedRuns(_checked_width(width), chosen, runs=runs)
    started, outcomes = time.monotonic(), [_Outcome() for _ in names]

    def one_member(i: int) -> None:
        started_member = time.monotonic()
        try:
            with padded_to(lengths):
                outcomes[i].result = work(i)
        except Exception as error:  # of any kind: it belongs to this member, the others continue
            _forget(error)
            outcomes[i].error = error
        outcomes[i].seconds = time.monotonic() - started_member

    with closing(runner.drive(partial(one_member, i) for i in range(len(names)))) as ended:
        for finished, _ in enumerate(ended, 1):
            if progress:
                progress(f"{finished} of {len(names)}", finished / len(names))
    return Many(
        names=tuple(names),
        results=tuple(outcome.result for outcome in outcomes),
        errors=tuple(outcome.error for outcome in outcomes),
        seconds=tuple(outcome.seconds for outcome in outcomes),
        wall=time.monotonic() - started,
    )


def check_options(call: Callable[..., Any], options: Iterable[str]) -> None:
    """Raise `InputError` for an unknown option, which would fail for every member."""
    names = [n for n, p in signature(call).parameters.items() if p.kind is Parameter.KEYWORD_ONLY]
    for name in options:
        if name not in names:
            raise InputError(
                f"dft.{call.__name__} has no option '{name}'; it has {listing(names)}.",
                "Correct or leave out the option.",
            )


class _Outcome:
    """Result or error of one member."""

    result: Any = None
    error: Exception | None = None
    seconds: float = 0.0


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


def _checked_width(width: Any) -> int:
    try:
        fine = operator.index(width) >= 1
    except TypeError:
        fine = False
    if not fine:
        raise InputError(
            f"width: expected a whole number from 1 on, found {width!r}.", "Correct it."
        )
    return int(width)


PROGRAM = 4_000_000
"""Cost of compiling for one more length, in samples that could be fitted in that time."""
_MOST = 512  # distinct lengths; more are merged first


def ladder(lengths: Iterable[int], program: float = PROGRAM) -> list[int]:
    """The lengths to pad to, ascending: each log is padded to the next length.

    Args:
        lengths: of the logs, in samples.
        program: what one more length costs, in samples.

    Returns:
        The set of least total cost; with very many lengths, neighbours are merged first.

    Example:
        >>> ladder([1000] * 50 + [1010] * 50, program=20_000)
        [1010]
    """
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
