"""How far a simulation is from a measurement: RMSE, NRMSE and fit percent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ChannelError:
    """Error of one measured channel.

    Args:
        rmse: root mean square of measured minus modelled, in the channel's unit.
        nrmse: the RMSE over the standard deviation of the measurement (NaN for a constant one).
        fit_percent: 100 (1 - |y - yhat| / |y - mean y|); 100 is perfect, 0 no better than the mean.
        samples: number of samples compared.
    """

    rmse: float
    nrmse: float
    fit_percent: float
    samples: int


@dataclass(frozen=True)
class Errors:
    """Errors by channel; ``nrmse`` is the root mean square of the channels' NRMSE."""

    nrmse: float
    channels: Mapping[str, ChannelError]

    def to_json(self) -> dict[str, Any]:
        """The ERR object of the JSON contract."""
        return {"nrmse": self.nrmse, "channels": {n: vars(e) for n, e in self.channels.items()}}


def wrapped(rest: Any) -> Any:
    """A difference of angles without whole turns; of NumPy or of JAX."""
    return rest - 2 * np.pi * (rest / (2 * np.pi)).round()


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """An angle without jumps of a full turn; NaN samples stay."""
    out = angle.copy()
    seen = np.isfinite(angle)
    out[seen] = np.unwrap(angle[seen])
    return out


def errors(pairs: Mapping[str, Iterable[tuple[np.ndarray, np.ndarray]]]) -> Errors:
    """Errors from (measured, residual) pairs of each channel, pooled over runs.

    Samples at which either is not finite in the measurement are left out; a residual that is not
    finite where something was measured makes the error infinite: a failed simulation is never good.
    """
    by_channel = {}
    for name, runs in pairs.items():
        measured, residual = (np.concatenate(x) for x in zip(*runs, strict=True))
        seen = np.isfinite(measured)
        if seen.all():
            seen = slice(None)  # no copy
        if measured[seen].size:
            by_channel[name] = _channel(measured[seen], residual[seen])
    overall = np.sqrt(np.mean([e.nrmse**2 for e in by_channel.values()])) if by_channel else np.nan
    return Errors(float(overall), by_channel)


def _channel(measured: np.ndarray, residual: np.ndarray) -> ChannelError:
    if not np.all(np.isfinite(residual)):
        return ChannelError(np.inf, np.inf, -np.inf, measured.size)
    rmse = float(np.sqrt(np.mean(residual**2)))
    std = float(np.std(measured))
    ratio = rmse / std if std > 0 else np.nan
    return ChannelError(rmse, ratio, 100.0 * (1.0 - ratio), measured.size)
