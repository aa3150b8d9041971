"""Fits, comparisons, posteriors and describing functions of many members."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter
from diffthrust._support.validation import whole_number
from diffthrust.comparison._compare import compare as compare_one
from diffthrust.describing._describe import describing_function as describe_one
from diffthrust.describing._describe import maps_of
from diffthrust.describing._request import MapRequest, request
from diffthrust.estimation._arguments import listed
from diffthrust.estimation._fit import fit as fit_one
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.many._batch.each import check_options, divided, each, keyword_defaults, lengths_of
from diffthrust.many._batch.result import Many, Outcome, gathered, named_members
from diffthrust.models._base.model import Model
from diffthrust.uncertainty._sampling.sample import sample as sample_one

Records = Sequence[Log | Sequence[Log]]
_MAPS_AT_A_TIME = 16
"""Models whose maps are computed together: more would only take memory."""


@progressing
def fit(
    model: Model | Sequence[Model],
    logs: Records,
    *,
    holdout: Sequence[Log | Sequence[Log] | None] | None = None,
    names: Sequence[str] | None = None,
    width: int | None = None,
    devices: Sequence[Any] | None = None,
    processes: int = 1,
    progress: ProgressOption = None,
    **options: Any,
) -> Many:
    """Fit a model to each of many records, as `diffthrust.fit` does to one.

    Each member is fitted separately, with its own starts, checks and status, but simulations of
    several members run together in one compiled program. Logs are padded to a few lengths, chosen
    to minimise the cost of compiling and padding. Results equal those of single fits, up to
    rounding. A record that cannot be fitted becomes an error of that member.

    Args:
        model: the first guess for all members, or one for each.
        logs: a log, or several, of each member.
        holdout: unseen logs of each member, or ``None``.
        names: of the members; by default those of their first logs.
        width: members per run of a program on each device; chosen automatically if ``None``.
        devices: JAX devices over which each run is divided; by default JAX's choice.
        processes: number of processes on this machine. One keeps two or three processors busy;
            several take seconds to start, and pay off for thousands of members on more
            processors.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.fit`.

    Returns:
        `Many` fits; ``.table()`` has a row for each.

    Raises:
        InputError: lists differ in length, or an argument is invalid.

    Example:
        >>> result = dft.many.fit(dft.Thruster(), [log, unseen], names=["one", "two"], starts=2)
        >>> result.table()["name"].tolist(), result["one"].status
        (['one', 'two'], <Status.CONVERGED: 'converged'>)
    """
    check_options(fit_one, options)
    members = _members(logs)
    models = _for_each(model, Model, "model", len(members))
    unseen = _for_each(holdout, type(None), "holdout", len(members))
    held = [listed(entry) for entry in unseen if entry is not None]

    lengths = lengths_of(log for group in (*members, *held) for log in group)
    named, triples = _names(names, members), list(zip(models, members, unseen, strict=True))
    if whole_number("processes", processes) > 1 and devices is not None:
        raise InputError(
            "processes: devices belong to one process.", "Leave processes or devices out."
        )
    if processes == 1:
        return _fits(triples, named, (lengths, width, None, options), devices, reporter(progress))
    # Two runs at a time: each process has one processor, and one group waits while the other
    # computes.
    common = (lengths, width, 2, options)
    return divided(_fits, triples, named, common, processes=processes, progress=reporter(progress))


def _fits(
    members: Sequence[tuple[Any, ...]],
    names: Sequence[str],
    common: tuple[Any, ...],
    devices: Sequence[Any] | None = None,
    progress: Progress | None = None,
) -> Many:
    lengths, width, runs, options = common

    def fit_member(i: int) -> Fit:
        model, logs, unseen = members[i]
        # Thousands of short fits: checking each log for doubts would double the time.
        return fit_one(model, logs, holdout=unseen, **{"doubts": False, **options})

    return each(
        fit_member, names, lengths, width=width, devices=devices, runs=runs, progress=progress
    )


@progressing
def compare(
    fit: Fit | Model | Sequence[Fit | Model],
    logs: Records,
    *,
    names: Sequence[str] | None = None,
    width: int | None = None,
    devices: Sequence[Any] | None = None,
    progress: ProgressOption = None,
    **options: Any,
) -> Many:
    """Compare a model, or a fit of each member, with each of many records.

    Args:
        fit: a model or fit for all members, or one for each.
        logs: a log, or several, of each member.
        names: of the members; by default those of their first logs.
        width: members per run of a program on each device; chosen automatically if ``None``.
        devices: JAX devices over which each run is divided; by default JAX's choice.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.compare`.

    Returns:
        `Many` comparisons; ``.table()`` has a row for each.

    Raises:
        InputError: lists differ in length, or an argument is invalid.

    Example:
        >>> held_against = dft.many.compare(fit, [log, unseen], names=["one", "two"])
        >>> held_against.table().shape[0]
        2
    """
    shared = {"width": width, "devices": devices, "progress": reporter(progress)}
    return _of_each(compare_one, fit, (Fit, Model), "fit", logs, options, names, shared)


@progressing
def sample(
    fits: Many | Sequence[Fit],
    logs: Records,
    *,
    names: Sequence[str] | None = None,
    width: int | None = None,
    devices: Sequence[Any] | None = None,
    progress: ProgressOption = None,
    **options: Any,
) -> Many:
    """Draw from the posterior of each of many fits; see `diffthrust.sample`.

    Chains of a single posterior already run together and fill a processor; on an accelerator,
    chains of many logs padded to one length run together as well.

    Args:
        fits: the fits, in the order of the logs; failed members are errors here, too.
        logs: the training logs of each.
        names: of the members; by default those of their first logs.
        width: chains per run of a program on each device; chosen automatically if ``None``.
        devices: JAX devices over which each run is divided; by default JAX's choice.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.sample`, except ``file``.

    Returns:
        `Many` posteriors.

    Raises:
        InputError: lists differ in length, or an argument is invalid.

    Example:
        >>> posteriors = dft.many.sample([fit], [log], draws=100, warmup=50)
        >>> len(posteriors.results)
        1
    """
    if "file" in options:
        raise InputError(
            "file: one file cannot hold the chains of many posteriors.",
            "Leave it out, or run `diffthrust campaign --task sample`.",
        )
    shared = {"width": width, "devices": devices, "progress": reporter(progress)}
    return _of_each(sample_one, fits, (), "fits", logs, options, names, shared)


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
    report, started, count = reporter(progress), time.monotonic(), len(models)
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
        report(f"maps {finished} of {count}", finished / count)
    return gathered(named, outcomes, started)


def _of_each(
    call: Callable[..., Any], fits: Any, kinds: Any, what: str, logs: Records,
    options: Mapping[str, Any], names: Sequence[str] | None, shared: Mapping[str, Any],
) -> Many:  # fmt: skip
    """A call with the fit and the logs of each member."""
    check_options(call, options)
    members = _members(logs)
    given = _for_each(fits, kinds, what, len(members))
    lengths = lengths_of(log for group in members for log in group)
    return each(
        lambda i: call(given[i], members[i], **options), _names(names, members), lengths, **shared
    )


def _members(logs: Any) -> list[tuple[Log, ...]]:
    """The logs of each member."""
    if isinstance(logs, Log) or not isinstance(logs, Sequence) or isinstance(logs, str):
        raise InputError(
            f"logs: expected a list with the log or logs of each member, found "
            f"{type(logs).__name__}.",
            "Write [log], or [[log1, log2], ...] where members have several.",
        )
    return [listed(entry) for entry in logs]


def _for_each(one_or_all: Any, kinds: Any, what: str, members: int) -> Sequence[Any] | Many:
    """One value per member; a failed member of a `Many` raises its own error when accessed."""
    if isinstance(one_or_all, kinds):
        return [one_or_all] * members
    if not isinstance(one_or_all, Sequence | Many) or isinstance(one_or_all, str):
        raise InputError(
            f"{what}: expected a list with one of each, found {type(one_or_all).__name__}.",
            "Give a list as long as that of the logs.",
        )
    if len(one_or_all) != members:
        raise InputError(
            f"{what}: expected one for each of {members} members, found {len(one_or_all)}.",
            "Give lists of equal length.",
        )
    return one_or_all


def _names(names: Sequence[str] | None, members: Sequence[Sequence[Log]]) -> tuple[str, ...]:
    first = [group[0].name if group else "empty" for group in members]
    return named_members(names, first)
