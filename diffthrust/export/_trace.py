"""A model with its effects, traced as elementary operations, for whatever language."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.effects._curve import spline_weights
from diffthrust.effects._forms import marked
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Relaxing, Signal, Signals
from diffthrust.simulation._integrate import plain_rate
from diffthrust.simulation._trajectory import arriving, equations_of, read_out, starting_point

MEMORY = ("delayed", "rate_limited", "lagged")
"""What effects do to recorded series, by the functions of `effects._forms` that do it."""
_WEIGHTS, _POWERS = "curve_weights", "truncated_powers"
"""The functions of `effects._curve` by which splines are worked out; a tuple stands for weights."""


class Constant(NamedTuple):
    """A number that stands in the equations."""

    value: float | bool


class Operation(NamedTuple):
    """One elementary operation."""

    name: str  # as JAX calls its primitives, or one of `MEMORY`
    operands: tuple[Any, ...]  # `Constant`, the name of what is given, the number of an earlier one
    power: int = 0  # of "integer_pow"
    truth: bool = False  # the result is true or false


@dataclass
class Operations:
    """Elementary operations in the order in which they are worked out."""

    listed: list[Operation] = field(default_factory=list)
    results: dict[str, Any] = field(default_factory=dict)  # operands by the name of the result
    called: dict[int, str] = field(default_factory=dict)  # names that the equations give, by number
    _known: dict[Operation, int] = field(default_factory=dict, repr=False)

    def add(self, operation: Operation) -> Any:
        """The operand that it gives; what has been worked out before is not repeated."""
        first, last = operation.operands[0], operation.operands[-1]
        if operation.name == "sub" and first == last:  # how equations hide a value from derivatives
            return Constant(0.0)
        if operation.name == "add" and last == Constant(0.0):
            return first
        # x != x is how isnan is traced; not every language lets a comparison with itself stand
        if operation.name == "ne" and first == last:
            operation = operation._replace(name="is_nan", operands=(first,))
        # two equal delays are two memories: each holds its own samples
        if operation not in self._known or operation.name in MEMORY:
            self._known[operation] = len(self.listed)
            self.listed.append(operation)
        return self._known[operation]

    def needed(self) -> list[int]:
        """How often each operation is read, by its number; 0 where nothing depends on it."""
        uses = [0] * len(self.listed)
        for operand in self.results.values():
            if isinstance(operand, int):
                uses[operand] += 1
        for number in reversed(range(len(self.listed))):
            if uses[number]:
                for operand in self.listed[number].operands:
                    if isinstance(operand, int):
                        uses[operand] += 1
        return uses


def traced(
    function: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    signals: Mapping[str, Any],
    where: str,
) -> Operations:
    """The operations by which a function works out its results.

    Of the examples of signals only the shapes count, and a series stands for one signal.
    """
    names = list(signals)
    closed, shape = jax.make_jaxpr(
        lambda *values: dict(function(dict(zip(names, values, strict=True)))), return_shape=True
    )(*signals.values())
    operations = Operations()
    outputs = _walk(
        operations, closed.jaxpr, [_constant(c, where) for c in closed.consts], names, where
    )
    flat = jax.tree_util.tree_flatten_with_path(shape)[0]
    operations.results = {path[0].key: out for (path, _), out in zip(flat, outputs, strict=True)}
    return operations


_CALLS = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call",
          "checkpoint", "remat", "remat2")  # fmt: skip
_SAME = ("broadcast_in_dim", "reshape", "squeeze", "expand_dims", "stop_gradient", "copy", "copy_p",
         "optimization_barrier", "reduce_precision")  # fmt: skip
_TRUTHS = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not", "xor", "is_finite")
_KNOWN = {
    *_TRUTHS, *("add", "add_any", "sub", "mul", "div", "neg", "abs", "sign", "max", "min", "clamp"),
    *("pow", "integer_pow", "square", "sqrt", "rsqrt", "cbrt", "exp", "exp2", "expm1", "log"),
    *("log1p", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "logistic", "erf", "floor", "ceil", "rem", "select_n"),
}  # fmt: skip


def _walk(
    operations: Operations, jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Any], where: str
) -> list[Any]:
    """Add a traced function's operations; what it is given and gives are operands."""
    values: dict[Any, Any] = dict(zip(jaxpr.constvars, consts, strict=True))
    values.update(zip(jaxpr.invars, arguments, strict=True))

    def read(atom: Any) -> Any:
        return _constant(atom.val, where) if hasattr(atom, "val") else values[atom]

    for eqn in jaxpr.eqns:
        name, operands = eqn.primitive.name, [read(atom) for atom in eqn.invars]
        inner = eqn.params.get("jaxpr", eqn.params.get("call_jaxpr"))
        # what acts on series is not unrolled: a language brings its own memory of that name
        if name in _CALLS and eqn.params.get("name") in MEMORY:
            results = [operations.add(Operation(eqn.params["name"], tuple(operands)))]
        # the tables of splines cannot be traced as scalars: their known numbers are written out
        # instead
        elif name in _CALLS and eqn.params.get("name") == _WEIGHTS:
            results = [_weights(operations, operands)]
        elif name in _CALLS and eqn.params.get("name") == _POWERS:
            results = [_powers(operations, *operands)]
        elif name in _CALLS and inner is not None:
            closed = hasattr(inner, "consts")
            held = [_constant(c, where) for c in inner.consts] if closed else []
            results = _walk(operations, inner.jaxpr if closed else inner, held, operands, where)
        elif name == "name":
            if isinstance(operands[0], int):
                operations.called.setdefault(operands[0], eqn.params["name"])
            results = operands
        elif name in _SAME:
            results = operands
        elif name == "convert_element_type":
            results = [_converted(operations, eqn, operands[0], where)]
        elif name in _KNOWN and not (name == "select_n" and len(operands) != 3):
            truth = eqn.outvars[0].aval.dtype.kind == "b"
            results = [
                operations.add(Operation(name, tuple(operands), int(eqn.params.get("y", 0)), truth))
            ]
        else:
            raise InputError(
                f"{where}: the operation '{name}' has no translation into other languages.",
                "Write it with sums, products, powers, jnp.where and the functions of mathematics, "
                "or leave out the effect that uses it.",
            )
        values.update(zip(eqn.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _weights(operations: Operations, coefficients: Sequence[Any]) -> tuple[Any, ...]:
    """The weight of each third power in a curve with such coefficients."""
    return tuple(
        _summed(operations, zip(map(Constant, row), coefficients, strict=True))
        for row in spline_weights(len(coefficients)).tolist()
    )


def _powers(operations: Operations, x: Any, weights: Sequence[Any]) -> Any:
    """Third powers of what ``x`` is above 0, 1, 2, ..., each times its weight, and their sum."""
    powers = []
    for k in range(len(weights)):
        above = operations.add(Operation("sub", (x, Constant(float(k)))))
        above = operations.add(Operation("max", (above, Constant(0.0))))
        powers.append(operations.add(Operation("integer_pow", (above,), 3)))
    return _summed(operations, zip(weights, powers, strict=True))


def _summed(operations: Operations, pairs: Iterable[tuple[Any, Any]]) -> Any:
    """The sum of products."""
    terms = [operations.add(Operation("mul", pair)) for pair in pairs]
    return reduce(lambda total, term: operations.add(Operation("add", (total, term))), terms)


def _converted(operations: Operations, eqn: Any, operand: Any, where: str) -> Any:
    """An operand in another type: numbers stay what they are, truths become one or zero."""
    old, new = eqn.invars[0].aval.dtype, eqn.params["new_dtype"]
    if isinstance(operand, Constant):
        value = np.asarray(operand.value).astype(new)
        return Constant(bool(value) if new.kind == "b" else float(value))
    if old == new or (old.kind in "iu" and new == np.float64):
        return operand
    if old.kind == "b" and new.kind in "fiu":
        return operations.add(Operation("select_n", (operand, Constant(0.0), Constant(1.0))))
    if new.kind == "b":
        return operations.add(Operation("ne", (operand, Constant(0.0)), truth=True))
    raise InputError(
        f"{where}: numbers of the type {new} have no translation into other languages.",
        "Keep to floating-point numbers of double precision.",
    )


def _constant(value: Any, where: str) -> Constant:
    array = np.asarray(value)
    if array.size != 1:
        raise InputError(
            f"{where}: a table of {array.size} numbers has no translation into other languages.",
            "Write the law as a formula.",
        )
    return Constant(bool(array.item()) if array.dtype.kind == "b" else float(array.item()))


_SAMPLES = 3
"""How long the example series are by which effects on whole series are traced."""


class _Naming(Ports):
    """Ports that leave the name of each port, and of each effect there, in what is traced."""

    def __call__(self, port: str, value: Signal) -> Signal:
        return super().__call__(port, checkpoint_name(value, port))

    def _through(self, effect: Effect, port: str, value: Signal) -> Signal:
        name = effect.name.removeprefix(f"{port}_")
        return checkpoint_name(super()._through(effect, port, value), f"{port} after {name}")

    def tell(self, **signals: Signal | float) -> None:
        super().tell(**{name: checkpoint_name(value, name) for name, value in signals.items()})


def read_inputs(model: Model, signals: Mapping[str, Any]) -> dict[str, str]:
    """The inputs that a model and its effects read, of those that the logs have; with units."""
    possible = {**model.inputs, **model.optional_inputs, **model.states}
    possible |= {name: "" for effect in model.effects for name in effect.needs} | possible
    needs = [name for effect in model.effects for name in effect.needs]
    names = list(signals) or list(dict.fromkeys([*model.inputs, *needs]))
    unknown = [name for name in names if name not in possible]
    if unknown:
        raise InputError(
            f"The model '{model}' does not read {listing(unknown)}; it reads {listing(possible)}.",
            "Correct the names of the inputs.",
        )
    return {name: unit for name, unit in possible.items() if name in names}


def traced_model(
    model: Model, inputs: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, Operations]]:
    """What a model that reads the given inputs does at each sample and within a step.

    The states that it integrates, name to unit, and its functions by elementary operations:
    "arrive" from the recorded inputs to those that reach the model; "start" from the first inputs
    and the states as given ("given speed") to all states; "rates" from states and inputs to the
    rate of each state, "decays" to the decay of each that relaxes, and "read" to what the sensors
    report.
    """
    where = f"The model '{model}'"
    states = {name: unit for name, unit in model.all_states.items() if name not in inputs}
    values = {name: np.float64(p.value) for name, p in model.parameters.items()}
    example = {**values, "time": 0.5, **dict.fromkeys((*inputs, *states), np.float64(0.5))}
    many = {
        name: value if name in values else np.linspace(0.5, 1.0, _SAMPLES)
        for name, value in example.items()
    }

    def signals(by_name: Mapping[str, Any], *kinds: Mapping[str, str]) -> dict[str, Any]:
        return {"time": by_name["time"], **{n: by_name[n] for kind in kinds for n in kind}}

    def arrive(signals_in: Mapping[str, Any]) -> Mapping[str, Any]:
        return arriving(model.bind(signals_in), signals_in["time"], signals(signals_in, inputs, {}))

    def start(signals_in: Mapping[str, Any]) -> Mapping[str, Any]:
        first = Signals(signals(signals_in, inputs))
        bound = model.bind(signals_in)
        initial = bound.initial(first) if any(n in model.states for n in states) else {}
        # NaN stands for "not given": the exported reset takes it where a caller leaves a state open
        chosen = {
            name: jnp.where(jnp.isnan(signals_in[name]), initial.get(name, 0.0), signals_in[name])
            for name in model.states
            if name in states
        }
        every = starting_point(bound, first, chosen)
        return {
            name: value
            if name in model.states
            else jnp.where(jnp.isnan(signals_in[name]), value, signals_in[name])
            for name, value in every.items()
        }

    def slopes(signals_in: Mapping[str, Any]) -> dict[str, Any]:
        bound, s = model.bind(signals_in), Signals(signals(signals_in, inputs, states))
        port = _Naming(bound.effects, s)
        own_rates, _ = equations_of(bound, s, port)
        return {name: {**own_rates, **port.rates}[name] for name in states}

    def rates(signals_in: Mapping[str, Any]) -> Mapping[str, Any]:
        return {name: plain_rate(k) for name, k in slopes(signals_in).items()}

    def decays(signals_in: Mapping[str, Any]) -> Mapping[str, Any]:
        return {n: k.decay for n, k in slopes(signals_in).items() if isinstance(k, Relaxing)}

    def read(signals_in: Mapping[str, Any]) -> Mapping[str, Any]:
        return read_out(model.bind(signals_in), Signals(signals(signals_in, inputs, states)))

    with marked():
        functions = {
            function.__name__: traced(function, examples, where)
            for function, examples in (
                (arrive, many),
                (start, example),
                (rates, example),
                (decays, example),
                (read, many),
            )
        }
    return states, functions
