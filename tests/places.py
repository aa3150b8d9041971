"""Where things stand in the checkout."""

from pathlib import Path

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
FITS = ROOT / "fits"
EXAMPLES = ROOT / "examples"


def docs_pages() -> list[Path]:
    """The pages of the documentation as they are written, without what a build makes."""
    made = {"_build", "atlas", "gallery", "reference"}
    pages = (ROOT / "docs").rglob("*.md")
    return sorted(p for p in pages if not made & {*p.relative_to(ROOT / "docs").parts})
