"""What a workbench is opened with: a spec, a log, or a saved or present fit or diagnosis."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import short_repr
from diffthrust._support.results import Brief
from diffthrust._support.saved_file import read_saved
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.estimation._arguments import listed
from diffthrust.estimation._result import Fit
from diffthrust.logs._kinds import is_log
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.saved._load import fitted_spec, load
from diffthrust.specs._file import NAME, parse_spec, read_spec_text
from diffthrust.specs._scripts import script_file
from diffthrust.specs._spec import Spec, load_spec
from diffthrust.survey._look import look


@dataclass(frozen=True, repr=False)
class Source(Brief):
    """A model with its logs, as they were opened, and a fit or a diagnosis that exists already.

    The spec is ``None`` for objects of Python; one that was drafted from bare logs lies in a
    temporary folder. Options are arguments of `fit`.
    """

    name: str
    model: Model
    train: tuple[Log, ...]
    unseen: tuple[Log, ...] = ()
    spec: Spec | None = None
    drafted: bool = False
    fit: Fit | None = None
    diagnosis: Diagnosis | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


def opened(
    what: object,
    logs: Log | Sequence[Log] = (),
    holdout: Log | Sequence[Log] = (),
    trust: Sequence[Path | str] = (),
) -> Source:
    """Open what `explore` takes, with its arguments.

    Raises:
        InputError: it cannot be opened; it names a script outside the trusted folders; no logs.
    """
    train, unseen = listed(logs), listed(holdout, "holdout")
    if isinstance(what, str | PathLike):
        return _of_path(Path(what), trust)
    if isinstance(what, Spec):
        return _of_spec(what)
    if isinstance(what, Fit):
        count = len(what.data)
        train, unseen = train or what.logs[:count], unseen or what.logs[count:]
        source = Source(what.model.name, what.model, train, unseen, fit=what, options=what.options)
    elif isinstance(what, Diagnosis):
        source = _of_diagnosis(what)
    elif isinstance(what, Model):
        source = Source(what.name, what, train, unseen)
    else:
        raise InputError(
            f"expected a spec, a log, a fit, a diagnosis or a model, found {short_repr(what)}.",
            "Name a file, or give one of these objects.",
        )
    if not source.train:
        raise InputError(
            f"{source.name}: expected training logs, found none.",
            "Give them: explore(model, logs, holdout=...).",
        )
    return source


def _of_path(path: Path, trust: Sequence[Path | str]) -> Source:
    kind = path.suffix.lower()
    if kind == ".json":
        return _of_saved(path, trust)
    folder_of_logs = path.is_dir() and not (path / NAME).is_file()
    if kind != ".toml" and (folder_of_logs or (path.is_file() and is_log(path))):
        return _of_logs(path)
    _refuse_scripts(path / NAME if path.is_dir() else path, trust)
    return _of_spec(load_spec(path, trust=trust))


def _refuse_scripts(file: Path, trust: Sequence[Path | str]) -> None:
    """Raise `InputError` for a spec that names a script outside the trusted folders.

    Elsewhere a spec's own folder is trusted. A page that is opened to look at a log should not run
    what came with it.
    """
    for word in parse_spec(read_spec_text(file), file).words:
        script = script_file(word, file.parent)
        if script and not any(script.resolve().is_relative_to(Path(p).resolve()) for p in trust):
            raise InputError(
                f"{file}: it names the script {script.name}, which the workbench does not run.",
                f"Read it; then trust its folder: --trust {script.parent}",
            )


def _of_spec(spec: Spec) -> Source:
    train = spec.train_logs()
    options = spec.file.fit.model_dump(exclude_unset=True)
    return Source(spec.name, spec.model, train, spec.holdout_logs(), spec=spec, options=options)


def _of_logs(path: Path) -> Source:
    """Bare logs: the spec that `look` drafts, in a folder that goes with the process."""
    survey = look(path)
    if survey.model is None:
        raise InputError(
            f"{path}: no model suits its columns.", f"See what they are: diffthrust look {path}"
        )
    folder = Path(tempfile.mkdtemp(prefix="diffthrust-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    source = _of_spec(load_spec(survey.save_spec(folder / NAME)))
    named = path if path.is_file() else path.resolve()  # "." has no name of its own
    return replace(source, drafted=True, name=named.stem)


def _of_saved(path: Path, trust: Sequence[Path | str]) -> Source:
    document = read_saved(path)
    if document["kind"] == "diagnosis":
        return _of_diagnosis(load(path, trust=trust))
    named = Path((document["origin"] or {}).get("spec_file") or "")
    for place in (named, path.parent / named.name):
        if place.is_file():
            _refuse_scripts(place, trust)
    spec, fit = fitted_spec(path, trust)
    return replace(_of_spec(spec), fit=fit)


def _of_diagnosis(diagnosis: Diagnosis) -> Source:
    """The logs with which a diagnosis was compared, and what it found."""
    unseen = diagnosis.stages[0].holdout is not None
    trained = diagnosis.trained[0] if diagnosis.trained else diagnosis.before
    return Source(
        diagnosis.model.name,
        diagnosis.model,
        tuple(run.record.log for run in trained.runs),
        tuple(run.record.log for run in diagnosis.before.runs) if unseen else (),
        fit=diagnosis.stages[0].fit,
        diagnosis=diagnosis,
    )
