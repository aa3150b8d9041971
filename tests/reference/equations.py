"""The equations of a fitted model, as `whole_runs` has them, and its numbers in their words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from . import whole_runs as wr

Numbers = Mapping[str, float]

_THRUSTER: dict[str, tuple[str, dict[str, Callable[[Numbers], float]]]] = {
    "command_deadband": ("deadband", {"band": lambda n: n["command_deadband.half_width"]}),
    "command_saturation": ("saturation", {"limit": lambda n: n["command_saturation.limit"]}),
    "command_delay": ("delay", {"delay": lambda n: n["command_delay.delay"]}),
    "linear_damping": ("damping", {"linear": lambda n: n["linear_damping.rate"]}),
    "thrust_sensor_offset": (
        "offset",
        {"thrust_offset": lambda n: n["thrust_sensor_offset.offset"]},
    ),
    "supply_voltage_sag": (
        "sag",
        {
            "share": lambda n: n["supply_voltage_sag.share"],
            "nominal": lambda n: n["supply_voltage_sag.nominal"],
        },
    ),
    "reverse_thrust_asymmetry": (
        "reverse",
        {"ct_reverse": lambda n: n["ct"] * (1.0 + n["reverse_thrust_asymmetry.change"])},
    ),
}
_DRAGS = {f"quadratic_{axis}_drag": axis for axis in ("surge", "sway", "yaw")}
_BOAT: dict[str, tuple[str, dict[str, str]]] = {
    "differential_gain": ("gain", {"gain": "gain"}),
    "swapped_thrusters": ("crossed", {"share": "share"}),
    "force_exponent": ("power", {"power": "exponent", "reference": "reference"}),
    "propeller_inflow": ("inflow", {"loss": "loss"}),
    "sway_yaw_coupling": ("coupling", {"m23": "mass", "d23": "damping"}),
}


class Unwritten(Exception):
    """A model or an effect whose equations nobody wrote out here."""


def system_of(model: str, effects: Sequence[str]) -> wr.System:
    """The equations of a model of the package with effects, by their names.

    Raises:
        Unwritten: `whole_runs` has no equations of it.
    """
    if model == "thruster":
        return wr.yoerger(**{_of(name): True for name in effects})
    if model == "vessel":
        extra = {*effects} - {*_DRAGS, *_BOAT, "water_current"}
        if extra:
            raise Unwritten(f"{sorted(extra)}")
        return wr.twin_boat(
            drag=[axis for name, axis in _DRAGS.items() if name in effects],
            current="water_current" in effects,
            **{_BOAT[name][0]: True for name in effects if name in _BOAT},
        )
    if model == "axis_vehicle" and not effects:
        return wr.rail_axis(viscous=False, quadratic=True)
    raise Unwritten(f"{model} with {sorted(effects)}")


def _of(effect: str) -> str:
    if effect not in _THRUSTER:
        raise Unwritten(effect)
    return _THRUSTER[effect][0]


def values_of(model: str, effects: Sequence[str], numbers: Numbers) -> dict[str, float]:
    """Numbers of a fit, ``{"ct": 0.02, "command_deadband.half_width": 0.4}``, for `system_of`."""
    system = system_of(model, effects)
    values = {n: numbers.get(n, r.start) for n, r in system.parameters.items()}
    if model == "thruster":
        for name in effects:
            values |= {n: of(numbers) for n, of in _THRUSTER[name][1].items()}
    if model == "axis_vehicle":
        values |= {"mass": numbers["mass"], "quadratic": numbers["drag"]}
    if model == "vessel":
        for name, axis in _DRAGS.items():
            if name in effects:
                values[f"q_{axis}"] = numbers[f"{name}.drag"]
        for name in ("to_north", "to_east"):
            if name in values:
                values[name] = numbers[f"water_current.{name}"]
        for name in (name for name in effects if name in _BOAT):
            values |= {ours: numbers[f"{name}.{its}"] for ours, its in _BOAT[name][1].items()}
    return values


def fit_of(
    model: str, effects: Sequence[str], numbers: Numbers, fixed: Sequence[str], runs: Any, **options
) -> wr.Found:
    """A plain least squares of the same equations, the first start at the numbers of a fit."""
    system = system_of(model, effects)
    values = values_of(model, effects, numbers)
    free = {n for n, r in system.parameters.items() if r.low < r.high} - {*fixed}
    held = {n: v for n, v in values.items() if n not in free}
    return wr.fit(system.fixed(**held), runs, first=values, **options)
