"""Errors that a person can act on: what was expected, what was found, and the mend."""

from __future__ import annotations

from dataclasses import dataclass

from diffthrust._support.visible import visible


@dataclass(frozen=True)
class Place:
    """The place in the user's input that an error is about.

    Args:
        text: how a message names it, such as ``run3.csv, line 212, column 'rpm'``.
        column: the column of a log file that is to blame.
        channel: the channel of a log that is to blame.
        unit: the stated unit is to blame, not the numbers.
    """

    text: str
    column: str | None = None
    channel: str | None = None
    unit: bool = False

    def __str__(self) -> str:
        return self.text


def refused(error: OSError) -> tuple[str, str]:
    """Problem and mend for an unforeseen error of the operating system."""
    where = f"{error.filename}: " if error.filename else ""
    return (
        f"{where}the system refused it ({error.strerror or error}).",
        "Check the path, its permissions and the free space, then try again.",
    )


class InputError(ValueError):
    """Input from the user that cannot be used.

    The message names the file, line, column, channel, parameter or effect, says what was expected
    and what was found, and ends with the mend. The command line prints it and exits with status 2.

    Args:
        problem: one or more sentences that say where, what was expected and what was found.
        mend: what the user can do about it, as an imperative sentence.
        place: the column or channel concerned; a caller may add the line of a spec that names it.

    Example:
        >>> try:
        ...     dft.Thruster(alfa=0.03)
        ... except dft.InputError as error:
        ...     print(error.mend)
        Correct the name.
    """

    def __init__(self, problem: str, mend: str = "", *, place: Place | None = None) -> None:
        problem, mend = visible(problem), visible(mend)
        self.problem: str = problem
        self.mend: str = mend
        self.place = place
        super().__init__(f"{problem}\nMend: {mend}" if mend else problem)

    def _render_traceback_(self) -> list[str]:
        """What IPython and notebooks show: the message without a traceback."""
        return [f"{type(self).__name__}: {self}"]

    @classmethod
    def at(cls, place: Place | str, problem: str, mend: str = "") -> InputError:
        """Make an error whose message begins with a place; a `Place` is kept with the error.

        Example:
            >>> print(
            ...     dft.InputError.at(
            ...         "fit.toml, line 3", "expected a number, found 'x'.", "Correct it."
            ...     )
            ... )
            fit.toml, line 3: expected a number, found 'x'.
            Mend: Correct it.
        """
        typed = place if isinstance(place, Place) else None
        return cls(f"{place}: {problem}", mend, place=typed)


class os_errors_as:
    """`InputError` with a problem, and the system's reason behind it, where the system refuses.

    Not a generator: of those type checkers believe that they may swallow any error.
    """

    def __init__(self, problem: str, mend: str) -> None:
        self._problem, self._mend = problem, mend

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise InputError(f"{self._problem} ({reason}).", self._mend) from None


class Defect(InputError):
    """A mistake of the library, not of the user's input."""
