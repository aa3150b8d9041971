"""The tasks of a campaign: specs found in folders, and a fingerprint of the inputs of each."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.files import PathLike
from diffthrust._support.names import listing, nearest
from diffthrust._support.visible import in_line
from diffthrust.many._batch.each import keyword_defaults
from diffthrust.specs._file import NAME, parse_toml, read_spec_text
from diffthrust.specs._scripts import script_file
from diffthrust.specs._spec import Spec, load_spec

ResultRow = dict[str, Any]
OPTIONS: dict[str, tuple[str, ...]] = {
    "fit": (),
    "diagnose": ("candidates",),
    "sample": ("method", "draws", "warmup", "walkers", "chains", "seed"),
}
"""The tasks of a campaign, with their options."""


@dataclass(frozen=True)
class Job:
    """One spec to work on; plain data, so that it can be sent to any worker."""

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
    allowed = OPTIONS[task]
    for name in options:
        if name not in allowed:
            raise InputError(
                f"options: the task {task!r} knows no {name!r}{nearest(name, allowed, '; ')}.",
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
            # again. Of a folder, such as a bag, all files.
            (os.path.relpath(file, here), _digest(file))
            for p in paths
            for file in (sorted(filter(Path.is_file, p.rglob("*"))) if p.is_dir() else [p])
        ],
    }
    return hashlib.sha256(json.dumps(causes, sort_keys=True).encode()).hexdigest()


def _digest(path: Path) -> str:
    mend = "Make it readable, or take it out of the spec."
    with os_errors_as(f"{path}: the file cannot be read", mend), open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def found_specs(specs: PathLike | Iterable[PathLike], output: Path) -> list[tuple[Path, str, str]]:
    """Spec files by absolute path, with their names and those of their folders of results.

    The name is the path without the common prefix. Folders are searched recursively, except hidden
    ones and the output. A TOML file with neither ``model`` nor ``logs`` is not a spec; an
    unreadable one is, so that it is reported. Folders of results are siblings, so that none is
    inside another, and no two differ only in case: they can be copied to any file system.
    """
    listed = [specs] if isinstance(specs, str | os.PathLike) else list(specs)
    if strange := [each for each in listed if not isinstance(each, str | os.PathLike)]:
        raise InputError(
            f"specs: expected folders and files, found {strange[0]!r}.",
            "Give a folder with spec files, or their paths.",
        )
    roots = [Path(os.path.abspath(path)) for path in listed]
    files: list[Path] = []
    for root in roots:
        if root.is_dir():
            files += _below(root, Path(os.path.abspath(output)))
        elif root.suffix.lower() == ".toml":
            files.append(root)
        else:
            what = "found another file" if root.exists() else "found nothing there"
            raise InputError(
                f"{root}: expected a folder or a spec file (.toml), {what}.", "Correct the path."
            )
    if not files:
        raise InputError(
            f"{', '.join(map(str, roots)) or 'specs'}: expected spec files (.toml with a model and "
            "[logs]), found none.",
            "Name a folder that holds spec files, at any depth.",
        )
    # A spec named twice, or through a link, is one spec.
    files = list({path.resolve(): path for path in files}.values())
    base = roots[0] if len(roots) == 1 and roots[0].is_dir() else _common(files)
    taken: dict[str, Path] = {}
    named = []
    for path in files:
        name = _name(path, base)
        # Without dots at the front, which would hide a result and confuse it with a temporary
        # folder.
        folder = re.sub(r"[^\w.\-]+", "_", name.replace("/", "__")).lstrip(".") or "_"
        rival = taken.setdefault(folder.casefold(), path)
        if rival != path:
            raise InputError(
                f"{path} and {rival}: the results of both would go to one folder, {folder!r}.",
                "Rename one of the two.",
            )
        named.append((path, name, folder))
    return named


def _below(root: Path, output: Path) -> Iterator[Path]:
    for folder, inner, files in os.walk(root):
        here = Path(folder)
        inner[:] = sorted(n for n in inner if not n.startswith(".") and here / n != output)
        for name in sorted(files):
            if name.endswith(".toml") and not name.startswith(".") and _is_spec(here / name):
                yield here / name


def _is_spec(path: Path) -> bool:
    if path.name == NAME:
        return True
    try:
        keys = set(parse_toml(read_spec_text(path), path))
    except InputError:
        return True
    return bool(keys & {"model", "logs"})


def _common(files: list[Path]) -> Path:
    try:
        return Path(os.path.commonpath([path.parent for path in files]))
    except ValueError:  # different drives
        return Path(files[0].anchor)


def _name(path: Path, base: Path) -> str:
    place = Path(os.path.relpath(path, base))
    place = place.parent if place.name == NAME else place.with_suffix("")
    return in_line(place.as_posix() if place.name else path.parent.name)
