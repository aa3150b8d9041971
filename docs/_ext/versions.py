"""Put a built site beside its other versions: `versions.py HTML SITE VERSION [BASE]`.

SITE gets a folder for the version, `switcher.json` for the menu of versions, and an `index.html`
that leads to the newest release, or to `dev` where there is none. BASE is the path below which
the site is served (`/diffthrust`), since the menu stands on pages of any depth.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

RELEASE = re.compile(r"\d+(\.\d+)+")


def by_number(name: str) -> tuple[int, ...]:
    """What releases are sorted by."""
    return tuple(int(part) for part in name.split("."))


def publish(html: Path, site: Path, version: str, base: str = "") -> list[dict[str, object]]:
    """Copy the site, and write what leads to it; gives the entries of the menu."""
    if not (RELEASE.fullmatch(version) or version == "dev"):
        raise SystemExit(f"expected a version like 0.1.0, or dev, found {version!r}")
    shutil.rmtree(site / version, ignore_errors=True)
    shutil.copytree(html, site / version, ignore=shutil.ignore_patterns(".doctrees", ".buildinfo"))
    there = [path.name for path in site.iterdir() if path.is_dir()]
    releases = sorted(filter(RELEASE.fullmatch, there), key=by_number, reverse=True)
    names = [*releases, *(name for name in there if name == "dev")]
    entries: list[dict[str, object]] = [
        {"version": name, "url": f"{base}/{name}/", "preferred": name == names[0]} for name in names
    ]
    (site / "switcher.json").write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")
    (site / ".nojekyll").write_text("", encoding="utf-8")
    (site / "index.html").write_text(
        f'<!doctype html><meta charset="utf-8"><title>diffthrust</title>'
        f'<meta http-equiv="refresh" content="0; url={names[0]}/">'
        f'<a href="{names[0]}/">diffthrust {names[0]}</a>\n',
        encoding="utf-8",
    )
    return entries


if __name__ == "__main__":
    publish(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
