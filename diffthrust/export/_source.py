"""What is exported, a model at its values with what is known of its logs, and what that gives."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._written import PWM, ShownUnits
from diffthrust.models._base.component import Mounted
from diffthrust.models._base.model import Model


@dataclass(frozen=True)
class ExportSource:
    """What is exported."""

    model: Model  # with its effects, at the values that go into the file
    inputs: Mapping[str, str]  # those that it reads, name to unit
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """The smallest and largest value of each input in the logs, in these units."""
    linear: tuple[str, ...] = ()  # inputs that run straight from sample to sample; others are held
    substeps: int = 1  # integrator steps per sample
    errors: Mapping[str, float] = field(default_factory=dict)
    """Standard errors of the parameters, by full name, where they are known."""
    provenance: tuple[str, ...] = ()  # where the values come from, for the head of the file
    version: str = ""  # of the library
    units: ShownUnits = field(default_factory=ShownUnits)  # how the logs wrote each channel
    mounted: Mounted[Model] | None = None  # where a thruster of a craft stands
    strength: float = 1.0  # force of a thruster of a craft beside that of its model

    def stored(self, channel: str, limits: tuple[float, float], unit: str) -> tuple[float, float]:
        """A range that is given as the logs would write it, in ``unit``."""
        pulses = self.pulses(channel)
        if pulses is not None:
            low, high = sorted(float(effort) for effort in pulses.effort(limits))
            return low, high
        # every conversion is a scale and an offset: two points give its inverse
        zero, unit_value = self.units.values(channel, np.array([0.0, 1.0]), unit)
        low, high = ((limit - zero) / (unit_value - zero) for limit in limits)
        return float(low), float(high)

    def pulses(self, channel: str) -> PWM | None:
        """What widths of pulses mean, where the logs have a channel as such."""
        way = self.units.written.get(channel)
        return None if way is None else way.pwm

    @property
    def conversions(self) -> list[str]:
        """A sentence on each channel that the logs have in another unit."""
        lines = []
        for name, unit in {**self.inputs, **self.model.outputs}.items():
            pulses, theirs = self.pulses(name), self.units.unit(name, unit)
            if pulses is not None:
                lines.append(
                    f"The {name} is an effort here; the logs have pulses, stop {pulses.stop:g}, "
                    f"full {pulses.full:g}, astern {pulses.astern:g} {theirs}."
                )
            elif theirs != unit:
                zero, unit_value = self.stored(name, (0.0, 1.0), unit)
                each = f"{unit_value - zero:.9g}"
                lines.append(f"The {name} is in {unit} here; of the logs, 1 {theirs} is {each}.")
        return lines

    @property
    def head(self) -> list[str]:
        """What stands at the head of a file, sentence by sentence."""
        return [*self.provenance, *self.conversions]


@dataclass(frozen=True)
class Exported:
    """A fit in the language of another program.

    Args:
        target: for which it was made.
        text: what goes into the file; ``str(exported)`` gives it too.
        notes: what the target cannot express, and what to mind.
        path: the file that was written, or ``None``.

    Example:
        >>> exported = dft.export.export_model(dft.Thruster(), "python")
        >>> exported.target, exported.notes, "def step" in exported.text
        ('python', (), True)
    """

    target: str
    text: str = field(repr=False)
    notes: tuple[str, ...] = ()
    path: Path | None = None

    def __str__(self) -> str:
        return self.text


ENDINGS = {
    "python": (".py",),
    "c": (".h",),
    "lut": (".csv", ".h"),
    "gz": (".sdf", ".xml"),
    "uuv": (".xacro", ".urdf", ".xml"),
    "stonefish": (".scn", ".xml"),
}
"""How the files of each target may end, the usual one first."""


def filled_in(template: str, **parts: Any) -> str:
    """The template of that name, filled in."""
    import jinja2

    def named(name: str) -> str:
        folder = files("diffthrust.export").joinpath("templates")
        return folder.joinpath(f"{name}.jinja").read_text(encoding="utf-8")

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(named),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template(template).render(**parts)
    return re.sub(r"\n{4,}", "\n\n\n", text).rstrip() + "\n"
