"""What only one reader, writer or command needs is an extra of the package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from diffthrust._support.errors import InputError


@contextmanager
def extra(name: str, what: str, instead: str = "") -> Iterator[None]:
    """Within it, imports of an extra that is not installed end in an `InputError` that names it.

    Args:
        name: the extra.
        what: what needs it, as a subject.
        instead: how to do without it, as a command.

    Example:
        >>> from diffthrust._support.extras import extra
        >>> with extra("excel", "Reading run.xlsx"):
        ...     import openpyxl
    """
    try:
        yield
    except ImportError as error:
        library = (error.name or "a library").partition(".")[0]
        if library == "diffthrust":  # a defect of ours
            raise
        mend = f"Install the extra: python -m pip install 'diffthrust[{name}]'"
        raise InputError(
            f"{what} needs {library}, which cannot be imported ({error}).",
            f"{mend}, or {instead}." if instead else f"{mend}.",
        ) from None
