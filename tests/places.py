"""Where things stand in the checkout."""

from pathlib import Path

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
FITS = ROOT / "fits"
EXAMPLES = ROOT / "examples"
