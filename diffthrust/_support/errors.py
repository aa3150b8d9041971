"""Errors that a person can act on: what was expected, what was found, and the mend."""


class InputError(ValueError):
    """Something given by the user cannot be used.

    The message names the file, line, column, channel, parameter or effect, says what was expected
    and what was found, and ends with the mend. The command line prints it and exits with status 2.

    Args:
        problem: one or more sentences that say where, what was expected and what was found.
        mend: what the user can do about it, as an imperative sentence.
    """

    def __init__(self, problem: str, mend: str = "") -> None:
        self.problem = problem
        self.mend = mend
        super().__init__(f"{problem}\nMend: {mend}" if mend else problem)
