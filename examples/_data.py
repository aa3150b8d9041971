"""Where the measured logs lie, and where figures go; shared by the examples."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import diffthrust as dft


def runs_of(load: Callable[..., dft.datasets.Runs], *names: str) -> dft.datasets.Runs:
    """The logs of a public data set, or the end of the script where they cannot be had.

    They come from the folder that the environment variable DIFFTHRUST_DATA names, without one from
    ``shared/data`` beside the repository, and without that from their public repository.
    """
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    if beside.is_dir():
        os.environ.setdefault("DIFFTHRUST_DATA", str(beside))
    try:
        return load(names or None)
    except dft.InputError as error:
        print(f"The measured logs are not here: {error.problem} {error.mend}")
        raise SystemExit(0) from None


def output_folder() -> Path:
    """The folder for figures: the first argument of the script, or ``example_output``."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "example_output")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
