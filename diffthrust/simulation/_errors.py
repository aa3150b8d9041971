"""How far a simulation is from a measurement: RMSE, NRMSE and fit percent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diffthrust._support.results import Brief
from diffthrust.logs._written import ShownUnits, Size


@dataclass(frozen=True)
class ChannelError:
    """Error of one measured channel.

    Args:
        rmse: root mean square of measured minus modelled, in ``unit``.
        nrmse: the RMSE over the standard deviation of the measurement (NaN for a constant one).
        fit_percent: 100 (1 - |y - yhat| / |y - mean y|); 100 is perfect, 0 no better than the mean.
        samples: number of samples compared.
        unit: that of the model's channel.
        per: how many of ``shown_unit`` make one of ``unit``.
        shown_unit: the unit for people, in which the log was written; ``unit`` where it is empty.
    """

    rmse: float
    nrmse: float
    fit_percent: float
    samples: int
    unit: str = ""
    per: float = 1.0
    shown_unit: str = ""

    @property
    def shown(self) -> Size:
        """The RMSE with its unit, for people: as the channel was written, where that is known."""
        return Size(self.per * self.rmse, self.shown_unit or self.unit)

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the model's unit and as the channel was written."""
        names = ("rmse", "nrmse", "fit_percent", "samples", "unit")
        shown = dict(zip(("rmse", "unit"), self.shown, strict=True))
        return {**{name: getattr(self, name) for name in names}, "written": shown}


@dataclass(frozen=True, repr=False)
class Errors(Brief):
    """Errors by channel; ``nrmse`` is the root mean square of the channels' NRMSE.

    Example:
        >>> errors = dft.compare(fit, unseen).errors
        >>> sorted(errors.channels), errors.channels["speed"].samples
        (['speed', 'thrust'], 240)
        >>> list(errors.to_json())
        ['nrmse', 'channels']
    """

    nrmse: float
    channels: Mapping[str, ChannelError]

    def to_json(self) -> dict[str, Any]:
        """The ERR object of the JSON contract."""
        channels = {name: error.to_json() for name, error in self.channels.items()}
        return {"nrmse": self.nrmse, "channels": channels}


@np.errstate(invalid="ignore")  # of a model that runs away there is no angle
def wrapped(difference: Any) -> Any:
    """A difference of angles without whole turns; of NumPy or of JAX."""
    return difference - 2 * np.pi * (difference / (2 * np.pi)).round()


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """An angle without jumps of a full turn; NaN samples stay."""
    out = angle.copy()
    finite = np.isfinite(angle)
    out[finite] = np.unwrap(angle[finite])
    return out


@np.errstate(over="ignore", invalid="ignore")  # numbers in wrong units are reported elsewhere
def errors(
    pairs: Mapping[str, Iterable[tuple[np.ndarray, np.ndarray]]],
    units: Mapping[str, str] | None = None,
    shown: ShownUnits | None = None,
) -> Errors:
    """Errors from (measured, residual) pairs of each channel, pooled over runs.

    The numbers are in ``units``; ``shown`` gives the display units. Samples that
    were not measured are left out; a residual that is not finite where something was measured
    makes the error infinite: a failed simulation is never good.
    """
    by_channel = {}
    for name, runs in pairs.items():
        measured, residual = (np.concatenate(x) for x in zip(*runs, strict=True))
        finite = np.isfinite(measured)
        if finite.all():
            finite = slice(None)  # no copy
        if measured[finite].size:
            error, unit = _channel(measured[finite], residual[finite]), (units or {}).get(name, "")
            per, shown_unit = (shown or ShownUnits()).size(name, 1.0, unit)
            by_channel[name] = replace(error, unit=unit, per=per, shown_unit=shown_unit)
    overall = np.sqrt(np.mean([e.nrmse**2 for e in by_channel.values()])) if by_channel else np.nan
    return Errors(float(overall), by_channel)


def _channel(measured: np.ndarray, residual: np.ndarray) -> ChannelError:
    if not np.all(np.isfinite(residual)):
        # Infinite, not NaN: comparisons with NaN are false both ways, so that a failed run could
        # win.
        return ChannelError(np.inf, np.inf, -np.inf, measured.size)
    rmse = float(np.sqrt(np.mean(residual**2)))
    std = float(np.std(measured))
    ratio = rmse / std if std > 0 else np.nan
    return ChannelError(rmse, ratio, 100.0 * (1.0 - ratio), measured.size)
