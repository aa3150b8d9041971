"""The work of many members, each with an outcome of its own."""

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

from diffthrust._support._running.batching import SharedRuns, padded_to
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import Progress
from diffthrust.logs._log import Log
from diffthrust.many._batch.lengths import ladder
from diffthrust.many._batch.result import Many
from diffthrust.simulation._inputs import bridged

WIDTH = 8
"""Rows of one run on a processor: enough to fill its vector units, few enough for its cache."""
ACCELERATED = 256
"""Rows of one run on an accelerator."""


def lengths_of(logs: Iterable[Log]) -> list[int]:
    """To which lengths these logs are padded."""
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
    """Do ``work(i)`` for every name; what raises an error is a row with it.

    Args:
        work: of one member; the programs that it runs are run together with those of others.
        names: of the members.
        lengths: to which logs are padded, so that they share programs.
        width: rows of one run, on each device; by default `WIDTH` on a processor, and on an
            accelerator `ACCELERATED`, or all members if they are fewer.
        devices: over which runs are divided; by default the one that JAX would take.
        runs: at a time; by default one more than processors, so that none is idle.
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

    def one(i: int) -> None:
        begun = time.monotonic()
        try:
            with padded_to(lengths):
                outcomes[i].result = work(i)
        except Exception as error:  # a row of its own, whatever it is: the others go on
            _forget(error)
            outcomes[i].error = error
        outcomes[i].seconds = time.monotonic() - begun

    with closing(runner.drive(partial(one, i) for i in range(len(names)))) as ended:
        for done, _ in enumerate(ended, 1):
            if progress:
                progress(f"{done} of {len(names)}", done / len(names))
    return Many(
        names=tuple(names),
        results=tuple(one.result for one in outcomes),
        errors=tuple(one.error for one in outcomes),
        seconds=tuple(one.seconds for one in outcomes),
        wall=time.monotonic() - started,
    )


def check_options(call: Callable[..., Any], options: Iterable[str]) -> None:
    """Raise `InputError` for an option that a call does not have: no member could be worked out."""
    known = [n for n, p in signature(call).parameters.items() if p.kind is Parameter.KEYWORD_ONLY]
    for name in options:
        if name not in known:
            raise InputError(
                f"dft.{call.__name__} has no option '{name}'; it has {listing(known)}.",
                "Correct or leave out the option.",
            )


class _Outcome:
    """What became of one member."""

    result: Any = None
    error: Exception | None = None
    seconds: float = 0.0


def _forget(error: Exception) -> None:
    """Let go of what an error's frames hold: where it happened is kept, the arrays are not."""
    for one in (error, error.__cause__, error.__context__):
        if one is not None:
            traceback.clear_frames(one.__traceback__)


def _checked(devices: Any) -> tuple[Any, ...]:
    listed = tuple(devices) if isinstance(devices, Sequence) else ()
    fine = listed and all(isinstance(device, jax.Device) for device in listed)
    if not fine or len(set(listed)) < len(listed):
        raise InputError(
            f"devices: expected a list of JAX's devices, each once, found {devices!r}.",
            "Give jax.devices() or a part of it.",
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
