"""A table of force and command in the steady state, to be read in both directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from textwrap import wrap

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.words import number
from diffthrust.export._source import ExportSource, filled_in
from diffthrust.export._steady import steady_output
from diffthrust.models._base.model import Model

_FIRST = 33
"""Commands at which the force is worked out first."""
_ACCURACY = 1e-3
"""Between rows a straight line is no further off than this share of the whole range."""
OUTPUT = "thrust"


@dataclass(frozen=True)
class ForceTable:
    """Commands and the forces that they settle at; neither repeats, so both can be looked up.

    Args:
        channel: the input that commands.
        commands: ``(n,)``, in the model's unit.
        forces: ``(n,)`` [N].
        notes: where the force stands still, and what was taken for given.
    """

    channel: str
    commands: np.ndarray
    forces: np.ndarray
    notes: tuple[str, ...]


def steady_table(source: ExportSource, limits: tuple[float, float] | None = None) -> ForceTable:
    """The forces that a thruster settles at over commands, by default those of the logs."""
    model = source.model
    channel = commanding(model, source)
    low, high = command_limits(source, channel, limits)
    notes: list[str] = []
    constants = {}
    for name, unit in source.inputs.items():
        if name != channel:
            inner = source.ranges.get(name, (0.0, 0.0))
            constants[name] = 0.0 if name == "inflow" else 0.5 * (inner[0] + inner[1])
            notes.append(f"It holds for {name} = {number(constants[name], 4)} {unit}".strip() + ".")

    left_out = [e.name for e in model.effects if all(port in model.outputs for port in e.ports)]
    if left_out:
        notes.append(f"The force itself, without what its sensor adds: {', '.join(left_out)}.")

    def forces(commands: np.ndarray) -> np.ndarray:
        inputs = {name: np.full(commands.shape, value) for name, value in constants.items()}
        return steady_output(model, {channel: commands, **inputs}, OUTPUT)

    def as_written(command: float) -> str:
        unit = source.inputs[channel]
        shown = float(source.shown(channel, np.array([command]), unit)[0])
        return f"{number(shown, 4)} {source.unit(channel, unit)}"

    commands = np.linspace(low, high, _FIRST)
    # without a row at the stop a dead band's edges would be lost between two rows
    if low < 0.0 < high:
        commands = np.unique([*commands, 0.0])
    commands, computed = _refined(commands, forces(commands), forces)
    return _monotone(ForceTable(channel, commands, computed, tuple(notes)), as_written)


def commanding(model: Model, source: ExportSource) -> str:
    """The input that commands the thrust."""
    drives = [name for name in ("command", "speed") if name in source.inputs]
    if OUTPUT not in model.outputs or not drives:
        raise InputError(
            f"The model '{model}' has the inputs {listing(source.inputs)} and the outputs "
            f"{listing(model.outputs)}; expected a thruster, from a command to a thrust.",
            "Export it to python or to c.",
        )
    return drives[0]


def command_limits(
    source: ExportSource, channel: str, limits: tuple[float, float] | None
) -> tuple[float, float]:
    """The lowest and highest command in the model's unit: those given, or of the logs."""
    unit = source.unit(channel, source.inputs[channel])
    range_given = source.ranges.get(channel)
    if limits is not None:
        range_given = source.stored(channel, limits, source.inputs[channel])
    if range_given is None:
        raise InputError(
            f"The range of the {channel} [{unit}] is not known: expected limits, found none.",
            f"Give the lowest and highest {channel}: limits=(LOW, HIGH), or --limits LOW HIGH.",
        )
    low, high = (float(value) for value in range_given)
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError(
            f"limits: expected the lowest and the highest {channel} [{unit}], found "
            f"{limits or range_given}.",
            "Give two numbers, the lower one first.",
        )
    return low, high


def _refined(
    commands: np.ndarray, computed: np.ndarray, forces: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Rows added where a straight line between rows would be off, in either direction."""
    reach = commands[-1] - commands[0]
    rows = dict(zip(commands, computed, strict=True))
    open_ = list(pairwise(commands))
    while open_:
        span = float(np.ptp([*rows.values()])) or 1.0
        middles = np.array([0.5 * (low + high) for low, high in open_])
        bent = []
        for (low, high), middle, middle_force in zip(open_, middles, forces(middles), strict=True):
            rise = rows[high] - rows[low]
            off = abs(middle_force - 0.5 * (rows[low] + rows[high])) / span
            sloped = abs(rise) > FLAT * span  # the line's command for the force in the middle
            # tables are read in both directions: near a dead band a line that is right for the
            # force may be far off for the command
            back = (
                abs((middle_force - rows[low]) / rise - 0.5) * (high - low) / reach
                if sloped
                else 0.0
            )
            # a jump would be halved for ever
            if max(off, back) > _ACCURACY and high - low > CLOSEST * reach:
                rows[middle] = middle_force
                bent += [(low, middle), (middle, high)]
        open_ = bent
    edges = _edges(rows)
    while edges:  # where the force begins to change
        middles = np.array([0.5 * (low + high) for low, high in edges])
        rows.update(zip(middles, forces(middles), strict=True))
        edges = [(low, high) for low, high in _edges(rows) if high - low > CLOSEST * reach]
    ordered = sorted(rows.items())
    return np.array([c for c, _ in ordered]), np.array([f for _, f in ordered])


def _edges(rows: Mapping[float, float]) -> list[tuple[float, float]]:
    """Neighbours between which the force changes, beside others between which it does not."""
    commands = sorted(rows)
    forces = np.array([rows[c] for c in commands])
    flat = np.abs(np.diff(forces)) <= FLAT * float(np.ptp(forces))
    edge = ~flat & (np.append(False, flat[:-1]) | np.append(flat[1:], False))
    return [(commands[i], commands[i + 1]) for i in np.flatnonzero(edge)]


def _monotone(table: ForceTable, converted: Callable[[float], str]) -> ForceTable:
    """The rows on which the force grows with the command (or falls), with what was left out."""
    commands, forces = table.commands, table.forces
    span = float(np.ptp(forces))
    if not span:
        raise InputError(
            f"The force is the same at every {table.channel} from {converted(commands[0])} to "
            f"{converted(commands[-1])}.",
            "Widen the limits.",
        )
    turn, stop = np.sign(forces[-1] - forces[0]) or 1.0, int(np.argmin(np.abs(commands)))
    rise = turn * (forces - forces[stop])
    reach = commands[-1] - commands[0]
    up = Outwards(commands[stop:], rise[stop:], span, reach, converted)
    down = Outwards(-commands[stop::-1], -rise[stop::-1], span, reach, lambda c: converted(-c))
    rows = [(-c, -f) for c, f in down.rows[:0:-1]] + up.rows
    notes = [*down.notes, *up.notes]
    if up.idle or down.idle:
        notes.insert(
            0, f"No force from {converted(-down.idle)} to {converted(up.idle)}: a dead band."
        )
    return replace(
        table,
        commands=np.array([c for c, _ in rows]),
        forces=forces[stop] + turn * np.array([f for _, f in rows]),
        notes=(*table.notes, *notes),
    )


def to_table(
    source: ExportSource, name: str, suffix: str, limits: tuple[float, float] | None
) -> tuple[str, list[str]]:
    """The table as CSV, or as a C header where the file ends in ``.h``; and its notes.

    Both are in the units in which the logs were written.
    """
    table, model = steady_table(source, limits), source.model
    unit, force_unit = source.inputs[table.channel], model.outputs[OUTPUT]
    rows = sorted(
        zip(
            source.shown(OUTPUT, table.forces, force_unit),
            source.shown(table.channel, table.commands, unit),
            strict=True,
        )
    )
    force_unit, unit = source.unit(OUTPUT, force_unit), source.unit(table.channel, unit)
    if suffix == ".csv":
        lines = [f"{OUTPUT} [{force_unit}],{table.channel} [{unit}]"]
        lines += [f"{force:.9g},{command:.9g}" for force, command in rows]
        return "\n".join(lines) + "\n", list(table.notes)
    text = filled_in(
        "table.h",
        prefix=name,
        channel=table.channel,
        unit=unit,
        force_unit=force_unit,
        rows=rows,
        head_lines=[line for each in (*source.provenance, *table.notes) for line in wrap(each, 90)],
        model=model,
        version=source.version,
    )
    return text, list(table.notes)


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
