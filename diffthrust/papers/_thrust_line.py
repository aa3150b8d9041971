"""Thrust over the square of a speed that was measured with noise: the line of an instrument."""

from __future__ import annotations

import numpy as np

from diffthrust._support.errors import InputError


def thrust_line(
    speed: np.ndarray, thrust: np.ndarray, simulated: np.ndarray
) -> tuple[float, float]:
    """The ct, and its standard error, of thrust = ct speed |speed|, where the speed carries noise.

    With noise e of variance s^2, (W + e)|W + e| is W|W| + 2|W| e + e^2: the line of least squares
    is too flat by 4 s^2 W^2 over W^4, and the square too large by s^2 besides. A simulated speed
    is independent of e: with its square as instrument the first error vanishes. The slope that
    least squares lose against it gives s^2, by which the squares are then lowered. Without noise
    both lines agree.

    Args:
        speed: measured [rad/s], ``(n,)``; each sample's noise may depend on that of others.
        thrust: measured [N], ``(n,)``, with noise that is independent of the speed's.
        simulated: the speed by a model [rad/s], ``(n,)``, which need not be exact.

    Raises:
        InputError: a speed that does not move, or that the simulated one has nothing to do with.

    Source: Soderstrom & Stoica 1983, Instrumental Variable Methods, section 3; the standard error
    is that of unequal variances (White 1980, Econometrica 48, 817).

    Example:
        >>> ct, error = thrust_line(speed, thrust, dft.simulate(model, log)["speed"])
    """
    squared, instrument = speed * np.abs(speed), simulated * np.abs(simulated)
    if not instrument @ squared > 0.0:
        raise InputError(
            "dynamic_test: the measured speed is unrelated to the speed that a simulation of the "
            "command gives.",
            "Look at the signs of speed and command, and whether the record moves.",
        )
    flat = (squared @ thrust) / (squared @ squared)
    steep = (instrument @ thrust) / (instrument @ squared)
    flatter = 1.0 - flat / steep if steep else 0.0
    # from flat / steep = 1 - 4 s^2 sum W^2 / sum W^4, by samples in the place of expectations
    variance = max(flatter, 0.0) * (squared @ squared) / (4.0 * speed @ speed)
    squared = squared - variance * np.sign(speed)
    ct = (instrument @ thrust) / (instrument @ squared)
    residual = instrument * (thrust - ct * squared)
    return float(ct), float(np.sqrt(residual @ residual) / (instrument @ squared))
