"""Derived quantities with intervals, from common draws of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.files import plain
from diffthrust._support.names import listing
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust._support.validation import finite_row
from diffthrust.logs._written import ShownUnits
from diffthrust.uncertainty._prediction.band import DerivedQuantity, summarised
from diffthrust.uncertainty._prediction.draws import Draws, draws_of
from diffthrust.uncertainty._prediction.physical import (
    check_sizes,
    duct_quantities,
    physical_units,
    torque_driven,
)
from diffthrust.uncertainty._prediction.responses import responses
from diffthrust.uncertainty._tables import quantities_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Quantities(Result, Mapping[str, DerivedQuantity]):
    """Derived quantities by name, all from the same draws.

    Args:
        by_name: the quantities.
        level: probability of the intervals: equal tails, point by point.
        kind: "posterior" or "covariance": source of the draws.
        notes: remarks for the user.

    Example:
        >>> result = dft.uncertainty.quantities(fit, pitch=0.101, area=0.0527)
        >>> sorted(result.by_name)[:2], list(result.to_json())
        (['efficiency', 'torque_constant'], ['level', 'draws_from', 'quantities'])
    """

    by_name: Mapping[str, DerivedQuantity]
    level: float
    kind: str
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> DerivedQuantity:
        return self.by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_name)

    def __len__(self) -> int:
        return len(self.by_name)

    def _report(self) -> Report:
        return quantities_report(self.values(), self.level, self.notes)

    def to_json(self) -> dict[str, Any]:
        """The intervals as plain data."""
        data = {name: q.to_json() for name, q in self.items()}
        return plain({"level": self.level, "draws_from": self.kind, "quantities": data})

    @showing
    def plot(self) -> Figure:
        """Plot the curves with their bands, one panel each.

        Raises:
            InputError: there is no curve.

        Example:
            >>> result = dft.uncertainty.quantities(fit, steps=[1.0, 2.0])
            >>> figure = result.plot()
        """
        from diffthrust.uncertainty._prediction.figures import curves_figure

        return curves_figure(self, self.level)


def quantities(
    source: Any,
    model: Any = None,
    *,
    pitch: float | None = None,
    area: float | None = None,
    density: float = 1000.0,
    commands: Sequence[float] | np.ndarray | None = None,
    steps: Sequence[float] | np.ndarray | None = None,
    amplitudes: Sequence[float] | np.ndarray | None = None,
    response: str | None = None,
    inputs: Mapping[str, float] | None = None,
    functions: Mapping[str, Callable[[Mapping[str, float]], Any]] | None = None,
    units: Mapping[str, str] | None = None,
    level: float = 0.95,
    draws: int = 400,
    seed: int = 0,
) -> Quantities:
    """What follows from the parameters, with intervals: only what is asked for is worked out.

    - ``pitch`` and ``area``: "efficiency", "volume" and "torque_constant" of a thruster (see
      `physical`).
    - ``commands``: "steady_thrust", the output in the end under each constant command, by
      simulation of the model with its effects.
    - ``steps``: "step_time", the time from a step out of rest to 1 - 1/e = 63 % of the response.
    - ``amplitudes``: "break_frequency", at which a thruster follows no more whose speed swings so
      far: 8 alpha / (3 pi) times the amplitude.
    - ``functions``: any functions of the parameters.

    Predicted trajectories come from `predict`.

    Args:
        source: a posterior that `sample` gives, or a `Fit`, whose covariance is drawn from.
        model: the model or the fit that was sampled; not needed where the source is a fit.
        pitch: pitch of the propeller [m/rad].
        area: area of the duct [m^2].
        density: of the water [kg/m^3].
        commands: constant values of the model's input, in its unit.
        steps: sizes of steps of the input.
        amplitudes: of the propeller's speed [rad/s].
        response: the output; by default "thrust", or else the first one. Effects of its sensor are
            left out.
        inputs: constant values of other inputs, such as ``{"supply_voltage": 24.0}``.
        functions: by name, from parameter values by full name to a number or an array.
        units: units of the functions' values.
        level: probability of the intervals.
        draws: number of draws; with 400 the ends of a 95 % interval lie at 2.5 % +- 0.8 %.
        seed: of the draws.

    Returns:
        A mapping from name to `DerivedQuantity`, with ``.report()`` and ``.plot()``.

    Raises:
        InputError: the posterior is empty, the model has no such quantity, or none is requested.

    Source: Yoerger, Cooke & Slotine 1990, sections II B (efficiency, volume), II C (steady thrust),
    III and figure 6 (steps), IV (break frequency).

    Example:
        >>> result = dft.uncertainty.quantities(fit, pitch=0.101, area=0.0527)
        >>> sorted(result.by_name)
        ['efficiency', 'torque_constant', 'volume']
    """
    drawn = draws_of(source, model, count=draws, seed=seed, level=level)
    if (pitch is None) != (area is None):
        raise InputError("quantities: expected both pitch and area, found one.", "Give both.")
    requested = {"commands": commands, "steps": steps, "amplitudes": amplitudes}
    curves = {n: _points(n, wanted) for n, wanted in requested.items() if wanted is not None}
    if functions is not None and not (
        isinstance(functions, Mapping) and all(map(callable, functions.values()))
    ):
        raise InputError(
            f"functions: expected functions by name, found {functions!r}.",
            "Write functions={'gain': lambda p: p['beta'] / p['alpha']}.",
        )
    if pitch is None and not curves and not functions:
        raise InputError(
            "quantities: no quantity is requested.",
            "Give pitch and area, commands, steps, amplitudes or functions.",
        )
    notes = list(drawn.notes)
    entries: list[_Entry] = []
    if pitch is not None and area is not None:
        check_sizes("quantities", pitch, area, density)
        thruster = torque_driven("quantities", drawn.model, drawn.values)
        constants = duct_quantities(thruster, pitch, area, density)
        entries += [(n, u, constants[n], ()) for n, u in physical_units(drawn.model).items()]
    shown = ShownUnits((drawn.fit.written,) if drawn.fit else ())
    if "commands" in curves or "steps" in curves:
        entries += _responses(drawn, curves, response, inputs or {}, shown, notes)
    if "amplitudes" in curves:
        entries.append(_break_frequency(drawn, curves["amplitudes"], shown, notes))
    for name, function in (functions or {}).items():
        values = _by_draw(name, function, drawn)
        grid = () if values.ndim == 1 else (np.arange(values.shape[1], dtype=float), "index", "")
        entries.append((name, (units or {}).get(name, ""), values, grid))
    by_name: dict[str, DerivedQuantity] = {}
    for name, unit, values, grid in entries:
        if name in by_name:
            raise InputError(
                f"quantities: there are two of the name {name!r}.", "Give the function another."
            )
        by_name[name] = summarised(name, unit, np.asarray(values, float), level, *grid)
    return Quantities(by_name, level, drawn.kind, tuple(notes))


_Entry = tuple[str, str, Any, tuple[Any, ...]]
"""Name and unit of a quantity, its values by draw, and the grid of a curve."""


def _break_frequency(
    drawn: Draws, swing: np.ndarray, shown: ShownUnits, notes: list[str]
) -> _Entry:
    thruster = torque_driven("quantities", drawn.model, drawn.values)
    size, unit = shown.size("speed", 1.0, "rad/s")
    shafted = [e.name for e in drawn.model.effects if {"load", "shaft"} & set(e.ports)]
    if shafted:
        notes.append(
            "break_frequency counts the load in proportion to speed squared alone, not "
            f"{', '.join(shafted)}."
        )
    grid = (swing, "speed amplitude", "rad/s", 1.0, "", size * swing, unit)
    return "break_frequency", "rad/s", thruster.sine_load[:, None] * np.abs(swing), grid


def _responses(
    drawn: Draws,
    curves: Mapping[str, np.ndarray],
    response: str | None,
    inputs: Mapping[str, float],
    shown: ShownUnits,
    notes: list[str],
) -> list[_Entry]:
    model = drawn.model
    entries: list[_Entry] = []
    output = response or ("thrust" if "thrust" in model.outputs else next(iter(model.outputs)))
    commands, steps = (curves.get(name, np.empty(0)) for name in ("commands", "steps"))
    answers = responses(drawn, np.concatenate([commands, steps]), output, inputs)
    drive = next((n for n in model.inputs if n not in inputs), "input")
    unit, count = model.inputs.get(drive, ""), commands.size
    if count:
        out = model.outputs[output]
        size = shown.size(output, 1.0, out)
        grid = shown.values(drive, commands, unit), shown.unit(drive, unit)
        over = (commands, drive, unit, *size, *grid)
        entries.append((f"steady_{output}", out, answers.steady[:, :count], over))
    times = answers.time[:, count:]
    if steps.size:
        size, shown_unit = shown.size(drive, 1.0, unit)
        over = (steps, f"step of {drive}", unit, 1.0, "", size * steps, shown_unit)
        entries.append(("step_time", "s", times, over))
    if not np.all(np.isfinite(times)):
        notes.append("step_time is infinite (inf) where a step moves nothing, as in a dead band.")
    if answers.unsettled > 0:
        notes.append(
            f"In {100 * answers.unsettled:.2g} % of the draws a response had not settled at the "
            "end of its simulation: its parameters are badly determined."
        )
    return entries


def _points(name: str, wanted: Any) -> np.ndarray:
    points = finite_row(wanted)
    if points is None:
        raise InputError(
            f"quantities: expected finite numbers as {name}, found {wanted!r}.",
            f"Write {name}=[0.5, 1.0, 2.0].",
        )
    return points


def _by_draw(name: str, function: Callable[..., Any], drawn: Draws) -> np.ndarray:
    rows = []
    for i in range(len(drawn)):
        try:
            row = function({n: float(v[i]) for n, v in drawn.values.items()})
        except KeyError as error:
            raise InputError(
                f"quantities: the function {name!r} reads the parameter {error}, which the model "
                f"'{drawn.model}' does not have; it has {listing(drawn.values)}.",
                "Correct the name.",
            ) from None
        rows.append(np.asarray(row, float))
    if len({row.shape for row in rows}) > 1 or rows[0].ndim > 1:
        raise InputError(
            f"quantities: the function {name!r} gives arrays of the shapes "
            f"{listing({str(row.shape) for row in rows}, 3)}.",
            "Let it give a number, or an array of one dimension and always the same length.",
        )
    return np.stack(rows)
