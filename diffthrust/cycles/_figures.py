"""Figures of a loop: G(jw) against -1/N(A, w), its poles, and its course from rest."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from diffthrust._support.envelope import stretches
from diffthrust._support.figures import BLUE, GREY, VERMILLION, literal, styled
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._crossings import axis_crossings, pole_path
from diffthrust.cycles._element import LimitCycle, LoopCourse, Nonlinearity

_MARKS = {"stable": ("o", "black"), "unstable": ("o", "white"), "undecided": ("D", "0.7")}
_AMPLITUDES = 64
"""At which poles are drawn."""


def nyquist_figure(
    transfer: Transfer,
    element: Nonlinearity,
    cycles: Sequence[LimitCycle],
    *,
    amplitudes: tuple[float, float],
    frequencies: tuple[float, float],
    nearest: tuple[float, float, float],
    unit: str,
) -> Figure:
    """The polar plot of the linear part and of the element, their crossings labelled.

    The window is laid around the crossings, or without any around the place where the two come
    nearest; parts of the curves far outside are not drawn.
    """
    figure = Figure(figsize=(7.4, 6.8), layout="constrained")
    axes = figure.add_subplot()
    w = np.geomspace(*frequencies, 4000)
    a = np.geomspace(*amplitudes, 400 if element.lags else 2000)
    if not element.lags and element.scale:
        a = np.unique(np.concatenate([a, element.least + element.scale * np.geomspace(1e-6, 50)]))
    places = [complex(transfer(1j * c.frequency)) for c in cycles]
    if not places:
        places = [complex(transfer(1j * nearest[2]))]
    radius = 2.5 * max(max(abs(p) for p in places), 1e-12)
    _drawn(axes, transfer(1j * w), radius, BLUE, "G(jw)", "-")
    crossings = list(dict.fromkeys(c.frequency for c in cycles)) or [nearest[2]]
    for i, frequency in enumerate(crossings if element.lags else crossings[:1]):
        with np.errstate(divide="ignore", invalid="ignore"):
            curve = -1.0 / element.describing(a, frequency)
        label = f"-1/N(A, {frequency:.3g} rad/s)" if element.lags else "-1/N(A)"
        _drawn(axes, curve, radius, VERMILLION, label, ("-", "--", ":", "-.")[i % 4])
    for number, (c, place) in enumerate(zip(cycles, places, strict=False), 1):
        mark, face = _MARKS[c.verdict]
        best, side = c.best, _clear_side(transfer, c.frequency)
        axes.plot(
            [place.real],
            [place.imag],
            mark,
            color="black",
            markerfacecolor=face,
            markersize=7,
            zorder=4,
            label=f"{number}. {c.verdict}: amplitude {best.amplitude:.4g}{unit}, "
            f"{best.frequency:.4g} rad/s",
        )
        axes.annotate(
            str(number),
            (place.real, place.imag),
            xytext=(6, side + math.copysign(11 * ((number - 1) % 3), side)),
            textcoords="offset points",
            fontsize=9,
            fontweight="bold",
            zorder=5,
        )
    axes.axhline(0.0, color="0.5", linewidth=0.7, zorder=0)
    axes.axvline(0.0, color="0.5", linewidth=0.7, zorder=0)
    title = f"G = {transfer}\nN: {literal(str(element))}"
    styled(axes, title, "real part", "imaginary part")
    for limits, parts in (
        (axes.set_xlim, [p.real for p in places]),
        (axes.set_ylim, [p.imag for p in places]),
    ):
        limits(min(0.0, *parts, 0.0) - 0.5 * radius, max(0.0, *parts, 0.0) + 0.5 * radius)
    axes.set_aspect("equal")
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    if not cycles:
        axes.text(
            0.02, 0.98, "no limit cycle in the range", transform=axes.transAxes, va="top",
            fontsize=10,
        )  # fmt: skip
    return figure


def _clear_side(transfer: Transfer, w: float) -> int:
    """Height of a label [points] that keeps off G's curve: below where that rises to the right."""
    ahead = complex(transfer(1.001j * w) - transfer(1j * w))
    return -14 if ahead.real * ahead.imag > 0 else 7


def _drawn(
    axes: Axes, curve: np.ndarray, radius: float, colour: str, label: str, style: str
) -> None:
    """A curve where it is finite and not far outside the window, an arrow in its direction."""
    near = np.isfinite(curve) & (np.abs(curve) < 4.0 * radius)
    named = False
    for begin, end in stretches(near):
        z = curve[begin:end]
        axes.plot(
            np.real(z), np.imag(z), style, color=colour, linewidth=1.5, label="" if named else label
        )
        named = True
        inside = np.flatnonzero(np.abs(z) < 0.9 * radius)
        if inside.size > 4:
            length = np.cumsum(np.abs(np.diff(z[inside], prepend=z[inside[0]])))
            k = int(inside[np.searchsorted(length, 0.6 * length[-1])])
            k = min(max(k, 1), z.size - 1)
            if abs(z[k] - z[k - 1]) > 1e-12 * radius:
                axes.annotate(
                    "", (z[k].real, z[k].imag), (z[k - 1].real, z[k - 1].imag),
                    arrowprops={"arrowstyle": "-|>", "color": colour, "mutation_scale": 16},
                )  # fmt: skip


def course_figure(course: LoopCourse, levels: Mapping[str, float], title: str) -> Figure:
    """Command and thrust over time, with what the formulas and the balance say of the peak."""
    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(course.time, course.output, color=GREY, linewidth=1.6, label="thrust")
    axes.plot(course.time, course.input, color=BLUE, linewidth=1.3, label="command")
    for style, (name, level) in zip((":", "--", "-"), levels.items(), strict=False):
        for side in (level, -level):
            axes.axhline(
                side,
                color=VERMILLION,
                linestyle=style,
                linewidth=0.9,
                label=f"{name}: {level:.2f} N" if side > 0 else "",
            )
    styled(axes, title, "time [s]", "force [N]")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8.5)
    return figure


def pole_figure(
    transfer: Transfer,
    element: Nonlinearity,
    ends: tuple[float, float],
    *,
    factor: float = 1.0,
    label: str = "amplitude",
) -> Figure:
    """The figure; amplitudes are shown times ``factor``."""
    a, poles = pole_path(transfer, element, np.geomspace(*ends, _AMPLITUDES))
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


def _window(transfer: Transfer, poles: np.ndarray) -> float:
    """How far from the origin the figure reaches: around the pairs near the imaginary axis."""
    pair = poles[np.abs(np.imag(poles)) > 1e-6 * np.abs(poles)]
    near = np.abs(pair[np.abs(np.real(pair)) < 0.6 * np.abs(pair)])
    if near.size:
        return 1.3 * float(min(near.max(), 4.0 * np.median(near)))
    return 2.0 * float(transfer.corners[-1])
