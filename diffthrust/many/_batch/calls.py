"""Fits, comparisons and posteriors of many members."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, ProgressOption, progressing, teller
from diffthrust.comparison._compare import compare as compare_one
from diffthrust.estimation._arguments import listed
from diffthrust.estimation._fit import fit as fit_one
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.many._batch.each import check_options, each, lengths_of
from diffthrust.many._batch.processes import divided
from diffthrust.many._batch.result import Many, named_members
from diffthrust.models._base.model import Model
from diffthrust.uncertainty._sampling.sample import sample as sample_one

Records = Sequence[Log | Sequence[Log]]


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

    The members are fitted one by one, each with its own starts, checks and status; their
    simulations are run some at a time in one compiled program. Logs of different length are padded
    to few lengths, chosen such that compiling and padding together cost least. Results are those
    of single fits, to rounding. A record that cannot be fitted is an error of its own.

    Args:
        model: the first guess of all, or one of each.
        logs: what each is fitted to: a log, or several.
        holdout: unseen logs of each, or ``None`` where there are none.
        names: of the members; by default those of their first logs.
        width: members in one run of a program on each device; chosen by the machine where
            ``None``.
        devices: of JAX over which each run is divided; its own choice by default.
        processes: of this machine among which the members are divided. One keeps two or three
            processors busy; several take seconds to start, and pay for thousands of members where
            there are more processors.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.fit`.

    Returns:
        `Many` fits; ``.table()`` has a row for each.

    Raises:
        InputError: lists of different length, or arguments that cannot be meant.

    Example:
        >>> found = dft.many.fit(dft.Thruster(), [log, unseen], names=["one", "two"], starts=2)
        >>> found.table()["name"].tolist(), found["one"].status
        (['one', 'two'], <Status.CONVERGED: 'converged'>)
    """
    check_options(fit_one, options)
    members = [listed(one) for one in _records(logs)]
    models = _for_each(model, Model, "model", len(members))
    unseen = _for_each(holdout, type(None), "holdout", len(members))
    held = [listed(one) for one in unseen if one is not None]

    lengths = lengths_of(log for group in (*members, *held) for log in group)
    named, triples = _names(names, members), list(zip(models, members, unseen, strict=True))
    if _processes(processes, devices) == 1:
        return _fits(triples, named, (lengths, width, None, options), devices, teller(progress))
    common = (lengths, width, 2, options)  # each has one processor
    return divided(_fits, triples, named, common, processes=processes, progress=teller(progress))


def _fits(
    members: Sequence[tuple[Any, ...]],
    names: Sequence[str],
    common: tuple[Any, ...],
    devices: Sequence[Any] | None = None,
    progress: Progress | None = None,
) -> Many:
    lengths, width, runs, options = common

    def one(i: int) -> Fit:
        model, logs, unseen = members[i]
        # thousands of short fits: each takes about as long as a look at its logs
        return fit_one(model, logs, holdout=unseen, **{"doubts": False, **options})

    return each(one, names, lengths, width=width, devices=devices, runs=runs, progress=progress)


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
    """Hold a model, or the fit of each, against each of many records.

    Args:
        fit: a model or fit for all, or one of each.
        logs: a log, or several, of each member.
        names: of the members; by default those of their first logs.
        width: members in one run of a program on each device; chosen by the machine where
            ``None``.
        devices: of JAX over which each run is divided; its own choice by default.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.compare`.

    Returns:
        `Many` comparisons; ``.table()`` has a row for each.

    Raises:
        InputError: lists of different length, or arguments that cannot be meant.

    Example:
        >>> held_against = dft.many.compare(fit, [log, unseen], names=["one", "two"])
        >>> held_against.table().shape[0]
        2
    """
    check_options(compare_one, options)
    members = [listed(one) for one in _records(logs)]
    fits = _for_each(fit, (Fit, Model), "fit", len(members))

    def one(i: int) -> Any:
        return compare_one(fits[i], members[i], **options)

    lengths = lengths_of(log for group in members for log in group)
    named = _names(names, members)
    return each(one, named, lengths, width=width, devices=devices, progress=teller(progress))


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
    """Draw from the posterior of each of many fits, as `diffthrust.sample` does of one.

    Chains of one posterior are run together already, and fill a processor; on an accelerator those
    of many logs padded to one length are run together, too.

    Args:
        fits: the fits, in the order of the logs; members without one are errors here, too.
        logs: the training logs of each.
        names: of the members; by default those of their first logs.
        width: chains in one run of a program on each device; chosen by the machine where ``None``.
        devices: of JAX over which each run is divided; its own choice by default.
        progress: True for a bar, or a function of a message and the share done.
        **options: of `diffthrust.sample`, but for ``file``.

    Returns:
        `Many` posteriors.

    Raises:
        InputError: lists of different length, or arguments that cannot be meant.

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
    check_options(sample_one, options)
    members = [listed(one) for one in _records(logs)]
    each_fit = _for_each(fits, (), "fits", len(members))

    def one(i: int) -> Any:
        return sample_one(each_fit[i], members[i], **options)

    lengths = lengths_of(log for group in members for log in group)
    named = _names(names, members)
    return each(one, named, lengths, width=width, devices=devices, progress=teller(progress))


def _processes(processes: Any, devices: Any) -> int:
    if isinstance(processes, bool) or not isinstance(processes, int) or processes < 1:
        raise InputError(
            f"processes: expected a whole number from 1 on, found {processes!r}.", "Correct it."
        )
    if processes > 1 and devices is not None:
        raise InputError(
            "processes: devices belong to one process.", "Leave processes or devices out."
        )
    return processes


def _records(logs: Any) -> list[Any]:
    if isinstance(logs, Log) or not isinstance(logs, Sequence) or isinstance(logs, str):
        raise InputError(
            f"logs: expected a list with the log or logs of each member, found "
            f"{type(logs).__name__}.",
            "Write [log], or [[log1, log2], ...] where members have several.",
        )
    return list(logs)


def _for_each(one_or_all: Any, kinds: Any, what: str, members: int) -> Sequence[Any] | Many:
    """What was given, one of each; of `Many`, a member that failed raises its own error."""
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
