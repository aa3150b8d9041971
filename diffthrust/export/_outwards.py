"""Rows of a table from the stop outwards, as far as the force grows with the command."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

CLOSEST = 1e-4
"""Rows are no closer to each other than this share of the range of commands."""
FLAT = 1e-6
"""What changes by less than this share of the range of forces is flat."""
_JUMP = 0.01
"""Over two rows as close as that, a force that grows by more than this share jumps."""


class Outwards:
    """Rows from the stop outwards, as far as the force grows.

    Args:
        commands: from the stop on, growing.
        forces: beyond that at the stop.
        span: range of all forces.
        reach: range of all commands.
        converted: writes a command for people.
    """

    def __init__(
        self,
        commands: np.ndarray,
        forces: np.ndarray,
        span: float,
        reach: float,
        converted: Callable[[float], str],
    ) -> None:
        self.rows = [(float(commands[0]), 0.0)]
        self.notes: list[str] = []
        self.idle = float(commands[0])
        """How far the command may go from the stop without a force."""
        flat, least = None, FLAT * span
        for command, force in zip(commands[1:], forces[1:], strict=True):
            top = self.rows[-1][1]
            # twice the flatness: after a flat stretch a row is set at top + least, which must lie
            # below this one
            if force > top + 2 * least:
                if flat is not None:
                    self.rows.append((flat, top + least))
                last, low = self.rows[-1]
                if len(self.rows) == 1 + (flat is not None):
                    self.idle = last
                if command - last <= 2 * CLOSEST * reach and force - low > _JUMP * span:
                    self.notes.append(
                        f"The force jumps at {converted(last)}: it is not held between."
                    )
                self.rows.append((float(command), float(force)))
                flat = None
            elif force >= top - 2 * least:
                flat = float(command)
            else:
                self.notes.append(
                    f"The force falls beyond {converted(self.rows[-1][0])}: the table ends there."
                )
                return
        if flat is not None and len(self.rows) > 1:
            self.notes.append(f"The force does not change beyond {converted(self.rows[-1][0])}.")
