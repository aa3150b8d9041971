"""One column of a file, or one field of its messages, as a survey of the file finds it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Field:
    """One column of a table, or one field of a message or topic.

    Args:
        name: what ``Column(...)`` takes, such as ``"rpm"``, ``"RCOU.C1"`` or
            ``"/odom.twist.twist.linear.x"``.
        values: numbers, ``(n,)``, NaN where missing or no number.
        time: own stamps [s] from the log's first message, ``(n,)``; None in a table.
        unit: what the file itself says, empty where it says nothing.
        text: an example of a cell that is no number, empty where there is none.
        dates: a column of dates; its values are seconds after the first.
        date_formats: of dates that do not begin with the year, what ``Column(dates=)`` takes; two
            where the file does not tell the day from the month.
    """

    name: str
    values: np.ndarray
    time: np.ndarray | None = None
    unit: str = ""
    text: str = ""
    dates: bool = False
    date_formats: tuple[str, ...] = ()
