"""A model with its effects, traced as the four functions by which `simulate` runs it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.effects._forms import marked
from diffthrust.export._operations import Operations, traced
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Relaxing, Signal, Signals
from diffthrust.simulation._integrate import plain_rate
from diffthrust.simulation._trajectory import arriving, equations_of, read_out, starting_point

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
