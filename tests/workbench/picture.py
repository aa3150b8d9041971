"""The pictures of the workbench in the documentation: ``cd tests && python -m workbench.picture``.

From the raw logs of ``examples/bench`` to a saved spec by clicks alone, which are counted; then
what is wrong on a stretch of the model as opened, and the law that another diagnosis has learned.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from PIL import Image

from tests.workbench.page import explored, looked_at, served

ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "docs" / "_static"
CLICKS = (
    ("Diagnose: what is missing?", "Found: ", "workbench_diagnosed"),
    ("Add what was found", "reverse thrust asymmetry, change", ""),
    ("Save", "Saved in ", "workbench"),
)
"""Buttons, what the page says once it is done, and the picture that is made then."""
WRONG = (12.0, 18.0)
"""Seconds of the first log with full thrust astern, where the model errs most."""


def main() -> None:
    """Make the pictures, and print the clicks."""
    folder = Path(tempfile.mkdtemp()) / "bench"
    shutil.copytree(ROOT / "examples" / "bench", folder)
    os.chdir(folder.parent)  # saved beside it, under a name without a path
    begun = time.monotonic()
    with served(folder) as (address, _), looked_at(address, 1280, 860) as page:
        page.set_default_timeout(900_000)
        page.get_by_text(re.compile("^fit: ")).wait_for()
        print(f"opened and fitted after {time.monotonic() - begun:.0f} s", flush=True)
        take(page, "workbench_opened")
        for clicks, (name, sign, picture) in enumerate(CLICKS, 1):
            page.get_by_role("button", name=name, exact=True).click()
            page.get_by_text(re.compile(sign)).first.wait_for()
            print(f"click {clicks}, {name}: {time.monotonic() - begun:.0f} s", flush=True)
            if picture:
                take(page, picture)
        page.get_by_role("button", name="Undo").click()
        page.get_by_text("A stretch alone", exact=True).click()
        for k, seconds in enumerate(WRONG):
            end = page.locator(".bk-Spinner input").nth(k)
            end.fill(f"{seconds:g}")
            end.press("Tab")
        page.get_by_role("button", name="What is wrong here?").click()
        page.get_by_text("alone, speed loop thruster lacks").wait_for()
        take(page, "workbench_stretch")
    learned()


def learned() -> None:
    """The law that the tutorial learns, by its own lines."""
    tutorial = (ROOT / "docs" / "getting-started" / "learned_law.md").read_text()
    names: dict[str, Any] = {}
    for cell in re.findall(r"```{code-cell} ipython3\n(.*?)```", tutorial, re.DOTALL):
        if "diagnosis" not in names:
            exec(cell, names)
    with explored(names["diagnosis"]) as address, looked_at(address, 1280, 860) as page:
        page.set_viewport_size({"width": 1280, "height": 1070})  # later: its plots would grow
        page.get_by_text("Learned law", exact=True).click()
        take(page, "workbench_learned")


def take(page: Any, name: str) -> None:
    """A picture of the page, once two of them are the same."""
    page.mouse.move(640, 845)
    page.evaluate("() => scrollTo(0, 0)")
    picture, last = page.screenshot(), b""
    while picture != last:
        time.sleep(3)  # what is drawn comes after what is said
        picture, last = page.screenshot(), picture
    with Image.open(io.BytesIO(picture)) as shot:  # a third of the size, for eyes the same
        shot.convert("RGB").quantize(256).save(STATIC / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
