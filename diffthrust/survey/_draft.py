"""Draft a spec file: guesses become keys, doubts become comments."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from os.path import commonpath, realpath, relpath
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from diffthrust.layouts._layout import listing_of
from diffthrust.survey._choice import Choice, Pick
from diffthrust.survey._crafts import craft_parameters, craft_tables, pwm_text

_WIDTH = 96
_ROLES = {"input": " # an input", "measured": " # measured", "": ""}


def drafted(
    choice: Choice, train: Sequence[Path], holdout: Sequence[Path], folder: Path, apart: str = ""
) -> str:
    """The text of a spec file in a folder, which its paths are relative to.

    ``apart`` are sentences on files that were left out.
    """
    lines = [*_head(choice, [*train, *holdout], apart), ""]
    if choice.model is None:
        lines += ['# model = "thruster" # diffthrust new --help lists the models', ""]
    else:
        lines += [*_model(choice), "effects = [] # diffthrust effects lists them", ""]
    if choice.craft:
        for fact in choice.craft.facts:
            lines += _comment(f"{listing_of(fact.values)}: {fact.mark}, {fact.source}")
        lines += [*craft_tables(choice.craft, choice.channels), ""]
    lines += _logs(choice, train, holdout, folder)
    for name, pick in choice.channels.items():
        if choice.craft is None or pick.role == "measured":
            lines += ["", *_channel(name, pick)]
    if choice.craft:
        lines += ["", "[parameters]", *craft_parameters(choice.craft)]
    if choice.held:
        lines += ["", "[parameters]", *(f"{name} = {{ fixed = true }}" for name in choice.held)]
    if choice.model == "vessel":
        lines += ["", "[parameters]", "lever_arm = { value = 0.5 } # [m], not in a log: measure it"]
    if choice.spare:
        lines += ["", *_comment("Also in the file. Remove the # to use one:")]
        for name, pick in choice.spare.items():
            lines += ["#", *(f"# {line}" if line else "#" for line in _channel(name, pick))]
    unused = _unused(choice)
    if unused:
        lines += ["", *_comment(f"Not used: {unused}.")]
    return "\n".join(lines) + "\n"


def _model(choice: Choice) -> Iterator[str]:
    yield f'model = "{choice.model}"'
    if choice.craft:
        yield f'body = "{choice.craft.body.name}"'
    command = choice.channels.get("command")
    if command is None:
        return
    if command.meaning.quantity == "set_point":
        yield "# the command is the set point of a speed"
    elif not command.meaning.effort:
        yield '# or "dc_motor_thruster", with the currents and voltages of its motor'
    elif choice.model == "thruster":
        yield '# the command drives a torque, or "speed_loop_thruster", behind a controller (ESC)'
    else:
        yield '# a motor controller (ESC) holds the speed; or "thruster", where it drives a torque'


def _head(choice: Choice, files: Sequence[Path], apart: str) -> Iterator[str]:
    names = files[0].name if len(files) == 1 else f"{files[0].name} and {len(files) - 1} more"
    yield from _comment(
        f"Drafted from {names} ({choice.contents.kind}). What is in doubt stands in comments: read "
        "them, correct the keys, and run diffthrust fit on this file."
    )
    for doubt in (*choice.doubts, apart):
        if doubt:
            yield "#"
            yield from _comment(doubt)


def _logs(
    choice: Choice, train: Sequence[Path], holdout: Sequence[Path], folder: Path
) -> Iterator[str]:
    def files(paths: Sequence[Path]) -> str:
        names = [_toml(_as_seen(Path(realpath(path)), Path(realpath(folder)))) for path in paths]
        listed = f"[{', '.join(names)}]"
        return (
            listed
            if len(listed) < 80
            else "[\n" + "".join(f"    {name},\n" for name in names) + "]"
        )

    yield "[logs]"
    yield f"train = {files(train)}"
    if holdout:
        yield f"holdout = {files(holdout)} # never fitted: it shows what the fit is worth"
    else:
        yield '# holdout = ["..."] # another log, never fitted, shows what the fit is worth'
    if choice.craft:
        yield 'rate = 10 # [Hz], by means; or base = "messages": all stamps as they are'
    elif choice.contents.messages:
        yield 'base = "messages" # all stamps as they are; or a step in seconds, such as 0.1'
    elif choice.step is not None:
        yield f"time = {choice.step:g} # [s] a row"
    elif choice.time is None:
        if choice.held:
            yield "time = 0.5 # [s] for which each row is held"
            yield "static = true # a table without time"
        else:
            yield "time = false # a table without time"
    else:
        yield from _doubts(choice.time)
        clock = choice.time.field
        unit = f", unit = {_toml(choice.time.meaning.unit)}"
        if clock.dates:
            unit = f", dates = {_toml(clock.date_formats[0])}" if clock.date_formats else ""
        yield f"time = {{ column = {_toml(clock.name)}{unit} }}"
    if choice.contents.sheet:
        yield f"sheet = {_toml(choice.contents.sheet)}"
    used = [*choice.channels.values()]
    texts = list(dict.fromkeys(p.field.text for p in used if p.field.text))
    if texts:
        yield f"missing_values = [{', '.join(map(_toml, texts))}] # these cells hold no number"
    if used and not choice.contents.messages:
        finite = np.array([np.isfinite(p.field.values) for p in used])
        driving = np.array([p.role == "input" for p in used])
        # A row for each message: of any channel, most rows hold nothing.
        if not driving.all() and finite[~driving].mean(axis=1).min() < 0.6:
            yield "# rate = 10 # [Hz] brings rows merged from messages to one rate, by means"
        # Rows without any number are dropped when the log is read, and need no interpolation.
        if (finite.any(axis=0) & ~finite[driving].all(axis=0)).any():
            yield "interpolate_inputs = true # an input has missing samples"


def _as_seen(path: Path, folder: Path) -> str:
    """A path relative to a folder; absolute if they share only the root."""
    # From the root up, "../../../../data/run.csv" is longer and more fragile than the absolute
    # path.
    apart = Path(commonpath((path, folder))) == Path(path.anchor)
    return path.as_posix() if apart else Path(relpath(path, folder)).as_posix()


def _channel(name: str, pick: Pick) -> Iterator[str]:
    yield f"[channels.{name}]{_ROLES[pick.role]}"
    yield from _doubts(pick)
    yield f"column = {_toml(pick.field.name)}"
    if pick.alternatives:
        few = ", ".join(_toml(column) for column in pick.alternatives[:4])
        yield from _comment(f"or one of {few}" if len(pick.alternatives) > 1 else f"or {few}")
    meaning = pick.meaning
    if meaning.pwm is not None:
        yield f"pwm = {pwm_text(meaning.pwm)}"
    if meaning.spec_unit:
        yield f"unit = {_toml(meaning.spec_unit)}"
        if meaning.unit == "percent":
            yield "effort = true # 100 at full drive"
    if pick.unsigned:
        yield "unsigned = true"
    if meaning.scale != 1:
        yield f"scale = {meaning.scale:.10g}"
    if meaning.offset:
        yield f"offset = {meaning.offset:.10g}"


def _doubts(pick: Pick) -> Iterator[str]:
    for doubt in pick.meaning.doubts:
        yield from _comment(doubt)


def _comment(words: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(words, _WIDTH - 2, break_long_words=False)]


def _toml(value: Any) -> str:
    return tomlkit.item(value).as_string()


def _unused(choice: Choice, limit: int = 12) -> str:
    used = {p.field.name for p in (*choice.channels.values(), *choice.spare.values())}
    used |= {choice.time.field.name} if choice.time else set()
    names = [f.name for f in choice.contents.fields if f.name and f.name not in used]
    more = len(names) - limit
    return ", ".join(names[:limit]) + (f" and {more} more" if more > 0 else "")
