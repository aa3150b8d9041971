"""One task of a campaign: its spec and options, and a fingerprint of its inputs."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.many._batch.each import keyword_defaults
from diffthrust.specs._scripts import script_file
from diffthrust.specs._spec import Spec, load_spec

OPTIONS: dict[str, tuple[str, ...]] = {
    "fit": (),
    "diagnose": ("candidates",),
    "sample": ("method", "draws", "warmup", "walkers", "chains", "seed"),
}
"""The tasks of a campaign, with their options."""


@dataclass(frozen=True)
class Job:
    """One spec to work on; plain data, so that it can be sent to any worker.

    Args:
        name: display name of the spec: its path in the searched folder.
        spec: its file, an absolute path.
        folder: result folder, an absolute path.
        task: "fit", "diagnose" or "sample".
        options: arguments of the task.
        report: write a page beside the result.
        time_limit: seconds after which the task is killed; ``None`` for never.
        trust: folders whose scripts specs may run, absolute paths.
    """

    name: str
    spec: str
    folder: str
    task: str
    options: Mapping[str, Any] = field(default_factory=dict)
    report: bool = False
    time_limit: float | None = None
    trust: Sequence[str] = ()

    def load(self) -> Spec:
        """Load the current spec."""
        return load_spec(self.spec, trust=self.trust)


def check_task(task: str, options: Mapping[str, Any]) -> None:
    """Raise `InputError` for an unknown task or an invalid option."""
    if task not in OPTIONS:
        raise InputError(
            f"task: expected one of {listing(OPTIONS)}, found {task!r}.", "Correct the task."
        )
    for name in options:
        if name not in OPTIONS[task]:
            allowed = OPTIONS[task]
            near = nearest(name, allowed)
            raise InputError(
                f"options: the task {task!r} knows no {name!r}{'; ' + near if near else ''}.",
                f"It takes {listing(allowed)}." if allowed else f"Leave {name} out.",
            )
    if task == "sample":
        from diffthrust.uncertainty._sampling.sample import check_sampling, sample

        sampling = {**keyword_defaults(sample), **options}
        del sampling["progress"]
        check_sampling(**sampling)
    names = options.get("candidates")
    if names is not None and (
        isinstance(names, str) or not names or not all(isinstance(n, str) for n in names)
    ):
        raise InputError(
            f"candidates: expected a list of names of effects, found {names!r}.",
            "Write an effect of your own as 'script.py:Class': workers find it there.",
        )


def fingerprint(spec: Spec, job: Job) -> str:
    """A digest of everything that determines the result: if equal, the work need not be repeated.

    It covers the text of the spec, the content of its logs and scripts, the task with its options,
    and the version of the library, but not modules imported by a script.
    """
    from diffthrust import __version__

    here = spec.path.parent
    named = (*spec.file.words, *job.options.get("candidates", ()))
    scripts = [script for name in named if (script := script_file(name, here))]
    paths = [*spec.train, *spec.holdout, *(path for path in scripts if path.is_file())]
    causes = {
        "library": __version__,
        "task": job.task,
        "options": dict(job.options),
        "spec": hashlib.sha256(spec.text.encode()).hexdigest(),
        "files": [
            # Relative to the spec: a folder that was moved with its logs need not be worked on
            # again.
            (os.path.relpath(file, here), _digest(file))
            for p in paths
            for file in _files(p)
        ],
    }
    return hashlib.sha256(json.dumps(causes, sort_keys=True).encode()).hexdigest()


def _files(path: Path) -> Iterator[Path]:
    """The file, or all files of a folder such as a bag."""
    if path.is_dir():
        yield from sorted(file for file in path.rglob("*") if file.is_file())
    else:
        yield path


def _digest(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be read ({error.strerror or error}).",
            "Make it readable, or take it out of the spec.",
        ) from None
