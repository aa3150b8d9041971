"""The examples as a gallery: their order, which of them run, and the figures that they save."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from textwrap import indent
from typing import Any

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
SAVED = DOCS / "_build" / "examples"
"""What the examples write, a folder each."""

MEASURED = (
    "Not run when this page was made: it takes measured logs, which the repository does not "
    "hold, and whose licences do not let figures of them stand here. ``diffthrust datasets`` says "
    "where they are published."
)
PRINTED = Path(__file__).parent / "printed"
"""What examples on measured logs printed where the logs were, by hand: ``NAME.txt``."""

ORDER: dict[str, str | None] = {
    "fit_thruster": None,
    "export": None,
    "uncertainty": None,
    "many_logs": None,
    "campaign": None,
    "fleet": None,
    "describing_function": None,
    "limit_cycle": None,
    "compensators": None,
    "tune_lead": None,
    "pi_speed_loop": None,
    "path_tracking": None,
    "papers_yoerger": None,
    "papers_yoerger_duct": None,
    "papers_yoerger_adaptive": None,
    "papers_siramdasu": None,
    "papers_open_loop": None,
    "papers_aras": None,
    "papers_aras_depth": None,
    "papers_plans": None,
    "papers_printed": None,
    "own_model": MEASURED,
    "t200_map": MEASURED,
    "blueboat": MEASURED,
    "esso_osaka": MEASURED,
    "ngs_thruster": MEASURED,
    "open_loop_thrust": MEASURED,
    "papers_on_measured": MEASURED,
    "headroom": MEASURED,
    "uncertainty_measured": MEASURED,
}
"""In the order of the gallery, with the reason why one does not run."""


def runs(name: str) -> bool:
    """Whether a build runs it: those on measured logs where DIFFTHRUST_GALLERY is "measured"."""
    wanted = os.environ.get("DIFFTHRUST_GALLERY") == "measured"
    return ORDER[name] is None or (wanted and ORDER[name] is MEASURED)


def place(filename: str) -> int:
    """Where an example stands in the gallery; a new one stands last."""
    names = list(ORDER)
    stem = Path(filename).stem
    return names.index(stem) if stem in names else len(names)


def folder_of(script: str) -> Path:
    """Where an example writes."""
    return SAVED / Path(script).stem


def output_folder(gallery_conf: Any, script_vars: dict[str, Any]) -> list[str]:
    """The argument of an example, a new folder, as it is seen from the examples.

    The example also learns its own path here, by which it finds the logs beside it.
    """
    folder = folder_of(script_vars["src_file"])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    script_vars["example_globals"]["__file__"] = script_vars["src_file"]
    return [os.path.relpath(folder, ROOT / "examples")]


def saved_figures(block: Any, block_vars: dict[str, Any], gallery_conf: Any) -> str:
    """The figures that an example has saved since the last block, one below the other."""
    from sphinx_gallery.scrapers import figure_rst

    rst = ""
    for path in sorted(folder_of(block_vars["src_file"]).glob("*.png"), key=os.path.getmtime):
        image = Path(next(block_vars["image_path_iterator"])).with_suffix(".png")
        shutil.move(path, image)
        rst += figure_rst([str(image)], gallery_conf["src_dir"], path.stem.replace("_", " "))
    return rst


def finish_page(app: Any, docname: str, source: list[str]) -> None:
    """Leave out where the checkout lies; say why an example was not run, and what it prints."""
    folder, _, name = docname.rpartition("/")
    if folder != "gallery" or name not in ORDER:
        return
    source[0] = source[0].replace(f"{ROOT}/", "")
    call = "\n\n    python examples/"
    source[0] = source[0].replace(call, f"\n\n.. code-block:: none{call}", 1)
    if runs(name):
        return
    title = source[0].find("\n====")
    end = source[0].find("\n\n", title)
    note = f"\n\n.. note::\n\n   {ORDER[name]}\n"
    source[0] = source[0][:end] + note + source[0][end:]
    printed = PRINTED / f"{name}.txt"
    if printed.exists():
        lines = indent(printed.read_text(encoding="utf-8").strip(), "   ")
        printed_text = (
            f"\n\nWhat it printed where the logs were:\n\n.. code-block:: none\n\n{lines}\n\n"
        )
        at = source[0].find(".. _sphx_glr_download")
        source[0] = source[0][:at] + printed_text + source[0][at:]


_SCRIPT = re.compile(r"\]\((?:\.\./)+examples/(\w+\.py)\)")


def link_examples(app: Any, docname: str, source: list[str]) -> None:
    """Turn links to the scripts, for who reads the pages as they are, into links to the gallery."""
    source[0] = _SCRIPT.sub(r"](#sphx_glr_gallery_\1)", source[0])


def setup(app: Any) -> dict[str, Any]:
    """Connect what completes the pages."""
    app.connect("source-read", finish_page)
    app.connect("source-read", link_examples)
    return {"parallel_read_safe": True}
