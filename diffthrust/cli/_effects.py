"""The command ``diffthrust effects``: the catalogue."""

from __future__ import annotations

from diffthrust.cli._session import session, show


def effects_command() -> None:
    """List the effects of the catalogue: what each does, its port, and its parameters."""
    with session():
        from diffthrust.cli._tables import catalogue_report
        from diffthrust.models import MODELS, Vessel
        from diffthrust.models._base.registry import catalogue

        models = {name: model() for name, model in MODELS.items()}
        models["vessel (twin)"] = Vessel(drive="twin")
        report = catalogue_report(catalogue().values(), models)
    show(report)
