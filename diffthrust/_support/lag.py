"""First-order lags along a series, evenly sampled or not."""

from __future__ import annotations

import numpy as np


def lagged(first: np.ndarray, toward: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Values that keep a share of the last one at each step, and go on toward others.

    y[0] = first, y[k + 1] = kept[k] y[k] + (1 - kept[k]) toward[k]: a bidiagonal system, solved by
    LAPACK. (`scipy.signal.lfilter` is as fast, takes 0.4 s to import, and no uneven steps.)

    Args:
        first: the first value, ``(d,)``.
        toward: what it goes toward at each step, ``(n, d)``.
        kept: the share that is kept at each step, ``(n,)``.

    Returns:
        ``(n + 1, d)``.
    """
    from scipy.linalg import get_lapack_funcs  # slow to import

    band = np.zeros((2, kept.size + 1))
    band[1, :-1] = -kept
    driven = np.concatenate([first[None], (1.0 - kept)[:, None] * toward])
    (tbtrs,) = get_lapack_funcs(("tbtrs",), (band,))
    return tbtrs(band, np.asfortranarray(driven), uplo="L", diag="U", overwrite_b=True)[0]
