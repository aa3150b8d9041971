"""The printed figures of all three papers, in one table."""

from __future__ import annotations

from dataclasses import replace

from printed import aras, siramdasu, yoerger
from printed.printed import Printed


def printed_figures() -> list[Printed]:
    """Every printed figure of the three papers, with the paper's name.

    Ours is worked out when this is called, in some seconds: by closed forms, and by simulation.

    Example:
        >>> print(printed_table(printed_figures()))
    """
    papers = {
        "Yoerger 1990": yoerger.printed_figures(),
        "Siramdasu 2013": siramdasu.printed_figures(),
        "Aras 2013": aras.printed_figures(),
    }
    return [replace(row, source=name) for name, rows in papers.items() for row in rows]
