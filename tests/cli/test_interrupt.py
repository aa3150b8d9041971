"""An interrupt ends a command wherever it is: status 130, one word, and no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap

import pytest
from places import FITS

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no process there can be interrupted alone")
STUCK = 120.0
"""Seconds after which a command is one that nothing ends: what it is at would take longer."""


def ended(program: str, *words: object, interrupt: bool = False) -> tuple[int, str, str]:
    """Run a program that interrupts itself, or is interrupted when it says that it may be."""
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program), *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if interrupt:
        assert process.stdout is not None
        assert process.stdout.readline() == "now\n"
        process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=STUCK)
    return process.returncode, out, err


AT_AN_IMPORT = """
    import os, signal, sys
    from diffthrust.__main__ import entry

    module = sys.argv.pop()

    class Interrupting:
        def find_spec(self, name, path=None, target=None):
            if name == module:
                os.kill(os.getpid(), signal.SIGINT)

    sys.meta_path.insert(0, Interrupting())
    entry()
"""


@pytest.mark.parametrize(
    "module",
    ["typer", "diffthrust.cli._app", "jax", "jaxlib.xla_client", "equinox", "scipy.linalg"],
)
def test_while_it_loads(module):
    status, out, err = ended(AT_AN_IMPORT, "fit", FITS / "depth_sensor", module)
    assert (status, out, err.strip()) == (130, "", "Stopped.")


def test_in_code_that_does_not_return():
    program = """
        import hashlib
        from diffthrust.cli._interrupt import ended_soon
        with ended_soon():
            print("now", flush=True)
            hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
    """
    status, _, err = ended(program, interrupt=True)
    assert (status, err.strip()) == (130, "Stopped.")


def test_where_nothing_can_be_raised():
    program = """
        import os, signal, time
        from diffthrust.cli._interrupt import ended_soon
        class Last:
            def __del__(self):
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.1)
        with ended_soon():
            Last()
            while True:
                time.sleep(0.1)
    """
    status, _, err = ended(program)
    assert (status, err.strip()) == (130, "Stopped.")


def test_what_an_interrupt_breaks_is_not_taken_for_a_defect():
    program = """
        import os, signal
        from diffthrust.cli import _lists, _app
        from diffthrust.cli._session import session
        def command():
            with session():
                try:
                    os.kill(os.getpid(), signal.SIGINT)
                    while True:
                        pass
                except KeyboardInterrupt:
                    raise ImportError("cut short") from None
        _app.app.command("broken")(command)
        import sys
        sys.argv = ["diffthrust", "broken"]
        _app.main()
    """
    status, _, err = ended(program)
    assert (status, err.strip()) == (130, "Stopped.")


def test_after_the_work_it_ends_the_process_at_once():
    program = """
        import os, signal, time
        from diffthrust.cli._interrupt import ended_soon
        with ended_soon():
            pass
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1000)
    """
    assert ended(program) == (-signal.SIGINT, "", "")
