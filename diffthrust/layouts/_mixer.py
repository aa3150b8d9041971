"""What a controller sends to the thrusters for its commands."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any, Self

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.files import ending, write_whole
from diffthrust._support.literals import as_toml
from diffthrust._support.names import listing, short_repr
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.words import counted, number
from diffthrust.models._craft.six import Six

AXES = Six._fields
"""What a mixer may command: surge, sway, heave, roll, pitch, yaw; x ahead, y to starboard, z down,
positive turns clockwise about them (FRD). A heave command pushes down."""


@dataclass(frozen=True, repr=False, eq=False)
class Mixer(Result):
    """What a controller sends to each thruster for a command of 1 of each axis.

    Args:
        commands: the axes that it commands, of `AXES`: forces along x ahead, y to starboard, z
            down, and moments clockwise about them.
        factors: for each thruster what it is sent, in the order of ``commands``.
        source: whose it is.

    Raises:
        InputError: an axis that is none, or a thruster with another number of factors.

    Example:
        >>> mixer = dft.layouts.Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
        >>> mixer.matrix.tolist(), mixer.thrusters
        ([[1.0, 1.0], [1.0, -1.0]], ('port', 'starboard'))
        >>> print(mixer.csv().splitlines()[1])
        port,1.0,1.0
        >>> mixer.save("mixer.toml").read_text().splitlines()[-1]
        'starboard = [1.0, -1.0]'
    """

    commands: tuple[str, ...]
    factors: Mapping[str, Sequence[float]]
    source: str = "a matrix"

    def __post_init__(self) -> None:
        object.__setattr__(self, "commands", tuple(self.commands))
        unknown = [name for name in self.commands if name not in AXES]
        if unknown or not self.commands or len(set(self.commands)) < len(self.commands):
            raise InputError(
                f"Mixer: expected axes of {listing(AXES)}, each once, found "
                f"{listing(self.commands) if self.commands else 'none'}.",
                "A heave command pushes down, a sway command to starboard: name what yours does.",
            )
        rows = _rows("Mixer", self.factors, self.commands, "factors")
        object.__setattr__(self, "factors", rows)

    @classmethod
    def inverse(cls, effectiveness: Mapping[str, Sequence[float]], source: str = "") -> Self:
        """The pseudo-inverse of what each thruster does, as many allocators take it.

        Args:
            effectiveness: for each thruster its force and moment, in the order of `AXES`, per what
                it is sent.
            source: whose it is.

        Returns:
            A mixer of those axes on which any thruster acts.

        Raises:
            InputError: a thruster without six finite numbers, or none that acts.

        Example:
            >>> boat = {"port": (1, 0, 0, 0, 0, 0.3), "starboard": (1, 0, 0, 0, 0, -0.3)}
            >>> print(dft.layouts.Mixer.inverse(boat).commands)
            ('surge', 'yaw')
        """
        does = _rows("Mixer.inverse", effectiveness, AXES, "numbers")
        acting = np.array([*does.values()]).T
        if not np.any(acting):
            raise InputError(
                f"Mixer.inverse: expected forces or moments of {listing(does)}, found zeros.",
                "Give what each thruster does, per what it is sent.",
            )
        mix = np.linalg.pinv(acting, rcond=1e-9)
        used = [k for k in range(len(AXES)) if np.abs(mix[:, k]).max() > 1e-9]
        rows = {name: mix[i, used].tolist() for i, name in enumerate(effectiveness)}
        return cls(tuple(AXES[k] for k in used), rows, source or "a pseudo-inverse")

    @property
    def thrusters(self) -> tuple[str, ...]:
        """The thrusters, in their order."""
        return tuple(self.factors)

    @property
    def matrix(self) -> np.ndarray:
        """The factors, ``(thrusters, commands)``."""
        return np.array([*self.factors.values()], float)

    def named(self, names: Sequence[str]) -> Self:
        """The mixer with other names of its thrusters, in their order.

        Raises:
            InputError: another number of names.

        Example:
            >>> dft.layouts.ardusub_mixer("simplerov_3").named(("left", "right", "up")).thrusters
            ('left', 'right', 'up')
        """
        if len(names) != len(self.factors):
            raise InputError(
                f"named: expected {len(self.factors)} names, found {len(names)}.",
                f"Name the thrusters in the order of {listing(self.factors)}.",
            )
        return replace(self, factors=dict(zip(names, self.factors.values(), strict=True)))

    def csv(self) -> str:
        """The factors as a table, a line for each thruster."""
        text = StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(("thruster", *self.commands))
        table.writerows((name, *row) for name, row in self.factors.items())
        return text.getvalue()

    def toml(self) -> str:
        """The factors as TOML, an array for each thruster."""
        # a comment ends with its line
        lines = [f"# {' '.join(self.source.split())}: x ahead, y to starboard, z down"]
        lines += [f"commands = {as_toml(self.commands)}", "[thrusters]"]
        lines += [f"{_key(name)} = {as_toml(row)}" for name, row in self.factors.items()]
        return "\n".join(lines) + "\n"

    def ardusub(self) -> str:
        """The factors as lines of ArduSub's custom frame (``SUB_FRAME_CUSTOM``), to paste.

        ArduSub counts a throttle up. Its ``MOT_n_DIRECTION`` must be 1: directions are contained.
        Source: ArduPilot, libraries/AP_Motors/AP_Motors6DOF.cpp.

        Example:
            >>> mixer = dft.layouts.ardusub_mixer("simplerov_3")
            >>> print(mixer.ardusub().splitlines()[-1])
            add_motor_raw_6dof(AP_MOTORS_MOT_3, 0.0f, 0.0f, 0.0f, -1.0f, 0.0f, 0.0f, 3);
        """
        lines = ["// motor, roll, pitch, yaw, throttle, forward, lateral, testing order"]
        for k, row in enumerate(self.factors.values(), 1):
            by_axis = {**dict.fromkeys(AXES, 0.0), **dict(zip(self.commands, row, strict=True))}
            by_axis["heave"] = -by_axis["heave"] + 0.0
            order = ("roll", "pitch", "yaw", "heave", "surge", "sway")
            factors = ", ".join(f"{round(by_axis[axis], 4)}f" for axis in order)
            lines.append(f"add_motor_raw_6dof(AP_MOTORS_MOT_{k}, {factors}, {k});")
        return "\n".join(lines) + "\n"

    def save(self, path: Path | str) -> Path:
        """Write the factors: a table (.csv) or TOML (.toml).

        Raises:
            InputError: another ending, or a folder that cannot be written to.
        """
        file = Path(path)
        kind = ending(file, ".csv", ".toml")
        write_whole(file, (self.csv() if kind == ".csv" else self.toml()).encode())
        return file

    def _line(self) -> str:
        return (
            f"{self.source}: {counted(len(self.factors), 'thruster')} by {', '.join(self.commands)}"
        )

    def _report(self) -> Report:
        rows = [(name, *(number(v, 3) for v in row)) for name, row in self.factors.items()]
        headings = ("Sent to", *self.commands)
        table = Rows.of(headings, rows, numbers=range(1, len(headings)))
        return Report(Section("", f"Mixer: {self.source}, for a command of 1.", table))


def _rows(
    what: str, by_thruster: Any, columns: Sequence[str], noun: str
) -> dict[str, tuple[float, ...]]:
    """One finite number of each thruster for each column."""
    if not isinstance(by_thruster, Mapping) or not by_thruster:
        content = "none" if isinstance(by_thruster, Mapping) else short_repr(by_thruster)
        raise InputError(
            f"{what}: expected thrusters, found {content}.",
            f'Give {noun} by thruster, as in {{"port": (1, 1)}}.',
        )
    rows = {}
    for name, row in by_thruster.items():
        try:
            values = np.array(row, float)
        except (TypeError, ValueError):
            values = np.array(np.nan)
        if values.shape != (len(columns),) or not np.all(np.isfinite(values)):
            raise InputError(
                f"{what}, {name}: expected {len(columns)} {noun}, for {listing(columns)}, found "
                f"{short_repr(row)}.",
                f"Give each thruster one finite number for each of {listing(columns)}.",
            )
        rows[name] = tuple(values.tolist())
    return rows


def _key(name: str) -> str:
    """A name as a key of TOML: quoted where it is more than letters, digits, _ and -."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else as_toml(name)
