"""The command line, run in this process: a process for each call takes two seconds."""

from __future__ import annotations

from click.testing import Result
from typer.main import get_command
from typer.testing import CliRunner

from diffthrust.cli._app import app  # private: the console script ends the process it runs in

COMMANDS = get_command(app).commands
"""The commands by their names, with what each of them takes."""


def run(*words: object, status: int | None = 0) -> Result:
    """Run ``diffthrust WORDS``, which ends with a status; with None, whichever it is."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert status in (None, result.exit_code), result.output
    return result


def refused(*words: object) -> str:
    """What ``diffthrust WORDS`` says of input that cannot be used: one message with its mend."""
    result = run(*words, status=2)
    assert "Traceback" not in result.output
    assert result.stdout == ""
    assert "Mend:" in result.stderr
    return result.stderr
