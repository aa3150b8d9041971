"""The command line answers at once: its help loads nothing that only a command's work needs."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {
    *("arviz", "emcee", "equinox", "jax", "jaxlib", "jinja2", "matplotlib", "numpy", "optimistix"),
    *("pandas", "pint", "pyarrow", "pydantic", "scipy"),
}
PROGRAM = """
import sys
from diffthrust.cli._app import main
try:
    main()
except SystemExit as end:
    assert not end.code
print(*{name.partition(".")[0] for name in sys.modules}, file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("words", "shown"),
    [(["--help"], "campaign"), (["--version"], "diffthrust 0"), (["fit", "--help"], "--report")],
)
def test_help_loads_nothing_heavy(words, shown):
    command = [sys.executable, "-c", PROGRAM, *words]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert shown in told.stdout
    assert not HEAVY & set(told.stderr.split())
