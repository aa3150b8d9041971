"""One thread for each of some members at a time, their programs side by side."""

from __future__ import annotations

import operator
import os
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import jax

from diffthrust._errors import InputError
from diffthrust._intake import bridged
from diffthrust._lanes import Lanes
from diffthrust._log import Log
from diffthrust._starts import Progress
from diffthrust._step_check import CoarseStepWarning
from diffthrust.many._lengths import ladder
from diffthrust.many._result import Many

WIDTH = 8
"""Rows of one run on a processor: enough to fill its vector units, few enough for its cache."""
ACCELERATED = 256
"""Rows of one run on an accelerator."""


def each(
    work: Callable[[int], Any],
    names: Sequence[str],
    logs: Iterable[Log] = (),
    *,
    width: int | None = None,
    devices: Sequence[Any] | None = None,
    progress: Progress | None = None,
) -> Many:
    """Do ``work(i)`` for every name; what raises an error is a row with it.

    Args:
        work: of one member; the programs that it runs are run together with those of others.
        names: of the members.
        logs: all logs that will be simulated, by whose lengths programs are shared.
        width: members in one run; by default `WIDTH` on a processor, and on an accelerator
            `ACCELERATED` or all if they are fewer.
        devices: over which runs are divided; by default the first of those that JAX has.
        progress: called with a message and the share done.
    """
    devices = _checked(devices)
    width = _width(width, len(names), devices)
    # two runs at a time: one computes while what the other gave is looked at
    workers = min(os.cpu_count() or 1, 4) if devices[0].platform == "cpu" else 2
    lanes = Lanes(
        width * len(devices), workers, ladder(len(bridged(log)[0]) for log in logs), devices
    )
    started, found = time.monotonic(), [_Outcome() for _ in names]

    def one(i: int) -> None:
        begun = time.monotonic()
        try:
            found[i].result = lanes.do(lambda: work(i))
        except Exception as error:  # a row of its own, whatever it is: the others go on
            found[i].error = error
        found[i].seconds = time.monotonic() - begun

    active = lanes.width * (workers + 1)  # some runs are computed, one gathers
    pool = ThreadPoolExecutor(max_workers=min(active, max(len(names), 1)))
    try:
        with warnings.catch_warnings():  # each fit notes what it warns of
            warnings.simplefilter("ignore", CoarseStepWarning)
            under_way = [pool.submit(one, i) for i in range(len(names))]
            for done, _ in enumerate(as_completed(under_way), 1):
                if progress:
                    progress(f"{done} of {len(names)}", done / len(names))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        lanes.close()
    return Many(
        names=tuple(names),
        results=tuple(one.result for one in found),
        errors=tuple(one.error for one in found),
        seconds=tuple(one.seconds for one in found),
        wall=time.monotonic() - started,
    )


class _Outcome:
    """What became of one member."""

    result: Any = None
    error: Exception | None = None
    seconds: float = 0.0


def _checked(devices: Sequence[Any] | None) -> list[Any]:
    given = list(devices) if devices is not None else jax.devices()[:1]
    known = [d for platform in {d.platform for d in jax.devices()} for d in jax.devices(platform)]
    if not given or any(device not in known for device in given):
        raise InputError(
            f"devices: expected some of JAX's devices, found {given or 'none'}.",
            "Give jax.devices() or a part of it.",
        )
    return given


def _width(width: Any, members: int, devices: Sequence[Any]) -> int:
    if width is None:
        most = WIDTH if devices[0].platform == "cpu" else ACCELERATED
        return max(1, min(most, -(-members // len(devices))))
    try:
        fine = operator.index(width) >= 1
    except TypeError:
        fine = False
    if not fine:
        raise InputError(
            f"width: expected a whole number from 1 on, found {width!r}.", "Correct it."
        )
    return int(width)
