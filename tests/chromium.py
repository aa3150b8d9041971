"""Chromium that looks at a page: a message in its console, or a request to elsewhere, fails."""

from __future__ import annotations

import importlib.util
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
NEEDED = pytest.mark.skipif(
    CHROMIUM is None or importlib.util.find_spec("playwright") is None,
    reason="Chromium (apt: chromium) or Playwright is not installed",
)
GREETINGS = ("setting log level to", "items were rendered successfully")
"""What Bokeh's server says in the console of each of its pages."""


@contextmanager
def looked_at(address: str, own: str, **options: Any) -> Iterator[Any]:
    """A page, until one has looked at it.

    Args:
        address: of the page.
        own: how its requests may begin, as an expression.
        options: of the window, as Playwright names them.
    """
    from playwright.sync_api import sync_playwright

    wrong: list[str] = []
    asked: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(**options)
        page.set_default_timeout(300_000)
        page.on("console", lambda message: wrong.append(message.text))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda socket: asked.append(socket.url))
        page.goto(address)
        yield page
        browser.close()
    assert asked
    assert not [url for url in asked if not re.match(rf"(?:{own}|data:)", url)]
    assert not [words for words in wrong if not any(g in words for g in GREETINGS)]
