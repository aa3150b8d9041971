"""Parameters that are held at a value: each a candidate whose null is that value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model


def constants_in(model: Model) -> tuple[str, ...]:
    """The parameters of a model and of its effects that are held at a number.

    Not the forms that an effect may have: each of these is tried by itself.

    Example:
        >>> constants_in(dft.Vessel())
        ('lever_arm',)
    """
    return tuple(n for n, p in model.parameters.items() if p.fixed and not p.probes)


def of_effect(parameter: str, effect: str) -> bool:
    """Whether a parameter belongs to a candidate: an effect, or a held parameter itself."""
    return effect in (parameter, parameter.rpartition(".")[0])


def with_candidates(
    model: Model, effects: Iterable[str], candidates: Mapping[str, Effect]
) -> Model:
    """A model with some candidates: effects added, parameters that were held freed."""
    freed = [n for n in effects if n not in candidates]
    return model.free(*freed) + [candidates[n] for n in effects if n in candidates]
