"""A fit gathered for its way into another program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from diffthrust._support.errors import InputError
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._origin import Origin
from diffthrust.estimation._status import Status
from diffthrust.export._export import exported
from diffthrust.export._exported import Exported
from diffthrust.export._source import ExportSource
from diffthrust.export._trace import read_inputs
from diffthrust.logs._written import ShownUnits, Written
from diffthrust.models._base.model import Model


class Fitted(Protocol):
    """What of a fit goes along."""

    @property
    def model(self) -> Model:
        """The model at the estimates."""
        ...

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """The estimates by full name."""
        ...

    @property
    def status(self) -> Status:
        """What may be claimed."""
        ...

    @property
    def message(self) -> str:
        """Why."""
        ...

    @property
    def substeps(self) -> int:
        """Integrator steps per sample."""
        ...

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Inputs of the training logs."""
        ...

    @property
    def origin(self) -> Origin | None:
        """When and of which logs it was made."""
        ...

    @property
    def hold(self) -> Mapping[str, str]:
        """How these ran between samples."""
        ...

    @property
    def written(self) -> Mapping[str, Written]:
        """How these wrote their channels."""
        ...


def exported_fit(
    fit: Fitted, to: str, path: Path | str | None, limits: tuple[float, float] | None
) -> Exported:
    """A fit in the language of another program; see `Fit.export`."""
    from diffthrust import __version__

    if fit.status is Status.SIMULATION_FAILED:
        raise InputError(
            f"This fit failed, so that there is nothing to export. {fit.message}",
            "Fit again, from other values or with narrower bounds.",
        )
    source = ExportSource(
        fit.model,
        read_inputs(fit.model, fit.ranges),
        ranges=fit.ranges,
        linear=tuple(name for name, way in fit.hold.items() if way == "linear"),
        substeps=fit.substeps,
        errors={name: e.std_error for name, e in fit.parameters.items() if e.std_error is not None},
        provenance=(f"Fit: {fit.message}", *(fit.origin.sentences if fit.origin else ())),
        version=__version__,
        units=ShownUnits((fit.written,)),
    )
    result = exported(source, to, path, limits)
    if fit.status.ok:
        return result
    return replace(result, notes=(f"The fit is {fit.status}: {fit.message}", *result.notes))
