"""Where the measured logs lie, and where figures go; shared by the examples."""

import os
import sys
from pathlib import Path


def data_folder(name: str) -> Path:
    """The folder of one data set, or the end of the script where it is absent.

    It is looked for in the folder that the environment variable DIFFTHRUST_DATA names, and without
    one in ``shared/data`` beside the repository.
    """
    named = os.environ.get("DIFFTHRUST_DATA")
    root = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not (root / name).is_dir():
        print(
            f"The measured logs '{name}' are not here ({root / name}): "
            "set DIFFTHRUST_DATA to the folder that holds them."
        )
        raise SystemExit(0)
    return root / name


def output_folder() -> Path:
    """The folder for figures: the first argument of the script, or ``example_output``."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "example_output")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
