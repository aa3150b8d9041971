"""What is right: a diagnosis against the truth of a set, and the figures of many."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from math import sqrt
from typing import Any, NamedTuple

import diffthrust as dft

from .further import SAME, FurtherSet
from .sets import HiddenSet

LARGEST_GROUP = 3
CLOSE = 1.05
FREQUENCY = 0.01

#: The share of sets of each class that must be right.
TARGETS: dict[str, float] = {
    "clear": 0.99,
    "faint": 0.95,
    "limit": 0.95,
    "none": 0.95,
    "none_ar": 0.95,
    "redundant": 0.95,
    "pairs": 0.95,
    "outside": 0.90,
    "speed_only": 0.95,
    "poor": 0.95,
    "vessel": 0.99,
    "vessel_faint": 0.95,
    "vessel_none": 0.95,
    "vessel_outside": 0.90,
    "field-clear": 0.95,
    "field-none": 0.95,
    "field-pairs": 0.85,
    "field-outside": 0.90,
    "field-speed_only": 0.95,
    "field-poor": 0.95,
    "field-vessel": 0.95,
    "field-vessel_none": 0.95,
    "field-vessel_outside": 0.90,
    "unmeasured": 0.90,
    "constants": 0.90,
    "odd_log": 0.90,
    "rivals": 0.90,
    "too_small": 0.95,
    "held": 0.95,
    "held_none": 0.95,
    "gaps": 0.95,
    "gaps_none": 0.95,
    "dominated": 0.90,
    "dominated_none": 0.95,
    "periodic_force": 0.90,
    "periodic_none": 0.97,
    "craft": 0.90,
    "craft_none": 0.97,
}
LABELS = (
    "right",
    "wrong name",
    "missed",
    "false alarm",
    "vague",
    "unexplained",
    "wrong port",
    "failed",
)


class Outcome(NamedTuple):
    """Whether a diagnosis is right, a label of `LABELS`, and the reason in words."""

    right: bool
    label: str
    why: str


def score(hidden: HiddenSet, diag: Any) -> Outcome:
    """Judge a diagnosis by the truth.

    An effect that is there must be in the group of an added effect of its own, the group must be
    of at most three, nothing superfluous may be added, and the verdict must be that this is all.
    ``adequate`` is right too at the limit of detection and for poor logs, and there groups of poor
    logs may be of any size. Nothing hidden, or nothing that differs from the basic model:
    ``adequate``, or ``undecided``. An effect outside the catalogue: ``unexplained``, with one of
    the right ports, and no effect named, for none of the catalogue's is there. An effect that is
    certain and changes little (``detectable``) counts as named. So does one that is a mistake of
    the logs, if the answer begins with its mend and what that does to the error.
    """
    if isinstance(hidden, FurtherSet) and hidden.asks != "effect":
        return _further(hidden, diag)
    base = hidden.group.removeprefix("field-")
    said = f"{diag.verdict}: {', '.join(diag.added) or 'nothing'}"
    if hidden.ports:
        return _outside(hidden, diag, said)
    if hidden.truth == ("swapped_thrusters",) and _exchange_told(diag):
        return Outcome(True, "right", diag.summary.splitlines()[0])
    if diag.verdict == "unexplained":
        return Outcome(False, "unexplained", f"{said}; remaining {diag.remaining}")
    groups = [*map(set, diag.groups), *map(set, diag.detectable_groups)]
    if not groups:
        allowed = not hidden.truth or base in ("limit", "poor")
        return Outcome(allowed, "right" if allowed else "missed", said)
    if not hidden.truth:
        return Outcome(False, "false alarm", said)
    pairing = _paired(hidden.truth, groups)
    if pairing is None:
        found = [name for name in hidden.truth if any(name in g for g in groups)]
        label = "missed" if len(groups) < len(hidden.truth) and found else "wrong name"
        label = "false alarm" if len(found) == len(hidden.truth) else label
        return Outcome(False, label, f"{said}, groups {[sorted(g) for g in groups]}")
    largest = max(map(len, groups))
    if largest > LARGEST_GROUP and base != "poor":
        return Outcome(False, "vague", f"{said}, a group of {largest}")
    return Outcome(True, "right", said)


def _exchange_told(diag: Any) -> bool:
    """Whether the logs are to be mended first, and one of the readings exchanges both thrusters."""
    readings = [reading for mend in diag.helpful_mends for reading in mend.doubt.readings]
    both = {"left_force", "right_force"}
    return any({*dict(reading.sources)} == both for reading in readings)


def _paired(truth: tuple[str, ...], groups: list[set[str]]) -> tuple[set[str], ...] | None:
    """Groups in the order of the true effects, one each and none left over; or ``None``."""
    if len(groups) != len(truth):
        return None
    for order in permutations(groups):
        if all(name in group for name, group in zip(truth, order, strict=True)):
            return order
    return None


def _outside(hidden: HiddenSet, diag: Any, said: str) -> Outcome:
    if diag.verdict == "adequate":
        return Outcome(False, "missed", said)
    if diag.verdict != "unexplained" or diag.remaining is None:
        return Outcome(False, "wrong name", said)
    place = f"{said}; {diag.remaining.port} by {diag.remaining.depends_on}"
    if diag.remaining.port not in hidden.ports:
        return Outcome(
            False, "wrong port", f"{place}, expected {' or '.join(sorted(hidden.ports))}"
        )
    if diag.groups or diag.detectable_groups:
        return Outcome(False, "false alarm", place)
    return Outcome(True, "right", place)


def _further(hidden: FurtherSet, diag: Any) -> Outcome:
    """Judge what is asked besides effects: constants, odd logs, rivals, what does not matter."""
    data = diag.to_json()
    added, about = set(data["added"]), set(hidden.about)
    groups, held = [set(group) for group in data["groups"]], set(data["held"])
    odd = {one["log"] for one in data["odd_logs"]}
    said = f"{data['verdict']}: {', '.join(data['added']) or 'nothing'}"
    if hidden.asks == "not adequate":
        right = data["verdict"] in ("unexplained", "undecided")
        return Outcome(right, "right" if right else "missed", said)
    if hidden.asks == "nothing":
        return Outcome(not added, "false alarm" if added else "right", said)
    if hidden.asks == "added":
        right = _paired(hidden.about, [*groups, *map(set, diag.detectable_groups)]) is not None
        label = "right" if right and added else "missed" if not added else "false alarm"
        return Outcome(label == "right", label, f"{said}, groups {data['groups']}")
    if hidden.asks in ("doubt", "sound"):
        return _wired(hidden, diag, said)
    if hidden.asks.endswith("periodic"):
        return _periodic(hidden, diag, said)
    if hidden.asks == "group":
        if not added:
            return Outcome(False, "missed", said)
        right = len(groups) == 1 and about <= groups[0]
        label = "false alarm" if len(groups) > 1 else "wrong name"
        return Outcome(right, "right" if right else label, f"{said}, groups {data['groups']}")
    named = held if hidden.asks == "held" else odd
    said = f"{said}; {hidden.asks}: {', '.join(sorted(named)) or 'none'}, asked {about}"
    if not about <= named:
        return Outcome(False, "missed", said)
    same = {name for one in about for name in SAME.get(one, ())}
    if named != about or added - same:
        return Outcome(False, "false alarm", said)
    return Outcome(True, "right", said)


def _wired(hidden: FurtherSet, diag: Any, said: str) -> Outcome:
    """The one doubt, its kind and its commands; or none, and no effect or constant besides.

    Beside a doubt that is right, effects are of the logs as they are, and are not judged.
    """
    doubts = [
        (doubt.kind, *(name.partition(".")[0] for r in doubt.readings[:1] for name in r.sources))
        for doubt in diag.doubts
    ]
    said = f"{said}; held {sorted(diag.held)}; doubts {doubts}, asked {hidden.about}"
    if hidden.asks == "sound":
        told = bool(doubts or diag.added or diag.held)
        return Outcome(not told, "false alarm" if told else "right", said)
    if not doubts:
        return Outcome(False, "missed", said)
    kind, *names = hidden.about
    right = len(doubts) == 1 and (doubts[0][0], {*doubts[0][1:]}) == (kind, {*names})
    return Outcome(right, "right" if right else "wrong name", said)


def _periodic(hidden: FurtherSet, diag: Any, said: str) -> Outcome:
    """One force of the right frequency, beside the true effects and nothing else; or none."""
    forces = [name for name in diag.added if name.startswith("periodic_force")]
    if hidden.asks == "not periodic":
        return Outcome(not forces, "false alarm" if forces else "right", said)
    if not forces:
        return Outcome(False, "missed", said)
    found = [diag.fit.parameters[f"{name}.frequency"].value for name in forces]
    said = f"{said}; {', '.join(f'{f:.4f}' for f in found)} Hz for {hidden.about[0]}"
    if len(found) > 1 or abs(found[0] / float(hidden.about[0]) - 1.0) > FREQUENCY:
        return Outcome(False, "false alarm", said)
    others = [set(g) for g in (*diag.groups, *diag.detectable_groups) if forces[0] not in g]
    if _paired(hidden.truth, others) is None:
        label = "missed" if len(others) < len(hidden.truth) else "false alarm"
        return Outcome(False, label, f"{said}; beside it {[sorted(g) for g in others]}")
    right = diag.verdict != "unexplained"
    return Outcome(right, "right" if right else "unexplained", f"{said}; {diag.remaining}")


def held_out_ratio(hidden: HiddenSet, diag: Any) -> float:
    """Held-out error of the last stage over that of the true structure fitted to the same logs."""
    model = hidden.model
    for name in hidden.truth:
        model = model + name
    truth = dft.fit(model, hidden.train, holdout=hidden.unseen)
    assert truth.holdout is not None
    return diag.stages[-1].holdout.nrmse / truth.holdout.nrmse


def wilson(successes: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927); the whole range where nothing was counted."""
    if count == 0:
        return 0.0, 1.0
    z, share = 1.959964, successes / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return max(0.0, middle - half), min(1.0, middle + half)


class Line(NamedTuple):
    """One class of the confusion table."""

    group: str
    count: int
    labels: dict[str, int]
    share: float
    interval: tuple[float, float]
    target: float
    close: tuple[int, int]
    seconds: float


def confusion(rows: Sequence[dict[str, Any]]) -> list[Line]:
    """The figures of each class, in the order of `TARGETS`.

    ``close`` counts the rightly named sets whose held-out error is within 5 % of that of the true
    structure, and those for which it was computed; ``seconds`` is the median time of a diagnosis.
    """
    lines = []
    for group, target in TARGETS.items():
        mine = [row for row in rows if row["group"] == group]
        if not mine:
            continue
        right = sum(row["right"] for row in mine)
        ratios = [row["ratio"] for row in mine if row["ratio"] is not None]
        times = sorted(row["seconds"] for row in mine)
        lines.append(
            Line(
                group,
                len(mine),
                {label: sum(row["label"] == label for row in mine) for label in LABELS},
                right / len(mine),
                wilson(right, len(mine)),
                target,
                (sum(ratio <= CLOSE for ratio in ratios), len(ratios)),
                times[len(times) // 2],
            )
        )
    return lines
