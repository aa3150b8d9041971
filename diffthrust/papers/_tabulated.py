"""A vessel whose ratios are a table against speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.models import Vessel
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import RatesAndOutputs, Signals
from diffthrust.simulation._trajectory import Key


class TabulatedVessel(Model):
    """A vessel that reads its parameters from a table at its present speed.

    Between two speeds of the table the parameters are straight lines, beyond its ends they are
    constant. Ports, inputs, states and outputs are those of `Vessel`, so the same effects fit.
    The model has no parameters of its own: fit a `Vessel` near each speed, and tabulate.

    Args:
        speeds: surge speeds at which the vessels were identified [m/s], increasing, ``(n,)``.
        vessels: the vessel at each, with the same drive; without effects.

    Raises:
        InputError: lengths that differ, speeds that do not increase, vessels of another form.

    Source: Siramdasu & Fahimi 2013, section 3 (parameters hold near one speed, "and must be
    tabulated versus the vessel's speed").

    Example:
        >>> boat = dft.papers.TabulatedVessel([0.4, 0.75], [dft.Vessel(), dft.Vessel(d11=5.0)])
        >>> boat.inputs
        {'propeller_speed': 'rev/s', 'rudder_angle': 'rad'}
    """

    name = "tabulated_vessel"
    options: ClassVar[tuple[str, ...]] = ("speeds", "table", "vessel")
    optional_inputs: ClassVar[Mapping[str, str]] = Vessel.optional_inputs
    states: ClassVar[Mapping[str, str]] = Vessel.states
    outputs: ClassVar[Mapping[str, str]] = Vessel.outputs
    angles: ClassVar[tuple[str, ...]] = Vessel.angles
    time_scales: ClassVar[tuple[float, float]] = Vessel.time_scales
    horizon: ClassVar[float | None] = Vessel.horizon

    speeds: tuple[float, ...]
    table: tuple[tuple[str, tuple[float, ...]], ...]
    vessel: Key

    def __init__(self, speeds: Sequence[float], vessels: Sequence[Vessel]) -> None:
        at = np.asarray(speeds, float).ravel()
        if len(vessels) != at.size or at.size < 2 or not np.all(np.diff(at) > 0):
            raise InputError(
                f"TabulatedVessel: expected two or more increasing speeds and a vessel for each, "
                f"found {at.tolist()} and {len(vessels)} vessels.",
                "Sort them by speed.",
            )
        forms = {v.structure if isinstance(v, Vessel) else None for v in vessels}
        if len(forms) != 1 or None in forms or vessels[0].effects:
            raise InputError(
                "TabulatedVessel: expected vessels with the same drive and without effects, found "
                f"{', '.join(str(v) for v in vessels)}.",
                "Add effects to the tabulated vessel itself.",
            )
        first = vessels[0]
        self._set(
            speeds=tuple(float(x) for x in at),
            table=tuple(
                (name, tuple(float(v.parameters[name].value) for v in vessels))
                for name in first.parameters
            ),
            vessel=Key(first),
            inputs=first.inputs,
            ports=first.ports,
        )
        super().__init__()

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Those of `Vessel`, with the parameters at the present surge."""
        values = {name: _along(s.surge, self.speeds, column) for name, column in self.table}
        return self.vessel.model.bind(values).equations(s, port)


def _along(x: Any, knots: tuple[float, ...], values: tuple[float, ...]) -> Any:
    """Straight between knots, constant beyond; elementwise, which a look-up would not be."""
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(knots), [0.0]])
    bent = [
        change * jnp.maximum(x - knot, 0.0)
        for change, knot in zip(np.diff(slopes), knots, strict=True)
    ]
    return values[0] + sum(bent)
