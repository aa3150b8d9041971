"""Where in a model something may be missing: its ports, and what each drives."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._linearise import Reading, slopes_at
from diffthrust.simulation._record import Record
from diffthrust.simulation._runge_kutta import plain_rate
from diffthrust.simulation._trajectory import equations_of


@dataclass(frozen=True)
class DrivingPort:
    """One port at which an unknown signal is tried.

    Args:
        port: the port.
        state: the state whose rate it drives, or ``None``.
        output: the measured output that it drives without a state between, or ``None``.
    """

    port: str
    state: str | None
    output: str | None

    @property
    def target(self) -> str:
        """What it drives: a state or an output."""
        return self.state or self.output or ""


def words_and_unit(model: Model, port: str) -> tuple[str, str]:
    """The signal at a port in words, and its unit, with which the description of the port ends."""
    parts = re.fullmatch(r"(.*?) *\[([^]]*)\]", model.ports[port], re.DOTALL)
    return (parts[1], parts[2]) if parts else (model.ports[port], "")


def unseen_at(model: Model, record: Record, channels: Collection[str]) -> set[str]:
    """Ports and inputs through which nothing reaches a measured channel.

    Where a state is prescribed by the log, what would drive it drives nothing.
    """
    rates, outputs = slopes_at(model, record)
    observed = [rates[n] for n in model.states if n not in record.inputs]
    observed += [outputs[n] for n in outputs if n in channels and n not in record.inputs]
    names = [(1, port) for port in model.ports]
    names += [(2, name) for name in record.inputs_for(model) if name not in model.states]
    return {name for index, name in names if all(slopes[index][name] == 0 for slopes in observed)}


def places_of(model: Model, record: Record, channels: Sequence[str]) -> tuple[DrivingPort, ...]:
    """One port for every state that a port drives, and one for every measured output that one does.

    Nothing drives a state that the log prescribes. Of several ports that drive the same, the last
    one is taken: the sum of all that acts there.
    """
    rates, outputs = slopes_at(model, record)
    places: list[DrivingPort] = []
    for state in model.states:
        if state in record.inputs:
            continue
        pushing = [p for p in model.ports if state in rates and rates[state][1][p] != 0]
        if pushing:
            # a port that drives no other state as well, if there is one: it is nearest to the state
            single = [p for p in pushing if sum(bool(r[1][p] != 0) for r in rates.values()) == 1]
            places.append(DrivingPort((single or pushing)[-1], state, None))
    taken = {place.port for place in places}
    for output in outputs:
        pushing = [p for p in model.ports if outputs[output][1][p] != 0 and p not in taken]
        if pushing and output in channels:
            places.append(DrivingPort(pushing[-1], None, output))
    return tuple(places)


def slopes_along(
    model: Model, series: Mapping[str, np.ndarray], place: DrivingPort
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of what a place drives by its state and by its port, at every sample, ``(T,)``.

    What it drives is the rate of its state; or an output, whose derivative by a state is zero.
    """
    signals = {name: jnp.asarray(value, float) for name, value in series.items()}
    state, still = signals.get(place.state or "", jnp.zeros(())), jnp.zeros_like(signals["time"])

    def driven(x: Array, push: Array) -> Array:
        s = Signals({**signals, place.state: x} if place.state else signals)
        rates, outputs = equations_of(model, s, Reading(model.effects, s, {place.port: push}))
        value = plain_rate((rates if place.state else outputs)[place.target])
        return jnp.broadcast_to(value, still.shape)

    unit, zeros = jnp.ones_like(state), jnp.zeros_like(state)
    _, by_state = jax.jvp(driven, (state, still), (unit, jnp.zeros_like(still)))
    _, by_port = jax.jvp(driven, (state, still), (zeros, jnp.ones_like(still)))
    return np.asarray(by_state if place.state else still), np.asarray(by_port)


def place_words(model: Model, port: str) -> str:
    """A port in words: its name, and what the signal there is."""
    if port in model.ports:
        return f"the port '{port}' ({words_and_unit(model, port)[0]})"
    if port in model.outputs:
        return f"the measured {port} (its sensor)"
    return f"the recorded {port}"
