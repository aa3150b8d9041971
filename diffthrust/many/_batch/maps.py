"""Describing functions of many models."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.progress import ProgressOption, progressing
from diffthrust.describing._describe import describing_function as describe_one
from diffthrust.describing._describe import maps_of
from diffthrust.describing._request import MapRequest, request
from diffthrust.estimation._result import Fit
from diffthrust.many._batch.each import check_options, keyword_defaults
from diffthrust.many._batch.result import Many, Outcome, gathered, named_members
from diffthrust.models._base.model import Model

_MAPS_AT_A_TIME = 16
"""Models whose maps are computed together: more would only take memory."""


@progressing
def describing_function(
    models: Many | Sequence[Fit | Model],
    amplitudes: Any,
    frequencies: Any,
    *,
    names: Sequence[str] | None = None,
    progress: ProgressOption = None,
    **options: Any,
) -> Many:
    """Describing functions of many models; see `diffthrust.describing_function`.

    Models of the same structure are computed together. A model that fails becomes an error of that
    member.

    Args:
        models: models or fits; failed members of a `Many` are errors here, too.
        amplitudes: of the input, ``(A,)``, the same for all.
        frequencies: [rad/s], ``(F,)``.
        names: of the members; by default those of the `Many`, or numbers.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.describing_function`.

    Returns:
        `Many` maps.

    Raises:
        InputError: not a list of models, or the number of names differs.

    Example:
        >>> maps = dft.many.describing_function(
        ...     [fit], [0.5, 2.0], [0.5, 2.0], method="harmonic_balance"
        ... )
        >>> maps[0].gain.shape
        (2, 2)
    """
    if not isinstance(models, Sequence | Many):
        raise InputError(
            f"models: expected a list of models or fits, found {type(models).__name__}.",
            "Write [model], or use dft.describing_function for one.",
        )
    check_options(describe_one, options)
    wanted = {**keyword_defaults(describe_one), **options}
    del wanted["progress"]
    started, count = time.monotonic(), len(models)
    named = named_members(names, models.names if isinstance(models, Many) else range(count))
    outcomes: list[Outcome] = [(None, None, 0.0)] * count
    requests: dict[int, MapRequest] = {}
    groups: dict[Any, list[int]] = {}
    for i in range(count):
        try:
            requests[i] = request(models[i], amplitudes, frequencies, **wanted)
            groups.setdefault(requests[i].model.structure, []).append(i)
        except Exception as error:  # of any kind: it belongs to this member, the others continue
            outcomes[i] = None, error, 0.0
    chunks = [
        g[at : at + _MAPS_AT_A_TIME]
        for g in groups.values()
        for at in range(0, len(g), _MAPS_AT_A_TIME)
    ]
    finished = count - len(requests)
    while chunks:
        chunk, since = chunks.pop(0), time.monotonic()
        failure = None
        try:
            drawn = maps_of([requests[i] for i in chunk], [models[i] for i in chunk])
        except Exception as error:
            if len(chunk) > 1:  # retry one by one, so that only the faulty model fails
                chunks = [[i] for i in chunk] + chunks
                continue
            drawn, failure = [None], error
        for i, result in zip(chunk, drawn, strict=True):
            outcomes[i] = result, failure, time.monotonic() - since
        finished += len(chunk)
        if callable(progress):
            progress(f"maps {finished} of {count}", finished / count)
    return gathered(named, outcomes, started)
