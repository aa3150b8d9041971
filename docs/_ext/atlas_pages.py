"""The atlas: a page for each effect of the catalogue, made from its class when the site is built.

As a Sphinx extension it writes ``atlas/`` beside the other pages, where the sources of models and
effects have changed since; by hand: ``python docs/_ext/atlas_pages.py docs/atlas``.
"""

from __future__ import annotations

import hashlib
import re
import sys
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

import atlas_text as words  # noqa: E402  (lies beside)
import numpy as np  # noqa: E402
from atlas_figures import effect_figure, likeness_figure, shown  # noqa: E402
from atlas_logs import (  # noqa: E402
    Answer,
    Bench,
    answers,
    benches,
    levels,
    likeness,
    telling_record,
    typical,
)
from generated import write  # noqa: E402

import diffthrust as dft  # noqa: E402
from diffthrust.effects import EFFECTS  # noqa: E402

MADE = ("curve", "formula")
"""Effects that are made of what a user writes; the guide to effects describes them."""


@dataclass(frozen=True)
class Entry:
    """An effect on the first model that has its port.

    Args:
        effect: at a typical size.
        index: of the bench.
        found: what it does on each record.
        others: code of the further models that have its port.
    """

    effect: dft.Effect
    index: int
    found: dict[str, Answer]
    others: tuple[str, ...]

    @property
    def bench(self) -> Bench:
        """The model and its records."""
        return benches()[self.index]

    @property
    def record(self) -> str:
        """The record on which the effect is shown."""
        return telling_record(self.found)


@cache
def entries() -> dict[str, Entry]:
    """All effects of the catalogue, by name."""
    made = {}
    for name, cls in EFFECTS.items():
        if name in MADE:
            continue
        where = [i for i, bench in enumerate(benches()) if _fits(bench, cls)]
        if not where:
            raise ValueError(f"no bench of the atlas has the port of {name}")
        first = where[0]
        effect = typical(cls(), _levels(first))
        others = tuple(benches()[i].code for i in where[1:])
        made[name] = Entry(effect, first, answers(first, effect), others)
    return made


@cache
def _levels(index: int) -> dict[str, float]:
    return levels(benches()[index])


def _fits(bench: Bench, cls: type[dft.Effect]) -> bool:
    try:
        return bool(bench.model + cls())
    except dft.InputError:
        return False


def neighbours(name: str) -> list[tuple[str, Answer, dict[str, Answer]]]:
    """The effects that look most like one, on the record on which this one is shown."""
    mine = entries()[name]
    same = {n: e for n, e in entries().items() if e.index == mine.index and n != name}
    one = mine.found[mine.record]
    alike = sorted(same, key=lambda n: -likeness(one, same[n].found[mine.record]))
    return [(n, same[n].found[mine.record], same[n].found) for n in alike[:4]]


def make(folder: Path, say: Any = print) -> None:
    """Write all pages and figures."""
    started = time.monotonic()
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for name, entry in entries().items():
        bench = entry.bench
        one = shown(bench, entry.effect, entry.record)
        title = f"{words.spoken(name)}, on the record “{entry.record}” (simulated)"
        effect_figure(one, words.units_of(bench), title).savefig(figures / f"{name}.png", dpi=110)
        write(folder / f"{name}.md", words.page(name, entry, one, neighbours(name)))
    maps = []
    for index, bench in enumerate(benches()):
        found = {n: e for n, e in entries().items() if e.index == index}
        if len(found) < 3:
            continue
        names = list(found)
        standard = bench.standard.name
        of = [found[n].found[standard] for n in names]
        table = np.array([[likeness(a, b) for b in of] for a in of])
        np.fill_diagonal(table, 1.0)
        title = f"Alike on “{standard}”: {bench.title}"
        file = f"alike_{index}.png"
        likeness_figure(names, table, title).savefig(figures / file, dpi=110)
        maps.append((bench, file))
    write(folder / "index.md", words.index(entries(), maps))
    kept = {"index.md", *(f"{name}.md" for name in entries())}
    for old in folder.glob("*.md"):
        if old.name not in kept:
            old.unlink()
    say(f"atlas: {len(entries())} pages in {time.monotonic() - started:.0f} s")


def stamp() -> str:
    """Changes with anything that a page is made of."""
    package = HERE.parents[1] / "diffthrust"
    folders = ("effects", "models", "simulation", "estimation")
    files = [*HERE.glob("atlas_*.py"), *(f for d in folders for f in (package / d).rglob("*.py"))]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(re.sub(rb"\s+", b" ", file.read_bytes()))
    return digest.hexdigest()


def _when_built(app: Any) -> None:
    folder = Path(app.srcdir) / "atlas"
    mark = folder / ".made_of"
    if mark.exists() and mark.read_text() == stamp() and (folder / "index.md").exists():
        return
    from sphinx.util import logging

    make(folder, logging.getLogger(__name__).info)
    mark.write_text(stamp())


def setup(app: Any) -> dict[str, Any]:
    """Make the pages before Sphinx looks which there are."""
    app.connect("builder-inited", _when_built)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    make(Path(sys.argv[1]))
