"""A model taken to another program: its language, a table, or a simulator."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

from diffthrust._support.errors import InputError
from diffthrust._support.files import ending, write_whole
from diffthrust._support.names import listing, nearest
from diffthrust.export._program import C99, HISTORY, Python, program_text
from diffthrust.export._simulators import to_simulator
from diffthrust.export._source import ENDINGS, Exported, ExportSource
from diffthrust.export._table import to_table
from diffthrust.export._trace import read_inputs
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import means_note

ExportTo = Literal["python", "c", "lut", "gz", "uuv", "stonefish"]
TARGETS: tuple[str, ...] = get_args(ExportTo)


def export_model(
    model: Model,
    to: ExportTo,
    path: Path | str | None = None,
    *,
    limits: tuple[float, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    hold: str | Mapping[str, str] = "zero",
    substeps: int = 1,
) -> Exported:
    """Take a model with its effects to another program; ``fit.export`` does so with a fit.

    Args:
        model: the model with its effects, at the values that go along.
        to: "python" (a module that needs nothing but ``math``) or "c" (a C99 header), each with a
            ``reset`` and a ``step`` that give what `simulate` gives; "lut" (a table of force and
            command in the steady state, as CSV or as a C header, by the ending of ``path``); "gz"
            (gz-sim), "uuv" (uuv_simulator) or "stonefish": the thruster as these describe it, or
            each thruster of a craft with its place.
        path: the file to write, or ``None``. Names inside begin with its name.
        limits: lowest and highest command, for the table and the simulators.
        ranges: the inputs that the model reads, with their smallest and largest value, in the
            model's units; by default those that it needs.
        hold: how inputs run between samples, "zero" or "linear", as of a `Log`.
        substeps: integrator steps per call, for "python" and "c".

    Returns:
        The text, and notes on what the target cannot express.

    Raises:
        InputError: an unknown target, another ending of the file, an operation of the model without
            a translation, or a model that the target has no place for.

    Example:
        >>> exported = dft.export.export_model(dft.Thruster(), "c", "thruster.h")
        >>> exported.notes, Path("thruster.h").exists()
        ((), True)
    """
    from diffthrust import __version__

    inputs = read_inputs(model, ranges or {})
    ways = dict.fromkeys(inputs, hold) if isinstance(hold, str) else hold
    source = ExportSource(
        model,
        inputs,
        ranges=dict(ranges or {}),
        linear=tuple(name for name in inputs if ways.get(name) == "linear"),
        substeps=substeps,
        version=__version__,
    )
    return exported(source, to, path, limits)


def exported(
    source: ExportSource,
    to: str,
    path: Path | str | None = None,
    limits: tuple[float, float] | None = None,
) -> Exported:
    """As `export_model`, of what is already gathered."""
    if to not in TARGETS:
        near = nearest(str(to), TARGETS, "; ")
        raise InputError(
            f"to: expected one of {listing(TARGETS)}, found {to!r}{near}.",
            "Correct the target.",
        )
    file = None if path is None else Path(path)
    suffix = ENDINGS[to][0] if file is None else ending(file, *ENDINGS[to])
    words = re.sub(r"\W", "_", source.model.name if file is None else file.stem)
    # the file's name becomes a prefix of identifiers, which no language lets begin with a digit
    name = f"m{words}" if words[:1].isdigit() or not words else words
    text, notes = _made(source, to, name, suffix, limits)
    if file is not None:
        write_whole(file, text.encode())
    return Exported(to, text, (*notes, *means_note(source.model.per_log)), file)


def _made(
    source: ExportSource, to: str, name: str, suffix: str, limits: tuple[float, float] | None
) -> tuple[str, list[str]]:
    """The text of a target, and its notes."""
    if to == "lut":
        return to_table(source, name, suffix, limits)
    if to in ("python", "c"):
        title = "".join(word.capitalize() for word in name.split("_"))
        language = C99(name) if to == "c" else Python(title)
        text = program_text(source, language)
        late = to == "c" and "delayed" in language.memories.values()
        notes = [
            f"A delay remembers {HISTORY} samples, and a delay of more calls than that is cut; "
            f"#define {name.upper()}_HISTORY before the #include gives it more room."
        ] * late
        return text, notes
    return to_simulator(to, source, name, limits)
