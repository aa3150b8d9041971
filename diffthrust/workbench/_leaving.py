"""What a session leaves behind: a spec file, a fit, a report with figures, and a script."""

from __future__ import annotations

import os
from base64 import b64decode
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import tomlkit

from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.files import made_folder, write_whole
from diffthrust._support.literals import as_python
from diffthrust._support.page import image
from diffthrust.checks._check import run_again
from diffthrust.comparison._page import comparisons_of, write_comparison_page
from diffthrust.estimation._origin import code_of, effects_line, python_lines
from diffthrust.specs._file import NAME, parse_spec
from diffthrust.specs._scripts import script_file
from diffthrust.specs._spec import Spec, load_spec
from diffthrust.workbench._session import Session

_FIRST = "# Saved by the workbench of diffthrust: diffthrust explore opens it again."
"""The first line of a spec that may be overwritten: nobody has written it by hand."""
_ELSEWHERE = "Name another folder."


def spec_text(session: Session, folder: Path) -> str:
    """The spec with what was added, left out and shifted; comments and all else stay.

    Its paths are relative to the folder, where it will lie.

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
            logs[key] = [_relative(file, folder) for file in files]
    _set_left_out(logs, (*spec.file.logs.leave_out, *setup.left_out))
    written = parse_spec(spec.text, spec.path).channels
    for name, seconds in setup.shifts.items():
        channel = spec.file.channels[name]
        # the column of a thruster's command may stand with the thruster
        whole = {} if name in written else channel.model_dump(exclude_defaults=True)
        shift = {"shift": channel.shift + seconds}
        _set(document, "channels", name, "column", {**whole, **shift})
    kept = zip(spec.model.effects, document.get("effects", []), strict=True)
    entries: dict[str, Any] = {effect.name: entry for effect, entry in kept}
    laws = tomlkit.parse(effects_line(session.laws.values()))["effects"]
    entries |= dict(zip(session.laws, laws, strict=True))
    added = [name for name in setup.effects if name not in _freed(session)]
    words = [entries.get(name, name) for name in added]
    home = spec.path.parent
    document["model"] = _word(document["model"], home, folder)
    document["effects"] = [_word(w, home, folder) if isinstance(w, str) else w for w in words]
    _set_parameters(document, session)
    return f"{_FIRST}\n\n{tomlkit.dumps(document)}"


def _relative(file: Path, folder: Path) -> str:
    return Path(os.path.relpath(file.resolve(), folder)).as_posix()


def _word(word: str, home: Path, folder: Path) -> str:
    """The word of a model or an effect; the path of a script as it is seen from the folder."""
    script_of = script_file(word, home)
    return f"{_relative(script_of, folder)}:{word.rpartition(':')[2]}" if script_of else word


def _set_left_out(logs: Any, stretches: Iterable[Any]) -> None:
    logs.pop("leave_out", None)
    lines = tomlkit.array()
    for stretch in stretches:
        entry = tomlkit.inline_table()
        entry.update({key: value for key, value in vars(stretch).items() if value != ""})
        lines.append(entry)
    if lines:
        logs["leave_out"] = lines.multiline(True)


def _set_parameters(document: Any, session: Session) -> None:
    """Drop those of effects that are gone; write what is estimated, and where a fit begins."""
    gone = {*session.opened} - {*session.setup.effects}
    for name in list(document.get("parameters", {})):
        if name.partition(".")[0] in gone:
            del document["parameters"][name]
    fields: dict[str, dict[str, float | bool]] = {n: {"fixed": False} for n in _freed(session)}
    for name, value in _moved(session).items():
        fields[name] = {**fields.get(name, {}), "value": value}
    if fields:
        document.setdefault("parameters", tomlkit.table())
    for name, new in fields.items():
        _set(document, "parameters", name, "value", new)


def _set(
    document: Any, kind: str, name: str, alone: str, fields: Mapping[str, float | bool]
) -> None:
    """Set fields of a channel or a parameter, which may be one field ``alone``: speed = "rpm".

    The table is fetched anew for each: of one with dotted keys, or in several places of the file,
    tomlkit gives a copy, and what is set in a copy after the first assignment is lost.
    """
    table = document[kind]
    effect, dot, of_effect = name.partition(".")
    if dot and effect in table:  # in the table of its effect
        table, name = table[effect], of_effect
    entry = table.get(name)
    if isinstance(entry, Mapping):
        cast(Any, entry).update(fields)
    else:
        whole = tomlkit.inline_table()
        if entry is not None:
            whole.trivia.comment = entry.trivia.comment
            whole[alone] = entry
        whole.update(fields)
        table[name] = whole[alone] if set(whole) == {alone} else whole


def _freed(session: Session) -> list[str]:
    """The constants that are estimated now."""
    return [name for name in session.setup.effects if name in session.constants]


def _moved(session: Session) -> dict[str, float]:
    """The values that sliders were moved to, of parameters that the model has.

    To eight digits: a slider gives 0.12000000000000001 where a reader expects 0.12.
    """
    has = session.task.model.parameters if session.setup.moved else ()
    return {n: float(f"{v:.8g}") for n, v in session.setup.values.items() if n in has}


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
    for name, logs in (("train", session.source.train), ("unseen", session.source.unseen)):
        for index, log in enumerate(logs):
            edits = (f".{do}({', '.join(map(as_python, of))})" for do, of in task.edits(log))
            if code := "".join(edits):
                lines.append(f"{name}[{index}] = {name}[{index}]{code}")
    options = "".join(f", {k}={as_python(v)}" for k, v in session.source.options.items())
    lines += ["", f"fit = dft.fit(model, train, holdout=unseen{options})"]
    lines += ["print(fit.report())", "print(dft.compare(fit, unseen or train).report())", ""]
    return "\n".join(lines)


def _model_code(session: Session) -> list[str]:
    setup, free = session.setup, _freed(session)
    terms = [f" - {as_python(name)}" for name in session.opened if name not in setup.effects]
    added = (name for name in setup.effects if name not in (*session.opened, *free))
    terms += [f" + {code_of(session.effects[name])}" for name in added]
    lines = [f"model = spec.model{''.join(terms)}"]
    if free:
        lines.append(f"model = model.free({', '.join(map(as_python, free))})")
    if setup.moved:
        lines.append(f"model = model.replace({as_python(_moved(session))})")
    return lines


def save(session: Session, folder: Path) -> tuple[Path, ...]:
    """Write spec, fit, report, figure and script into a folder, all of them or none.

    The spec gets its [expected] block, so that ``diffthrust check`` accepts it as it is.

    Raises:
        InputError: there is no fit, a spec lies there that somebody has written, or a file cannot
            be written.
    """
    if session.fit is None:
        raise InputError("The present model is not fitted.", "Fit it, then save.")
    folder = made_folder(folder, _ELSEWHERE).resolve()
    _check_own(folder / NAME)
    # Renamed once all are whole: a save that is killed would leave the spec of one model beside the
    # fit of another.
    refusal = os_errors_as(f"{folder}: cannot be written to", _ELSEWHERE)
    with refusal, TemporaryDirectory(prefix=".saving-", dir=folder) as place:
        made = _written(session, Path(place), folder)
        for path in made:
            os.replace(path, folder / path.name)
    return tuple(folder / path.name for path in made)


def _check_own(path: Path) -> None:
    if path.exists() and not path.read_text("utf-8", errors="replace").startswith(_FIRST):
        raise InputError(
            f"{path}: expected none, or one that the workbench has saved; nothing that somebody "
            "has written is overwritten.",
            _ELSEWHERE,
        )


def _written(session: Session, place: Path, folder: Path) -> list[Path]:
    """Write the files in a place of their own; the fit says that its spec is in the folder."""
    task, fit, spec, text = session.task, session.fit, session.source.spec, ""
    assert fit is not None
    paths = [place / name for name in ("fit.json", "report.html", "script.py", "errors.png")]
    fit_file, report, lines, picture = paths
    if spec is not None:
        paths.append(place / NAME)
        saved = _with_expected(session, folder / f"{place.name}.toml", spec.path.parent)
        write_whole(place / NAME, saved.text.encode())
        assert fit.origin is not None
        origin = replace(fit.origin, spec=saved.sha256, spec_file=str(folder / NAME))
        fit, text = replace(fit, origin=origin), saved.text
    fit.save(fit_file)
    write_whole(lines, script(session).encode())
    if session.diagnosis is not None:
        paths.append(place / "diagnosis.html")
        session.diagnosis.save(paths[-1], spec=text)
    comparisons = comparisons_of(fit, task.train, task.unseen)
    title = session.source.name
    write_comparison_page(report, title=title, spec=text, comparisons=comparisons, fit=fit)
    write_whole(picture, b64decode(image(list(comparisons.values())[-1].plot)))
    return paths


def _with_expected(session: Session, draft: Path, home: Path) -> Spec:
    """The spec with its [expected] block, by a draft in its folder, from which its paths lead."""
    trust = [str(home.resolve())]
    try:
        write_whole(draft, spec_text(session, draft.parent).encode())
        run_again(session.source.name, draft, update=True, trust=trust)
        return load_spec(draft, trust=trust)
    finally:
        draft.unlink(missing_ok=True)
