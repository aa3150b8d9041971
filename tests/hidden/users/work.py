"""One set: a plain least squares of it, and what a diagnosis makes of it, in a process of its own.

A process is ended where a diagnosis goes on for too long: an alarm does not interrupt compiled
code. Nothing of this may stand in ``__main__``, which such a process does not import.
"""

from __future__ import annotations

import multiprocessing
import time
import traceback
from typing import Any

from reference import whole_runs as wr

from .draw import draw
from .judge import judge, last_error
from .made import UserSet

Row = dict[str, Any]

IDENTIFIED = 1.15
"""Times the truth's own error that the true structure, fitted, may leave: what is found is held
against the fit by the same share (``UserSet.close``)."""


def plain(made: UserSet, starts: int) -> Row:
    """Errors of the unseen logs: the model as given and the true structure, by least squares.

    Without ``starts`` the true structure alone, against which a diagnosis is held: on a boat whose
    yaw no model explains it took 4 s, and the model as given over 9 minutes.

    Runs begin at their true states: a first sample is noise, and a compass a degree off at the
    start leads a track astray that any model would follow.
    """
    train, unseen = made.begun()
    truth = wr.errors(made.systems[1], unseen, made.truth)
    if made.per_log:  # amplitude and phase belong to one log: fitted to the unseen one itself
        train = unseen
    row: Row = {"truth": truth}
    # Nothing fits better than what is near the truth: the true structure needs one start, there.
    # By the noise: a motor's angle goes on for hundreds of radians, beside which a hundredth, its
    # noise, counts for nothing.
    channels = [c for c in made.noise if c not in made.ruled]
    true: dict[str, Any] = {"first": made.truth, "sizes": made.noise, "channels": channels}
    given, structure = made.systems
    ways = {"true": (structure, {"starts": 1, **true})}
    if starts:
        ways = {"given": (given, {"starts": starts}), **ways}
    for name, (system, way) in ways.items():
        begun = time.perf_counter()
        result = wr.fit(system, train, **way)
        row[name] = {
            "errors": wr.errors(system, unseen, result.values),
            "values": result.values,
            "costs": result.costs,
            "seconds": round(time.perf_counter() - begun, 1),
        }
    fitted = row["true"]["errors"]
    row["reached"] = {c: fitted[c] / truth[c] for c in channels}
    # over the channels together, as a diagnosis is judged: an arm that all but stands on its head
    # errs by three times the noise of its angle, and by none of its rate's
    sums = [sum(errors[c] ** 2 for c in channels) for errors in (fitted, truth)]
    row["identified"] = sums[0] <= IDENTIFIED**2 * sums[1]
    return row


def diagnosed(made: UserSet, true_error: float) -> Row:
    """The verdict of a diagnosis, what is wrong in it, and its errors over whole runs."""
    import diffthrust as dft

    begun = time.perf_counter()
    try:
        train, unseen = made.diagnosed()
        diag = dft.diagnose(made.model, train, holdout=unseen, experiment=False)
    except Exception:
        why = traceback.format_exc(limit=-4)
        spent = round(time.perf_counter() - begun, 1)
        return {"verdict": "failed", "right": False, "why": why, "seconds": spent}
    return {
        "verdict": str(diag.verdict),
        "added": list(diag.added),
        "detectable": list(diag.detectable),
        **judge(diag, made, true_error)._asdict(),
        "before": diag.stages[0].holdout.to_json(),
        "after": last_error(diag).to_json(),
        "seconds": round(time.perf_counter() - begun, 1),
        "steps": {step: round(spent, 1) for step, spent in diag.seconds.items()},
        "summary": diag.details,
        "notes": list(diag.notes),
        "doubts": [str(doubt) for doubt in diag.fit.doubts],
    }


def send(
    pipe: Any, kind: str, seed: int, starts: int, only_plain: bool
) -> None:  # in a process of its own
    """Send the plain least squares, then what the diagnosis makes of the set."""
    made = draw(kind, seed)
    hidden = [{"what": h.what, "required": h.required, **h.parameters} for h in made.hidden]
    squares = plain(made, starts)
    pipe.send({"hidden": hidden, "plain": squares})
    if not only_plain:
        pipe.send(diagnosed(made, squares["true"]["errors"]["all"]))


def work(task: tuple[str, int], limit: float, only_plain: bool, starts: int) -> Row:
    """One row."""
    kind, seed = task
    context = multiprocessing.get_context("spawn")
    rows, pipe = context.Pipe(duplex=False)
    process = context.Process(target=send, args=(pipe, kind, seed, starts, only_plain))
    process.start()
    pipe.close()  # so that the end of the process is seen
    row: Row = {"kind": kind, "seed": seed}
    try:
        row |= rows.recv()
        if only_plain:
            return row
        too_long = {"verdict": "too long", "right": False, "seconds": limit}
        return row | (rows.recv() if rows.poll(limit) else too_long)
    except EOFError:
        return row | {"verdict": "died", "right": False, "seconds": 0.0}
    finally:
        process.kill()
        process.join()
