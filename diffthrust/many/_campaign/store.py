"""Write the result folder of a spec atomically: complete, or not at all."""

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
    """Write the folder of a task under a temporary sibling name, then rename.

    A folder of an earlier run is replaced. A kill leaves at worst a hidden folder, which the next
    campaign removes. ``mark`` is the `fingerprint` of its inputs.
    """
    target = Path(job.folder)
    fresh = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    # No system replaces a folder that has files in one step: the old one is moved aside, and back
    # if the new one cannot take its place.
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
    except (OSError, ValueError) as error:  # ValueError: a name that is not valid text
        what = error.problem if isinstance(error, InputError) else f"{target}: {error}"
        raise InputError(
            f"The result cannot be written: {what}",
            "Make room, or let the folder be written to, and run the campaign again.",
        ) from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        with suppress(OSError):  # the folder may be locked meanwhile
            if old.exists() and not target.exists():
                os.rename(old, target)


def stored(job: Job) -> dict[str, Any] | None:
    """The stored status of a task; ``None`` if its folder is missing or incomplete."""
    try:
        status = json.loads((Path(job.folder) / STATUS).read_text(encoding="utf-8"))
        task, stored_spec = status["task"], status["row"]["spec"]
    except (OSError, ValueError, TypeError, KeyError):
        return None
    if task != job.task:
        raise InputError(
            f"{job.folder}: it holds the task {task!r} of {stored_spec}, and this campaign "
            f"would put {job.task!r} there.",
            "Name another output folder.",
        )
    # A spec that was moved leaves its result behind under the old path: only one that still exists
    # is another spec.
    if stored_spec != job.spec and Path(stored_spec).exists():
        raise InputError(
            f"{job.folder}: it holds the result of {stored_spec}, and this campaign would put "
            f"that of {job.spec} there.",
            "Name another output folder.",
        )
    return status


def is_whole(job: Job, folder: Mapping[str, Any], mark: str) -> bool:
    """Whether a folder holds a complete result of the current inputs."""
    files = [_RESULT[job.task], *([_PAGE] if job.report else [])]
    return (
        folder["row"].get("status") == "ok"
        and folder.get("fingerprint") == mark
        and all((Path(job.folder) / name).is_file() for name in files)
    )


def sweep(output: Path, jobs: Iterable[Job]) -> None:
    """Remove half-written folders of killed workers."""
    folders = {Path(job.folder).name for job in jobs}
    for entry in output.iterdir() if output.is_dir() else ():
        match = re.fullmatch(r"\.(.+)\.[0-9a-f]{32}\.(tmp|old)", entry.name)
        if match and match[1] in folders:
            shutil.rmtree(entry, ignore_errors=True)
