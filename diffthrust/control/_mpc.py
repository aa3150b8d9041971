"""Nonlinear model predictive control of a vessel along a path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._channels import listing
from diffthrust._errors import InputError
from diffthrust._model import Model
from diffthrust._simulate import Key
from diffthrust.control._motion import AT_SEA, begin, check_vessel
from diffthrust.control._mpc_step import Frame, Numbers, Plan, solved
from diffthrust.control._path import Wanted
from diffthrust.control._reference import number

_LONGEST = 0.1
"""Seconds: the longest step with which the controller integrates its model."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MPC:
    """A vessel's inputs over a horizon such that the model follows the path, anew at each sample.

    The sum of squares of the errors of position over ``position``, and of the changes of the
    inputs from sample to sample over ``moves``, is minimized by Gauss-Newton steps with the limits
    kept exactly, beginning with the last plan one sample on. The first inputs of the plan are
    applied.

    With ``disturbance`` the accelerations that the model does not explain (wind, current) are
    estimated from its errors of one sample; without it a steady disturbance leaves a steady error,
    as in the paper.

    Args:
        model: what the controller believes: a `Vessel` with the fitted effects.
        limits: lowest and highest value of each input, in the model's units.
        moves: change of each input from one sample to the next that weighs as much as an error of
            ``position``; a fifth of the range where not given.
        rate: samples in a second [Hz].
        horizon: samples to look ahead.
        position: error of position that weighs one [m].
        disturbance: time constant [s] of the estimated accelerations, or ``None``.
        iterations: Gauss-Newton steps at most, for each sample.

    Raises:
        InputError: a model that is no vessel, an input without limits, limits without a range, a
            number that cannot be meant.

    Source: Siramdasu & Fahimi 2013, section 6 (that a predictive controller was used; the method
    is not printed there). Diehl et al. 2005, A real-time iteration scheme for nonlinear
    optimization in optimal feedback control (warm start, Gauss-Newton).

    Example:
        >>> mpc = dft.control.MPC(
        ...     model=dft.Vessel(),
        ...     limits={"propeller_speed": (0, 150), "rudder_angle": (-0.42, 0.42)},
        ... )
        >>> plan = mpc.start({"surge": 0.0, "sway": 0.0, "yaw_rate": 0.0,
        ...                   "north": 0.0, "east": 0.5, "heading": 0.0})
        >>> plan = mpc.step(plan, measured, path.at(now + mpc.ahead))
        >>> plan.inputs["rudder_angle"]
    """

    model: Model
    limits: Mapping[str, tuple[float, float]]
    moves: Mapping[str, float] = field(default_factory=dict)
    rate: float = 5.0
    horizon: int = 25
    position: float = 0.3
    disturbance: float | None = None
    iterations: int = 10

    def __post_init__(self) -> None:
        check_vessel(self.model, "MPC")
        for name in ("rate", "position"):
            number(f"MPC, {name}", getattr(self, name), lambda x: x > 0, "a number above zero")
        if self.disturbance is not None:
            number("MPC, disturbance", self.disturbance, lambda x: x > 0, "seconds, above zero")
        for name in ("horizon", "iterations"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InputError(
                    f"MPC, {name}: expected a whole number, 1 or more, found {value!r}.",
                    "Correct it.",
                )
        names = tuple(self.model.inputs)
        for what, given in (("limits", self.limits), ("moves", self.moves)):
            wrong = [n for n in given if n not in names] if isinstance(given, Mapping) else [given]
            if wrong:
                raise InputError(
                    f"MPC, {what}: the model has no input {listing(wrong)}; it has "
                    f"{listing(names)}.",
                    f'Write {what}={{"{names[0]}": ...}}.',
                )
        for name in names:
            _check_limits(name, self.limits.get(name))
        moves = {n: 0.2 * (self.limits[n][1] - self.limits[n][0]) for n in names}
        for name, value in self.moves.items():
            number(f"MPC, moves of '{name}'", value, lambda x: x > 0, "a number above zero")
        object.__setattr__(self, "moves", {**moves, **self.moves})

    @property
    def ahead(self) -> np.ndarray:
        """How far ahead of the present sample the path is to be told [s], ``(horizon,)``."""
        return np.arange(1, self.horizon + 1) / self.rate

    def start(self, measured: Mapping[str, Any], inputs: Mapping[str, float] | None = None) -> Plan:
        """What is remembered before the first sample.

        Args:
            measured: ``surge``, ``sway``, ``yaw_rate``, ``north``, ``east``, ``heading``, and
                other states where they are known.
            inputs: what was applied until now; the middle between the limits where not given.

        Raises:
            InputError: a measurement that is missing or not finite.
        """
        now = {n: 0.5 * (low + high) for n, (low, high) in self.limits.items()} | {**(inputs or {})}
        state = begin(self.model, now, self._measured(measured))
        low, high = self._range
        share = jnp.stack([jnp.asarray(now[n], float) for n in self.model.inputs])
        planned = jnp.clip(jnp.tile((share - low) / (high - low), (self.horizon, 1)), 0.0, 1.0)
        zero = jnp.zeros(())
        push = {"north": zero, "east": zero, "yaw": zero}
        held = {name: jnp.asarray(now[name], float) for name in self.model.inputs}
        return Plan(held, planned, state, push, zero, jnp.asarray(0), jnp.asarray(False))

    def step(self, plan: Plan, measured: Mapping[str, Any], wanted: Wanted) -> Plan:
        """One sample: what to apply now, and the plan behind it.

        Args:
            plan: of the sample before, or `start`.
            measured: the six states; a missing or NaN one is taken as it was expected.
            wanted: where to be at the instants `ahead` of now, ``(horizon,)`` each.

        Raises:
            InputError: a path of another length, or with numbers that are not finite.
        """
        place = np.stack([np.asarray(wanted.north, float), np.asarray(wanted.east, float)], -1)
        if place.shape != (self.horizon, 2) or not np.all(np.isfinite(place)):
            raise InputError(
                f"MPC: expected the path at {self.horizon} instants ahead, finite, found an array "
                f"{place.shape}.",
                "Give path.at(now + mpc.ahead).",
            )
        seen = {n: jnp.asarray(measured.get(n, math.nan), float) for n in AT_SEA}
        return solved(self._frame, self._numbers, plan, seen, jnp.asarray(place))

    @cached_property
    def _range(self) -> tuple[Any, Any]:
        pairs = [self.limits[name] for name in self.model.inputs]
        return jnp.asarray([p[0] for p in pairs], float), jnp.asarray([p[1] for p in pairs], float)

    @cached_property
    def _frame(self) -> Frame:
        substeps = max(1, math.ceil(1.0 / (self.rate * _LONGEST) - 1e-9))
        return Frame(Key(self.model), substeps, self.disturbance is not None)

    @cached_property
    def _numbers(self) -> Numbers:
        low, high = self._range
        moves = jnp.asarray([self.moves[name] for name in self.model.inputs], float)
        return Numbers(
            {name: jnp.asarray(p.value, float) for name, p in self.model.parameters.items()},
            low,
            high,
            moves / (high - low),
            jnp.asarray(1.0 / self.rate),
            jnp.asarray(self.position, float),
            jnp.asarray(self.disturbance or 1.0, float),
            jnp.asarray(self.iterations),
        )

    def _measured(self, measured: Mapping[str, Any]) -> dict[str, Any]:
        for name in AT_SEA:
            number(f"MPC, measured '{name}'", measured.get(name), lambda x: True, "a number")
        return {n: jnp.asarray(v, float) for n, v in measured.items() if n in self.model.all_states}


def _check_limits(name: str, pair: Any) -> None:
    try:
        low, high = (float(value) for value in pair)
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(
            f"MPC, limits: expected a lowest and a highest value of '{name}', found {pair!r}.",
            f'Write limits={{"{name}": (LOWEST, HIGHEST)}}.',
        )
