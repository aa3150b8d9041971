"""Draft a spec file: guesses become keys, doubts become comments."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os.path import commonpath, realpath, relpath
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from diffthrust.layouts._layout import RecordedLayout, listing_of
from diffthrust.survey._choice import Choice, Pick
from diffthrust.survey._suited import mass_of

_WIDTH = 96
_ROLES = {"input": " # an input", "measured": " # measured", "": ""}
_NAMED = 12
"""Columns that are not used, up to which they are named."""


def drafted(
    choice: Choice, train: Sequence[Path], holdout: Sequence[Path], folder: Path, apart: str = ""
) -> str:
    """The text of a spec file in a folder, which its paths are relative to.

    ``apart`` are sentences on files that were left out.
    """
    lines = [*_head(choice, [*train, *holdout], apart), "", *_model(choice), ""]
    if choice.craft:
        for fact in choice.craft.facts:
            lines += _comment(f"{listing_of(fact.values)}: {fact.mark}, {fact.source}")
        lines += [*_thrusters(choice.craft, choice.channels), ""]
    lines += _logs(choice, train, holdout, folder)
    for name, pick in choice.channels.items():
        if choice.craft is None or pick.role == "measured":
            lines += ["", *_channel(name, pick)]
    if parameters := [*_parameters(choice)]:
        lines += ["", "[parameters]", *parameters]
    if choice.spare:
        lines += ["", *_comment("Also in the file. Remove the # to use one:")]
        for name, pick in choice.spare.items():
            lines += ["#", *(f"# {line}" for line in _channel(name, pick))]
    used = {p.field.name for p in (*choice.timed.values(), *choice.spare.values())}
    unused = [f.name for f in choice.contents.fields if f.name and f.name not in used]
    if unused:
        more = f" and {len(unused) - _NAMED} more" if len(unused) > _NAMED else ""
        lines += ["", *_comment(f"Not used: {', '.join(unused[:_NAMED])}{more}.")]
    return "\n".join(lines) + "\n"


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


def _model(choice: Choice) -> Iterator[str]:
    if choice.model is None:
        yield '# model = "thruster" # diffthrust new --help lists the models'
        return
    yield f'model = "{choice.model}"'
    if choice.craft:
        yield f'body = "{choice.craft.body.name}"'
    if "command" in choice.channels:
        yield f"# {_of_command(choice.channels['command'], choice.model)}"
    yield "effects = [] # diffthrust effects lists them"


def _of_command(command: Pick, model: str) -> str:
    if command.meaning.quantity == "set_point":
        return "the command is the set point of a speed"
    if not command.meaning.effort:
        return 'or "dc_motor_thruster", with the currents and voltages of its motor'
    if model == "thruster":
        return 'the command drives a torque, or "speed_loop_thruster", behind a controller (ESC)'
    return 'a motor controller (ESC) holds the speed; or "thruster", where it drives a torque'


def _thrusters(layout: RecordedLayout, channels: Mapping[str, Pick]) -> Iterator[str]:
    """The thrusters of a craft."""
    picks = {name: channels[f"{name}.command"] for name in layout.thrusters}
    units = {
        n: f"pwm = {_pwm(p)}" if p.meaning.pwm else 'unit = "effort"' for n, p in picks.items()
    }
    first = next(iter(picks))
    common = len({*units.values()}) == 1
    yield "[thrusters]"
    yield 'model = "static_thruster"'
    if common:
        yield units[first]
    for name, thruster in layout.thrusters.items():
        yield f"[thrusters.{name}]"
        if name != first:
            yield f'like = "{first}"'
        yield f"at = {_numbers(thruster.place)}"
        yield f"pointing = {_numbers(thruster.pointing)}"
        if thruster.reaction is not None:
            yield f"reaction = {thruster.reaction:.6g}"
        yield f'input = "{picks[name].field.name}"'
        if not common:
            yield units[name]


def _numbers(values: Iterable[float]) -> str:
    return f"[{', '.join(f'{value:.6g}' for value in values)}]"


def _parameters(choice: Choice) -> Iterator[str]:
    """What this log cannot tell, and the strengths of a craft's thrusters."""
    if choice.craft:
        mass = mass_of(choice.craft)
        described = choice.craft.body.declared[mass]
        yield f"{mass} = {{ value = {described.value:g}, fixed = true }} # [{described.unit}]"
        for name, thruster in choice.craft.thrusters.items():
            if thruster.strength != 1.0:
                yield f'"{name}.strength" = {thruster.strength:.6g}'
    yield from (f"{name} = {{ fixed = true }}" for name in choice.held)
    if choice.model == "vessel":
        yield "lever_arm = { value = 0.5 } # [m], not in a log: measure it"


def _logs(
    choice: Choice, train: Sequence[Path], holdout: Sequence[Path], folder: Path
) -> Iterator[str]:
    yield "[logs]"
    yield f"train = {_files(train, folder)}"
    if holdout:
        unseen = "never fitted: it shows what the fit is worth"
        yield f"holdout = {_files(holdout, folder)} # {unseen}"
    else:
        yield '# holdout = ["..."] # another log, never fitted, shows what the fit is worth'
    if choice.craft:
        yield 'rate = 10 # [Hz], by means; or base = "messages": all stamps as they are'
    elif choice.contents.messages:
        yield 'base = "messages" # all stamps as they are; or a step in seconds, such as 0.1'
    elif choice.step is not None:
        yield f"time = {choice.step:g} # [s] a row"
    elif choice.time is not None:
        yield from _time(choice.time)
    elif choice.held:
        yield "time = 0.5 # [s] for which each row is held"
        yield "static = true # a table without time"
    else:
        yield "time = false # a table without time"
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


def _files(paths: Sequence[Path], folder: Path) -> str:
    names = [_toml(_as_seen(Path(realpath(path)), Path(realpath(folder)))) for path in paths]
    listed = f"[{', '.join(names)}]"
    return listed if len(listed) < 80 else "[\n" + "".join(f"    {name},\n" for name in names) + "]"


def _as_seen(path: Path, folder: Path) -> str:
    """A path relative to a folder; absolute if they share only the root."""
    # From the root up, "../../../../data/run.csv" is longer and more fragile than the absolute
    # path.
    apart = Path(commonpath((path, folder))) == Path(path.anchor)
    return path.as_posix() if apart else Path(relpath(path, folder)).as_posix()


def _time(pick: Pick) -> Iterator[str]:
    yield from _doubts(pick)
    clock = pick.field
    unit = f", unit = {_toml(pick.meaning.unit)}"
    if clock.dates:
        unit = f", dates = {_toml(clock.date_formats[0])}" if clock.date_formats else ""
    yield f"time = {{ column = {_toml(clock.name)}{unit} }}"


def _channel(name: str, pick: Pick) -> Iterator[str]:
    meaning = pick.meaning
    yield f"[channels.{name}]{_ROLES[pick.role]}"
    yield from _doubts(pick)
    yield f"column = {_toml(pick.field.name)}"
    if pick.alternatives:
        few = ", ".join(_toml(each) for each in pick.alternatives[:4])
        yield from _comment(f"or one of {few}" if len(pick.alternatives) > 1 else f"or {few}")
    if meaning.pwm is not None:
        yield f"pwm = {_pwm(pick)}"
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


def _pwm(pick: Pick) -> str:
    """Widths of pulses as a spec file has them."""
    pwm = pick.meaning.pwm
    assert pwm is not None
    reverse = "" if pwm.reverse is None else f", reverse = {pwm.reverse:g}"
    return f"{{ stop = {pwm.stop:g}, full = {pwm.full:g}{reverse} }}"


def _doubts(pick: Pick) -> Iterator[str]:
    for doubt in pick.meaning.doubts:
        yield from _comment(doubt)


def _comment(words: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(words, _WIDTH - 2, break_long_words=False)]


def _toml(value: Any) -> str:
    return tomlkit.item(value).as_string()
