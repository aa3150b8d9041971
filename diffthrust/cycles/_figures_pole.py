"""Figure of the closed loop's poles as the amplitude grows (Yoerger et al. 1990, figure 13)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.figures import literal, showing, styled
from diffthrust._support.transfer import Transfer, transfer_of
from diffthrust.cycles._crossings import grid_of, loop_poles
from diffthrust.cycles._element import Nonlinearity
from diffthrust.cycles._find import element_of, range_of

_COUNT = 64


@showing
def plot_pole_motion(
    linear: Any, nonlinearity: Any, *, amplitudes: ArrayLike | None = None
) -> Figure:
    """The root locus of the quasi-linear loop over the amplitude at the element's input.

    Where the poles cross to the left as the amplitude grows, an oscillation that is too small
    grows and one that is too large shrinks: a stable limit cycle. A model's lag is taken at the
    frequency of the oscillating pair itself.

    Args:
        linear: G(s) as for `limit_cycles`.
        nonlinearity: the element, model or fit, as for `limit_cycles`.
        amplitudes: lowest and highest, or a rising grid; as for `limit_cycles`.

    Raises:
        InputError: as for `limit_cycles`, or no poles at any amplitude.

    Source: Yoerger, Cooke & Slotine 1990, figure 13.

    Example:
        >>> figure = dft.cycles.plot_pole_motion(([2.0], [1, 3, 2, 0]), dft.cycles.Saturation(1.0))
    """
    transfer, element = transfer_of(linear), element_of(nonlinearity)
    grid, scale = range_of("amplitudes", amplitudes, element.least), element.scale
    if grid is None and scale is not None:
        grid = np.array([element.least + 0.1 * scale, 100.0 * scale])
    elif grid is None:
        grid, _ = grid_of(transfer, element, None, None)
    return pole_figure(transfer, element, (float(grid[0]), float(grid[-1])))


def pole_path(
    transfer: Transfer, element: Nonlinearity, amplitudes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes ``(m,)`` with a describing function, and the loop's poles [1/s], ``(m, n)``."""
    w = np.full(amplitudes.shape, np.sqrt(transfer.corners[0] * transfer.corners[-1]))
    rows: list[np.ndarray] = []
    for _ in range(8):  # the lag depends on the frequency of the pair that it moves
        rows, previous = [], w.copy()
        for i, n in enumerate(element.describing(amplitudes, w)):
            poles = np.empty(0, complex)
            if np.isfinite(n):
                poles = loop_poles(transfer, element, float(amplitudes[i]), float(w[i]), complex(n))
            turning = poles[np.imag(poles) > 1e-6 * np.abs(poles)]
            if turning.size:
                w[i] = complex(turning[int(np.argmax(np.real(turning)))]).imag
            rows.append(poles)
        if np.abs(np.log(w / previous)).max() < 1e-6:
            break
    most = max(row.size for row in rows)
    # where a lag has no phase to give, the order falls and the row has fewer poles
    complete = [i for i, row in enumerate(rows) if most and row.size == most]
    if not complete:
        raise InputError(
            "The quasi-linear loop has no poles at these amplitudes.",
            "Choose amplitudes at which the element has an output.",
        )
    return amplitudes[complete], np.array([rows[i] for i in complete])


def pole_figure(
    transfer: Transfer,
    element: Nonlinearity,
    ends: tuple[float, float],
    *,
    factor: float = 1.0,
    label: str = "amplitude",
) -> Figure:
    """The figure; amplitudes are shown times ``factor``."""
    a, poles = pole_path(transfer, element, np.geomspace(*ends, _COUNT))
    figure = Figure(figsize=(7.6, 5.6), layout="constrained")
    axes = figure.add_subplot()
    reach = _window(transfer, poles)
    near = np.abs(poles) <= 3.0 * reach
    norm = LogNorm(factor * a[0], factor * a[-1])
    colours = np.broadcast_to(factor * a[:, None], poles.shape)[near]
    shown = axes.scatter(
        np.real(poles[near]),
        np.imag(poles[near]),
        c=colours,
        norm=norm,
        cmap="viridis",
        s=13,
        zorder=3,
    )
    figure.colorbar(shown, ax=axes, label=label, shrink=0.85)
    for amplitude, w, to_left in axis_crossings(a, poles):
        word = "stable" if to_left else "unstable"
        axes.plot([0, 0], [w, -w], "o", color="black", markersize=8, markerfacecolor="none")
        axes.annotate(
            f"{word} cycle: {factor * amplitude:.3g}\nat {w:.3g} rad/s",
            (0.0, w),
            xytext=(14, 10),
            textcoords="offset points",
            fontsize=8.5,
            arrowprops={"arrowstyle": "-", "color": "0.4", "linewidth": 0.7},
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
        )
    axes.axvline(0.0, color="0.3", linewidth=1.0, zorder=1)
    axes.axhline(0.0, color="0.7", linewidth=0.7, zorder=1)
    title = f"Poles of the quasi-linear loop\n{literal(str(element))}"
    styled(axes, title, "real part [1/s]", "imaginary part [rad/s]")
    axes.set_xlim(-1.3 * reach, 1.0 * reach)
    axes.set_ylim(-1.2 * reach, 1.2 * reach)
    return figure


def axis_crossings(a: np.ndarray, poles: np.ndarray) -> list[tuple[float, float, bool]]:
    """Where a pair crosses the imaginary axis: amplitude, frequency, and whether to the left."""
    crossed = []
    upper = np.where(np.imag(poles) > 1e-6 * np.abs(poles), poles, -np.inf)
    best = np.argmax(np.real(upper), axis=1)
    pair = upper[np.arange(a.size), best]
    for i in range(a.size - 1):
        start, end = pair[i], pair[i + 1]
        if np.isfinite(start.real) and np.isfinite(end.real) and start.real * end.real < 0:
            share = start.real / (start.real - end.real)
            amplitude = a[i] * (a[i + 1] / a[i]) ** share
            w = start.imag + share * (end.imag - start.imag)
            crossed.append((float(amplitude), float(w), bool(end.real < 0)))
    return crossed


def _window(transfer: Transfer, poles: np.ndarray) -> float:
    """How far from the origin the figure reaches: around the pairs near the imaginary axis."""
    pair = poles[np.abs(np.imag(poles)) > 1e-6 * np.abs(poles)]
    near = np.abs(pair[np.abs(np.real(pair)) < 0.6 * np.abs(pair)])
    if near.size:
        return 1.3 * float(min(near.max(), 4.0 * np.median(near)))
    return 2.0 * float(transfer.corners[-1])
