"""The observer behind the innovations, by itself: its gains, limits and passes."""

# ruff: noqa: F401 (tests take these names from here)

# private: as a comparison and a diagnosis call it, and its parts against closed forms
from diffthrust.estimation import _observer, _rebuild
from diffthrust.estimation._observer import (
    CLIP,
    REAL,
    WIDE,
    Correction,
    Limits,
    Observer,
    direction,
    guesses,
    innovations,
    is_memory,
    limited,
    uncorrected,
)
from diffthrust.estimation._one_step import cost, passes, settled_start, with_clip
from diffthrust.simulation._record import bind


def observer_of(model, log, channels, **options):
    """The observer of a model for some channels of a log."""
    (record,) = bind(model, [log], compared=False)
    return _observer.observer_of(model, record, channels, **options)


def one_step(fit, logs, substeps=1):
    """The one-step errors of a fit on some logs."""
    return _rebuild.one_step(fit, bind(fit.model, logs), substeps)
