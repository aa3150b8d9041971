"""A column of a file, or a field of its messages, with its numbers."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Field:
    """One column of a table, or one field of a message or topic.

    Args:
        name: what ``Column(...)`` takes, such as ``"rpm"``, ``"RCOU.C1"`` or
            ``"/odom.twist.twist.linear.x"``.
        values: numbers, ``(n,)``, NaN where missing or no number.
        time: time stamps of the field [s], from the log's first message, ``(n,)``; None in a table.
        unit: the unit stated in the file; empty if none is.
        text: an example of a cell that is not a number; empty if there is none.
        dates: a column of dates; its values are seconds after the first.
        date_formats: for dates that do not begin with the year, the values for ``Column(dates=)``;
            two if day and month cannot be told apart.
    """

    name: str
    values: np.ndarray
    time: np.ndarray | None = None
    unit: str = ""
    text: str = ""
    dates: bool = False
    date_formats: tuple[str, ...] = ()
