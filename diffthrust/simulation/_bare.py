"""A model without what only its sensors and its recorded channels do."""

from __future__ import annotations

from diffthrust.models._base.model import Model


def bare(model: Model) -> Model:
    """The model without the effects that act on what its sensors report."""
    kept = (e for e in model.effects if not all(port in model.outputs for port in e.ports))
    return model._copy(effects=tuple(kept))
