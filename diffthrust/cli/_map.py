"""The command ``diffthrust map``: gain and phase of a fitted model under a sinusoid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from diffthrust._support.errors import InputError
from diffthrust._support.files import write_json
from diffthrust.cli import _session as ui

if TYPE_CHECKING:
    import numpy as np

    from diffthrust.logs._log import Log
    from diffthrust.models._base.model import Model

_POINTS = 24
"""Default number of amplitudes and frequencies."""
_SPAN = 50.0
"""Default ratio of largest to smallest amplitude."""


def map_command(
    spec: ui.SpecPath,
    amplitudes: Annotated[
        str | None,
        Option(
            metavar="A,B,... or MIN:MAX:N",
            help="Of the input, in the model's unit; MIN:MAX:N gives N values, evenly spaced in "
            "the logarithm. By default up to the largest input in the logs.",
        ),
    ] = None,
    frequencies: Annotated[
        str, Option(metavar="A,B,... or MIN:MAX:N", help="In rad/s; N as above.")
    ] = f"0.1:30:{_POINTS}",
    method: Annotated[
        Literal["simulation", "harmonic_balance", "paper", "consistent"],
        Option(
            help="simulation and harmonic_balance take any model; paper and consistent are the "
            "closed forms of the plain thruster."
        ),
    ] = "simulation",
    harmonics: Annotated[
        int, Option(metavar="N", min=1, help="Number in a harmonic balance.")
    ] = 15,
    input: Annotated[str, Option(metavar="NAME", help="The input that is a sinusoid.")] = "command",
    output: Annotated[str, Option(metavar="NAME", help="The output.")] = "thrust",
    bias: Annotated[float, Option(metavar="X", help="Mean of the input.")] = 0.0,
    no_fit: ui.NoFitOption = False,
    draws: Annotated[
        int | None,
        Option(
            metavar="N",
            min=20,
            help="Add intervals of 95 % from N draws of the fit's covariance; 100 suffice.",
        ),
    ] = None,
    json: ui.JsonPath = None,
    figure: Annotated[Path | None, ui.figure_option("Draw gain and phase.")] = None,
    trust: ui.TrustOption = None,
) -> None:
    """Map gain and phase of the fitted model over amplitude and frequency."""
    with ui.session() as progress:
        from diffthrust.describing._band import uncertainty
        from diffthrust.describing._describe import describing_function
        from diffthrust.specs._spec import load_spec

        # Checked before the logs are read and the model is fitted, which takes a while.
        if draws is not None and no_fit:
            raise InputError(
                "--draws: expected a fit, whose covariance is drawn from, found --no-fit.",
                "Leave out one of the two.",
            )
        grids = {"frequencies": grid_points("--frequencies", frequencies)}
        if amplitudes is not None:
            grids["amplitudes"] = grid_points("--amplitudes", amplitudes)
        loaded = load_spec(spec, trust=trust or ())
        train, unseen = loaded.train_logs(), loaded.holdout_logs()
        if amplitudes is None:
            grids["amplitudes"] = _within(loaded.model, input, train, bias)
        fit = None if no_fit else loaded.fit(progress=progress, train=train, holdout=unseen)
        requested: Any = {"input": input, "output": output, "bias": bias}
        requested |= {"method": method, "harmonics": harmonics}
        if draws is None:
            response = describing_function(fit or loaded.model, **grids, **requested)
        else:
            response = uncertainty(fit, **grids, **requested, draws=draws)
        if json:
            status = {"status": fit.status.value, "message": fit.message} if fit else None
            write_json(json, {**response.to_json(), "fit": status})
        ui.write_figure(figure, response.plot)
    if fit:
        ui.show(f"Status: {fit.status.value}. {fit.message}")
    ui.show(response)
    ui.written(json, figure)


def grid_points(option: str, text: str) -> np.ndarray:
    """The numbers of ``a,b,c``, or n numbers evenly spaced in the logarithm for ``min:max:n``."""
    import numpy as np

    try:
        if ":" in text:
            low, high, count = text.split(":")
            first, last, size = float(low), float(high), int(count)
            if not (0 < first < last < np.inf and size >= 2):
                raise ValueError
            return np.geomspace(first, last, size)
        return np.unique([float(piece) for piece in text.split(",") if piece.strip()])
    except ValueError:
        raise InputError(
            f"{option}: expected numbers as 0.5,1,2 or as 0.1:10:24 (from, to, count), found "
            f"{text!r}.",
            "Correct it; amplitudes and frequencies are positive.",
        ) from None


def _within(model: Model, name: str, logs: Sequence[Log], bias: float) -> np.ndarray:
    """Amplitudes up to the largest in the logs: the model was identified in this range."""
    import numpy as np

    from diffthrust.simulation._record import bind

    driving = [log.replaced(measured={}) for log in logs]  # measurements are not read here
    records = bind(model, driving, compared=False)
    inputs = [record.inputs_for(model).get(name, np.zeros(1)) for record in records]
    largest = max((float(np.nanmax(np.abs(series - bias))) for series in inputs), default=0.0)
    if not largest > 0:
        raise InputError(
            f"The logs do not show how far {name!r} swings.", "Give --amplitudes, as 0.1:10:24."
        )
    return np.geomspace(largest / _SPAN, largest, _POINTS)
