"""Envelopes of long series: what a screen shows of them."""

from __future__ import annotations

import numpy as np
import pytest

from diffthrust._support.envelope import (  # private: what pages draw
    bins_of,
    envelope,
    envelopes,
    stretches,
)


def test_an_envelope_keeps_every_spike_and_is_as_wide_as_the_screen():
    rng = np.random.default_rng(0)
    time, values = 0.01 * np.arange(100_000), rng.normal(size=100_000)
    values[[12_345, 70_000]] = 50.0, -50.0
    values[500:30_000] = np.where(np.arange(500, 30_000) == 12_345, 50.0, np.nan)
    edges = bins_of(time, 0.0, time[-1], 800)
    shown = envelopes(edges, time, {"y": values})
    assert shown["y"].shape == shown["time"].shape == (1600,)
    assert shown["y"].dtype == np.float32
    assert (np.diff(shown["time"]) >= 0).all()
    low, high = shown["y"][::2], shown["y"][1::2]
    for begin, end, least, most in zip(edges, edges[1:], low, high, strict=False):
        part = values[begin:end]
        if np.isfinite(part).any():
            assert (least, most) == (np.float32(np.nanmin(part)), np.float32(np.nanmax(part)))
        else:
            assert np.isnan(least)
            assert np.isnan(most)


@pytest.mark.parametrize(("start", "stop"), [(2.0, 3.0), (-5.0, 0.5), (9.5, 20.0), (3.2, 3.2)])
def test_a_close_picture_has_the_samples_and_one_beyond_either_end(start, stop):
    time = 0.1 * np.arange(100)
    edges = bins_of(time, start, stop, 800)
    inside = np.flatnonzero((time >= start) & (time <= stop))
    shown = envelope(edges, time)
    if inside.size:
        first, last = max(inside[0] - 1, 0), min(inside[-1] + 1, 99)
        np.testing.assert_allclose(shown[[0, -1]], time[[first, last]], rtol=1e-6)
    assert shown.size >= 1


def test_a_gap_in_time_takes_no_pixels_from_the_rest():
    time = np.concatenate([np.arange(5000), 1e6 + np.arange(5000)])
    edges = bins_of(time, 0.0, 2e6, 100)
    assert edges[0] == 0
    assert edges[-1] == 10_000
    assert (np.diff(edges) > 0).all()


def test_marks_become_stretches():
    marked = np.array([1, 1, 0, 0, 1, 0, 0, 1], bool)
    assert stretches(marked).tolist() == [[0, 2], [4, 5], [7, 8]]
    assert stretches(np.zeros(8, bool)).shape == (0, 2)
