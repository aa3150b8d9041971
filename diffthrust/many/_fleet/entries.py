"""The fits of a fleet, whatever their source, and the coordinates of their parameters."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.extras import extra
from diffthrust._support.results import Brief
from diffthrust.estimation._result import Fit
from diffthrust.many._batch.result import Many, estimates_of, fit_row, named_members
from diffthrust.many._campaign.campaign import Campaign
from diffthrust.many._campaign.tables import TABLE
from diffthrust.models._base.effect import catalogue
from diffthrust.models._base.parameter import Parameter

if TYPE_CHECKING:
    import pandas as pd

ERROR = "_std_error"
_TYPICAL = 0.5
"""Between-vehicle spread that counts as typical: this in a logarithm, or this share of the size."""
_SOURCES = "Give what dft.fit or dft.many.fit returns, a table of fits, or a campaign."
Columns = Mapping[str, Sequence[Any]]
Labels = Sequence[Any] | Mapping[str, Any] | Callable[[str], Any] | None


@dataclass(frozen=True, repr=False)
class Entry(Brief):
    """One fit of one vehicle, at a time that may be ``None``."""

    name: str
    vehicle: str
    time: Any
    model: str  # without its effects
    effects: tuple[str, ...]
    columns: Mapping[str, Any]  # further ones of the table
    estimates: Mapping[str, tuple[float, float | None]]  # values and standard errors
    fit: Fit | None = field(default=None, repr=False)  # None where only a row of a table is known

    def has(self, parameter: str) -> bool:
        """Whether the fit estimated a parameter; for a table row, whether it has an error."""
        if self.fit is not None:
            return parameter in self.fit.free
        return self.estimates.get(parameter, (0.0, None))[1] is not None

    @property
    def usable(self) -> bool:
        """Whether its estimates may be compared; rows without a status count as converged."""
        status = self.columns.get("fit_status") or "converged"
        return status in ("converged", "converged_at_bound", "not_identifiable")


def entries_of(source: Any, vehicle: Labels, time: Labels) -> tuple[list[Entry], list[str]]:
    """The entries, and notes on fits that were left out."""
    if isinstance(source, Many | Mapping | Sequence) and not isinstance(source, str):
        made, notes, columns = _of_fits(source, vehicle)
    else:
        made, notes, columns = _of_table(_frame(source))
    if not made:
        raise InputError("Expected the fits of a fleet, found none.", " ".join(notes))
    models = sorted({entry.model for entry in made})
    if len(models) > 1:
        raise InputError(
            f"A fleet has one model, with effects or without; these are fits of {models}.",
            "Make a fleet of the fits of each.",
        )
    names = named_members(None, [entry.name for entry in made])
    vehicles = _labels("vehicle", vehicle, names, columns) or [n.split("/")[0] for n in names]
    times = _labels("time", time, names, columns) or [None] * len(names)
    labels = zip(made, names, vehicles, times, strict=True)
    return [replace(e, name=n, vehicle=str(v), time=t) for e, n, v, t in labels], notes


def _of_fits(
    source: Many | Mapping[str, Any] | Sequence[Any], vehicle: Labels
) -> tuple[list[Entry], list[str], Columns]:
    """Entries without labels, notes, and the vehicles that the names tell."""
    notes: list[str] = []
    fits: list[tuple[str, Any]]
    if isinstance(source, Many):
        if failed := source.failed:
            notes.append(f"Failed, and left out: {', '.join(failed)}.")
        fits = [
            pair for pair in zip(source.names, source.results, strict=True) if pair[0] not in failed
        ]
    elif isinstance(source, Mapping):
        several = {n: f if isinstance(f, list | tuple) else [f] for n, f in source.items()}
        fits = [(str(name), fit) for name, group in several.items() for fit in group]
    elif vehicle is None:
        raise InputError(
            "vehicle: expected the vehicle of each fit in the list, found none.",
            "Give vehicle=[...], or {'auv1': [fit, ...], ...} instead of the list.",
        )
    else:
        fits = [(f"fit {i}", fit) for i, fit in enumerate(source, 1)]
    made = []
    for name, fit in fits:
        if not isinstance(fit, Fit):
            raise InputError(f"{name}: expected a fit, found {type(fit).__name__}.", _SOURCES)
        columns, effects = fit_row(fit), tuple(effect.name for effect in fit.model.effects)
        model, estimates = columns["model"], estimates_of(fit)
        made.append(Entry(name, "", None, model, effects, columns, estimates, fit))
    return made, notes, {"vehicle": [name for name, _ in fits]}


def _frame(source: Any) -> pd.DataFrame:
    """The table of a campaign, of its folder or file, or a given table."""
    import pandas as pd

    if isinstance(source, Campaign):
        return source.table
    if isinstance(source, pd.DataFrame):
        return source
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            f"Expected fits, a table of them or a campaign, found {type(source).__name__}.",
            "Give what dft.many.fit or dft.many.campaign returns, or the folder of a campaign.",
        )
    path = Path(source)
    path = path / TABLE if path.is_dir() else path
    with extra("parquet", "The table of a campaign"):
        import pyarrow  # noqa: F401
    try:
        return pd.read_parquet(path)
    except Exception as error:  # a damaged file raises exceptions of any kind
        raise InputError(
            f"{path}: the table of a campaign cannot be read ({error}).",
            f"Name the folder of a campaign, or its {TABLE}.",
        ) from None


def _of_table(frame: Any) -> tuple[list[Entry], list[str], Columns]:
    """Entries without labels, notes, and the table's columns of vehicles and times."""
    notes = []
    if "status" in frame:
        failed = frame["status"] != "ok"
        if count := int(failed.sum()):
            words = "row has no result and is" if count == 1 else "rows have no result and are"
            notes.append(f"{count} {words} left out.")
        frame = frame[~failed]
    values = [c for c in frame.columns if f"{c}{ERROR}" in frame.columns]
    if not values:
        raise InputError(
            f"The table has no parameter with a standard error: no pair of columns such as "
            f"'alpha' and 'alpha{ERROR}' among {', '.join(map(str, frame.columns))}.",
            "Give the table of dft.many.fit or of a campaign.",
        )
    for name in (n for c in values for n in (c, f"{c}{ERROR}")):
        if frame[name].notna().any() and frame[name].dtype.kind not in "fiu":
            raise InputError(
                f"Column '{name}': expected numbers, found {frame[name].dtype}.", "Correct it."
            )
    made = []
    for i, row in enumerate(frame.to_dict("records")):
        # Tables keep the effects of a fit as one text with commas.
        model, text = (row[c] if isinstance(row.get(c), str) else "" for c in ("model", "effects"))
        effects = tuple(effect.strip() for effect in text.split(",") if effect)
        columns = {c: row[c] for c in ("fit_status", "train_nrmse", "holdout_nrmse") if c in row}
        numbers = {c: (_finite(row[c]), _finite(row[f"{c}{ERROR}"])) for c in values}
        estimates = {
            c: (value, error if error and error > 0 else None)
            for c, (value, error) in numbers.items()
            if value is not None
        }
        name = str(row.get("name", f"row {i}"))
        made.append(Entry(name, "", None, model, effects, columns, estimates))
    return made, notes, {c: list(frame[c]) for c in ("vehicle", "time") if c in frame}


def _finite(value: Any) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _labels(what: str, labels: Labels, names: Sequence[str], columns: Columns) -> Sequence[Any]:
    """A label for each fit: as given, or else out of the columns, or else none."""
    import pandas as pd

    if labels is None:
        listed = columns.get(what, [])
        for name, label in zip(names, listed, strict=False):
            if pd.isna(label):
                raise InputError(f"Column '{what}': '{name}' has none.", "Fill the column.")
        return listed
    if callable(labels):
        return [labels(name) for name in names]
    if isinstance(labels, Mapping):
        absent = [name for name in names if name not in labels]
        if absent:
            raise InputError(f"{what}: nothing is given for '{absent[0]}'.", f"Add its {what}.")
        return [labels[name] for name in names]
    listed = [labels] if isinstance(labels, str) else list(labels)
    if len(listed) != len(names):
        raise InputError(
            f"{what}: expected one for each of {len(names)} fits, found {len(listed)}.",
            "Give a list as long as that of the fits, or a dictionary by the names of fits.",
        )
    return listed


@dataclass(frozen=True)
class Axis:
    """A parameter's coordinate: its logarithm if it is positive by nature, else its value."""

    name: str
    unit: str  # of its value
    log: bool
    typical: float  # spread between vehicles, in the coordinate; sizes the prior of `pool`

    def coordinate(self, value: Any) -> Any:
        """The coordinate of a value; NaN if there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.log(value) if self.log else np.asarray(value, float)
        return np.where(np.isfinite(at), at, np.nan)

    def value(self, coordinate: Any) -> Any:
        """The value at a coordinate."""
        return np.exp(coordinate) if self.log else np.asarray(coordinate, float)

    def slope(self, value: Any) -> Any:
        """d(value)/d(coordinate)."""
        return np.asarray(value, float) if self.log else np.ones_like(value, float)


def axes_of(entries: Iterable[Entry]) -> dict[str, Axis]:
    """The axes of all parameters estimated by at least one fit.

    The description comes from the fit's model, or for a table row from the catalogue; if neither
    is known, the coordinate is the value.
    """
    described: dict[str, Parameter] = {}
    sizes: dict[str, list[float]] = {}
    catalogued = cache(_from_catalogue)
    for entry in entries:
        fit = entry.fit
        parameters = fit.model.parameters if fit else catalogued(entry.model, entry.effects)
        for name, (value, error) in entry.estimates.items():
            if error is not None:
                sizes.setdefault(name, []).append(abs(value))
                if name in parameters:
                    described.setdefault(name, parameters[name])
    return {name: _axis(name, described.get(name), np.array(v)) for name, v in sizes.items()}


def _axis(name: str, p: Parameter | None, values: np.ndarray) -> Axis:
    if p is not None and p.transform == "log":
        return Axis(name, p.unit, True, _TYPICAL)
    # A parameter that may be negative or zero has no logarithm: its declared size sets the scale.
    size = p.size if p is not None and p.size is not None else float(np.median(values)) or 1.0
    return Axis(name, p.unit if p is not None else "", False, _TYPICAL * size)


def _from_catalogue(model: str, effects: tuple[str, ...]) -> Mapping[str, Parameter]:
    """The parameters of a model given by name; empty for a user's own model."""
    from diffthrust.models import MODELS

    with suppress(KeyError, InputError):
        made = MODELS[model]()
        for effect in effects:
            made = made + catalogue()[effect]()
        return made.parameters
    return {}


def times_of(times: Sequence[Any]) -> tuple[np.ndarray, str]:
    """Times as numbers, and their unit; dates become days since the first."""
    import pandas as pd

    if all(time is None for time in times):
        return np.full(len(times), np.nan), "unit of time"
    if all(isinstance(time, int | float | np.number) for time in times):
        numbers, unit = np.array(times, float), "unit of time"
    else:
        try:
            # UTC: dates with and without a time zone cannot be subtracted.
            dates = pd.to_datetime(pd.Series(list(times)), utc=True, format="ISO8601")
        except (ValueError, TypeError) as error:
            raise InputError(
                f"time: expected numbers or dates, found neither ({error}).",
                "Write dates as 2026-05-01 or 2026-05-01T12:00.",
            ) from None
        numbers, unit = ((dates - dates.min()) / pd.Timedelta(days=1)).to_numpy(float), "day"
    if not np.isfinite(numbers).all():
        raise InputError(
            f"time: fit {int(np.argmin(np.isfinite(numbers))) + 1} has none.",
            "Give a time for each fit, or for none.",
        )
    return numbers, unit
