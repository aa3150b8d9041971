"""A craft for a simulator of vehicles: each of its thrusters, with its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

from diffthrust._support.errors import InputError
from diffthrust.export._source import ExportSource
from diffthrust.logs._written import ShownUnits
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.placed import Placed

_V = TypeVar("_V")
Limits = tuple[float, float] | None
Simulator = Callable[[ExportSource, str, Limits], tuple[str, list[str]]]


def of_craft(
    source: ExportSource, name: str, limits: Limits, simulator: Simulator
) -> tuple[str, list[str]]:
    """The thrusters of a craft one after the other, and the notes on all of them.

    Args:
        source: a craft.
        name: with which the names of its thrusters begin.
        limits: lowest and highest command of each.
        simulator: writes one thruster.

    Raises:
        InputError: a thruster that the simulator has no place for, by its name.
    """
    texts, notes = [], ["The hull is left out: simulators describe its mass and drag elsewhere."]
    for part, thruster in thrusters_of(source):
        try:
            text, remarks = simulator(thruster, f"{name}_{part}", limits)
        except InputError as error:
            raise InputError(f"{part}: {error.problem}", error.mend) from None
        texts.append(text.strip("\n"))
        notes += remarks
    return "\n\n".join(texts) + "\n", [*dict.fromkeys(notes)]


def thrusters_of(source: ExportSource) -> Iterator[tuple[str, ExportSource]]:
    """Each thruster of a craft by itself: with the effects on it, its place and its strength."""
    craft = source.model
    assert isinstance(craft, Craft)
    errors, owners = source.errors, {n: group[0] for group in craft.groups() for n in group}
    for name, mounted in craft.actuators.items():
        model = craft.actuator(name)
        named = {n: f"{owners[name]}.{n}" for n in model.parameters}
        for effect in craft.effects:
            if isinstance(effect, Placed) and name in effect.members:
                inner = effect.inner
                model = model + inner
                named |= {f"{inner.name}.{k}": f"{effect.name}.{k}" for k in inner._parameters}
        own = {n: f"{name}.{n}" for n in ("strength", "x", "y", "z")}
        present = {n: full for n, full in {**named, **own}.items() if full in craft.parameters}
        x, y, z = (craft.parameters[f"{name}.{axis}"].value for axis in "xyz")
        strength = craft.parameters.get(f"{name}.strength")
        units = ShownUnits((_short(source.units.written, name),))
        yield (
            name,
            replace(
                source,
                model=model,
                inputs=_short(source.inputs, name),
                ranges=_short(source.ranges, name),
                linear=tuple(_short(dict.fromkeys(source.linear), name)),
                errors={n: errors[full] for n, full in present.items() if full in errors},
                provenance=(*source.provenance, *_marks(craft, name, present, errors)),
                units=units,
                mounted=replace(mounted, place=(x, y, z)),
                strength=1.0 if strength is None else float(strength.value),
            ),
        )


def _short(named: Mapping[str, _V], name: str) -> dict[str, _V]:
    """What belongs to a thruster, by its short names."""
    prefix = f"{name}."
    return {n.removeprefix(prefix): v for n, v in named.items() if n.startswith(prefix)}


def _marks(
    craft: Craft, name: str, present: Mapping[str, str], errors: Mapping[str, float]
) -> Iterator[str]:
    """Where each number is from: estimated, with its error, or held."""
    yield f"Thruster {name}:"
    for short, full in present.items():
        p = craft.parameters[full]
        unit = f" {p.unit}" if p.unit else ""
        if full in errors:
            mark = f"estimated, standard error {errors[full]:.2g}"
        else:
            mark = "held" if p.fixed else "not fitted"
        yield f"{short} = {p.value:.6g}{unit}: {mark}."
