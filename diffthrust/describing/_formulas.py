"""The quasi-linear describing function of the torque-driven thruster, in closed form.

With the speed taken as a sinusoid, speed |speed| is replaced by (8 / 3 pi) times its amplitude
times the speed. From commanded to delivered thrust the thruster is then a first-order lag, whose
break frequency depends on amplitude and frequency.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.models._base.model import Model
from diffthrust.models._base.quadratic_load import QuadraticLoad

FORMULAS = ("paper", "consistent")


def check_plain(method: str, model: Model, input: str, output: str, bias: float) -> None:
    """Raise `InputError` for a model, or a way to look at it, that the formulas do not cover."""
    beyond: list[str] = []
    if model.quadratic_load is None:
        beyond.append(f"the model '{model.name}'")
    elif model.effects:
        named = ", ".join(f"'{e.name}'" for e in model.effects)
        beyond.append(f"the effects {named}")
    if input != "command" or output not in ("thrust", "speed"):
        beyond.append(f"the path from {input!r} to {output!r}")
    if bias != 0:
        beyond.append(f"a bias of {bias:g}")
    if beyond:
        raise InputError(
            f"describing_function: the formula '{method}' is that of the plain thruster, from "
            f"'command' to 'thrust' or 'speed' about zero; it does not cover {', '.join(beyond)}.",
            "Use method='simulation' or method='harmonic_balance'.",
        )


def quasi_linear(
    thruster: QuadraticLoad, amplitudes: Any, frequencies: Any, output: str, *, paper: bool
) -> np.ndarray:
    """The describing function, complex: from the command to the thrust [N/V] or speed [rad/(s V)].

    That to the thrust is a lag of static gain ct beta / alpha and of the break frequency

        lambda^2 = (-w^2 + sqrt(w^4 + 4 g (Fc / ct)^2)) / 2

    with Fc = ct (beta / alpha) c and gamma = 8 alpha / (3 pi); for the speed the static gain is
    beta / lambda. The paper has g = gamma^4, having taken the amplitude of the thrust as ct times
    the squared amplitude of the speed. With the amplitude of the fundamental of the thrust
    throughout, g = (gamma alpha)^2. In the numbers of the thruster alpha is the load, beta the
    drive's gain.

    Source: Yoerger, Cooke & Slotine 1990, section IV, figure 12.
    """
    w = np.asarray(frequencies)
    gamma = np.asarray(thruster.sine_load)
    weight = gamma**4 if paper else (gamma * thruster.load) ** 2
    steady = thruster.drive_gain / thruster.load * np.asarray(amplitudes)  # speed |speed| at rest
    level = 4.0 * weight * steady**2
    # (-a + sqrt(a^2 + b)) / 2 loses its digits where b is small; this does not
    lag = np.sqrt(0.5 * level / (w**2 + np.sqrt((w**2) ** 2 + level)))
    if output == "speed":
        return np.asarray(thruster.drive_gain) / (lag + 1j * w)
    return np.asarray(thruster.thrust_per_command) * lag / (lag + 1j * w)
