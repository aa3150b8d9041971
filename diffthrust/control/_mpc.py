"""Nonlinear model predictive control of a vessel along a path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import check_known, finite, whole_number
from diffthrust.control._mpc_step import Frame, Plan, Setting, compiled_replan
from diffthrust.control._one_sample import AT_SEA, begin, check_vessel
from diffthrust.control._reference import Wanted
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import Key

_AHEAD = 5.0
"""Seconds to look ahead where no horizon is given."""
_LONGEST = 0.1
"""Seconds: the longest step with which the controller integrates its model."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MPC:
    """At each sample, the inputs over a horizon with which the model of a vessel follows the path.

    The sum of squares of the errors of position over ``position``, and of the inputs' rates of
    change over ``rates``, is minimized by Gauss-Newton steps between the limits, beginning with the
    last plan one sample on or with inputs held throughout, whichever is better. The first inputs of
    the plan are applied. Limits of inputs and of their rates always hold; those of states hold in
    the plan to a thousandth or so, and in the vessel as well as the model knows it: what is beyond
    them already is brought back.

    With ``disturbance`` the accelerations that the model does not explain (wind, current) are
    estimated from its errors of one sample; without it a steady disturbance leaves a steady error,
    as in the paper. The estimate needs the speeds to be measured.

    A path that is faster than the limits, the wind or the current let the vessel go waits for it:
    where the plan ends more than ``position`` behind and still loses ground, the wanted places are
    those of an earlier instant (`Plan.late`) and not of a point that runs away.

    The method sees no further than its horizon: from a heading a quarter turn off the path or more,
    turning may not pay within 5 s, and the vessel stays where it is. Give a longer horizon there.

    Args:
        model: what the controller believes: a `Vessel` with the fitted effects. Its wind, if it has
            one, is the constant one of its parameters.
        limits: lowest and highest value of each input, and of those states that have limits, in the
            model's units (angles in rad): ``{..., "surge": (0, 0.6), "north": (-0.5, math.inf)}``.
        slew: fastest rate of change of an input, in its unit per second, where it has one.
        rates: rate of change of each input that weighs as much as an error of ``position``, in its
            unit per second; its whole range in a second where not given.
        rate: samples in a second [Hz].
        horizon: samples to look ahead; those of 5 s where not given. Much less than the time in
            which the vessel answers, a few seconds, steers badly.
        position: error of position that weighs one [m].
        point: how far ahead of the centre of gravity the point lies that follows the path [m].
        disturbance: time constant [s] of the estimated accelerations, or ``None``.
        iterations: Gauss-Newton steps at most, for each sample.

    Raises:
        InputError: a model that is no vessel, an input without limits, limits without a range, a
            number that cannot be meant.

    Source: Siramdasu & Fahimi 2013, section 6 (that a predictive controller was used; the method
    is not printed there) and figure 1 (the control point; its place is not printed). Diehl et al.
    2005, A real-time iteration scheme for nonlinear optimization in optimal feedback control (warm
    start, Gauss-Newton).

    Example:
        >>> mpc = dft.control.MPC(
        ...     model=dft.Vessel(),
        ...     limits={"propeller_speed": (0, 150), "rudder_angle": (-0.42, 0.42)},
        ...     horizon=6,
        ... )
        >>> mpc.ahead.shape
        (6,)
    """

    model: Model
    limits: Mapping[str, tuple[float, float]]
    slew: Mapping[str, float] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)
    rate: float = 5.0
    horizon: int | None = None
    position: float = 0.3
    point: float = 0.0
    disturbance: float | None = None
    iterations: int = 10

    def __post_init__(self) -> None:
        check_vessel(self.model, "MPC")
        for name in ("rate", "position"):
            finite(f"MPC, {name}", getattr(self, name), lambda x: x > 0, "a number above zero")
        if self.disturbance is not None:
            finite("MPC, disturbance", self.disturbance, lambda x: x > 0, "seconds, above zero")
        if self.horizon is None:
            object.__setattr__(self, "horizon", max(1, round(_AHEAD * self.rate)))
        for name in ("horizon", "iterations"):
            object.__setattr__(self, name, whole_number(f"MPC, {name}", getattr(self, name)))
        finite("MPC, point", self.point, math.isfinite, "metres ahead of the centre of gravity")
        units, states = self.model.inputs, self.model.all_states
        _check_names("limits", self.limits, (*units, *states), "(LOWEST, HIGHEST)")
        limits = {n: _limit_pair(n, self.limits.get(n), unit) for n, unit in units.items()}
        more = {name: _limit_pair(name, pair, states[name], open_=True)
                for name, pair in self.limits.items() if name in states}  # fmt: skip
        # inputs first, then limited states: the step reads them in this order
        object.__setattr__(self, "limits", {**limits, **more})
        for what in ("slew", "rates"):
            _check_names(what, getattr(self, what), tuple(units), "0.5")
            for name, value in getattr(self, what).items():
                finite(f"MPC, {what} of '{name}'", value, lambda x: x > 0, "a number above zero")

    @property
    def input_limits(self) -> dict[str, tuple[float, float]]:
        """Those of ``limits`` that are of inputs.

        Example:
            >>> mpc.input_limits["propeller_speed"]
            (0.0, 150.0)
        """
        return {name: self.limits[name] for name in self.model.inputs}

    @property
    def ahead(self) -> np.ndarray:
        """How far ahead of the present sample the path is asked for [s], ``(horizon,)``.

        Example:
            >>> mpc.ahead.shape
            (4,)
        """
        return np.arange(1, self._samples + 1) / self.rate

    def start(self, measured: Mapping[str, Any], inputs: Mapping[str, float] | None = None) -> Plan:
        """What is remembered before the first sample.

        Args:
            measured: ``surge``, ``sway``, ``yaw_rate``, ``north``, ``east``, ``heading``, and
                other states where they are known.
            inputs: what was applied until now; the middle between the limits where not given.

        Raises:
            InputError: a measurement that is missing or not finite.

        Example:
            >>> plan = mpc.start(sighted)
            >>> sorted(plan.inputs)
            ['propeller_speed', 'rudder_angle']
        """
        now = {n: 0.5 * (low + high) for n, (low, high) in self.input_limits.items()}
        if inputs is not None:
            _check_names("inputs", inputs, tuple(now), "0.1")
            now |= {n: _given(f"input '{n}'", value) for n, value in inputs.items()}
        state = begin(self.model, now, self._seen(measured, complete=True))
        held = {name: jnp.asarray(now[name], float) for name in self.model.inputs}
        low, high = self._setting.low, self._setting.high
        share = (jnp.stack([*held.values()]) - low) / (high - low)
        planned = jnp.clip(jnp.tile(share, (self._samples, 1)), 0.0, 1.0)
        zero = jnp.zeros(())
        push = {"north": zero, "east": zero, "yaw": zero}
        return Plan(
            held, planned, state, push, zero, jnp.asarray(0), jnp.asarray(False), zero, zero
        )

    def step(self, plan: Plan, measured: Mapping[str, Any], wanted: Wanted) -> Plan:
        """One sample: what to apply now, and the plan behind it.

        Args:
            plan: of the sample before, or `start`.
            measured: the six states; a missing or NaN one is taken as it was expected.
            wanted: where to be at the instants `ahead` of now, less the plan's ``late``,
                ``(horizon,)`` each.

        Raises:
            InputError: a path of another length, or with numbers that are not finite.

        Example:
            >>> path = dft.control.StraightPath(0.8)
            >>> plan = mpc.step(mpc.start(sighted), sighted, path.at(mpc.ahead))
            >>> float(plan.inputs["propeller_speed"]) > 0
            True
        """
        place = jnp.asarray(self._place(wanted))
        if not isinstance(plan, Plan):
            raise InputError(
                f"MPC, step: expected the plan of the last sample, found {plan!r}.",
                "Begin with plan = mpc.start(measured).",
            )
        return compiled_replan(self._frame, self._setting, plan, self._seen(measured), place)

    @property
    def _samples(self) -> int:
        return self.horizon or 1  # `__post_init__` has made it a number

    def _place(self, wanted: Any) -> np.ndarray:
        """The places to be at over the horizon, ``(horizon, 2)``."""
        try:
            place = np.stack([np.asarray(wanted.north, float), np.asarray(wanted.east, float)], -1)
        except (AttributeError, TypeError, ValueError):
            place = np.empty((0, 2))
        if place.shape != (self._samples, 2) or not np.all(np.isfinite(place)):
            right = place.shape == (self._samples, 2)
            raise InputError(
                f"MPC: expected the path at {self._samples} instants ahead, finite, found "
                f"{'with missing numbers' if right else f'an array {place.shape}'}.",
                "Give path.at(now - plan.late + mpc.ahead).",
            )
        return place

    @cached_property
    def _frame(self) -> Frame:
        substeps = max(1, math.ceil(1.0 / (self.rate * _LONGEST) - 1e-9))
        limited = tuple(name for name in self.limits if name not in self.model.inputs)
        estimating = self.disturbance is not None
        return Frame(Key(self.model), substeps, estimating, limited, bool(self.slew))

    @cached_property
    def _setting(self) -> Setting:
        # inputs first, then limited states
        ends = np.array([*self.limits.values()], float)
        count = len(self.model.inputs)
        low, high = ends[:count].T
        # everything in shares of an input's range: a rudder in rad and a force in N weigh alike
        rates = np.array([self.rates.get(n, b - a) for n, (a, b) in self.input_limits.items()])
        fastest = np.array([self.slew.get(n, math.inf) for n in self.model.inputs])
        numbers = {
            "low": low,
            "high": high,
            "moves": rates / self.rate / (high - low),
            "reach": fastest / self.rate / (high - low),
            "least": ends[count:, 0],
            "most": ends[count:, 1],
            "period": 1.0 / self.rate,
            "position": float(self.position),
            "point": float(self.point),
            "lag": float(self.disturbance or 1.0),
        }
        return Setting(
            values={n: jnp.asarray(p.value, float) for n, p in self.model.parameters.items()},
            iterations=jnp.asarray(self.iterations),
            **{name: jnp.asarray(value) for name, value in numbers.items()},
        )

    def _seen(self, measured: Any, complete: bool = False) -> dict[str, Any]:
        """Measured states; NaN for what is missing unless all six have to be there."""
        _check_names("measured", measured, tuple(self.model.all_states), "0.0")
        values = {name: measured.get(name, math.nan) for name in AT_SEA}
        if complete:
            values |= measured
        for name, value in values.items():
            if complete:
                _given(f"measured '{name}'", value)
            try:
                values[name] = jnp.asarray(float(value))
            except (TypeError, ValueError):
                raise InputError(
                    f"MPC, measured '{name}': expected a number, found {value!r}.",
                    "Give NaN for what was not measured.",
                ) from None
        return values


def _given(what: str, value: Any) -> float:
    return finite(f"MPC, {what}", value, math.isfinite, "a number")


def _check_names(what: str, by_name: Any, names: tuple[str, ...], example: str) -> None:
    """Raise `InputError` for what is no dictionary by these names."""
    if not isinstance(by_name, Mapping):
        raise InputError(
            f"MPC, {what}: expected a dictionary by name, found {by_name!r}.",
            f'Write {{"{names[0]}": {example}, ...}}.',
        )
    for name in by_name:
        check_known(name, names, f"MPC, {what}: the model has no")


def _limit_pair(name: str, pair: Any, unit: str, *, open_: bool = False) -> tuple[float, float]:
    """Lowest and highest value of an input; of a state (``open_``) one side may be infinite."""
    try:
        low, high = (float(value) for value in pair)
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    ends = (math.isfinite(low), math.isfinite(high))
    if not (low < high and (any(ends) if open_ else all(ends))):
        raise InputError(
            f"MPC, limits: expected a lowest and a highest value of '{name}' [{unit}], found "
            f"{pair!r}.",
            f'Write limits={{"{name}": (LOWEST, HIGHEST)}}.',
        )
    if unit == "rad" and not open_ and max(-low, high) > 2.0 * math.pi:
        raise InputError(
            f"MPC, limits: expected '{name}' in rad, found {low:g} to {high:g}, more than a turn.",
            "Convert it: math.radians(24).",
        )
    return low, high
