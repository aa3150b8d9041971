"""The parts of a workbench that need no browser: envelopes, the lane, the signal path."""

from __future__ import annotations

import queue
import threading

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.workbench._envelope import (  # private: what the page draws
    bins_of,
    envelope,
    envelopes,
    stretches,
)
from diffthrust.workbench._lane import Lane, Stopped  # private: the threads of the page
from diffthrust.workbench._signal_path import signal_path  # private: what the page draws

# -- envelopes -------------------------------------------------------------------------------------


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
    time = 0.5 * np.arange(8)
    marked = np.array([1, 1, 0, 0, 1, 0, 0, 1], bool)
    assert stretches(marked, time) == [(0.0, 0.5), (2.0, 2.0), (3.5, 3.5)]
    assert stretches(np.zeros(8, bool), time) == []


# -- the lane --------------------------------------------------------------------------------------


@pytest.fixture
def delivered():
    """A queue of what a lane hands to the page, and the lane."""
    page: queue.Queue = queue.Queue()
    lane = Lane(page.put, lambda message, share: page.queue.append(lambda: (message, share)))
    yield page, lane
    lane.close()


def test_of_what_waits_only_the_newest_is_done(delivered):
    page, lane = delivered
    begun, release, done = threading.Event(), threading.Event(), []

    def slow(_):
        begun.set()
        release.wait(10)
        return "first"

    lane.ask(slow, done.append, done.append)
    assert begun.wait(10)
    for value in range(50):
        lane.ask(lambda _, value=value: value, done.append, done.append)
    assert lane.busy
    release.set()
    for _ in range(2):
        page.get(timeout=10)()
    assert done == ["first", 49]
    assert page.empty()


def test_work_is_stopped_where_it_reports_and_the_next_goes_on(delivered):
    page, lane = delivered
    begun, reported, done = threading.Event(), threading.Event(), []

    def endless(report):
        begun.set()
        reported.wait(10)
        report("still", 0.5)
        return "never"

    lane.ask(endless, done.append, done.append)
    assert begun.wait(10)
    lane.stop()
    reported.set()
    page.get(timeout=10)()
    assert isinstance(done[0], Stopped)
    lane.ask(lambda _: "next", done.append, done.append)
    page.get(timeout=10)()
    assert done[1:] == ["next"]


def test_an_error_is_handed_on(delivered):
    page, lane = delivered
    done = []
    lane.ask(lambda _: 1 / 0, done.append, done.append)
    page.get(timeout=10)()
    assert isinstance(done[0], ZeroDivisionError)


# -- the signal path -------------------------------------------------------------------------------


def test_the_path_of_the_thruster_is_that_of_its_equations():
    path = signal_path(dft.Thruster() + "command_deadband")
    assert set(path.edges) == {
        ("command", "drive"),
        ("drive", "shaft"),
        ("load", "shaft"),
        ("shaft", "speed"),
        ("speed", "load"),
        ("speed", "propeller"),
        ("propeller", "thrust"),
    }
    places = {node.name: (node.column, node.row) for node in path.nodes}
    assert places["load"] == (2.5, 1.0)  # what leads back lies below
    assert [places[n][0] for n in ("command", "drive", "shaft", "speed", "propeller")] == [
        *range(5)
    ]
    assert {node.name: node.kind for node in path.nodes}["speed"] == "state"


@pytest.mark.parametrize("name", sorted(dft.models.MODELS))
def test_every_model_is_drawn_with_all_its_ports_each_in_a_place_of_its_own(name):
    model = dft.models.MODELS[name]()
    path = signal_path(model)
    names = [node.name for node in path.nodes]
    assert {*model.ports, *model.inputs} <= set(names)
    assert len({(node.column, node.row) for node in path.nodes}) == len(names)
    assert {end for edge in path.edges for end in edge} <= set(names)
