"""What closed loops have in common: checks of what is given, signals by name, and running away."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import check_known, finite, whole_number
from diffthrust.logs._log import Log

RUN_AWAY = 1e9
"""A signal beyond this, in SI units, has run away."""


class RunSignals:
    """Signals by name over the samples of a run."""

    time: np.ndarray  # [s], (n,)
    signals: Mapping[str, np.ndarray]  # (n,) each
    diverged: float | None  # when it ran away [s]

    def __getitem__(self, name: str) -> np.ndarray:
        check_known(name, self.signals, "The run has no signal")
        return self.signals[name]

    def __repr__(self) -> str:
        end = "" if self.diverged is None else f", ran away at {self.diverged:.3g} s"
        return f"{type(self).__name__}({self.time[-1]:g} s, {self.time.size} samples{end})"

    def as_log(
        self,
        controller: Any,
        inputs: Mapping[str, np.ndarray],
        measured: Mapping[str, np.ndarray],
        units: Mapping[str, str],
        hold: str | Mapping[str, str],
        name: str = "loop",
    ) -> Log:
        """Some of the signals as a recorded experiment, which says where it is from."""
        origin = f"Simulated in a closed loop with {type(controller).__name__}."
        away = () if self.diverged is None else (f"The loop ran away at {self.diverged:.3g} s.",)
        return Log(
            time=self.time,
            inputs=inputs,
            measured=measured,
            units={name: units[name] for name in (*inputs, *measured) if name in units},
            hold=hold,
            name=name,
            notes=(origin, *away),
        )

    def within(self, what: str, start: float | None, stop: float | None) -> np.ndarray:
        """Which samples lie from one time to another; by default the last two thirds.

        Raises:
            InputError: none does, or a time that is no number.
        """
        end = float(self.time[-1])
        first, last = (
            usual if time is None else finite(f"{what}, {name}", time, lambda x: True, "seconds")
            for name, time, usual in (("start", start, end / 3.0), ("stop", stop, end))
        )
        inside = (self.time >= first - 1e-9) & (self.time <= last + 1e-9)
        if not inside.any():
            raise InputError(
                f"{what}: expected samples from {first:g} to {last:g} s, found none; the run lasts "
                f"{end:g} s.",
                "Choose start and stop inside the run.",
            )
        return inside


def bounded(
    time: np.ndarray, signals: Mapping[str, np.ndarray], mend: str
) -> tuple[np.ndarray, dict[str, np.ndarray], float | None]:
    """A run up to where it ran away, read-only, and when that was.

    The mend says what to look at where there is nothing left.
    """
    with np.errstate(invalid="ignore"):
        # NaN compares false: it counts as run away
        fine = np.all([np.abs(values) < RUN_AWAY for values in signals.values()], axis=0)
    diverged, kept = None, dict(signals)
    if not fine.all():
        end = int(np.argmin(fine))
        diverged = float(time[end])
        if end < 2:
            raise InputError(f"The loop ran away at {diverged:g} s, at its first samples.", mend)
        time = time[:end]
        kept = {name: values[:end] for name, values in signals.items()}
    for array in (time, *kept.values()):
        array.flags.writeable = False
    return time, kept, diverged


def check_noise(who: str, noise: Any, channels: Collection[str]) -> None:
    """Raise `InputError` for standard deviations that cannot be meant."""
    example = f'{{"{next(iter(channels))}": 0.3}}'
    for name, level in mapping(f"{who}, noise", noise, example, channels).items():
        finite(f"{who}, noise of '{name}'", level, lambda x: x >= 0, "zero or more")


def mapping(
    what: str,
    values: Any,
    example: str,
    names: Collection[str] | None = None,
    kind: str = "channel",
) -> Mapping[str, Any]:
    """What was given by the names of channels, or of another kind."""
    if not isinstance(values, Mapping):
        raise InputError(
            f"{what}: expected a dictionary by the names of {kind}s, found {values!r}.",
            f"Write {example}.",
        )
    for name in values:
        if names is not None:
            check_known(name, names, f"{what}: there is no {kind}", present="there are")
    return values


def seeded(seed: Any) -> np.random.Generator:
    """The generator of the measurement noise."""
    return np.random.default_rng(whole_number("seed", seed, 0, mend="Write seed=0."))
