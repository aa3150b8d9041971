"""What models and effects have in common, and one at a place of a craft."""

from __future__ import annotations

import copy
import inspect
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import jax
from jax.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, short_repr
from diffthrust._support.validation import check_known
from diffthrust.models._base.parameter import Parameter

FIELDS = ("value", "bounds", "fixed", "prior", "transform", "size", "per_log", "width")
"""What may be changed of a parameter; unit, null and words belong to its class."""


class Component:
    """An immutable thing with named parameters; the base of `Model` and `Effect`.

    Parameters are declared in the class body with `parameter` and read as plain numbers
    (``self.alpha``). Every component is a JAX pytree whose leaves are its parameter values, so it
    can be passed through ``jit``, ``vmap`` and ``grad``.

    Example:
        >>> dft.Thruster().arguments
        {'command': 'V'}
    """

    name: ClassVar[str] = ""
    library: ClassVar[dict[str, Any]]
    """The classes of this kind that are known by name; see `registered`."""
    declared: ClassVar[dict[str, Parameter]] = {}
    options: ClassVar[tuple[str, ...]] = ()
    """Names of attributes that choose the form of the equations (set in ``__init__``)."""

    _parameters: dict[str, Parameter]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        described = {k: v for k, v in vars(cls).items() if isinstance(v, Parameter)}
        # a subclass keeps the order of its parent's parameters, its own behind them: coordinates of
        # fits stay where they are
        cls.declared = {**cls.declared, **described}
        jax.tree_util.register_pytree_node(cls, _flatten, cls._unflatten)

    def __init__(self, **values: float | Parameter) -> None:
        self._set(_parameters={})
        parameters = dict(self.declared)
        for name, value in values.items():
            check_known(name, parameters, f"{type(self).__name__} has no parameter")
            parameters[name] = changed(parameters[name], value, name)
        for name, described in parameters.items():
            described.check(name)
        self._set(_parameters=parameters, **{k: p.value for k, p in parameters.items()})

    def _set(self, **attributes: Any) -> None:
        for name, value in attributes.items():
            object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(
            f"{type(self).__name__} cannot be changed; make another one: "
            f"model.replace({name}=...) or {type(self).__name__}({name}=...)."
        )

    def _copy(self, **attributes: Any) -> Self:
        copied = copy.copy(self)
        copied._set(**attributes)
        return copied

    def _present(self, name: str) -> Parameter:
        """A parameter at its present value."""
        return self._parameters[name].with_value(getattr(self, name))

    def _with_parameters(self, parameters: Mapping[str, Parameter]) -> Self:
        """A copy with these parameters, at their values."""
        values = {name: p.value for name, p in parameters.items()}
        return self._copy(_parameters=dict(parameters), **values)

    def _bound(self, values: Mapping[str, ArrayLike]) -> Self:
        """A copy whose parameters read as these (possibly traced) values."""
        return self._copy(**values)

    def _in_units(self, units: Mapping[str, str]) -> Self:
        """A copy whose parameters spell out the units that follow a channel's."""
        return self._copy(
            _parameters={name: p.in_units(units) for name, p in self._parameters.items()}
        )

    @property
    def own(self) -> bool:
        """Whether it is of a class of the user's own, which spec files do not know by name."""
        return self.library.get(type(self).name) is not type(self)

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments, besides parameters, that it was made with, as far as they are kept."""
        accepted = list(inspect.signature(type(self).__init__).parameters.values())[1:]
        named = [p.name for p in accepted if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
        return {k: getattr(self, k, _ABSENT) for k in named if k not in self.declared}

    @property
    def parts(self) -> Mapping[str, Component]:
        """The components that it is made of, by name; none by default."""
        return {}

    @classmethod
    def made_of(cls, arguments: Mapping[str, Any], parts: Mapping[str, Any]) -> Self:
        """The component that is made with some arguments and parts, besides parameters."""
        return cls(**arguments, **parts)

    def as_code(self, written: Callable[[Component], str]) -> str:
        """How a component that has parts is written in Python; empty where by its arguments."""
        return ""

    def as_plain(self) -> dict[str, Any]:
        """What it takes to make it again, as data: class, arguments, and parameters as they are.

        Raises:
            InputError: an argument of the constructor that is not kept, or cannot be written down.
        """
        cls = type(self)
        for name, value in self.arguments.items():
            if not _writable(value):
                reason = "which it does not keep" if value is _ABSENT else f"now {value!r:.60}"
                raise InputError(
                    f"{cls.__name__} is made with the argument '{name}', {reason}: it cannot be "
                    "saved.",
                    f"Keep it as self.{name}: a number, a word, or a tuple of these.",
                )
        origin = {"class": cls.__qualname__, "module": cls.__module__, "file": file_of(cls)}
        plain = {
            "name": cls.name,
            "own": origin if self.own else None,
            "arguments": self.arguments,
            "parameters": {name: self._present(name) for name in self._parameters},
        }
        parts = {name: part.as_plain() for name, part in self.parts.items()}
        return {**plain, "parts": parts} if parts else plain

    def __repr__(self) -> str:
        listed = ", ".join(f"{k}={getattr(self, k):.4g}" for k in self._parameters)
        return f"{type(self).__name__}({listed})"

    @property
    def structure(self) -> tuple[Hashable, ...]:
        """What fixes the compiled code: the class and its options, not its numbers."""
        return (type(self), *(getattr(self, name) for name in self.options))

    @classmethod
    def _unflatten(cls, description: _Described, children: Any) -> Any:
        values, effects = children
        component = description.component._bound(dict(zip(description.names, values, strict=True)))
        if effects:
            component._set(effects=effects)
        return component


C = TypeVar("C", bound=type[Component])


def registered(cls: C) -> C:
    """Make a model or an effect of the library known by its name to spec files and diagnoses.

    Example:
        >>> @registered
        ... class Cavitation(Effect): ...
    """
    cls.library[cls.name] = cls
    return cls


@dataclass(frozen=True)
class _Described:
    """A component as static data of a pytree: equal where all but the numbers is equal."""

    component: Component = field(compare=False)
    names: tuple[str, ...] = field(init=False)
    parameters: tuple[Parameter, ...] = field(init=False)
    structure: tuple[Hashable, ...] = field(init=False)

    def __post_init__(self) -> None:
        parameters = self.component._parameters
        object.__setattr__(self, "names", tuple(parameters))
        # numbers are leaves and left out: models that differ in values share one compiled program
        described = tuple(replace(p, value=0.0, width=None) for p in parameters.values())
        object.__setattr__(self, "parameters", described)
        object.__setattr__(self, "structure", self.component.structure)


def _flatten(component: Component) -> tuple[tuple[Any, ...], _Described]:
    values = tuple(getattr(component, name) for name in component._parameters)
    return (values, getattr(component, "effects", ())), _Described(component)


def changed(old: Parameter, new: float | Parameter | Mapping[str, Any], name: str) -> Parameter:
    """A parameter with a new value, a new description, or some fields replaced."""
    unit = old.in_units({}).unit or "no unit"
    if isinstance(new, Parameter):
        if new.unit not in ("", old.unit):
            raise InputError(
                f"Parameter '{name}': expected a value in {unit}, found one in {new.unit}: "
                "the unit of a parameter belongs to its model.",
                "Convert the value and leave the unit out.",
            )
        null = old.null if new.null is None else new.null
        doc = new.doc or old.doc
        return replace(new, unit=old.unit, pattern=old.pattern, doc=doc, null=null)
    if isinstance(new, Mapping):
        if "unit" in new:
            raise InputError(
                f"Parameter '{name}': expected no unit, found {new['unit']!r}: "
                "the unit of a parameter belongs to its model.",
                f"Convert the value to {unit} and leave the unit out.",
            )
        unknown = set(new) - {*FIELDS}
        if unknown:
            raise InputError(
                f"Parameter '{name}': there is no field {listing(sorted(unknown))}.",
                f"Fields are {listing(FIELDS)}.",
            )
        return replace(old, **new)
    try:
        # float("3") and float(True) would pass: a word of a spec file is an error
        if isinstance(new, bool | str):
            raise TypeError
        return old.with_value(float(new))
    except (TypeError, ValueError):
        raise InputError(
            f"Parameter '{name}': expected a number in {unit}, found {new!r}.",
            "Give the number in that unit, alone; a spec file takes numbers with the units of the "
            'logs, as in "25 us".'
            if isinstance(new, str)
            else "Give a number.",
        ) from None


def file_of(cls: type) -> str | None:
    """The script that defines a class: where its functions were written."""
    functions = (f for f in vars(cls).values() if inspect.isfunction(f))
    return next((f.__code__.co_filename for f in functions), None)


_ABSENT = object()


def _writable(value: Any) -> bool:
    if isinstance(value, tuple | Mapping):
        return all(map(_writable, value.values() if isinstance(value, Mapping) else value))
    return value is None or isinstance(value, bool | int | float | str)


_M = TypeVar("_M", bound=Component)
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Mounted(Generic[_M]):
    """A model of a thruster with the place where it pushes; made by `Model.at`.

    Axes are those of the craft: x forward, y to starboard, z down, from its origin.

    Args:
        model: the thruster, or another actuator: any model with an output ``thrust`` [N].
        place: where the force acts [m].
        pointing: direction of a positive thrust, of length one.
        reaction: torque about ``pointing`` per thrust [m], which the propeller leaves on the hull;
            positive where it turns the hull clockwise, seen along ``pointing``. ``None`` for none.

    Example:
        >>> dft.Thruster().at((-0.35, 0.28, 0), pointing=(2, 0, 0)).pointing
        (1.0, 0.0, 0.0)
    """

    model: _M
    place: Vector
    pointing: Vector = (1.0, 0.0, 0.0)
    reaction: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", _vector("place", self.place))
        pointing = _vector("pointing", self.pointing)
        length = math.hypot(*pointing)
        if length < 1e-9:
            raise InputError(
                f"at: expected a direction for pointing, found {self.pointing!r}.",
                "Say where a positive thrust pushes: (1, 0, 0) is ahead, (0, 0, 1) down.",
            )
        # + 0.0: no minus zero, which would be another structure and another program
        unit = tuple(round(each / length, 12) + 0.0 for each in pointing)
        object.__setattr__(self, "pointing", unit)


def _vector(what: str, given: Sequence[float]) -> Vector:
    """Three numbers."""
    try:
        x, y, z = (float(each) for each in given)
    except (TypeError, ValueError):
        raise InputError(
            f"at: expected three numbers for {what}, found {short_repr(given)}.",
            "Give x forward, y to starboard and z down [m]: (-0.35, 0.28, 0).",
        ) from None
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(f"at: expected finite numbers for {what}, found {given!r}.", "Correct it.")
    return x, y, z
