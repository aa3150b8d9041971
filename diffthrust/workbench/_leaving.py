"""What a session leaves behind: a spec file, a fit, a report with figures, and a script."""

from __future__ import annotations

import json
import os
from base64 import b64decode
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit

from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust._support.literals import as_python
from diffthrust._support.page import image
from diffthrust.checks._check import check
from diffthrust.comparison._page import comparisons_of, write_comparison_page
from diffthrust.estimation._model_lines import python_lines
from diffthrust.specs._file import NAME
from diffthrust.specs._spec import load_spec
from diffthrust.workbench._session import Session, Task

_FIRST = "# Saved by the workbench of diffthrust: diffthrust explore opens it again."
"""The first line of a spec that may be overwritten: nobody has written it by hand."""


def spec_text(session: Session, folder: Path) -> str:
    """The spec with what was added, left out and shifted; comments and all else stay.

    Args:
        session: of a spec file.
        folder: where it will lie: paths are relative to it.

    Raises:
        InputError: the session is not of a spec.
    """
    spec, setup = session.source.spec, session.setup
    if spec is None:
        raise InputError(
            f"{session.source.name} was not opened from a spec file, which names the logs.",
            "Copy the script instead, or open the workbench with a spec.",
        )
    document: Any = tomlkit.parse(spec.text.removeprefix("\ufeff").removeprefix(_FIRST).lstrip())
    document.pop("expected", None)
    logs = document["logs"]
    for key, files in (("train", spec.train), ("holdout", spec.holdout)):
        if files:
            logs[key] = [Path(os.path.relpath(file.resolve(), folder)).as_posix() for file in files]
    _set_list(logs, "leave_out", [dict(vars(stretch)) for stretch in _stretches(session)])
    for name, seconds in _shifts(session).items():
        channel = document["channels"][name]
        if not isinstance(channel, Mapping):  # channels.speed = "rpm" names the column alone
            document["channels"][name] = {"column": channel}
        document["channels"][name]["shift"] = seconds
    kept = zip(spec.model.effects, document.get("effects", []), strict=True)
    entries = {effect.name: entry for effect, entry in kept}
    document["effects"] = [entries.get(name, name) for name in setup.effects]
    _set_parameters(document, session)
    return f"{_FIRST}\n\n{tomlkit.dumps(document)}"


def _stretches(session: Session) -> list[Any]:
    spec = session.source.spec
    return [*(spec.file.logs.leave_out if spec else ()), *session.setup.left_out]


def _shifts(session: Session) -> dict[str, float]:
    """By channel, with those that the spec has already."""
    spec, channels = session.source.spec, {}
    for name, seconds in session.setup.shifts.items():
        already = spec.file.channels[name].shift if spec else 0.0
        channels[name] = already + seconds
    return channels


def _set_list(table: Any, key: str, entries: list[dict[str, Any]]) -> None:
    table.pop(key, None)
    if entries:
        lines = tomlkit.array()
        for entry in entries:
            inline = tomlkit.inline_table()
            inline.update({k: v for k, v in entry.items() if v != ""})
            lines.append(inline)
        table[key] = lines.multiline(True)


def _set_parameters(document: Any, session: Session) -> None:
    """Drop those of effects that are gone; sliders that were moved say where a fit begins."""
    parameters = document.get("parameters", {})
    gone = {effect.name for effect in session.source.model.effects} - {*session.setup.effects}
    for name in list(parameters):
        if name in gone or name.partition(".")[0] in gone:
            del parameters[name]
    if session.setup.moved:
        has = session.task.model.parameters
        moved = {n: float(f"{v:.8g}") for n, v in session.setup.values.items() if n in has}
        document.setdefault("parameters", tomlkit.table())
        for name, value in moved.items():
            effect, dot, of_effect = name.partition(".")
            table, key = document["parameters"], name
            if dot and effect in table:
                table, key = table[effect], of_effect
            if isinstance(table.get(key), Mapping):
                table[key]["value"] = value
            else:
                table[key] = value


def script(session: Session) -> str:
    """The lines of Python that do what was done on the page."""
    spec, task = session.source.spec, session.task
    lines = ["import diffthrust as dft", ""]
    if spec is None:
        lines += ["# train, unseen: the logs with which the workbench was opened"]
        lines += [python_lines(task.model)]
    else:
        place = as_python(str(spec.path))
        lines += [f"spec = dft.load_spec({place})", "train = list(spec.train_logs())"]
        lines += ["unseen = list(spec.holdout_logs())", *_model_code(session)]
    edits = [_edit_code(task, index) for index in range(len(task.logs))]
    lines += [edit for edit in edits if edit]
    options = "".join(f", {k}={_code(v)}" for k, v in session.source.options.items())
    lines += ["", f"fit = dft.fit(model, train, holdout=unseen{options})"]
    lines += ["print(fit.report())", "print(dft.compare(fit, unseen or train).report())", ""]
    return "\n".join(lines)


def _code(value: Any) -> str:
    return json.dumps(value) if isinstance(value, str) else as_python(value)


def _model_code(session: Session) -> list[str]:
    source, setup = session.source, session.setup
    had = [effect.name for effect in source.model.effects]
    terms = [f" - {as_python(name)}" for name in had if name not in setup.effects]
    terms += [f" + {as_python(name)}" for name in setup.effects if name not in had]
    lines = [f"model = spec.model{''.join(terms)}"]
    if setup.moved:
        has = session.task.model.parameters
        values = {n: float(f"{v:.8g}") for n, v in setup.values.items() if n in has}
        lines.append(f"model = model.replace({as_python(values)})")
    return lines


def _edit_code(task: Task, index: int) -> str:
    """The line that shifts one log and leaves stretches of it out; empty if nothing was done."""
    log, count, calls = task.logs[index], len(task.train), ""
    by_seconds: dict[float, list[str]] = {}
    for channel, seconds in task.setup.shifts.items():
        if channel in log.inputs or channel in log.measured:
            by_seconds.setdefault(seconds, []).append(channel)
    for seconds, channels in by_seconds.items():
        calls += f".shifted({seconds!r}, {', '.join(map(as_python, channels))})"
    for stretch in task.setup.left_out:
        if stretch.log == log.name:
            note = f", {as_python(stretch.note)}" if stretch.note else ""
            calls += f".leave_out({stretch.start!r}, {stretch.stop!r}{note})"
    name = f"train[{index}]" if index < count else f"unseen[{index - count}]"
    return f"{name} = {name}{calls}" if calls else ""


def save(session: Session, folder: Path) -> tuple[Path, ...]:
    """Write spec, fit, report, figure and script into a folder, each whole or not at all.

    The spec gets its [expected] block, so that ``diffthrust check`` accepts it as it is.

    Args:
        session: fitted, or with a fit of its present model.
        folder: made if it is not there.

    Returns:
        The files.

    Raises:
        InputError: there is no fit, a spec lies there that somebody has written, or a file cannot
            be written.
    """
    task, fit = session.task, session.fit
    if fit is None:
        raise InputError("The present model is not fitted.", "Fit it, then save.")
    made_folder(folder, "Name another folder.")
    files = {name: folder / name for name in ("fit.json", "report.html", "script.py")}
    if session.source.spec is not None:
        files[NAME] = _save_spec(session, folder)
        spec, place = load_spec(files[NAME], trust=[session.source.spec.path.parent]), files[NAME]
        assert fit.origin is not None
        origin = replace(fit.origin, spec=spec.sha256, spec_file=str(place.resolve()))
        fit = replace(fit, origin=origin)
    fit.save(files["fit.json"])
    write_whole(files["script.py"], script(session).encode())
    text = files[NAME].read_text("utf-8") if NAME in files else ""
    if session.diagnosis is not None:
        session.diagnosis.save(folder / "diagnosis.html", spec=text)
        files["diagnosis"] = folder / "diagnosis.html"
    comparisons = comparisons_of(fit, task.train, task.unseen)
    title = session.source.name
    write_comparison_page(
        files["report.html"], title=title, spec=text, comparisons=comparisons, fit=fit
    )
    files["errors.png"] = folder / "errors.png"
    picture = b64decode(image(list(comparisons.values())[-1].plot))
    write_whole(files["errors.png"], picture)
    return tuple(files.values())


def _save_spec(session: Session, folder: Path) -> Path:
    path = folder / NAME
    if path.exists() and not path.read_text("utf-8", errors="replace").startswith(_FIRST):
        raise InputError(
            f"{path}: expected none, or one that the workbench has saved; nothing that somebody "
            "has written is overwritten.",
            "Name another folder.",
        )
    write_whole(path, spec_text(session, folder.resolve()).encode())
    check(folder, update=True, jobs=1)
    return path
