"""Whether the channels that were chosen look sound, before anything is fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.logs._columns import Column
from diffthrust.logs._log import Log
from diffthrust.logs._read import read_log
from diffthrust.models._base.model import MODELS
from diffthrust.soundness._doubts import doubts
from diffthrust.survey._choice import Choice, Pick


def doubted(choice: Choice, paths: Sequence[Path]) -> Choice:
    """The choice with what `soundness.doubts` says of its channels in some files.

    A file in which they cannot be read is told as the fit will tell it. Of tables; the messages of
    a robot have clocks of their own, and a fit looks at them once a time base is chosen.
    """
    if choice.model is None or choice.time is None:
        return choice
    logs, unread = [], []
    for path in paths:
        try:
            logs.append(_log(choice, choice.time, path))
        except InputError as error:
            unread.append(f"{error.problem} Mend: {error.mend}")
    found = doubts(logs, MODELS[choice.model]())
    words = (f"{doubt.channel}: {doubt.evidence} Mend: {doubt.mend}" for doubt in found)
    return replace(choice, doubts=(*choice.doubts, *unread, *words))


def _log(choice: Choice, clock: Pick, path: Path) -> Log:
    """The chosen channels of a file."""
    columns = {name: _column(pick) for name, pick in choice.channels.items()}
    inputs = [name for name, pick in choice.channels.items() if pick.role == "input"]
    return read_log(
        path,
        time=_column(clock) if choice.step is None else choice.step,
        inputs={name: columns[name] for name in inputs},
        measured={name: column for name, column in columns.items() if name not in inputs},
        sheet=choice.contents.sheet or None,
        interpolate_inputs=True,
    )


def _column(pick: Pick) -> Column:
    """How a spec file describes the column."""
    meaning = pick.meaning
    return Column(
        pick.field.name,
        unit=meaning.spec_unit,
        unsigned=pick.unsigned,
        scale=meaning.scale,
        offset=meaning.offset,
        pwm=meaning.pwm,
        effort=meaning.unit == "percent",
    )
