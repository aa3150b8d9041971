"""Results of many members: a result or an error for each."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from diffthrust._support.errors import InputError
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.words import joined, number
from diffthrust.comparison._compare import Comparison
from diffthrust.estimation._result import Fit

if TYPE_CHECKING:
    import pandas as pd

_SHOWN = ("name", "status", "fit_status", "train_nrmse", "holdout_nrmse", "nrmse", "error")
"""The columns of a report, of those that the results have."""
_REPORTED_ROWS = 40
_COMMON = ("name", "status", "error", "mend", "seconds")
"""The columns of every kind of result."""
Outcome = tuple[Any, Exception | None, float]
"""The result or error of a member, and its seconds."""


@dataclass(frozen=True, repr=False)
class Many(Result):
    """The results of many members, in their order.

    ``len(fits)`` is the number of members; ``fits[3]`` or ``fits["pool 7"]`` returns the result
    of a member, or raises its error; ``fits[:3]`` returns a `Many`; iteration yields the results
    of members that did not fail.

    Args:
        names: of the members.
        results: of each, or ``None``.
        errors: of each, or ``None``.
        seconds: elapsed time of each; members run concurrently.
        wall: elapsed time of all [s].

    Example:
        >>> fits.names[:2], fits.failed, fits.units["alpha"]
        (('auv0/0', 'auv0/1'), {}, '1/rad')
        >>> fits.table().shape[0], fits["auv0/0"].status
        (6, <Status.CONVERGED: 'converged'>)
    """

    names: tuple[str, ...]
    results: tuple[Any, ...] = field(repr=False)
    errors: tuple[Exception | None, ...] = field(repr=False)
    seconds: tuple[float, ...] = field(repr=False)
    wall: float

    def __len__(self) -> int:
        """Number of members, including failed ones."""
        return len(self.names)

    def __iter__(self) -> Iterator[Any]:
        """The results of the members that did not fail."""
        return (r for r, e in zip(self.results, self.errors, strict=True) if e is None)

    def __getitem__(self, which: int | str | slice) -> Any:
        """The result of a member by index or name; for a slice, a `Many`.

        Raises:
            InputError: there is no such member.
            Exception: the error of the member, if it failed.
        """
        if isinstance(which, str):
            if which not in self.names:
                raise InputError(
                    f"There is no member '{which}' among {len(self)}.", "Names are in .names."
                )
            which = self.names.index(which)
        if isinstance(which, slice):
            lists = ("names", "results", "errors", "seconds")
            return replace(self, **{name: getattr(self, name)[which] for name in lists})
        error = self.errors[which]
        if error is not None:
            raise error
        return self.results[which]

    @property
    def failed(self) -> dict[str, Exception]:
        """The errors of the members that failed, by name."""
        pairs = zip(self.names, self.errors, strict=True)
        return {name: error for name, error in pairs if error is not None}

    def table(self) -> pd.DataFrame:
        """A row for each member: ``status`` ("ok" or "failed"), the results, or the error.

        Fits have status, errors and notes, and for each parameter a column with its value and one
        with the suffix ``_std_error``; comparisons have their errors.
        """
        import pandas as pd

        rows = []
        for name, result, error, seconds in zip(
            self.names, self.results, self.errors, self.seconds, strict=True
        ):
            row = dict(zip(_COMMON, (name, "ok", None, None, seconds), strict=True))
            if error is None:
                row |= {name: cell for name, (cell, _) in columns_of(result).items()}
            elif isinstance(error, InputError):
                row |= {"status": "failed", "error": error.problem, "mend": error.mend}
            else:
                row |= {"status": "failed", "error": str(error) or type(error).__name__}
            rows.append(row)
        return pd.DataFrame(rows, columns=None if rows else list(_COMMON))

    @property
    def units(self) -> dict[str, str]:
        """The units of the columns of `table`: those of the model, not of the logs."""
        units = {"seconds": "s"}
        for result in self:
            units |= {name: unit for name, (_, unit) in columns_of(result).items() if unit}
        return units

    def _line(self) -> str:
        kinds = {type(result).__name__ for result in self}
        return f"{len(self) - len(self.failed)} of {len(self)} {joined(sorted(kinds))} done"

    def _report(self) -> Report:
        table = self.table()
        names = [name for name in _SHOWN if name in table]
        rows = [
            [number(cell, 3) if isinstance(cell, float) else str(cell or "") for cell in row]
            for row in table[names].head(_REPORTED_ROWS).itertuples(index=False)
        ]
        more = len(table) - len(rows)
        numbers = [i for i, name in enumerate(names) if name.endswith("nrmse")]
        headings = [name.replace("_", " ") for name in names]
        remaining = [f"and {more} more; .table() has all."] if more else []
        shortened = Rows.of(headings, rows, numbers=numbers)
        return Report(Section("", shortened, *remaining, f"{self._line()}."))


def gathered(names: Iterable[str], outcomes: Sequence[Outcome], started: float) -> Many:
    """The outcomes of members whose work began at a time of `time.monotonic`."""
    results, errors, seconds = zip(*outcomes, strict=True) if outcomes else ((), (), ())
    return Many(tuple(names), results, errors, seconds, time.monotonic() - started)


def named_members(names: Iterable[Any] | None, otherwise: Iterable[Any]) -> tuple[str, ...]:
    """A unique name for each member; duplicates are numbered."""
    chosen = [str(name) for name in otherwise]
    if names is not None:
        wanted = [str(name) for name in names]
        if len(wanted) != len(chosen):
            raise InputError(
                f"names: expected one for each of {len(chosen)} members, found {len(wanted)}.",
                "Give lists of equal length.",
            )
        chosen = wanted
    taken, counts = set(chosen), Counter[str]()
    out = []
    for name in chosen:
        unique, counts[name] = name, counts[name] + 1
        # A given name may itself be "run (2)": numbers that are taken are skipped.
        while counts[name] > 1 and (unique := f"{name} ({counts[name]})") in taken:
            counts[name] += 1
        taken.add(unique)
        out.append(unique)
    return tuple(out)


def columns_of(result: Any) -> dict[str, tuple[Any, str]]:
    """The columns of a fit or a comparison, and their units; empty for other results."""
    if isinstance(result, Fit):
        estimates = result.parameters.items()
        columns = {name: (cell, "") for name, cell in fit_row(result).items()}
        columns |= {name: (e.value, e.unit) for name, e in estimates}
        return columns | {f"{name}_std_error": (e.std_error, e.unit) for name, e in estimates}
    if isinstance(result, Comparison):
        errors = result.errors
        columns = {"model": (result.model.name, ""), "nrmse": (errors.nrmse, "")}
        return columns | {f"{n}_rmse": (e.rmse, e.unit) for n, e in errors.channels.items()}
    return {}


def fit_row(fit: Fit) -> dict[str, Any]:
    """The columns of a fit, except for its parameters."""
    return {
        "model": fit.model.name,
        "effects": ", ".join(effect.name for effect in fit.model.effects),
        "fit_status": fit.status.value,
        "train_nrmse": fit.train.nrmse,
        "holdout_nrmse": fit.holdout.nrmse if fit.holdout else None,
        "notes": "\n".join(fit.notes),
    }


def estimates_of(fit: Fit) -> dict[str, tuple[float, float | None]]:
    """Value and standard error of each parameter."""
    return {name: (e.value, e.std_error) for name, e in fit.parameters.items()}
