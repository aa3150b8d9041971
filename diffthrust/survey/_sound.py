"""Whether the channels that were chosen look sound, before anything is fitted to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._columns import Column, fields_of_columns
from diffthrust.logs._log import Log
from diffthrust.models._base.model import MODELS
from diffthrust.soundness._doubts import doubts
from diffthrust.survey._choice import Choice, Pick


def doubted(choice: Choice) -> Choice:
    """The choice with what `soundness.doubts` says of its channels.

    Of a table; the messages of a robot have clocks of their own, and a fit looks at them once a
    time base is chosen.
    """
    clock = choice.seconds
    if choice.model is None or clock is None:
        return choice
    try:
        found = doubts(_log(choice, clock), MODELS[choice.model]())
    except InputError:  # what cannot be read so is told by the fit, with line and mend
        return choice
    words = (f"{doubt.channel}: {doubt.evidence} Mend: {doubt.mend}" for doubt in found)
    return replace(choice, doubts=(*choice.doubts, *words))


def _log(choice: Choice, clock: np.ndarray) -> Log:
    """The chosen channels as a log."""
    columns = {name: _column(pick) for name, pick in choice.channels.items()}
    inputs = [name for name, pick in choice.channels.items() if pick.role == "input"]
    name = choice.contents.path.name
    seen = np.isfinite(clock)
    fields = fields_of_columns(
        columns,
        inputs,
        [channel for channel in columns if channel not in inputs],
        time=clock[seen],
        values={c: pick.field.values[seen] for c, pick in choice.channels.items()},
        name=name,
        interpolate_inputs=True,
        notes=(),
        at=lambda channel, index: Place(f"{name}, channel {channel!r}", channel=channel),
    )
    return Log.of_checked(fields)


def _column(pick: Pick) -> Column:
    """How a spec file describes the column."""
    meaning = pick.meaning
    return Column(
        pick.field.name,
        unit="" if meaning.pwm is not None else meaning.unit,
        unsigned=pick.unsigned,
        scale=meaning.scale,
        offset=meaning.offset,
        pwm=meaning.pwm,
        effort=meaning.unit == "percent",
    )
