"""Both ways through the readers of text: short files cell by cell, long ones in blocks.

How long a long file is, is a number of the readers; here it is set so that small files show both.
"""

import pytest

from diffthrust.logs._tables import (  # private: sizes from which a way is taken
    csv,
    large_csv,
    text,
)

LARGE = large_csv.LARGE
"""Bytes from which a file is read in blocks."""
BadCell = text.BadCell
read_csv, seconds_of = csv.read_csv, text.seconds_of


def in_blocks(patch: pytest.MonkeyPatch, *, never_whole: bool = False) -> None:
    """Small files are large, with a few hundred lines in a block; none is held as a whole."""
    patch.setattr(csv, "LARGE", 1000)
    patch.setattr(large_csv, "_TOP", 20_000)
    patch.setattr(large_csv, "_BLOCK", 8_000)
    if never_whole:
        patch.setattr(csv, "_read_all_lines", None)


def many_dates(patch: pytest.MonkeyPatch) -> None:
    """Any number of dates is taken for many."""
    patch.setattr(text, "_MANY", 0)
