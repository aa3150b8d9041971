"""The describing function of one point as a user writes it: simulate until nothing changes.

The same loop for numba, which compiles it, and for CasADi.
"""

from __future__ import annotations

from typing import Any

ACCURACY = 2e-4
"""Of the first harmonic, relative: that of `diffthrust.describing_function`."""


def harmonic(period: Any, amplitude: float, frequency: float) -> complex:
    """First harmonic of the thrust over that of the command.

    Period after period until the harmonic stays, then with twice the steps, until that does not
    move it either. The command is a cosine: rest is then near the steady swing.

    Args:
        period: from the steps, amplitude, frequency and speed at its begin to the speed at its end
            and the harmonic.
        amplitude: of the command [V].
        frequency: [rad/s].
    """
    steps, x, coarse = 64, 0.0, 0.0 + 0.0j
    for _ in range(8):
        before, found = 0.0 + 0.0j, 0.0 + 0.0j
        for _ in range(400):
            x, found = period(steps, amplitude, frequency, x)
            if not abs(x) < 1e9:  # too few steps: unstable
                x = 0.0
                break
            if abs(found - before) <= 0.005 * ACCURACY * abs(found):
                break
            before = found
        if abs(found - coarse) <= ACCURACY * abs(found):
            return found
        steps, coarse = 2 * steps, found
    return complex(float("nan"))
