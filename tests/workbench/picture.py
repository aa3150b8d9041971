"""The picture of the workbench in the documentation: ``cd tests && python -m workbench.picture``.

From the raw logs of ``examples/bench`` to a saved spec by clicks alone, which are counted.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from PIL import Image

from tests.workbench.page import looked_at, served

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "_static" / "workbench.png"


def main() -> None:
    """Make the picture, and print the clicks."""
    folder = Path(tempfile.mkdtemp()) / "bench"
    shutil.copytree(ROOT / "examples" / "bench", folder)
    os.chdir(folder.parent)  # saved beside it, under a name without a path
    begun = time.monotonic()
    with served(folder) as (address, _), looked_at(address, 1280, 860) as page:
        page.set_default_timeout(900_000)
        page.get_by_text(re.compile("^fit: ")).wait_for()
        print(f"opened and fitted after {time.monotonic() - begun:.0f} s")
        buttons = (
            ("Diagnose: what is missing?", "Found: "),
            ("Add what was found", "reverse thrust asymmetry, change"),
            ("Save", "Saved in "),
        )
        for clicks, (name, sign) in enumerate(buttons, 1):
            page.get_by_role("button", name=name, exact=True).click()
            page.get_by_text(re.compile(sign)).first.wait_for()
            print(f"click {clicks}, {name}: {time.monotonic() - begun:.0f} s")
            time.sleep(8)  # what is drawn comes after what is said
            page.screenshot(path=folder / f"{clicks}.png")
        page.mouse.move(640, 700)
        page.screenshot(path=folder / "last.png")
    with Image.open(folder / "last.png") as picture:  # a third of the size, for eyes the same
        picture.convert("RGB").quantize(96).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
