"""The plan for a record that black-box models are identified from."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.transfer import transfer_of
from diffthrust._support.validation import finite
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.plans._plan import Plan
from diffthrust.plans._settling import checked_limits, settling_time
from diffthrust.plans._thruster import check_thruster, thruster_outputs

_SLOWER, _FASTER = 3.0, 2.0
"""The band reaches below the slowest and above the fastest time constant by these factors."""
_TO_A_HUNDREDTH = math.log(100.0)
"""Time constants until a first-order lag is within a hundredth of its final value."""
_LONGEST = 14
"""Stages of the longest shift register: 16383 switches to a period."""


def black_box(
    model: Any,
    limits: tuple[float, float],
    *,
    signal: Literal["prbs", "multisine"] = "prbs",
    periods: int = 2,
    step: float | None = None,
    measure: tuple[str, ...] | None = None,
) -> Plan:
    """A periodic record whose band follows from the model's time constants.

    The band reaches from 1 / (3 slowest) to 2 / fastest time constant [rad/s]. Of a linear system
    they are those of its poles; of a thruster, those of its steps from rest to half of the wider
    limit and to the limit itself. Both signals stay within the limits:

    - ``"prbs"``: a maximum-length binary sequence between the limits. It switches at most every
      2.8 / w seconds, so that its spectrum falls to half of its power at the band's end w; its
      period is at least that of the band's beginning. Two levels cannot show a curved map.
    - ``"multisine"``: sines of equal size at all multiples of the band's beginning within the band,
      with Schroeder's phases, which keep the peak of their sum low.

    Args:
        model: a thruster, or a linear system as `limit_cycles` takes it.
        limits: lowest and highest command, in the model's unit (V for a linear system).
        signal: see above.
        periods: number of periods; the first contains the transient.
        step: time between samples [s]; by default an eighth of the shortest switching interval, or
            of the shortest sine's half period.
        measure: channels to measure; by default speed and thrust of a thruster, "depth" of a
            linear system.

    Raises:
        InputError: limits without a range, a linear system that is not stable, a step too long for
            the band, time constants too far apart for a sequence of 16383 switches.

    Source: Aras et al. 2013, section 5 (which does not describe its record); the band and the
    sequence: Rivera, Lee, Braun & Mittelmann 2003, Plant-friendly system identification; the
    phases: Schroeder 1970, IEEE Transactions on Information Theory 16, 85 to 89.

    Example:
        >>> plan = dft.plans.black_box(dft.papers.aras.plant(), limits=(-13, 13))
        >>> list(plan.runs)
        ['black_box_prbs']
    """
    if signal not in ("prbs", "multisine"):
        raise InputError(
            f"black_box, signal: expected 'prbs' or 'multisine', found {signal!r}.", "Correct it."
        )
    count = int(finite("black_box, periods", periods, lambda x: x >= 1, "1 or more"))
    thruster = isinstance(model, Model)
    low, high = checked_limits("black_box", limits)
    slow, fast = _of_thruster(model, max(-low, high)) if thruster else _of_poles(model)
    begin, end = 1.0 / (_SLOWER * slow), _FASTER / fast  # [rad/s]
    longest = math.pi / end if signal == "multisine" else 2.8 / end
    step = longest / 8.0 if step is None else step
    finite("black_box, step", step, lambda x: 0 < x <= longest,
           f"seconds, above zero, up to {longest:.3g}")  # fmt: skip
    make = _binary if signal == "prbs" else _sines
    log = make(begin, end, step)
    # One sample more than whole periods: the last one holds the end of the last interval.
    values = 0.5 * (low + high) + 0.5 * (high - low) * np.append(np.tile(log, count), log[0])
    unit = model.inputs["command"] if thruster else "V"
    run = Log(step * np.arange(values.size), {"command": values}, units={"command": unit})
    return Plan(
        name="black_box",
        source="Aras et al. 2013, section 5",
        runs={f"black_box_{signal}": run},
        settle=run.duration,  # nothing is held
        measure=measure or (tuple(thruster_outputs(model)) if thruster else ("depth",)),
        note="Leave out the first period: it holds the transient.",
        band=(begin / (2.0 * math.pi), end / (2.0 * math.pi)),
    )


def _of_thruster(model: Model, largest: float) -> tuple[float, float]:
    """Slowest and fastest time constant, from steps to half of the largest command and to all."""
    check_thruster("black_box", model)
    times = [settling_time(model, thruster_outputs(model), {"command": share * largest})
             for share in (0.5, 1.0)]  # fmt: skip
    return max(times) / _TO_A_HUNDREDTH, min(times) / _TO_A_HUNDREDTH


def _of_poles(linear: Any) -> tuple[float, float]:
    poles = transfer_of(linear).poles
    if not poles.size or np.any(np.real(poles) >= 0.0):
        raise InputError(
            f"black_box: expected a stable system with poles, found {poles.tolist()}.",
            "An open-loop record needs a plant that comes to rest; close a loop around it first.",
        )
    return float(np.max(-1.0 / np.real(poles))), float(np.min(1.0 / np.abs(poles)))


def _binary(begin: float, end: float, step: float) -> np.ndarray:
    """One period of a maximum-length sequence of -1 and 1."""
    from scipy.signal import max_len_seq  # takes a while

    # 1e-9: the longest step allowed is exactly 2.8 / end, and the quotient may round to below 1.
    held = max(1, math.floor(2.8 / end / step + 1e-9))
    switches = 2.0 * math.pi / (begin * held * step)
    stages = max(3, math.ceil(math.log2(switches + 1.0)))
    if stages > _LONGEST:
        raise InputError(
            f"black_box: time constants that differ by a factor of {end / begin / 6.0:.3g} take "
            f"a sequence of {2**stages - 1} switches, more than {2**_LONGEST - 1}.",
            "Use signal='multisine', or two records: one for the slow, one for the fast part.",
        )
    return np.repeat(2.0 * max_len_seq(stages)[0] - 1.0, held)


def _sines(begin: float, end: float, step: float) -> np.ndarray:
    """One period of a sum of sines, to a largest value of 1."""
    samples = math.ceil(2.0 * math.pi / (begin * step))
    base = 2.0 * math.pi / (samples * step)
    order = np.arange(1, math.floor(end / base * (1.0 + 1e-9)) + 1)
    phase = -math.pi * order * (order - 1) / order.size
    # One inverse transform, instead of a sum over thousands of sines.
    lines = np.zeros(samples // 2 + 1, complex)
    lines[order] = np.exp(1j * phase)
    sines = np.fft.irfft(lines, samples)
    return sines / np.max(np.abs(sines))
