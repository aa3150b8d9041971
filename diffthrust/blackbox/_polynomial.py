"""ARX, ARMAX and output-error models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.blackbox._model import BlackBox, ModelKind
from diffthrust.blackbox._prediction_error import Orders, Shape, equations, shape_of, stretches
from diffthrust.blackbox._sampled import Channels, SampledLog, observer_form, sampled_channels
from diffthrust.blackbox._search import (
    FLAT,
    SearchEnd,
    armax_starts,
    bic_of,
    equation_fit,
    judged,
    memory_note,
    output_error_starts,
    samples_of,
    search_coefficients,
    size_of,
)
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._status import Status
from diffthrust.logs._log import Log

_ON_CIRCLE = 0.999
"""Numerics: a zero this near to the circle remembers a thousand samples, as long as a record."""


def arx(
    logs: Log | Sequence[Log],
    *,
    input: str | Sequence[str],
    output: str,
    orders: Orders = (2, 2, 1),
    offset: bool = False,
) -> BlackBox:
    """A(q) y = B(q) u + e, by linear least squares.

    Noise added to the output does not have this form and biases A and B; `output_error` has no such
    bias. No equation reaches from one log into another, or across a missing output.

    Args:
        logs: one or several, evenly sampled with the same step; missing outputs as NaN.
        input: name of the input, or several.
        output: name of the measured channel.
        orders: ``(na, nb, delay)``: coefficients of A and of B, and the samples after which the
            input first acts (1: at the next sample). nb and delay may be tuples by input.
        offset: estimate a constant input, for levels that are not zero at rest.

    Raises:
        InputError: channels are absent, samples uneven or too few, or orders invalid.

    Source: Ljung 1999, System Identification, 2nd edition, section 4.2.

    Example:
        >>> model = dft.blackbox.arx(log, input="command", output="thrust", orders=(1, 1, 1))
        >>> model.covariance.shape
        (2, 2)
    """
    names = ("na", "nb", "delay")
    channels, records, shape = _request("arx", logs, input, output, orders, names, offset)
    theta = equation_fit(records, shape)
    end = judged(stretches(records, shape, theta), theta, shape, size_of(records))
    return polynomial_model("arx", channels, records, shape, end)


def armax(
    logs: Log | Sequence[Log],
    *,
    input: str | Sequence[str],
    output: str,
    orders: Orders = (2, 2, 2, 1),
    offset: bool = False,
) -> BlackBox:
    """A(q) y = B(q) u + C(q) e, by the largest likelihood of one-step prediction errors.

    The errors before a record count as of the same law. Left free they would cost nothing, and the
    search would leave what can predict: noise on the output alone, whose C is A, has zeros near the
    unit circle.

    Arguments and errors as in `arx`, with ``orders = (na, nb, nc, delay)``.

    Source: Ljung 1999, sections 4.2, 7.2 and 10.2 to 10.3; Ansley 1979, Biometrika 66, for the
    likelihood; Hannan & Rissanen 1982, Biometrika 69, for the second of two starts.

    Example:
        >>> model = dft.blackbox.armax(log, input="command", output="thrust", orders=(1, 1, 1, 1))
        >>> model.status, len(model.parameters)
        (<Status.CONVERGED: 'converged'>, 3)
    """
    names = ("na", "nb", "nc", "delay")
    channels, records, shape = _request("armax", logs, input, output, orders, names, offset)
    return searched("armax", channels, records, shape, armax_starts(records, shape))


def output_error(
    logs: Log | Sequence[Log],
    *,
    input: str | Sequence[str],
    output: str,
    orders: Orders = (2, 2, 1),
    offset: bool = False,
) -> BlackBox:
    """Output = B(q) / F(q) u + e, by the least error of free simulation.

    Unbiased under any output noise that is independent of the input; standard errors allow for
    autocorrelated noise. Unstable systems cannot be simulated far: use `armax`. Several inputs
    share F.

    Arguments and errors as in `arx`, with ``orders = (nb, nf, delay)``.

    Source: Ljung 1999, sections 4.2 and 10.2 to 10.3; Steiglitz & McBride 1965 for the start.

    Example:
        >>> model = dft.blackbox.output_error(
        ...     log, input="command", output="thrust", orders=(1, 1, 1)
        ... )
        >>> model.status
        <Status.CONVERGED: 'converged'>
    """
    names = ("nb", "nf", "delay")
    channels, records, shape = _request("output_error", logs, input, output, orders, names, offset)
    return searched("output_error", channels, records, shape, output_error_starts(records, shape))


def _request(
    what: str,
    logs: Log | Sequence[Log],
    input: str | Sequence[str],
    output: str,
    orders: Orders,
    names: Sequence[str],
    offset: bool,
) -> tuple[Channels, list[SampledLog], Shape]:
    channels, records = sampled_channels(logs, input, output, offset)
    if len(channels.outputs) > 1:
        raise InputError(
            f"{what}: expected one output, found {len(channels.outputs)}.",
            "Make one model for each output, or use dft.blackbox.state_space.",
        )
    shape = shape_of(what, orders, names, channels)
    if not what == "output_error" and not shape.size:
        raise InputError(f"{what}, orders: nothing to estimate.", "Raise the orders.")
    check_enough(what, records, shape)
    return channels, records, shape


def check_enough(what: str, records: Sequence[SampledLog], shape: Shape) -> None:
    """Raise `InputError` if there are too few samples for the coefficients."""
    usable = sum(t.size for record in records for t, _, _ in equations(record, shape))
    if usable <= 2 * shape.size:
        raise InputError(
            f"{what}: {usable} equations without a missing sample for {shape.size} coefficients; "
            "expected more than twice as many.",
            "Give longer logs, or lower the orders or the delay.",
        )


def searched(
    kind: ModelKind,
    channels: Channels,
    records: Sequence[SampledLog],
    shape: Shape,
    starts: Sequence[np.ndarray],
) -> BlackBox:
    """The model at the best point of a search."""
    try:
        end = search_coefficients(records, shape, starts)
    except FloatingPointError:
        raise InputError(
            f"{kind}: no start gives a simulation that stays finite over the logs' length.",
            "Use dft.blackbox.armax, whose predictions lean on the measured output, or shorter "
            "logs.",
        ) from None
    return polynomial_model(kind, channels, records, shape, end)


def polynomial_model(
    kind: ModelKind,
    channels: Channels,
    records: Sequence[SampledLog],
    shape: Shape,
    end: SearchEnd,
) -> BlackBox:
    """The result with its names, units, systems and notes."""
    a, b, c = shape.split(end.theta)
    inputs = len(channels.inputs)
    nb, delay = (each[0] if inputs == 1 else each[:inputs] for each in (shape.nb, shape.delays))
    orders: Mapping[str, Any] = {
        "arx": {"na": shape.na, "nb": nb},
        "armax": {"na": shape.na, "nb": nb, "nc": shape.nc},
        "output_error": {"nb": nb, "nf": shape.na},
        "state_space": {"order": shape.na},
    }[kind] | {"delay": delay}
    polynomials = {"f" if kind == "output_error" else "a": a}
    polynomials |= {f"b_{name}" if inputs > 1 else "b": row
                    for name, row in zip(channels.inputs, b, strict=False)}  # fmt: skip
    polynomials |= {"c": c} if shape.nc else {}
    system, plain = observer_form(a, b, shape.delays, c), observer_form(a, b, shape.delays, [1.0])
    bic, deviation = bic_of(system, records, shape.size)
    status, notes = _status(shape, end)
    return BlackBox(
        kind=kind,
        orders=orders,
        channels=channels,
        parameters=_named(shape, end, channels),
        covariance=end.covariance,
        noise={channels.outputs[0]: float(deviation[0])},
        polynomials=polynomials,
        system=system,
        plain=plain,
        status=status,
        bic=bic,
        samples=samples_of(records),
        notes=notes,
    )


def _status(shape: Shape, end: SearchEnd) -> tuple[Status, tuple[str, ...]]:
    """What may be claimed of the end of a search, and the notes."""
    _, _, c = shape.split(end.theta)
    status = Status.CONVERGED if end.stationary else Status.NOT_CONVERGED
    notes = [*memory_note(end.memory, shape.tied)]
    if end.rank < shape.size:
        status = Status.NOT_IDENTIFIABLE
    elif not end.stationary:
        slope = f"cosine between residuals and gradient {end.flat:.1g}, expected below {FLAT:g}"
        notes.append(f"The search ended on a slope: {slope}.")
    if shape.nc and not shape.tied and np.abs(np.roots(c)).max(initial=0.0) > _ON_CIRCLE:
        notes.append(
            "A zero of C lies on the unit circle, where standard errors do not hold: noise of the "
            "output alone looks like this: use output_error."
        )
    if status is Status.NOT_IDENTIFIABLE:
        notes.append(
            f"These logs identify {end.rank} of {shape.size} coefficients: the orders are too "
            "high, the input too plain, or there is no noise for C."
        )
    return status, tuple(notes)


def _named(shape: Shape, end: SearchEnd, channels: Channels) -> dict[str, Estimate]:
    units = channels.units
    out = units[channels.outputs[0]]
    letter = "f" if shape.tied else "a"
    names = [(f"{letter}{i}", "") for i in range(1, shape.na + 1)]
    for name, count, delay in zip(channels.inputs, shape.nb, shape.delays, strict=False):
        of = f"_{name}" if len(channels.inputs) > 1 else ""
        unit = "" if units[name] == out else f"{out or '1'}/{units[name]}" if units[name] else out
        names += [(f"b{i}{of}", unit) for i in range(delay, delay + count)]
    names += [("offset", out)] if channels.offset else []
    names += [(f"c{i}", "") for i in range(1, shape.nc + 1)]
    spread = None if end.covariance is None else np.sqrt(np.diag(end.covariance))
    return {
        name: Estimate(
            float(value), None if spread is None else float(spread[i]), unit, False, False
        )
        for i, ((name, unit), value) in enumerate(zip(names, end.theta, strict=True))
    }
