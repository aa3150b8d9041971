"""Spec files: a model, its effects and its logs in one file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from glob import glob, has_magic
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import oddity
from diffthrust._support.names import listing, nearest
from diffthrust._support.progress import ProgressOption, progressing, reporter, subtask
from diffthrust._support.results import Brief
from diffthrust.logs._columns import Column
from diffthrust.logs._kinds import is_bag, kind_of
from diffthrust.logs._log import Log
from diffthrust.logs._read import read_log
from diffthrust.logs._robots.read import read_robot_log
from diffthrust.models._base.model import Model
from diffthrust.models._craft.craft import Craft
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._record import bind
from diffthrust.specs._file import NAME, SpecText, line_of, parse_spec, parse_toml, read_spec_text
from diffthrust.specs._model import roles_of, spec_model, with_commands
from diffthrust.specs._parts import SpecFile, TimePart
from diffthrust.specs._scripts import effect_class, script_file, trusted_folders
from diffthrust.specs._thrusters import place_of

if TYPE_CHECKING:
    from diffthrust.diagnosis._result import Diagnosis
    from diffthrust.estimation._result import Fit


@dataclass(frozen=True, repr=False)
class Spec(Brief):
    """A spec file, read and checked.

    Args:
        path: the file; paths inside it are relative to its folder.
        text: text of the file.
        file: its parsed keys.
        model: the model with its effects and the parameters of the file.
        inputs: columns of the input channels.
        measured: columns of the measured channels.
        train: files of the training logs.
        holdout: files of the unseen logs.

    Example:
        >>> spec = dft.load_spec("fit.toml")
        >>> len(spec.sha256), spec.train_logs()[0].name, len(spec.holdout_logs())
        (64, 'run1.csv', 1)
        >>> spec.fit().status
        <Status.CONVERGED: 'converged'>
    """

    path: Path
    text: str = field(repr=False)
    file: SpecFile = field(repr=False)
    model: Model
    inputs: Mapping[str, Column]
    measured: Mapping[str, Column]
    train: tuple[Path, ...]
    holdout: tuple[Path, ...]

    @property
    def name(self) -> str:
        """Display name: the folder of a ``fit.toml``, or the name of the file."""
        path = self.path.resolve()
        return path.parent.name if path.name == NAME else path.stem

    @cached_property
    def sha256(self) -> str:
        """Hash of the file's content without [expected], and of its scripts.

        Comments, spaces and the order of keys do not count.
        """
        # Parsed, so that an edited comment does not make stored fits look outdated.
        tables = parse_toml(self.text, self.path)
        tables.pop("expected", None)
        scripts = [script_file(word, self.path.parent) for word in self.file.words]
        code = [sha256(script.read_bytes()).hexdigest() for script in scripts if script]
        return sha256(json.dumps([tables, code], sort_keys=True, default=str).encode()).hexdigest()

    def train_logs(self) -> tuple[Log, ...]:
        """Read the training logs."""
        return tuple(self._read(path) for path in self.train)

    def holdout_logs(self) -> tuple[Log, ...]:
        """Read the unseen logs; there may be none."""
        return tuple(self._read(path) for path in self.holdout)

    def _log_name(self, path: Path) -> str:
        """The name of the log in one of the files, as reports give it."""
        # Folders day1/ and day2/ often hold a log.csv each: reports must keep them apart.
        unique = sum(file.name == path.name for file in (*self.train, *self.holdout)) == 1
        return path.name if unique else f"{path.parent.name}/{path.name}"

    def _read(self, path: Path) -> Log:
        logs = self.file.logs
        try:
            read, more = self._reader(path)
            log = read(
                path,
                inputs=self.inputs,
                measured=self.measured,
                missing_values=[str(word) for word in logs.missing_values],
                interpolate_inputs=logs.interpolate_inputs,
                start=logs.start,
                stop=logs.stop,
                rate=logs.rate,
                name=self._log_name(path),
                **more,
            )
            self._check_units(log)
        except InputError as error:
            raise self._placed(error) from None
        return self._edited(log)

    def _edited(self, log: Log) -> Log:
        """The log with its channels moved, and without the stretches that are left out."""
        for name, channel in self.file.channels.items():
            if channel.shift:
                log = log.shifted(channel.shift, name)
        for index, stretch in enumerate(self.file.logs.leave_out):
            if stretch.log == log.name:
                with SpecText(self.text, self.path).at("logs", "leave_out", index):
                    log = log.leave_out(stretch.start, stretch.stop, stretch.note)
        return log

    def _reader(self, path: Path) -> tuple[Callable[..., Log], dict[str, Any]]:
        """The reader of a file, and the keys of ``[logs]`` that only this reader has."""
        logs = self.file.logs
        source = SpecText(self.text, self.path)
        robot = kind_of(path).messages
        foreign = ("time", "static", "sheet") if robot else ("base", "gap", "faster", "stamps")
        for key in (key for key in foreign if key in logs.model_fields_set):
            raise source.error(
                ("logs", key),
                f"{path.name} is {'a log of messages' if robot else 'a table'}, for which {key!r} "
                "has no meaning.",
                f"Remove {key}" + (", and choose a time base: base." if robot else "."),
            )
        if not robot:
            return read_log, {"time": self._clock(), "static": logs.static, "sheet": logs.sheet}
        if logs.base is None and logs.rate is None:
            raise source.error(
                ("logs", "base"),
                f"{path.name} has messages of different rates, and no time base is chosen.",
                'Write base = "messages" for all stamps, base = "speed" for those of that channel, '
                "base = 0.05 for a step, or rate = 10 for means of 10 samples a second.",
            )
        return read_robot_log, {k: getattr(logs, k) for k in ("base", "gap", "faster", "stamps")}

    def _clock(self) -> Column | float | None:
        time = self.file.logs.time
        if isinstance(time, TimePart):
            return Column(time.column, unit=time.unit, dates=time.dates)
        return time

    def _check_units(self, log: Log) -> None:
        """Raise `InputError` for a channel whose unit does not fit the model."""
        model = self.model
        units = {**model.outputs, **model.all_states, **model.optional_inputs, **model.inputs}
        for name in (*log.inputs, *log.measured):
            if name in units:
                log.values(name, units[name])

    def _placed(self, error: InputError) -> InputError:
        """Add to an error on a column or channel the line of the spec that names it."""
        place = error.place
        if place is None:
            return error
        clock = self._clock()
        where = [("time", clock.column)] if isinstance(clock, Column) else []
        where += [(name, channel.column) for name, channel in self.file.channels.items()]
        for name, column in where:
            if column == place.column or name == place.channel:
                key = "unit" if place.unit else "column"
                line = line_of(self.text, self.path, place_of(self.file, name, key))
                problem = f"{error.problem} It is named in {line}."
                return InputError(problem, error.mend, place=place)
        return error

    def fit(
        self,
        *,
        progress: ProgressOption = None,
        train: tuple[Log, ...] | None = None,
        holdout: tuple[Log, ...] | None = None,
    ) -> Fit:
        """Fit with the options of ``[fit]``.

        Args:
            progress: True for a bar, or a function of a message and the share done.
            train: the training logs, if already read.
            holdout: the unseen logs, if already read.
        """
        from diffthrust.estimation._fit import fit

        unseen = self.holdout_logs() if holdout is None else holdout
        train = self.train_logs() if train is None else train
        # Only keys that the spec states: the defaults stay those of `fit`.
        options, mark = self.file.fit.model_dump(exclude_unset=True), self.sha256
        place = str(self.path.resolve())
        result = fit(self.model, train, holdout=unseen or None, progress=progress, **options)
        assert result.origin is not None
        return replace(result, origin=replace(result.origin, spec=mark, spec_file=place))

    @progressing
    def diagnose(
        self,
        *,
        progress: ProgressOption = None,
        candidates: Sequence[str] | None = None,
        fit: Fit | None = None,
        experiment: bool = True,
    ) -> Diagnosis:
        """Fit with the options of ``[fit]``, then diagnose which physics is missing.

        Args:
            fit: a fit of this spec, as loaded from a file; made where there is none.
            progress: True for a bar, or a function of a message and the share done.
            candidates: effects to try, named as under ``effects``, and fixed constants of the
                model, by name; ``None`` for all.
            experiment: propose a test that would separate effects that these logs cannot.

        Raises:
            InputError: an effect is unknown, or the logs cannot be diagnosed.

        Example:
            >>> spec = dft.load_spec("fit.toml")
            >>> spec.diagnose(candidates=["command_deadband"]).verdict
            'adequate'
        """
        from diffthrust.diagnosis._candidates import candidates_of
        from diffthrust.diagnosis._diagnose import diagnose

        folder = self.path.parent
        wanted = candidates and [effect_class(c, folder) if ":" in c else c for c in candidates]
        train, unseen = self.train_logs(), self.holdout_logs()
        model = adopted(self.model, train)
        records = bind(model, (*train, *unseen))
        # Before the fit, which takes minutes: a wrong name of an effect is reported at once.
        candidates_of(model, records, wanted)
        report = reporter(progress)
        begun = 0.15 if fit is None else 0.0
        if fit is None:
            fit = self.fit(progress=subtask(report, 0.0, begun), train=train, holdout=unseen)
        return diagnose(
            fit,
            train,
            holdout=unseen or None,
            candidates=wanted,
            experiment=experiment,
            progress=subtask(report, begun, 1.0),
        )


def load_spec(path: Path | str, *, trust: Path | str | Iterable[Path | str] = ()) -> Spec:
    """Read a spec file and build its model; logs are read later.

    A spec can name scripts (``script.py:Class``), which are executed, like commands of a Makefile:
    load only specs that you would run.

    Args:
        path: a TOML file, or a folder that holds a ``fit.toml``.
        trust: further folders whose scripts may be run; the spec's folder is always trusted.

    Raises:
        InputError: the file, a key or a name in it cannot be used; the message names file, line
            and key, what was expected and found, and the mend. Or a script lies outside the
            trusted folders, or fails.

    Example:
        >>> spec = dft.load_spec("fit.toml")
        >>> print(spec.model)
        thruster
        >>> len(spec.train_logs())
        1
    """
    path = Path(path)
    if path.is_dir():
        path = path / NAME
    text = read_spec_text(path)
    file = parse_spec(text, path)
    source = SpecText(text, path)
    if file.model == Craft.name:
        with source.at("thrusters"):
            file = with_commands(file)
    places = trusted_folders(trust)
    model = spec_model(file, source, places)
    roles = roles_of(model, file, source)
    inputs, measured = (
        {n: channel.as_column() for n, channel in file.channels.items() if roles[n] == role}
        for role in ("input", "measured")
    )
    train = _files(file.logs.train, "train", source)
    holdout = _files(file.logs.holdout, "holdout", source)
    # Resolved: the same file by another path, or through a link, is the same log.
    both = [a.name for a in train if a.resolve() in {b.resolve() for b in holdout}]
    if both:
        raise source.error(
            ("logs", "holdout"),
            f"{listing(both)} is also a training log; an unseen log must not be one.",
            "Take it out of one of the two lists.",
        )
    spec = Spec(
        path=path,
        text=text,
        file=file,
        model=model,
        inputs=inputs,
        measured=measured,
        train=train,
        holdout=holdout,
    )
    names = [spec._log_name(file) for file in (*train, *holdout)]
    for index, stretch in enumerate(file.logs.leave_out):
        if stretch.log not in names:
            raise source.error(
                ("logs", "leave_out", index),
                f"the spec has no log {stretch.log!r}{nearest(stretch.log, names, '; ')}.",
                f"Correct the name; there are {listing(names)}.",
            )
    return spec


def _files(patterns: Iterable[str], key: str, source: SpecText) -> tuple[Path, ...]:
    folder = source.path.parent
    files: list[Path] = []
    for pattern in patterns:
        # A file may be called run[1].csv.
        if _exists(folder / pattern):
            matches = [pattern]
        elif has_magic(pattern):
            matches = sorted(glob(pattern, root_dir=folder, recursive=True))
        else:
            matches = []
        if not matches:
            names = (file.name for file in folder.iterdir() if file.is_file())
            raise source.error(
                ("logs", key),
                f"expected the file {pattern!r} in {folder.resolve()}, found none"
                f"{nearest(pattern, names, '; ')}.",
                "Correct the name; paths are relative to the spec file.",
            )
        for file in (folder / match for match in matches):
            if what := oddity(file):
                raise source.error(
                    ("logs", key),
                    f"expected a log, found {file} to be {what}.",
                    "Name the file of a log.",
                )
            files.append(file)
    return tuple(dict.fromkeys(files))


def _exists(path: Path) -> bool:
    """Whether the path is a file, a bag's folder, or a special file (reported later)."""
    try:
        return path.is_file() or is_bag(path) or oddity(path) is not None
    except OSError:  # a name that is too long
        return False
