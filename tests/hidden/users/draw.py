"""The kinds of sets, and how one is drawn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from . import boats, own_models, thrusters
from .made import UserSet

KINDS: dict[str, Callable[[int], UserSet]] = {
    "boat": boats.boat,
    "boat_speeds": partial(boats.boat, speeds=True),
    "bench": thrusters.bench,
    "battery": thrusters.battery,
    "gear_motor": own_models.gear_motor,
    "tanks": own_models.tanks,
    "held_readings": thrusters.held_readings,
    "periodic_force": thrusters.periodic_force,
    "dominating_channel": boats.dominating_channel,
    "astern_runs": thrusters.astern_runs,
}


def draw(kind: str, seed: int) -> UserSet:
    """The set of a kind and a seed; the same two always give the same set."""
    return KINDS[kind](seed)
