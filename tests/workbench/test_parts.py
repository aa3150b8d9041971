"""The parts of a workbench that need no browser: the lane, the signal path."""

from __future__ import annotations

import queue
import threading

import pytest

import diffthrust as dft
from diffthrust.workbench._lane import Lane, Stopped  # private: the threads of the page
from diffthrust.workbench._signal_path import signal_path  # private: what the page draws

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
        release.wait(120)
        return "first"

    lane.ask(slow, done.append, done.append)
    assert begun.wait(120)
    for value in range(50):
        lane.ask(lambda _, value=value: value, done.append, done.append)
    assert lane.busy
    release.set()
    for _ in range(2):
        page.get(timeout=120)()
    assert done == ["first", 49]
    assert page.empty()


def test_work_is_stopped_where_it_reports_and_the_next_goes_on(delivered):
    page, lane = delivered
    begun, reported, done = threading.Event(), threading.Event(), []

    def endless(report):
        begun.set()
        reported.wait(120)
        report("still", 0.5)
        return "never"

    lane.ask(endless, done.append, done.append)
    assert begun.wait(120)
    lane.stop()
    reported.set()
    page.get(timeout=120)()
    assert isinstance(done[0], Stopped)
    lane.ask(lambda _: "next", done.append, done.append)
    page.get(timeout=120)()
    assert done[1:] == ["next"]


def test_an_error_is_handed_on(delivered):
    page, lane = delivered
    done = []
    lane.ask(lambda _: 1 / 0, done.append, done.append)
    page.get(timeout=120)()
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
