"""Where a result comes from, and the lines that make its model again, to copy.

A line that loses what was given (a parameter that was fixed, another lever arm) makes another
model: run, it must give the same errors. So beside the class and its arguments stand all numbers
that differ from what these make.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from inspect import signature
from typing import Any

from diffthrust._support.literals import ToCopy, as_python, as_toml
from diffthrust.logs._identity import LogIdentity
from diffthrust.logs._log import Log
from diffthrust.models._base.component import FIELDS, Component, file_of
from diffthrust.models._base.effect import Effect, catalogue
from diffthrust.models._base.made_effect import MadeEffect
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Normal, Parameter

_DIGITS = 8
"""Of a number. Errors computed from it agree to more than six: about an optimum they change with
the square of a parameter's change. More are not those of the fit on another machine."""


def python_lines(model: Model) -> str:
    """The lines of Python that make a model with its effects and its numbers, to copy.

    Example:
        >>> print(python_lines(dft.Vessel(drive="twin", lever_arm=0.3).fix("d11") + "wind"))
        model = dft.Vessel(drive="twin", command="N") + "wind"
        model = model.replace({
            "d11": {"fixed": True},
            "lever_arm": 0.3,
        })
    """
    parts = (model, *model.effects)
    lines = [*_hints(parts), f"model = {' + '.join(map(code_of, parts))}"]
    fields = _differing(model)
    if fields:
        entries = [f"    {as_python(n)}: {_entry_code(entry)}," for n, entry in fields.items()]
        lines += ["model = model.replace({", *entries, "})"]
    return ToCopy("\n".join(lines))


def spec_lines(model: Model, *, estimates: bool = True) -> str:
    """The lines of a spec file that name a model's effects and give its numbers, to copy.

    Args:
        model: the model.
        estimates: whether the values of free parameters are written, where a fit begins.

    Example:
        >>> print(spec_lines(dft.Thruster(alpha=0.03).fix("ct") + "actuator_lag"))
        effects = ["actuator_lag"]
        [parameters]
        alpha = 0.03
        ct = { fixed = true }
    """
    lines = [effects_line(model.effects)]
    fields = _differing(model)
    if not estimates:
        for name, entry in fields.items():
            if not model.parameters[name].fixed:
                entry.pop("value", None)
        fields = {name: entry for name, entry in fields.items() if entry}
    if fields:
        lines.append("[parameters]")
        lines += [f"{_key(name)} = {_entry_toml(entry)}" for name, entry in fields.items()]
    return ToCopy("\n".join(lines))


def effects_line(effects: Iterable[Effect | str]) -> str:
    """The line of a spec file that names effects, to copy.

    Args:
        effects: the effects, or words for them.

    Example:
        >>> effects_line((dft.Thruster() + "actuator_lag").effects)
        'effects = ["actuator_lag"]'
    """
    return ToCopy(f"effects = [{', '.join(map(_word, effects))}]")


def code_of(component: Component) -> str:
    """A model without its effects, or an effect, as it is constructed."""
    by_name = isinstance(component, Effect) and catalogue().get(component.name) is type(component)
    if code := component.as_code(code_of):
        return code
    chosen = _chosen(component)
    if by_name and not chosen:
        return f'"{component.name}"'
    own = component.own and not by_name
    folder = type(component).__module__.split(".")[1:2]
    place = "" if own else "dft." if folder == ["models"] else f"dft.{''.join(folder)}."
    arguments = ", ".join(f"{name}={_argument(value)}" for name, value in chosen.items())
    return f"{place}{type(component).__name__}({arguments})"


def _chosen(component: Component) -> Mapping[str, Any]:
    """The arguments, besides parameters, that are not what the constructor takes by itself."""
    if isinstance(component, MadeEffect):
        accepted = signature(type(component)).parameters
        usual = {name: p.default for name, p in accepted.items()}
    else:  # a class of one's own may not be made without arguments
        usual = {"command": ""} if component.own else type(component)().arguments
    return {n: v for n, v in component.arguments.items() if n not in usual or usual[n] != v}


def _argument(value: object) -> str:
    """A value as code; three dots for what the object does not keep, or cannot be written down."""
    plain = value is None or isinstance(value, bool | int | float | str | tuple | list | Mapping)
    return as_python(_rounded(value)) if plain else "..."


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    if isinstance(value, tuple | list):
        return tuple(map(_rounded, value))
    return {k: _rounded(v) for k, v in value.items()} if isinstance(value, Mapping) else value


def _differing(model: Model) -> dict[str, dict[str, Any]]:
    """Fields of the parameters that the constructors alone would not give, by full name."""
    made = dict(_constructed(model))
    for effect in model.effects:
        made |= {f"{effect.name}.{name}": p for name, p in _constructed(effect).items()}
    fields = {}
    for name, parameter in model.parameters.items():
        pairs = {f: (getattr(parameter, f), getattr(made[name], f)) for f in FIELDS}
        changed = {f: _rounded(now) for f, (now, usual) in pairs.items() if now != usual}
        if changed:
            fields[name] = changed
    return fields


def _constructed(component: Component) -> Mapping[str, Parameter]:
    """The parameters of a component that is made by its constructor and its arguments."""
    try:
        return _made_again(component)._parameters
    except Exception:  # a constructor of the user's own, whose arguments are not kept
        return type(component).declared


def _made_again(component: Component) -> Component:
    """A component of the same arguments, and parts of theirs, with the numbers of its classes."""
    parts = {name: _made_again(part) for name, part in component.parts.items()}
    return type(component).made_of(component.arguments, parts)


def _entry_code(entry: Mapping[str, Any]) -> str:
    if set(entry) == {"value"}:
        return as_python(entry["value"])
    texts = (f"{as_python(f)}: {_field_code(v)}" for f, v in entry.items())
    return f"{{{', '.join(texts)}}}"


def _field_code(value: Any) -> str:
    if isinstance(value, Normal):
        return f"dft.models.Normal(mean={value.mean!r}, std={value.std!r})"
    return as_python(value)


def _entry_toml(entry: Mapping[str, Any]) -> str:
    if set(entry) == {"value"}:
        return as_toml(entry["value"])
    return as_toml(
        {
            field: {"mean": v.mean, "std": v.std} if isinstance(v, Normal) else v
            for field, v in entry.items()
            if v is not None
        }
    )


def _key(name: str) -> str:
    return f'"{name}"' if "." in name else name


def _hints(parts: Iterable[Component]) -> list[str]:
    """Where the user's own classes are to be found, as comments."""
    lines = []
    for cls in dict.fromkeys(type(part) for part in parts if part.own):
        if catalogue().get(cls.name) is not cls:
            lines.append(f"# {cls.__name__}: a class of your own, in {_script(cls)}")
    return lines


def _word(effect: Effect | str) -> str:
    if isinstance(effect, str):
        return as_toml(effect)
    if effect.parts or catalogue().get(effect.name) is type(effect):
        return f'"{effect.name}"'
    if isinstance(effect, MadeEffect) and not effect.own:
        return as_toml(effect.as_table())
    return f'"{_script(type(effect))}:{type(effect).__name__}"'


def _script(cls: type) -> str:
    """The name of the script that defines a class."""
    return (file_of(cls) or "script.py").replace("\\", "/").rpartition("/")[2]


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
        spec_file: its path.

    Example:
        >>> fit.origin.created, [log.sha256[:8] for log in fit.origin.train]
        ('2026-11-22T16:05:00+00:00', ['3f2a9c01'])
    """

    created: str
    library: Mapping[str, str]
    train: tuple[LogIdentity, ...]
    holdout: tuple[LogIdentity, ...] = ()
    spec: str | None = None
    spec_file: str | None = None

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


def closing(origin: Origin | None, model: Model) -> tuple[str, ...]:
    """The last lines of a report: where it comes from, and what was given, to copy."""
    lines = spec_lines(model, estimates=False)
    said = model.effects or "\n" in lines
    return (*(origin.sentences if origin else ()), *[lines] * bool(said))


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


def _listed(logs: Iterable[LogIdentity]) -> str:
    marked = [f"{log.name} {log.sha256[:_SHORT]}" for log in logs]
    more = len(marked) - _LISTED
    return ", ".join(marked[:_LISTED]) + (f" and {more} more" if more > 0 else "")
