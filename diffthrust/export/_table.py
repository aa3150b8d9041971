"""A table of force and command in the steady state, to be read in both directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from textwrap import wrap

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.words import number
from diffthrust.export._source import ExportSource, filled_in
from diffthrust.export._steady import steady_outputs
from diffthrust.models._base.model import Model

_FIRST = 33
"""Commands at which the force is worked out first."""
_ACCURACY = 1e-3
"""Between rows a straight line is no further off than this share of the whole range."""
OUTPUT = "thrust"


def to_table(
    source: ExportSource, name: str, suffix: str, limits: tuple[float, float] | None
) -> tuple[str, list[str]]:
    """Commands and the forces that a thruster settles at, as CSV or as a C header; and the notes.

    Commands are by default those of the logs. Neither repeats, so that both can be looked up. Both
    are in the units in which the logs were written.
    """
    model = source.model
    channel = commanding(model, source)
    unit, force_unit = source.inputs[channel], model.outputs[OUTPUT]
    low, high = command_limits(source, channel, limits)
    constants, notes = _constants(source, channel)

    def force(commands: np.ndarray) -> np.ndarray:
        # the ends go along: at the edges of a dead band forces are small, and settle beside the
        # largest
        every = np.append(commands, [low, high])
        inputs = {name: np.full(every.shape, value) for name, value in constants.items()}
        return steady_outputs(model, {channel: every, **inputs}, (OUTPUT,))[0][:-2]

    def as_written(command: float) -> str:
        shown = float(source.units.values(channel, np.array([command]), unit)[0])
        return f"{number(shown, 4)} {source.units.unit(channel, unit)}"

    commands = np.linspace(low, high, _FIRST)
    # without a row at the stop a dead band's edges would be lost between two rows
    if low < 0.0 < high:
        commands = np.unique([*commands, 0.0])
    commands, forces = _refined(commands, force(commands), force)
    if not np.ptp(forces):
        raise InputError(
            f"The force is the same at every {channel} from {as_written(commands[0])} to "
            f"{as_written(commands[-1])}.",
            "Widen the limits.",
        )
    commands, forces, more = _monotone(commands, forces, as_written)
    notes += more
    units = source.units
    shown = units.values(OUTPUT, forces, force_unit), units.values(channel, commands, unit)
    rows = sorted(zip(*shown, strict=True))
    their_force_unit, their_unit = units.unit(OUTPUT, force_unit), units.unit(channel, unit)
    if suffix == ".csv":
        lines = [f"{OUTPUT} [{their_force_unit}],{channel} [{their_unit}]"]
        lines += [f"{force:.9g},{command:.9g}" for force, command in rows]
        return "\n".join(lines) + "\n", notes
    text = filled_in(
        "table.h",
        prefix=name,
        channel=channel,
        unit=their_unit,
        force_unit=their_force_unit,
        rows=rows,
        head_lines=[line for each in (*source.provenance, *notes) for line in wrap(each, 90)],
        model=model,
        version=source.version,
    )
    return text, notes


def _constants(source: ExportSource, channel: str) -> tuple[dict[str, float], list[str]]:
    """The inputs beside the command, which the table holds, and notes on what that neglects."""
    constants: dict[str, float] = {}
    notes: list[str] = []
    for name, unit in source.inputs.items():
        if name != channel:
            inner = source.ranges.get(name, (0.0, 0.0))
            constants[name] = 0.0 if name == "inflow" else 0.5 * (inner[0] + inner[1])
            notes.append(f"It holds for {name} = {number(constants[name], 4)} {unit}".strip() + ".")
    outputs = source.model.outputs
    sensed = [e.name for e in source.model.effects if all(port in outputs for port in e.ports)]
    if sensed:
        notes.append(f"The force itself, without what its sensor adds: {', '.join(sensed)}.")
    return constants, notes


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
    unit = source.units.unit(channel, source.inputs[channel])
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


CLOSEST = 1e-4
"""Rows are no closer to each other than this share of the range of commands."""
FLAT = 1e-6
"""What changes by less than this share of the range of forces is flat."""
_JUMP = 0.01
"""Over two rows as close as that, a force that grows by more than this share jumps."""


def _monotone(
    commands: np.ndarray, forces: np.ndarray, as_written: Callable[[float], str]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The rows on which the force grows with the command (or falls), with notes on the others."""
    turn, stop = np.sign(forces[-1] - forces[0]) or 1.0, int(np.argmin(np.abs(commands)))
    span, reach = float(np.ptp(forces)), commands[-1] - commands[0]
    rise = turn * (forces - forces[stop])
    up, ahead, ahead_notes = _outwards(commands[stop:], rise[stop:], span, reach, as_written)
    down, astern, astern_notes = _outwards(
        -commands[stop::-1], -rise[stop::-1], span, reach, lambda c: as_written(-c)
    )
    rows = np.array([(-c, -f) for c, f in down[:0:-1]] + up)
    notes = [*astern_notes, *ahead_notes]
    if ahead or astern:
        ends = f"{as_written(-astern)} to {as_written(ahead)}"
        notes.insert(0, f"No force from {ends}: a dead band.")
    return rows[:, 0], forces[stop] + turn * rows[:, 1], notes


def _outwards(
    commands: np.ndarray,
    forces: np.ndarray,
    span: float,
    reach: float,
    as_written: Callable[[float], str],
) -> tuple[list[tuple[float, float]], float, list[str]]:
    """Rows from the stop outwards, as far as the force grows; the idle part, and notes.

    Commands grow from the stop on, and forces count from that at the stop; ``span`` and ``reach``
    are the ranges of all forces and commands. Idle is how far the command may go without a force.
    """
    idle = float(commands[0])
    rows = [(idle, 0.0)]
    notes: list[str] = []
    flat, least = None, FLAT * span
    for command, force in zip(commands[1:], forces[1:], strict=True):
        top = rows[-1][1]
        # twice the flatness: after a flat stretch a row is set at top + least, which must lie
        # below this one
        if force > top + 2 * least:
            if flat is not None:
                rows.append((flat, top + least))
            last, low = rows[-1]
            if len(rows) == 1 + (flat is not None):
                idle = last
            if command - last <= 2 * CLOSEST * reach and force - low > _JUMP * span:
                notes.append(f"The force jumps at {as_written(last)}: it is not held between.")
            rows.append((float(command), float(force)))
            flat = None
        elif force >= top - 2 * least:
            flat = float(command)
        else:
            beyond = as_written(rows[-1][0])
            return rows, idle, [*notes, f"The force falls beyond {beyond}: the table ends there."]
    if flat is not None and len(rows) > 1:
        notes.append(f"The force does not change beyond {as_written(rows[-1][0])}.")
    return rows, idle, notes
