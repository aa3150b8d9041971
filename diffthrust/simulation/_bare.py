"""A model without what only its sensors and its recorded channels do."""

from __future__ import annotations

from diffthrust.models._base.model import Model


def bare(model: Model) -> Model:
    """The model without the effects that act on what its sensors report."""
    for effect in model.effects:
        if all(port in model.outputs for port in effect.ports):
            model = model - effect.name
    return model
