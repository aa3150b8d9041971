"""A suggested experiment in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diffthrust._support.words import number
from diffthrust.experiments._designs import KINDS, Design, Space
from diffthrust.experiments._result import Experiment
from diffthrust.logs._written import ShownUnits, Written


def promise_in_words(words: str, test: Experiment, imitator: str) -> str:
    """The channel in which the difference stands out most from the noise, and what follows."""
    apart = {name: test.difference(name, test.truth, imitator) for name in test.noise}
    peaks = {name: float(np.max(np.abs(np.nan_to_num(d)))) for name, d in apart.items()}
    channel = max(peaks, key=lambda name: peaks[name] / test.noise[name])
    shown = ShownUnits((test.written,)).size(channel, peaks[channel], test.units[channel])
    size = f"{number(shown.value, 2)} {shown.unit}".rstrip()
    size = f"{size} ({peaks[channel] / test.noise[channel]:.2g} x the noise)"
    ratio = f"expected log-likelihood ratio {test.expected_log_likelihood_ratio:.3g}"
    pair = " and ".join(f"'{name}'" for name in test.rivals if name in (test.truth, imitator))
    if not test.decisive:
        return (
            f"No test within the limits tells {pair} apart: the best that was tried "
            f"({words[0].lower()}{words[1:]}) makes {channel} differ by at most {size}; {ratio}."
        )
    between = f" between {pair}" if len(test.rivals) > 2 else ""
    return f"{words}: {channel} differs{between} by up to {size}; {ratio}."


def in_words(
    design: Design, space: Space, units: Mapping[str, str], written: Mapping[str, Written]
) -> str:
    """A design in words, in the units in which the inputs were written.

    Example:
        >>> in_words(design, space, {"command": "V"}, {})
        'Staircase of command between -2 V and 2 V, each level held 1.5 s'
    """
    shown = ShownUnits((written,))
    levels = {
        n: [
            f"{_number(float(level))} {shown.unit(n, units[n])}".rstrip()
            for level in shown.values(n, design.levels(n, space), units[n])
        ]
        for n in space.limits
    }
    joined = " and of ".join(f"{n} {_range(design, *levels[n])}" for n in design.moved)
    if len(set(design.moved.values())) > 1:
        joined += " in opposite senses"
    text = f"{KINDS[design.kind].words} of {joined}{_tempo(design, space)}"
    held = [n for n in space.limits if n not in design.moved]
    values = [f"{n} at {levels[n][0]}" for n in held]
    return f"{text}, with {' and '.join(values)}" if values else text


def _range(design: Design, low: str, high: str) -> str:
    if design.kind == "step down":
        low, high = high, low
    if design.kind in ("step up", "step down"):
        return f"from {low} to {high}"
    return f"between {low} and {high}"


def _tempo(design: Design, space: Space) -> str:
    hold = f"{design.hold:.3g} s"
    return {
        "step up": "",
        "step down": "",
        "reversals": f", each side held {hold}",
        "pulses": f", each {hold} long, one every {4 * design.hold:.3g} s",
        "ramps": f", each way in {2 * design.hold:.3g} s",
        "chirp": f", from {1 / space.active:.2g} to {0.5 / design.hold:.3g} Hz",
        "multisine": f", up to {0.5 / design.hold:.3g} Hz",
    }.get(design.kind, f", each level held {hold}")


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value + 0.0:.3g}"
