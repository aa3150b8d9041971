"""Who is measured, what each leaves out and why, and whether it is installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field

INSTALL = "python -m pip install -e '.[benchmark]'"


@dataclass(frozen=True)
class Tool:
    """Someone who does the jobs.

    Args:
        name: in the table.
        module: with a function for each job, by its name, that takes the size and returns what is
            timed: a function of the turn, which is its seed.
        needs: modules that must be installed.
        absent: the jobs that it does not do, with the reason.
        accelerated: jobs that also run on a GPU.
    """

    name: str
    module: str
    needs: tuple[str, ...] = ()
    absent: Mapping[str, str] = field(default_factory=dict)
    accelerated: tuple[str, ...] = ()

    @property
    def installed(self) -> bool:
        """Whether all that it needs can be imported."""
        return all(importlib.util.find_spec(name) for name in self.needs)


BATCHES = ("multi_start", "posterior", "describing_function", "many_logs")
OURS = Tool("diffthrust", f"{__package__}._diffthrust", accelerated=BATCHES)
TOOLS = (
    OURS,
    Tool(
        "its compiled core",
        f"{__package__}._core",
        absent=dict.fromkeys(
            BATCHES, "The core is shown for one log; the rest is as users call it."
        ),
    ),
    Tool(
        "numba + SciPy",
        f"{__package__}._numba",
        ("numba", "scipy"),
        {"posterior": "SciPy has no sampler; its density in numba is what emcee is given."},
    ),
    Tool(
        "CasADi + SciPy",
        f"{__package__}._casadi",
        ("casadi", "scipy"),
        {"posterior": "CasADi has no sampler; numba gives emcee the same density faster."},
    ),
    Tool(
        "diffrax + optimistix",
        f"{__package__}._diffrax",
        ("diffrax", "optimistix"),
        {"posterior": "Neither diffrax nor optimistix samples."},
    ),
    Tool(
        "emcee, unvectorised",
        f"{__package__}._emcee",
        ("emcee", "numba"),
        dict.fromkeys(
            ("simulation", "fit", "multi_start", "describing_function", "many_logs"),
            "emcee samples, and does nothing else.",
        ),
    ),
)
