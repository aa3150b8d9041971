"""The error for a damaged file, whatever its reader raises."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from diffthrust._support.errors import InputError


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """What is raised of a damaged file becomes one error: its readers raise any kind."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise damaged(path, kind, error) from None


def damaged(path: Path, kind: str, error: Exception) -> InputError:
    """The error for a file that its reader cannot read."""
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return InputError(
        f"{path.name}: expected a {kind} file, found something that cannot be read ({reason}).",
        "check that the file is complete, and that its name ends as its content requires.",
    )
