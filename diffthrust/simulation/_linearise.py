"""Derivatives of a model's rates and outputs by its states, ports and inputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._record import Record
from diffthrust.simulation._runge_kutta import plain_rate
from diffthrust.simulation._trajectory import Key, equations_of


class Reading(Ports):
    """Ports that note what passes and what the model tells, and may add something to the former."""

    def __init__(
        self, effects: Any, signals: Signals, push: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(effects, signals)
        self.push = push or {}
        self.seen: dict[str, Any] = {}
        self.told: dict[str, Any] = {}

    def hears(self, part: str) -> bool:
        return True

    def tell(self, **signals: Any) -> None:
        super().tell(**signals)
        self.told |= signals

    def __call__(self, port: str, value: Any) -> Any:
        value = super().__call__(port, value)
        self.seen[port] = value
        return value + self.push[port] if port in self.push else value


def slopes_at(model: Model, record: Record) -> tuple[dict[str, Any], dict[str, Any]]:
    """Derivatives of rates and outputs by states, ports and inputs, at one point of a record.

    Returns:
        ``{rate: (by_state, by_port, by_input)}`` and the same of the outputs.
    """
    rates, outputs = jax.tree.map(np.asarray, slopes(Key(model), *point_in(model, record)))
    return rates, outputs


def point_in(model: Model, record: Record) -> tuple[dict[str, Any], ...]:
    """Values of parameters, of the states and of the inputs, away from where slopes may vanish."""
    rng = np.random.default_rng(0)
    series = {n: record.at_samples(v) for n, v in record.inputs_for(model).items()}
    # away from zero, where a slope may vanish by symmetry (the drag of a vessel at rest)
    inputs = {n: np.asarray(np.nanmean(np.abs(v)) + 0.1) for n, v in series.items()}
    # Random values, for at equal ones differences of states cancel, and a slope that exists looks
    # like zero.
    states = {n: np.asarray(rng.uniform(0.3, 0.7)) for n in model.all_states if n not in inputs}
    return {n: np.asarray(p.value, float) for n, p in model.parameters.items()}, states, inputs


@program(1, quick_compile=True)
def slopes(
    key: Key, values: Mapping[str, Any], states: dict[str, Any], inputs: dict[str, Any]
) -> tuple[Any, Any]:
    """What `slopes_at` gives, at a point of its own.

    A program, for one by one its operations took 0.4 s of a first diagnosis, of a vessel 0.6 s.
    """
    model = key.model.bind(values)

    def both(x: dict[str, Any], push: dict[str, Any], fed: dict[str, Any]) -> Any:
        s = Signals({**fed, "time": jnp.zeros(()), **x})
        rates, outputs = equations_of(model, s, Reading(model.effects, s, push))
        return tuple(
            {n: jnp.asarray(plain_rate(v), float) for n, v in series.items() if n in declared}
            for series, declared in ((rates, model.states), (outputs, model.outputs))
        )

    still = {n: jnp.zeros(()) for n in model.ports}
    return jax.jacfwd(both, argnums=(0, 1, 2))(states, still, inputs)
