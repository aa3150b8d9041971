"""Convert black-box models to objects of python-control, if installed."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.blackbox._sampled_model import SampledModel


def control_object(model: SampledModel, form: str) -> Any:
    """The sampled model from inputs to outputs; see `BlackBox.to_control`."""
    try:
        import control
    except ImportError:
        raise InputError(
            "to_control: python-control is not installed.",
            "Install it: python -m pip install control. BlackBox.transfer() needs no more than "
            "this library.",
        ) from None
    if form not in ("transfer", "states"):
        raise InputError(
            f"to_control, form: expected 'transfer' or 'states', found {form!r}.", "Correct it."
        )
    channels = model.channels
    lags = model.plain.lags or (0,) * len(channels.inputs)
    if form == "transfer":
        num, den = model.rational(*model.pair(None, None))
        return control.TransferFunction(
            num,
            np.concatenate([den, np.zeros(lags[0])]),
            model.step,
            inputs=list(channels.inputs),
            outputs=list(channels.outputs),
        )
    return control.StateSpace(
        *_with_lags(model, lags),
        model.step,
        inputs=list(channels.inputs),
        outputs=list(channels.outputs),
    )


def _with_lags(model: SampledModel, lags: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """The matrices with a chain of states for each delayed input; without an offset."""
    m = len(model.channels.inputs)
    s = model.plain
    n, more = s.order, sum(lags[:m])
    a, b = np.zeros((n + more, n + more)), np.zeros((n + more, m))
    c, d = np.zeros((len(s.c), n + more)), np.zeros((len(s.c), m))
    a[:n, :n], c[:, :n] = s.a, s.c
    first = n
    for j, lag in enumerate(lags[:m]):
        if not lag:
            b[:n, j], d[:, j] = s.b[:, j], s.d[:, j]
            continue
        last = first + lag - 1
        # python-control has no input delay in discrete time: each is a chain of unit delays
        b[first, j] = 1.0
        for k in range(first, last):
            a[k + 1, k] = 1.0
        a[:n, last], c[:, last] = s.b[:, j], s.d[:, j]
        first = last + 1
    return a, b, c, d
