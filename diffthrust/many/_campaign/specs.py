"""Find the specs of a campaign in folders, and give each a name and a result folder."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.visible import in_line
from diffthrust.specs._file import NAME, parse_toml, read_spec_text

PathLike = str | os.PathLike[str]


def find_specs(specs: PathLike | Iterable[PathLike], output: Path) -> dict[Path, str]:
    """Spec files by absolute path, each with its name: its path without the common prefix.

    Folders are searched recursively, except hidden folders and the output. A TOML file with neither
    ``model`` nor ``logs`` is not a spec; an unreadable one counts as a spec, so that it is
    reported.
    """
    listed = [specs] if isinstance(specs, str | os.PathLike) else list(specs)
    for each in listed:
        if not isinstance(each, str | os.PathLike):
            raise InputError(
                f"specs: expected folders and files, found {each!r}.",
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
    return {path: _name(path, base) for path in files}


def folders(specs: dict[Path, str]) -> dict[Path, str]:
    """The name of the result folder of each spec.

    Folders are siblings, so that none is inside another, and no two differ only in case: results
    can be copied to any file system.
    """
    taken: dict[str, Path] = {}
    names = {}
    for path, name in specs.items():
        # Without dots at the front, which would hide a result and confuse it with a temporary
        # folder.
        folder = re.sub(r"[^\w.\-]+", "_", name.replace("/", "__")).lstrip(".") or "_"
        rival = taken.setdefault(folder.casefold(), path)
        if rival != path:
            raise InputError(
                f"{path} and {rival}: the results of both would go to one folder, {folder!r}.",
                "Rename one of the two.",
            )
        names[path] = folder
    return names


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
