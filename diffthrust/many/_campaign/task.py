"""What a worker does with one spec: the work, its row, its folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import plain
from diffthrust.many._campaign.job import SAMPLING, Job, fingerprint
from diffthrust.many._campaign.store import Row, store
from diffthrust.many._rows import estimates_of, fit_row
from diffthrust.specs._spec import Spec, load_spec


@dataclass(frozen=True)
class _Done:
    """A result: as plain data, as columns of the table, and as a page."""

    data: Mapping[str, Any]
    columns: Row
    numbers: Row
    page: Callable[[Path], None]


def run(job: Job) -> Row:
    """Do the work on one spec, here and now, and write its folder.

    Nothing is raised: what goes wrong is the row's ``error``, with the ``mend``.
    """
    begun, mark = time.perf_counter(), None
    try:
        spec = load_spec(job.spec)
        mark = fingerprint(spec, job)
        done = _TASKS[job.task](spec, job)
        seconds = time.perf_counter() - begun
        row = plain(
            {**head(job, "ok"), **done.columns, "seconds": seconds, "numbers": done.numbers}
        )
        store(job, row, mark, done.data, done.page if job.report else None)
        return row
    except InputError as error:
        problem, mend = error.problem, error.mend
    except OSError as error:
        problem, mend = str(error), "Look at the disk, and run the campaign again."
    except Exception as error:
        problem = f"A defect of diffthrust, not of your input: {type(error).__name__}: {error}"
        mend = (
            f"Please report what this prints: DIFFTHRUST_DEBUG=1 diffthrust {job.task} {job.spec}"
        )
    return failed(job, "failed", problem, mend, time.perf_counter() - begun, mark)


def run_plain(job: Mapping[str, Any]) -> Row:
    """`run` of a job that has come as plain data."""
    return run(Job(**job))


def head(job: Job, status: str) -> Row:
    """The columns that every row has."""
    where = {"name": job.name, "spec": job.spec, "folder": Path(job.folder).name}
    return {**{key: _text(value) for key, value in where.items()}, "status": status}


def failed(
    job: Job, status: str, problem: str, mend: str, seconds: float, mark: str | None = None
) -> Row:
    """The row of a spec without a result, also in its folder if that can be written."""
    row = {**head(job, status), "error": _text(problem), "mend": mend, "seconds": seconds}
    with suppress(InputError):  # the table tells it in any case
        store(job, row, mark)
    return row


def _text(words: str) -> str:
    """The words with a question mark for each byte of a file's name that is no text."""
    return words.encode("utf-8", "replace").decode()


def _fit(spec: Spec, job: Job) -> _Done:
    train, unseen = spec.train_logs(), spec.holdout_logs()
    fit = spec.fit(train=train, holdout=unseen)

    def page(path: Path) -> None:
        from diffthrust.comparison._page import comparisons_of, write_report

        held = comparisons_of(fit, train, unseen)
        write_report(path, title=job.name, spec=spec.text, comparisons=held, fit=fit)

    return _Done(fit.to_json(), fit_row(fit), estimates_of(fit), page)


def _diagnose(spec: Spec, job: Job) -> _Done:
    found = spec.diagnose(candidates=job.options.get("candidates"))

    def page(path: Path) -> None:
        from diffthrust.diagnosis._page import write_report

        write_report(found, path, title=f"Diagnosis: {job.name}", spec=spec.text)

    told = {"verdict": found.verdict, "added": ", ".join(found.added)}
    return _Done(found.to_json(), {**fit_row(found.fit), **told}, estimates_of(found.fit), page)


def _sample(spec: Spec, job: Job) -> _Done:
    from diffthrust.uncertainty._sampling.sample import sample
    from diffthrust.uncertainty._sampling.summary import sampled

    train, unseen = spec.train_logs(), spec.holdout_logs()
    fit = spec.fit(train=train, holdout=unseen)
    options: dict[str, Any] = {**SAMPLING, **job.options}
    found = sampled(sample(fit, train, **options), fit, train, unseen, seed=options["seed"])

    def page(path: Path) -> None:
        from diffthrust.uncertainty._sampling.page import write_report

        write_report(found, path, title=f"Posterior: {job.name}", spec=spec.text)

    numbers = {name: (s.median, s.sd) for name, s in found.parameters.items()}
    verdict = {"verdict": found.told.status.value}
    return _Done(found.to_json(), {**fit_row(fit), **verdict}, numbers, page)


_TASKS: Mapping[str, Callable[[Spec, Job], _Done]] = {
    "fit": _fit,
    "diagnose": _diagnose,
    "sample": _sample,
}
