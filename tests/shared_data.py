"""Where the measured logs lie, for the tests that need them."""

import os
from pathlib import Path

import pytest


def data_folder(name: str) -> Path:
    """Give the folder of one data set, or skip the test and say why."""
    named = os.environ.get("DIFFTHRUST_DATA")
    root = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    folder = root / name
    if not folder.is_dir():
        pytest.skip(
            f"the measured logs {name!r} are absent: neither DIFFTHRUST_DATA nor ../shared/data "
            "leads to them"
        )
    return folder
