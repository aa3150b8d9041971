"""Where a result comes from: when it was made, with what, and of which logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from diffthrust._support.literals import ToCopy, as_python, as_toml
from diffthrust.logs._identity import LogIdentity
from diffthrust.logs._log import Log
from diffthrust.models._base.component import file_of
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.made_effect import MadeEffect
from diffthrust.models._base.model import Model
from diffthrust.models._base.registry import catalogue

_SHORT = 8
"""Digits of a hash that people compare."""
_LISTED = 6
"""Logs that are named; of more the number is told."""


@dataclass(frozen=True)
class Origin:
    """Where a result comes from.

    Args:
        created: when it was made, in UTC, such as ``2026-11-22T16:05:00+00:00``.
        library: versions of diffthrust, and of the libraries that its numbers depend on.
        train: the logs that it was made of, in their order.
        holdout: the unseen logs that it was held against.
        spec: sha256 of the spec file without its [expected] block, where there was one.

    Example:
        >>> fit.origin.created, [log.sha256[:8] for log in fit.origin.train]
        ('2026-11-22T16:05:00+00:00', ['3f2a9c01'])
    """

    created: str
    library: Mapping[str, str]
    train: tuple[LogIdentity, ...]
    holdout: tuple[LogIdentity, ...] = ()
    spec: str | None = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """Date, versions and hashes, for the end of a report."""
        packages = ", ".join(f"{n} {v}" for n, v in self.library.items() if n != "diffthrust")
        day, _, moment = self.created.partition("T")
        made = (
            f"Made {day} {moment[:5]} UTC by diffthrust {self.library['diffthrust']} ({packages})."
        )
        logs = [f"Logs: {_listed(self.train)}"] if self.train else []
        logs += [f"unseen: {_listed(self.holdout)}"] if self.holdout else []
        spec = [f"Spec {self.spec[:_SHORT]}."] if self.spec else []
        origin = " ".join([f"{'; '.join(logs)}."] * bool(logs) + spec)
        return (made, origin) if origin else (made,)


def origin_of(logs: Sequence[Log], holdout: Sequence[Log] = (), spec: str | None = None) -> Origin:
    """The origin of a result that is made here and now."""
    return Origin(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        library=versions(),
        train=tuple(log.identity for log in logs),
        holdout=tuple(log.identity for log in holdout),
        spec=spec,
    )


def versions() -> dict[str, str]:
    """The versions of the libraries that the numbers of a result depend on."""
    import jax
    import numpy as np

    from diffthrust import __version__

    return {"diffthrust": __version__, "jax": jax.__version__, "numpy": np.__version__}


def effects_line(model: Model, more: Sequence[Effect | str] = ()) -> str:
    """The line of a spec file that names a model's effects, to copy.

    Args:
        model: the model.
        more: further effects, or words for them.

    Example:
        >>> effects_line(dft.Thruster() + "actuator_lag")
        'effects = ["actuator_lag"]'
    """
    return ToCopy(f"effects = [{', '.join(map(_word, (*model.effects, *more)))}]")


def python_line(model: Model, more: Sequence[Effect] = ()) -> str:
    """The line of Python that makes a model with its effects, to copy.

    Example:
        >>> python_line(dft.Vessel(drive="twin") + "wind")
        'model = dft.Vessel(drive="twin", command="N") + "wind"'
    """
    usual = {"command": ""} if model.own else type(model)().arguments  # one's own may need some
    chosen = {name: v for name, v in model.arguments.items() if usual.get(name) != v}
    arguments = ", ".join(f"{name}={_quoted(v)}" for name, v in chosen.items())
    made = f"{'' if model.own else 'dft.'}{type(model).__name__}({arguments})"
    every = (*model.effects, *more)
    return ToCopy(f"model = {' + '.join([made, *map(_made, every)])}")


def _made(effect: Effect) -> str:
    """An effect as code."""
    if _known(effect) and not effect.form:
        return f'"{effect.name}"'
    if isinstance(effect, MadeEffect) and not effect.own:
        arguments = ", ".join(f"{n}={as_python(v)}" for n, v in effect.arguments.items())
        return f"dft.effects.{type(effect).__name__}({arguments})"
    form = ", ".join(f"{name}={value:g}" for name, value in effect.form.items())
    return f"{'dft.effects.' if _known(effect) else ''}{type(effect).__name__}({form})"


def form_lines(effects: Sequence[Effect]) -> list[str]:
    """The lines below ``[parameters]`` of a spec file for effects that have another form."""
    return [
        f'[parameters] "{effect.name}.{name}" = {value:g}'
        for effect in effects
        for name, value in effect.form.items()
    ]


def closing(origin: Origin | None, model: Model) -> tuple[str, ...]:
    """The last lines of a report: where it comes from, and the effects, to copy."""
    effects = (effects_line(model), *form_lines(model.effects)) if model.effects else ()
    return (*(origin.sentences if origin else ()), *effects)


def same_logs(first: Sequence[LogIdentity], second: Sequence[LogIdentity]) -> bool:
    """Whether logs say the same, in the same order."""
    return [log.sha256 for log in first] == [log.sha256 for log in second]


def taken_part(origin: Origin, logs: Sequence[LogIdentity]) -> str:
    """Whether logs took part in a fit, in a sentence."""
    theirs = {log.sha256 for log in origin.train}
    shared = [log.name for log in logs if log.sha256 in theirs]
    sentence = f"The fit was made of {_listed(origin.train)}"
    if len(shared) == len(logs):
        return f"{sentence}: these logs took part in it."
    return f"{sentence}: {', '.join(shared) or 'none of these logs'} took part in it."


def _quoted(value: object) -> str:
    """A value as code; three dots for what cannot be written down."""
    if isinstance(value, str):
        return f'"{value}"'
    return repr(value) if isinstance(value, bool | int | float | tuple | None) else "..."


def _known(effect: Effect) -> bool:
    """Whether a name is enough: for the library's effects, and those of installed packages."""
    return catalogue().get(effect.name) is type(effect)


def _word(effect: Effect | str) -> str:
    if isinstance(effect, str):
        return as_toml(effect)
    if _known(effect):
        return f'"{effect.name}"'
    if isinstance(effect, MadeEffect) and not effect.own:
        return as_toml(effect.as_table())
    cls = type(effect)
    script = (file_of(cls) or "script.py").replace("\\", "/").rpartition("/")[2]
    return f'"{script}:{cls.__name__}"'


def _listed(logs: Iterable[LogIdentity]) -> str:
    marked = [f"{log.name} {log.sha256[:_SHORT]}" for log in logs]
    more = len(marked) - _LISTED
    return ", ".join(marked[:_LISTED]) + (f" and {more} more" if more > 0 else "")
