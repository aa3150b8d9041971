"""What each effect of a search removes of the error: the falls between stages, as one whole.

Shares that stand side by side are parts of the squared error of the model as given. Each is the
fall from the stage before the effect, so that they add up to what all effects remove. What an
effect removes beside all others, or alone, does not: such shares of a thruster with a dead band and
a lag added up to 113 % and -13 %.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._explained_share import Worth, shares_of_steps, sure_share
from diffthrust.diagnosis._search_state import FittedStage
from diffthrust.simulation._runs import Run


class _Part(NamedTuple):
    """Effects that have one share, and the stages in which the error falls by them."""

    names: tuple[str, ...]
    steps: tuple[int, ...]


def shares_by_effect(stages: Sequence[FittedStage]) -> dict[str, Worth]:
    """What each effect of the last stage removes, of unseen logs if any, and of all logs together.

    Effects that came in one stage have a joint share, and so has one without which another does
    harm. What came in the place of another effect has the share of both.

    Args:
        stages: the model as given, then with one effect after the other.
    """
    parts = list(_parts(stages))
    runs = [stage.runs for stage in stages], [stage.unseen_runs for stage in stages]
    worths = shares_by_steps(*runs, [part.steps for part in parts])
    while len(parts) > 1:
        harming = [
            k for k, share in enumerate(worths) if share.share < 0 and sure_share(share) is None
        ]
        if not harming:
            break
        k = min(harming[0], len(parts) - 2)
        parts[k : k + 2] = [_Part(*(a + b for a, b in zip(*parts[k : k + 2], strict=True)))]
        worths = shares_by_steps(*runs, [part.steps for part in parts])
    return {
        name: replace(worth, together=part.names if len(part.names) > 1 else ())
        for part, worth in zip(parts, worths, strict=True)
        for name in part.names
    }


def _parts(stages: Sequence[FittedStage]) -> Iterator[_Part]:
    """The effects of the last stage, with the stages in which they came or took another's place."""
    parts: list[_Part] = []
    for k, (before, stage) in enumerate(itertools.pairwise(stages), 1):
        lost = {*before.effects} - {*stage.effects}
        replaced = [part for part in parts if lost & {*part.names}]
        names = [name for part in replaced for name in part.names if name not in lost]
        names += [name for name in stage.effects if name not in before.effects]
        steps = (*(step for part in replaced for step in part.steps), k)
        parts = [*(part for part in parts if part not in replaced), _Part(tuple(names), steps)]
    yield from (part for part in parts if part.names)


def shares_by_steps(
    training: Sequence[Sequence[Run]],
    unseen: Sequence[Sequence[Run]],
    steps: Sequence[Sequence[int]],
) -> list[Worth]:
    """The shares of the first model's squared errors that steps from model to model remove.

    Of unseen logs if there are any, and beside these of all logs together.

    Args:
        training: the runs of the training logs, of one model after the other.
        unseen: those of the unseen logs.
        steps: for each share the steps that it is of (`shares_of_steps`).
    """
    trained, judged = _errors(training), _errors(unseen)
    if not steps:
        return []
    worths = shares_of_steps(judged or trained, steps)
    if not judged:
        return worths
    everywhere = shares_of_steps([*trained, *judged], steps)
    return [
        replace(worth, everywhere=joint) for worth, joint in zip(worths, everywhere, strict=True)
    ]


def _errors(by_stage: Sequence[Sequence[Run]]) -> list[dict[str, tuple[np.ndarray, ...]]]:
    """For each log and channel what was measured, and the errors stage by stage."""
    return [
        {
            name: (trace.measured, *(run.channels[name].residual for run in runs))
            for name, trace in runs[0].channels.items()
        }
        for runs in zip(*by_stage, strict=True)
    ]
