"""A workbench in a process of its own, and Chromium that looks at it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
GREETINGS = ("setting log level to", "items were rendered successfully")
"""What Bokeh says in the console of each of its pages."""


@contextmanager
def served(folder: Path, *words: str) -> Iterator[tuple[str, subprocess.Popen]]:
    """``diffthrust explore FOLDER`` in a process of its own: its address, and the process."""
    command = [sys.executable, "-m", "diffthrust.cli", "explore", str(folder), "--no-browser"]
    with subprocess.Popen([*command, *words], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.search(r"http://\S+", line)
            assert found, line
            yield found[0], process
        finally:
            process.kill()


@contextmanager
def looked_at(address: str, width: int = 1280, height: int = 720) -> Iterator[Any]:
    """The page in Chromium; a message in the console or a request to elsewhere is a failure."""
    from playwright.sync_api import sync_playwright

    wrong: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(150_000)
        page.on("console", lambda message: wrong.append(message.text))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(f"request: {request.url}"))
        page.on("websocket", lambda socket: wrong.append(f"request: {socket.url}"))
        page.goto(address)
        page.wait_for_selector(".bk-Slider")
        yield page
        browser.close()
    own = r"request: (http|ws)://127\.0\.0\.1:|request: data:"
    assert not [w for w in wrong if not re.match(own, w) and not any(g in w for g in GREETINGS)]
    assert any(re.match(own, w) for w in wrong)
