"""The folder of a spec's results: there as a whole, or not at all."""

from __future__ import annotations

import json
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import write_json
from diffthrust.many._campaign.job import Job

STATUS = "status.json"
ResultRow = dict[str, Any]
_RESULT = {"fit": "fit.json", "diagnose": "diagnosis.json", "sample": "posterior.json"}
_PAGE = "report.html"


def store(
    job: Job,
    row: ResultRow,
    mark: str | None = None,
    data: Mapping[str, Any] | None = None,
    page: Callable[[Path], None] | None = None,
) -> None:
    """Write the folder of a task under a temporary name beside it, then rename.

    A folder of an earlier run is replaced. A kill leaves at worst a hidden folder, which the next
    campaign removes.

    Args:
        job: the task.
        row: what the table says of it.
        mark: the `fingerprint` of what it was made of.
        data: the result, where there is one.
        page: writes a page for people to the path that it is given.

    Raises:
        InputError: the folder cannot be written, such as on a full disk; what was there is intact.
    """
    target = Path(job.folder)
    fresh = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    old = fresh.with_suffix(".old")
    try:
        fresh.mkdir(parents=True)
        if data is not None:
            write_json(fresh / _RESULT[job.task], data)
        if page:
            page(fresh / _PAGE)
        status = {"schema": 1, "task": job.task, "fingerprint": mark, "row": row}
        write_json(fresh / STATUS, status)
        if target.exists():
            os.rename(target, old)
        os.rename(fresh, target)
        shutil.rmtree(old, ignore_errors=True)
    except (OSError, ValueError) as error:  # a ValueError of a name that is no text, too
        what = error.problem if isinstance(error, InputError) else f"{target}: {error}"
        raise InputError(
            f"The result cannot be written: {what}",
            "Make room, or let the folder be written to, and run the campaign again.",
        ) from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        with suppress(OSError):  # of a place that is locked by now
            if old.exists() and not target.exists():
                os.rename(old, target)


def stored(job: Job) -> dict[str, Any] | None:
    """What the folder of a task says of it; ``None`` where there is none, or none that is whole.

    Raises:
        InputError: it holds the result of another task or of another spec.
    """
    try:
        status = json.loads((Path(job.folder) / STATUS).read_text(encoding="utf-8"))
        task, theirs = status["task"], status["row"]["spec"]
    except (OSError, ValueError, TypeError, KeyError):
        return None
    if task != job.task:
        raise InputError(
            f"{job.folder}: it holds the task {task!r} of {theirs}, and this campaign would put "
            f"{job.task!r} there.",
            "Name another output folder.",
        )
    if theirs != job.spec and Path(theirs).exists():
        raise InputError(
            f"{job.folder}: it holds the result of {theirs}, and this campaign would put that of "
            f"{job.spec} there.",
            "Name another output folder.",
        )
    return status


def is_whole(job: Job, folder: Mapping[str, Any], mark: str) -> bool:
    """Whether a folder holds the result, made of the same as now, with all its files."""
    files = [_RESULT[job.task], *([_PAGE] if job.report else [])]
    return (
        folder["row"].get("status") == "ok"
        and folder.get("fingerprint") == mark
        and all((Path(job.folder) / name).is_file() for name in files)
    )


def sweep(output: Path, jobs: Iterable[Job]) -> None:
    """Remove what workers that were killed left half-written."""
    ours = {Path(job.folder).name for job in jobs}
    for entry in output.iterdir() if output.is_dir() else ():
        left = re.fullmatch(r"\.(.+)\.[0-9a-f]{32}\.(tmp|old)", entry.name)
        if left and left[1] in ours:
            shutil.rmtree(entry, ignore_errors=True)
