"""What an audit of allocation found: forces by command, sentences, and the corrected mixer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.figures import Figure, showing
from diffthrust._support.report import Bullets, Report, Rows, Section, Styled, notes
from diffthrust._support.results import Result
from diffthrust._support.words import capitalised, joined, number, with_error
from diffthrust.layouts._mixer import AXES, Mixer
from diffthrust.models._base.parameter import means_note
from diffthrust.models._craft.craft import Craft

_WORTH = 0.02
"""Unwanted force below this share is not told: a controller's feedback removes it unseen."""
_SURE = 2.0
"""Standard errors that a force must be from zero to be told."""
_MOST = 8
_WAYS = {"surge": ("ahead", "astern"), "sway": ("to starboard", "to port"), "heave": ("down", "up")}


@dataclass(frozen=True, repr=False, eq=False)
class Allocation(Result):
    """What a mixer does with the thrusters of a craft; made by `allocation`.

    Args:
        mixer: what was held against the craft.
        level: size of the commands.
        full: what a factor of 1 sends, in the unit of the craft's commands.
        axes: in which the craft moves.
        forces: that a command of ``level`` leads to, ``(axes, commands)`` [N, N m]: half the
            difference of both directions.
        common: what both directions lead to, ``(axes, commands)``.
        std_errors: of ``forces``, where a fit was given.
        corrected: the mixer with factors that suit the thrusters.
        remaining: what that leads to, as ``forces``.
        uncorrected: commands that keep their factors as no others give the same force alone, and
            why.
        effectiveness: force and moment of each thruster per unit of its command, ``(6,
            thrusters)``: the chord at the largest command that the mixer sends to it.
        craft: the craft.

    Example:
        >>> boat = dft.layouts.BLUEBOAT.craft().replace({"starboard.strength": 0.8})
        >>> mixer = dft.layouts.Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
        >>> audit = dft.control.allocation(boat, mixer)
        >>> audit.forces.shape, audit.axes, abs(float(audit.remaining[2, 0])) < 1e-6
        ((3, 2), ('surge', 'sway', 'yaw'), True)
        >>> audit.findings[-1]
        'A surge command of 1 gives 0.11 of yaw: 0.711 N m at 0.5.'
        >>> audit.save("mixer.csv").exists()
        True
        >>> print(audit.px4().splitlines()[1])
        param set CA_ROTOR0_PX -0.35
        >>> figure = audit.plot()
    """

    mixer: Mixer
    level: float
    full: float
    axes: tuple[str, ...]
    forces: np.ndarray
    common: np.ndarray
    std_errors: np.ndarray | None
    corrected: Mixer
    remaining: np.ndarray
    uncorrected: Mapping[str, str]
    effectiveness: np.ndarray
    craft: Craft = field(repr=False)

    def coupling(self, forces: np.ndarray | None = None) -> np.ndarray:
        """Forces as the commands that would lead to them, ``(axes, commands)``.

        An entry of 0.08 in the row of yaw says that the command acts as a yaw command of 0.08
        besides. Of axes that nothing commands it is the share of the largest force, or moment, that
        the thrusters have along, or about, any axis.

        Args:
            forces: ``self.forces`` by default.

        Example:
            >>> layout = dft.layouts.ardupilot_layout({"FRAME_CONFIG": 1})
            >>> audit = dft.control.allocation(layout.craft(), layout.mixer)
            >>> audit.coupling()[:, 0].round(2) + 0.0  # thrusters above the centre of mass pitch it
            array([ 1.  ,  0.  ,  0.  ,  0.  , -0.08,  0.  ])
        """
        given = self.forces if forces is None else forces
        return given / self._scales()[:, None]

    def _scales(self) -> np.ndarray:
        """The force along each axis of a command of its own, or the most along any like it."""
        could, most = self._could()
        scales = []
        for axis in self.axes:
            k, own = AXES.index(axis), self._own(axis)
            scales.append(own if own is not None and abs(own) > 0.1 * could[k] else most[k])
        sizes = np.array(scales, float)
        return np.where(sizes != 0, sizes, 1.0)

    def _could(self) -> tuple[np.ndarray, np.ndarray]:
        """What the thrusters could do along each of `AXES`, and at most along any like it."""
        could = np.abs(self.effectiveness).sum(axis=1) * self.level * self.full
        return could, np.repeat(could.reshape(2, 3).max(axis=1), 3)

    def _own(self, axis: str) -> float | None:
        """The force along an axis by its own command; None where nothing commands it."""
        if axis not in self.mixer.commands:
            return None
        column = self.mixer.commands.index(axis)
        return float(self.forces[self.axes.index(axis), column]) if self._uses(column) else None

    def _uses(self, column: int) -> bool:
        return bool(np.any(self.mixer.matrix[:, column]))

    @property
    def findings(self) -> tuple[str, ...]:
        """Sentences: what is wrong, what cannot be corrected, what is unwanted, the largest first.

        Empty where nothing is.
        """
        kept = (
            f"The factors of {command} stay as they are: the same force free of others cannot be "
            f"had, {why}."
            for command, why in self.uncorrected.items()
        )
        return (*self._wrong(), *kept, *self._unwanted())

    def _wrong(self) -> Iterator[str]:
        """Commands that push the other way, hardly or not at all, and thrusters sent nothing."""
        strengths, most = self._could()
        for column, command in enumerate(self.mixer.commands):
            if command not in self.axes:
                continue
            if not self._uses(column):
                yield f"A {command} command sends nothing to any thruster."
                continue
            k, own = AXES.index(command), self._own(command) or 0.0
            could = strengths[k]
            if could <= 1e-9 * most[k]:
                yield f"A {command} command gives no {command}: no thruster can."
            elif abs(own) < 0.1 * could:
                yield (
                    f"A {command} command hardly does anything: {number(own, 3)} "
                    f"{_unit(command)} of the {number(could, 3)} that the thrusters can."
                )
            elif own < 0:
                ahead, back = _WAYS.get(command, ("clockwise", "counter-clockwise"))
                yield f"A {command} command pushes {back}: it should push {ahead}."
        idle = [name for name, row in self.mixer.factors.items() if not any(row)]
        if idle:
            yield f"{capitalised(joined(idle))} {'are' if len(idle) > 1 else 'is'} sent nothing."

    def _unwanted(self) -> list[str]:
        sentences = []
        shares, errors = self.coupling(), self.std_errors
        for row, axis in enumerate(self.axes):
            for column, command in enumerate(self.mixer.commands):
                share, force = float(shares[row, column]), float(self.forces[row, column])
                error = None if errors is None else float(errors[row, column])
                sure = error is None or abs(force) > _SURE * error
                if command == axis or abs(share) < _WORTH or not sure:
                    continue
                value = f"{number(force, 3)}" if error is None else _pair(force, error)
                if self._own(axis) is not None:
                    words = f"{number(share, 2)} of {axis}: {value} {_unit(axis)} at {self.level:g}"
                else:
                    words = (
                        f"{value} {_unit(axis)} of {axis} at {self.level:g}, which has no command"
                    )
                sentences.append((abs(share), f"A {command} command of 1 gives {words}."))
        # rounding is no order
        sentences.sort(key=lambda pair: -round(pair[0], 6))
        more = len(sentences) - _MOST
        return [text for _, text in sentences[:_MOST]] + [f"And {more} more."] * (more > 0)

    def _remarks(self) -> Iterator[str]:
        """What no mixer removes, and of what the numbers are."""
        thrusters = self.craft.actuators
        yield from means_note([n for n in self.craft.per_log if n.split(".")[0] in thrusters])
        both = np.abs(self.coupling(self.common))
        for column, command in enumerate(self.mixer.commands):
            others = [k for k, axis in enumerate(self.axes) if axis != command]
            rows = [k for k in others if both[k, column] > _WORTH]
            if rows:
                parts = (
                    f"{number(self.common[k, column], 3)} {_unit(self.axes[k])} of {self.axes[k]}"
                    for k in rows
                )
                yield (
                    f"A {command} command of either sign gives {joined(parts)}, as the thrusters "
                    "are not as strong astern as ahead; no factors remove it."
                )
        left = np.abs(self.coupling(self.remaining))
        for row, axis in enumerate(self.axes):
            columns = [k for k, c in enumerate(self.mixer.commands) if c != axis]
            stay = [self.mixer.commands[k] for k in columns if left[row, k] > _WORTH]
            if stay:
                yield f"These thrusters cannot free {joined(stay)} commands of {axis}."
        largest = float(np.abs(self.corrected.matrix).max())
        if largest > max(1.0, float(np.abs(self.mixer.matrix).max())) * (1 + 1e-6):
            yield (
                f"The largest corrected factor is {number(largest, 3)}: commands near 1 are cut "
                "where a thruster is sent more than it takes."
            )
        moved = [c for c in self.mixer.commands if c not in self.axes]
        if moved:
            yield f"The body does not move in {joined(moved)}: these commands are not looked at."
        yield (
            f"Thrust curves are not linear: forces are of commands of {self.level:g} and "
            f"-{self.level:g}, half their difference, at rest in still water, moments about the "
            "centre of mass. At other levels they are others."
        )

    def save(self, path: Path | str) -> Path:
        """Write the corrected mixer: a table (.csv) or TOML (.toml).

        Raises:
            InputError: another ending, or a folder that cannot be written to.
        """
        return self.corrected.save(path)

    def px4(self) -> str:
        """PX4's parameters of the thrusters as they were identified, as lines to paste.

        Places are about the centre of mass; CT has ratios only, with PX4's default as its mean.
        Source: PX4-Autopilot, src/modules/control_allocator/module.yaml.
        """
        centre = [getattr(self.craft, n, 0.0) for n in ("x_g", "y_g", "z_g")]
        pushes = []
        for k, mounted in enumerate(self.craft.actuators.values()):
            pushes.append(float(self.effectiveness[:3, k] @ mounted.pointing))
        mean = float(np.mean(np.abs(pushes))) or 1.0
        lines = [f"param set CA_ROTOR_COUNT {len(pushes)}"]
        for k, (name, mounted) in enumerate(self.craft.actuators.items()):
            place = (
                getattr(self.craft, f"{name}.{x}") - c for x, c in zip("xyz", centre, strict=True)
            )
            sign = -1.0 if pushes[k] < 0 else 1.0
            reaction = 0.0 if mounted.reaction is None else getattr(self.craft, f"{name}.reaction")
            values = {
                **dict(zip(("PX", "PY", "PZ"), place, strict=True)),
                **dict(zip(("AX", "AY", "AZ"), (sign * v for v in mounted.pointing), strict=True)),
                "CT": 6.5 * abs(pushes[k]) / mean,
                "KM": -reaction,
            }
            lines += [
                f"param set CA_ROTOR{k}_{n} {round(float(v), 5) + 0.0:g}" for n, v in values.items()
            ]
        return "\n".join(lines) + "\n"

    @showing
    def plot(self) -> Figure:
        """Draw what each command does beside what it should, as it is and corrected."""
        from diffthrust.control._figures import allocation_figure

        used = [k for k in range(len(self.mixer.commands)) if self._uses(k)]
        shares, after = self.coupling(), self.coupling(self.remaining)
        as_is = {self.mixer.commands[k]: shares[:, k] for k in used}
        title = f"{self.mixer.source}, at {self.level:g}"
        return allocation_figure(title, self.axes, as_is, after[:, used])

    def _line(self) -> str:
        return f"{self.mixer.source}: {len(self.findings)} findings at a command of {self.level:g}"

    def _report(self) -> Report:
        rows = []
        for column, command in enumerate(self.mixer.commands):
            if not self._uses(column):
                continue
            cells = []
            for row, axis in enumerate(self.axes):
                text = number(_rounded(self.forces[row, column], self.forces[row]), 3)
                cells.append(Styled(text, "strong") if axis == command else text)
            rows.append((command, *cells))
        headings = ("Command", *(f"{axis} [{_unit(axis)}]" for axis in self.axes))
        looked = {*self.mixer.commands} & {*self.axes}
        fine = ("Every command does what it should.",) if looked and not self.findings else ()
        corrected = Section(
            "", f"Corrected factors ({self.corrected.source}):", _factor_rows(self.corrected)
        )
        title = f"Forces by commands of {self.level:g} through {self.mixer.source}:"
        return Report(
            Section("", title, Rows.of(headings, rows, numbers=range(1, len(headings)))),
            Section("", Bullets(self.findings), *fine),
            corrected,
            Section("", *notes(self._remarks())),
        )


def _factor_rows(mixer: Mixer) -> Rows:
    table = (
        (name, *(number(_rounded(v, 1.0), 3) for v in row)) for name, row in mixer.factors.items()
    )
    headings = ("Sent to", *mixer.commands)
    return Rows.of(headings, table, numbers=range(1, len(headings)))


def _rounded(value: float, beside: Any) -> float:
    """Zero where a number is rounding beside others."""
    return 0.0 if abs(value) < 1e-6 * float(np.max(np.abs(beside))) else float(value)


def _unit(axis: str) -> str:
    return "N" if axis in AXES[:3] else "N m"


def _pair(value: float, error: float) -> str:
    return " ± ".join(with_error(value, error))
