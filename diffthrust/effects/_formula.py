"""An effect that is written as an expression of one line."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.effects._expression import Expression, valued, with_mark
from diffthrust.effects._grammar import ExpressionEffect, expression_of
from diffthrust.logs._units import si_unit
from diffthrust.models._base.component import registered
from diffthrust.models._base.made_effect import ARRIVING, described_fields, plain_description
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.signals import Signal, Signals

_POINTS = 256
_EXPONENT = {"value": 1.0, "bounds": (0.1, 4.0), "probes": (0.5, 1.0, 2.0), "transform": "linear"}
"""What an exponent is where only its unit is given."""
_FOLLOWS = re.compile(r"[^{}]*\{\w+\}[^{}]*")
"""A unit that follows a channel: which one that is, the model knows."""
_SHARE = 0.1
"""An amplitude is tried where it makes this share of what passes the port."""


@registered
class Formula(ExpressionEffect):
    """A hypothesis of one line: an expression of parameters and signals, at a port.

    Names among the keywords are parameters, every other name is a signal of the model: time,
    inputs, states, and what the model tells at the port (``model.signals_at(port)``). ``value`` is
    what arrives there: an expression that mentions it gives what leaves the port, one that does not
    is added. Allowed are numbers, ``+ - * / **``, comparisons (1 where they hold, 0 elsewhere), pi,
    and abs, sign, sqrt, exp, log, tanh, sin, cos, minimum, maximum (min, max) and
    ``where(condition, x, y)``. A power that is not whole is that of the size of its base; powers,
    roots, logarithms and quotients are finite everywhere, with their derivatives. At ports inside
    the model there is also what remembers: ``lag(x, T)`` follows x with the time constant T [s],
    settled when the log begins, ``lag(x, T, 0)`` from zero on; ``play(x, b)`` follows with a
    backlash of half the width b; and ``integral(x)`` is that since the log began.

    Args:
        port: a port of the model, or one of its channels.
        expression: the law, such as ``"-a * speed * abs(speed)**p"``.
        name: by which the model knows it; its parameters are then ``name.a``, ``name.p``.
        **parameters: each a unit ("" for a pure number), a `dft.parameter`, or a mapping of its
            fields with "unit". Where only the unit is given, a parameter without which the effect
            does nothing begins at zero and is tried at a tenth of what passes the port, and one in
            an exponent begins at 1 within 0.1 to 4. Any other needs a value.

    Null: the parameters are found without which nothing is changed; ``null`` in a mapping gives
    another.

    Raises:
        InputError: an expression that is not allowed, with a mark below the place; a parameter that
            it does not have or that needs a value; no null value.

    Example:
        >>> drag = dft.effects.Formula(
        ...     "shaft", "-a * speed * abs(speed)**p", name="drag", a="rad/s^2", p=""
        ... )
        >>> model = dft.Thruster() + drag
        >>> model.parameters["drag.p"].range_text(), model.parameters["drag.a"].null
        ('[0.1, 4]', 0.0)
    """

    name = "formula"
    main = "expression"
    options = ("name", "port", "expression")
    expression: str

    def __init__(
        self, port: str, expression: str, *, name: str = "formula", **parameters: Any
    ) -> None:
        if not isinstance(expression, str):
            raise InputError(
                f"formula: expected an expression as text, found {expression!r:.60}.",
                'Write one in quotes: "-a * speed".',
            )
        law = expression_of(expression)
        self._check_parameters(parameters, law.places, expression)
        descriptions = {
            n: plain_description(f"formula, parameter '{n}'", each)
            for n, each in parameters.items()
        }
        self._set(
            expression=expression, given=descriptions, __doc__=f"{expression} at the port '{port}'."
        )
        self._set(states={memory.state: "" for memory in law.memories})
        reads = tuple(n for n in law.places if n not in descriptions and n != ARRIVING)
        self._make(name, port, _declared(law, descriptions), reads)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        result = self._law(self._named(value, s), jnp)
        return value + result if self.adds else result

    @property
    def adds(self) -> bool:
        """Whether the expression is added to what arrives at the port, and does not read it."""
        return ARRIVING not in self._law.places

    def scaled(self, levels: Callable[[], Mapping[str, float]]) -> Formula:
        """The formula, its amplitudes without a size getting a tenth of the signal at the port."""
        described = dict(self._parameters)
        numbers = {n: getattr(self, n) for n in described}
        for name, p in self._parameters.items():
            if p.null == p.value == 0.0 and p.size is None and not p.probes:
                typical = levels()
                unit_change = _level(self, {**numbers, name: 1.0}, typical)
                size = (
                    _SHARE * typical.get(self.port, 0.0) / unit_change if unit_change > 0 else 0.0
                )
                if 0 < size < np.inf:
                    described[name] = replace(p, size=size, probes=(size, -size))
        return self._copy(_parameters=described)

    def unread(self, name: str, port: str, signals: Sequence[str]) -> InputError:
        """The error for a name that is neither parameter nor signal, with a mark below it."""
        near = nearest(name, (*signals, *self.declared), "; ")
        return with_mark(
            self.expression,
            self._law.places[name],
            f"{name!r} is no parameter of '{self.name}', and no signal at the port '{port}'{near}",
            f'Correct the name, or give a parameter\'s unit: {name}="rad/s". Signals there are '
            f"{listing(signals)}.",
        )


def _level(formula: Formula, numbers: Mapping[str, float], levels: Mapping[str, float]) -> float:
    """How much a formula adds to what arrives, for signals drawn within their levels.

    The 90th percentile of its size; zero where a level is not known.
    """
    law = formula._law
    rng = np.random.default_rng(0)
    ranges = {ARRIVING: levels.get(formula.port, 0.0), **levels}
    if any(name not in ranges for name in formula.reads):
        return 0.0
    at: dict[str, Any] = {
        n: ranges[n] * rng.uniform(-1, 1, _POINTS) for n in (ARRIVING, *formula.reads)
    }
    at |= {"time": np.abs(at["time"])} if "time" in at else {}
    at = {**at, **numbers}
    for memory in law.memories:  # an integral is as large as what it gains in a second
        with np.errstate(all="ignore"):
            followed = valued(memory.of, at.__getitem__, np)
        at[memory.state] = rng.permutation(np.broadcast_to(followed, _POINTS))
    change = np.abs(_change(law, at))
    change = change[np.isfinite(change)]
    return float(np.quantile(change, 0.9)) if change.size else 0.0


def _declared(
    law: Expression, descriptions: Mapping[str, str | Mapping[str, Any]]
) -> dict[str, Parameter]:
    """The parameters with their nulls, and with a value if only a unit was given."""
    described = {
        n: described_fields(f"formula, parameter '{n}'", each) for n, each in descriptions.items()
    }
    for name, fields in described.items():
        if not _FOLLOWS.fullmatch(str(fields["unit"])):
            si_unit(fields["unit"], where=f"formula, parameter '{name}'")
    nulls, linear = _nulls(law, described)
    full: dict[str, Parameter] = {}
    for name, fields in described.items():
        if name in nulls:
            begin = {"value": 0.0} if nulls[name] == 0 and name in linear else {}
            fields = {**begin, **fields, "null": nulls[name]}
            fields |= {"transform": "linear"} if nulls[name] == 0 else {}
        elif name in law.exponents:
            fields = {**_EXPONENT, **fields}
        if name in law.sizes:
            fields = {"bounds": (0.0, None), **fields}
        if "value" not in fields:
            raise with_mark(
                law.text,
                law.places[name],
                f"nothing says where {name!r} begins",
                f'Give it a value: {name}={{"unit": "{fields["unit"]}", "value": ...}}.',
            )
        full[name] = parameter(**fields)
    return full


def _nulls(
    law: Expression, described: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, float], list[str]]:
    """The nulls at which the formula changes nothing, and the parameters in which it is linear.

    Found by evaluation at random signals: linear parameters are tried first, and as few are taken
    as suffice.
    """
    free = [name for name, fields in described.items() if not fields.get("fixed")]
    required = {
        n: float(described[n]["null"]) for n in free if described[n].get("null") is not None
    }
    rng = np.random.default_rng(0)
    # sizes over three decades: a law that is linear at one size only is not taken for linear
    signals = {
        name: rng.normal(size=_POINTS) * 10 ** rng.uniform(-1, 2, _POINTS)
        for name in (*law.places, *(memory.state for memory in law.memories), ARRIVING)
    }
    drawn = {n: rng.uniform(0.5, 2.0) for n in described}
    drawn |= {
        n: fields["value"] for n, fields in described.items() if "value" in fields and n not in free
    }
    at = {**signals, **drawn}
    if not np.isfinite(_change(law, at)).any():
        raise InputError(
            f"formula: {law.text!r} is nowhere finite.", "Correct its numbers and exponents."
        )
    # amplitudes are linear: a * speed**p does nothing at a = 0, and p = 0 is no null
    linear = [n for n in free if _is_linear(law, at, n)]
    at |= required
    if required and _does_nothing(law, at):
        return required, linear
    for pool in (linear, free):
        zero = [name for name in pool if name not in required]
        if zero and _does_nothing(law, {**at, **dict.fromkeys(zero, 0.0)}):
            # as few nulls as suffice: in a * (speed + b * speed**2) a = 0 is enough, and b stays
            # free to start anywhere
            for name in reversed(zero):
                fewer = [n for n in zero if n != name]
                if fewer and _does_nothing(law, {**at, **dict.fromkeys(fewer, 0.0)}):
                    zero = fewer
            return {**required, **dict.fromkeys(zero, 0.0)}, linear
    zero = ", ".join(f"{n} = {v:g}" for n, v in required.items())
    raise InputError(
        f"formula: {law.text!r} changes what passes its port whatever its parameters"
        f"{f', also where {zero}' if zero else ''}.",
        "Without 'value' in it, it is added to what arrives: multiply it by an amplitude, or write "
        "what leaves: value * (1 + a), play(value, w). Or say at which value it does nothing: "
        'limit={"unit": "rad/s^2", "value": 50.0, "null": float("inf")}.',
    )


def _change(law: Expression, at: Mapping[str, Any]) -> np.ndarray:
    """What the formula adds to what arrives, at the points ``at``."""
    with np.errstate(all="ignore"):
        value = np.asarray(law(at.__getitem__, np), float)
        change = value - at[ARRIVING] if ARRIVING in law.places else value
    return np.broadcast_to(change, np.shape(at[ARRIVING]))


def _does_nothing(law: Expression, at: Mapping[str, Any]) -> bool:
    at = dict(at)
    for memory in law.memories:  # a lag with a time constant of zero equals its signal
        if (
            memory.kind == "lag"
            and memory.size is not None
            and np.all(valued(memory.size, at.get, np) == 0)
        ):
            at[memory.state] = valued(memory.of, at.get, np)
    change, size = _change(law, at), np.abs(at[ARRIVING])
    finite = np.isfinite(change)
    return bool(finite.any() and np.all(np.abs(change[finite]) <= 1e-12 * size[finite]))


def _is_linear(law: Expression, at: Mapping[str, Any], name: str) -> bool:
    at_one, at_two, at_three = (_change(law, {**at, name: k * at[name]}) for k in (1.0, 2.0, 3.0))
    with np.errstate(all="ignore"):
        # second differences vanish exactly for a linear parameter
        bend, rise = np.abs(at_one - 2 * at_two + at_three), np.abs(at_three - at_one)
    finite = np.isfinite(bend)
    return bool(finite.any() and np.all(bend[finite] <= 1e-9 * rise[finite] + 1e-300))
