"""What of a long series a screen can show: its least and greatest value in each pixel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def bins_of(time: np.ndarray, start: float, stop: float, bins: int) -> np.ndarray:
    """Where each pixel begins: rising indices into the samples from start to stop, with the end.

    A sample more on either side is in them, so that lines run out of the picture; one for each
    sample where there are fewer than two a pixel.
    """
    first, last = np.searchsorted(time, start), np.searchsorted(time, stop, "right")
    first, last = max(int(first) - 1, 0), min(int(last) + 1, time.size)
    if last - first <= 2 * bins:
        return np.arange(first, max(last, first + 1) + 1)
    edges = np.searchsorted(time, np.linspace(time[first], time[last - 1], bins + 1))
    return np.unique(np.append(edges[:-1], last))


def envelope(edges: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Least and greatest value of each of `bins_of`, or the samples where each has one.

    In single precision, of which a screen shows less; NaN where there is none.
    """
    begin = edges[:-1]
    if edges[-1] - edges[0] == begin.size:
        return values[edges[0] : edges[-1]].astype(np.float32)
    part, at = values[edges[0] : edges[-1]], begin - edges[0]
    low, high = np.fmin.reduceat(part, at), np.fmax.reduceat(part, at)
    return np.stack([low, high], axis=1).reshape(-1).astype(np.float32)


def envelope_time(edges: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The time stamps of an `envelope`: the beginning and the middle of each bin."""
    begin = edges[:-1]
    if edges[-1] - edges[0] == begin.size:
        return time[edges[0] : edges[-1]]
    middle = (begin + edges[1:]) // 2
    return np.stack([time[begin], time[middle]], axis=1).reshape(-1)


def envelopes(
    edges: np.ndarray, time: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The columns of a picture, with ``time``."""
    return {"time": envelope_time(edges, time)} | {
        name: envelope(edges, values) for name, values in columns.items()
    }


def stretches(marked: np.ndarray) -> np.ndarray:
    """Begin and end of each run of marked samples, ``(k, 2)``; the end is no longer marked."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    return edges.reshape(-1, 2)
