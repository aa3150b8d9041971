"""Yoerger, Cooke & Slotine 1990, section III: static tests and the dynamic test of a thruster.

Both are straight lines: of what is steady, and of the derivative of the speed. They need no first
guess and no simulation; noise in the measured speed biases the second (`dynamic_test`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.results import Brief
from diffthrust._support.validation import check_word, finite
from diffthrust.logs._log import Log
from diffthrust.models import QuadraticLoad, Thruster
from diffthrust.papers._line import FittedLine, fit_line, least_squares
from diffthrust.papers._steady import Steady, steady_portions
from diffthrust.simulation._runs import simulate
from diffthrust.uncertainty._prediction.physical import Quantity

__all__ = ["DynamicTest", "StaticTest", "dynamic_test", "static_test"]

CommandDirection = Literal["forward", "reverse", "both"]
_SPEED, _THRUST, _COMMAND = ("speed", "rad/s"), ("thrust", "N"), ("command", "V")


@dataclass(frozen=True, repr=False)
class StaticTest(Brief):
    """The lines through the steady portions of a thruster's records.

    Args:
        thrust: thrust [N] against speed |speed| [rad^2/s^2], through the origin.
        speed: speed |speed| against command [V], through the origin.
        portions: the portions that the points are from.
        direction: of the commands that were used.

    Example:
        >>> static = dft.papers.yoerger.static_test(held, settle=3.0)
        >>> round(static.ct.value, 4), static.ratio.unit, static.direction
        (0.02, 'rad^2/(V s^2)', 'forward')
        >>> figure = static.plot()
    """

    thrust: FittedLine
    speed: FittedLine
    portions: tuple[Steady, ...]
    direction: str

    @property
    def ct(self) -> Quantity:
        """Thrust over speed |speed|."""
        return self.thrust.quantity("N s^2/rad^2")

    @property
    def ratio(self) -> Quantity:
        """The steady speed |speed| over the command: beta / alpha."""
        return self.speed.quantity("rad^2/(V s^2)")

    @showing
    def plot(self) -> Figure:
        """The two lines, as in the paper's figures 8 and 9."""
        from diffthrust.papers._figures import static_test_figure

        return static_test_figure(self.thrust, self.speed, self.ct, self.ratio)


@dataclass(frozen=True, repr=False)
class DynamicTest(Brief):
    """A thruster's parameters from a moving record, by linear least squares.

    Args:
        alpha: [1/rad].
        beta: [rad/(V s^2)].
        ct: [N s^2/rad^2]; ``None`` where the record has no thrust.
        log: the record.

    Example:
        >>> dynamic = dft.papers.yoerger.dynamic_test(log)
        >>> dynamic.alpha.unit, dynamic.beta.unit
        ('1/rad', 'rad/(V s^2)')
        >>> print(dynamic.model)
        thruster
        >>> figure = dynamic.plot()
    """

    alpha: Quantity
    beta: Quantity
    ct: Quantity | None
    log: Log

    @property
    def model(self) -> Thruster:
        """The thruster with these values."""
        model = Thruster(alpha=self.alpha.value, beta=self.beta.value)
        return model if self.ct is None else model.replace(ct=self.ct.value)

    @showing
    def plot(self) -> Figure:
        """Command, and measured and simulated thrust (or speed), as in the paper's figure 10."""
        from diffthrust.papers._figures import dynamic_test_figure

        log = self.log
        name, unit = _SPEED if self.ct is None else _THRUST
        command, measured = log.values(*_COMMAND), log.values(name, unit)
        simulated = simulate(self.model, log)[name]
        return dynamic_test_figure(log.time, command, measured, simulated, f"{name} [{unit}]")


def static_test(
    logs: Log | Sequence[Log],
    *,
    settle: float,
    least: float = 0.5,
    direction: CommandDirection = "forward",
) -> StaticTest:
    """Find ct and beta/alpha from steady thrust, speed and command.

    The standard errors are the larger of two: what the scatter of the points about their line
    gives, and what the noise of the samples in each portion, taken as white, makes of them.

    Args:
        logs: records of ``command``, ``speed`` and ``thrust``, in which levels are held.
        settle: how long the thruster takes to come to rest after a step [s]; it is the longer, the
            smaller the step.
        least: how long a portion must last after that [s].
        direction: of the commands that are used; the paper used forward ones only.

    Returns:
        The lines, their points, and a figure.

    Raises:
        InputError: no record, a channel that is missing, no steady portion in that direction.

    Source: Yoerger, Cooke & Slotine 1990, section III, figures 8 and 9.

    Example:
        >>> round(dft.papers.yoerger.static_test(held, settle=3.0).ct.value, 4)
        0.02
    """
    check_word("direction", direction, *get_args(CommandDirection))
    portions = steady_portions(logs, settle=settle, least=least, inputs=["command"])
    used = [portion for portion in portions if _in_direction(portion.mean(*_COMMAND), direction)]
    if not used:
        raise InputError(
            f"static_test: no steady portion with a command {direction}; "
            f"{len(portions)} portions were found.",
            "Give direction='reverse' or 'both', or records with such commands.",
        )
    command, thrust = (
        np.array([p.mean(*channel) for p in used]) for channel in (_COMMAND, _THRUST)
    )
    speed = np.array([_signed_mean(portion) for portion in used])
    squared = speed * np.abs(speed)
    of_speed, of_thrust = (np.array([p.std_error(*c) for p in used]) for c in (_SPEED, _THRUST))
    of_squared = 2.0 * np.abs(speed) * of_speed
    # a first slope, to turn the speed's noise into an error of the thrust (effective variance)
    ct = fit_line(squared, thrust, "static_test, thrust", through_origin=True).slope
    apart = np.hypot(of_thrust, ct * of_squared)
    return StaticTest(
        fit_line(squared, thrust, "static_test, thrust", through_origin=True, errors=apart),
        fit_line(command, squared, "static_test, speed", through_origin=True, errors=of_squared),
        tuple(used),
        direction,
    )


def dynamic_test(
    log: Log, *, cutoff: float | None = None, direction: CommandDirection = "both"
) -> DynamicTest:
    """Find alpha, beta and ct by least squares on a moving record.

    The change of the speed from sample to sample is explained by the means of speed |speed| and of
    the command between them; all three pass the same zero-phase low-pass first, which leaves their
    relation as it is. Noise in the speed stands on both sides of the equation and biases alpha and
    beta where it is not small against what moves. `fit` has no such bias. The standard errors of
    alpha and beta take residuals for white, which the low-pass makes them not: over repeats of the
    tests' record alpha spreads by 17 % more, beta by 70 %. ct is freed of the noise in the
    speed, of whatever size and colour, with the simulated speed as instrument.

    Args:
        log: ``command`` and ``speed``, and ``thrust`` if it is there; evenly sampled.
        cutoff: of the low-pass [Hz]; a tenth of the sample rate where not given.
        direction: of the samples that are used.

    Raises:
        InputError: a channel that is missing or has gaps, a speed without a sign, a record that is
            not evenly sampled or too short, a cut-off beyond half the sample rate, an alpha or beta
            that is not positive.

    Source: Yoerger, Cooke & Slotine 1990, section III, figure 10. How the derivative was formed is
    not printed there.

    Example:
        >>> dynamic = dft.papers.yoerger.dynamic_test(log)
        >>> dynamic.beta.unit
        'rad/(V s^2)'
    """
    from scipy.signal import butter, sosfiltfilt  # takes a while

    check_word("direction", direction, *get_args(CommandDirection))
    if not isinstance(log, Log):
        raise InputError(
            f"dynamic_test: expected one Log, found {type(log).__name__}.",
            "Give one record at a time.",
        )
    speed, command = log.values(*_SPEED), log.values(*_COMMAND)
    thrust = log.values(*_THRUST) if "thrust" in log.measured else None
    if "speed" in log.unsigned:
        raise InputError(
            f"{log.name}: the sensor of 'speed' gives no sign; the dynamic test needs one.",
            "Use dft.fit, which takes care of it.",
        )
    steps = np.diff(log.time)
    rate = 1.0 / float(np.median(steps))
    cutoff = 0.1 * rate if cutoff is None else cutoff
    _check_record(log, steps, speed, cutoff, rate)
    low = butter(2, cutoff, fs=rate, output="sos")

    def smooth(values: np.ndarray) -> np.ndarray:
        return np.asarray(sosfiltfilt(low, values))

    # what beta and alpha multiply in the equation of the shaft
    driving, braking = QuadraticLoad.terms(command, speed)
    held = log.hold["command"] == "zero"
    # means over the interval and not values at its start: the difference of the speed is an
    # integral, and values at the start would be half a sample early
    drive = smooth(driving[:-1] if held else 0.5 * (driving[:-1] + driving[1:]))
    load = smooth(0.5 * (braking[:-1] + braking[1:]))
    slope = smooth(np.diff(speed) * rate)
    used = np.ones(slope.size, bool) if direction == "both" else (speed[:-1] > 0)
    used = ~used if direction == "reverse" else used
    matrix = np.stack([load, drive], axis=1)[used]
    if len(matrix) < 3 or np.linalg.matrix_rank(matrix) < 2:
        raise InputError(
            "dynamic_test: speed and command do not move enough to separate the coefficients.",
            "Give a record that moves, in the direction that is asked for.",
        )
    values, errors = (x.tolist() for x in least_squares(matrix, slope[used]))
    ct = None
    if thrust is not None:
        valid = used & np.isfinite(thrust[:-1])
        simulated = _simulated(log, *values)[:-1][valid]
        ct = Quantity(*thrust_line(speed[:-1][valid], thrust[:-1][valid], simulated), "N s^2/rad^2")
    alpha, beta = map(Quantity, values, errors, ("1/rad", "rad/(V s^2)"))
    return DynamicTest(alpha, beta, ct, log)


def _simulated(log: Log, alpha: float, beta: float) -> np.ndarray:
    """The speed under these values; or an `InputError`, where they are none of a thruster."""
    for name, value in {"alpha": alpha, "beta": beta}.items():
        if not value > 0:
            raise InputError(
                f"dynamic_test: {name} came out as {value:.3g}, which has no meaning.",
                "Look at the signs of speed and command, and whether the record moves.",
            )
    return simulate(Thruster(alpha=alpha, beta=beta), log)["speed"]


def _signed_mean(portion: Steady) -> float:
    """The mean speed; where the sensor gives no sign it has that of the command."""
    speed = portion.mean(*_SPEED)
    if "speed" not in portion.log.unsigned:
        return speed
    return abs(speed) * float(np.sign(portion.mean(*_COMMAND)))


def _in_direction(command: float, direction: str) -> bool:
    return command != 0 and (direction == "both" or (command > 0) == (direction == "forward"))


def _check_record(
    log: Log, steps: np.ndarray, speed: np.ndarray, cutoff: float, rate: float
) -> None:
    if np.ptp(steps) > 1e-3 * np.median(steps) or len(log) < 30:
        raise InputError(
            f"{log.name}: expected 30 or more evenly spaced samples, found {len(log)} with steps "
            f"of {steps.min():g} to {steps.max():g} s.",
            "Use dft.fit, which takes any time stamps.",
        )
    if not np.all(np.isfinite(speed)):
        raise InputError(
            f"{log.name}: 'speed' has {int(np.sum(~np.isfinite(speed)))} missing samples.",
            "Use dft.fit, which leaves them out, or a stretch without gaps: log.slice(...).",
        )
    expected = f"Hz, above zero and below half the sample rate, {0.5 * rate:g} Hz"
    finite("dynamic_test, cutoff", cutoff, lambda x: 0 < x < 0.5 * rate, expected)


def thrust_line(
    speed: np.ndarray, thrust: np.ndarray, simulated: np.ndarray
) -> tuple[float, float]:
    """The ct, and its standard error, of thrust = ct speed |speed|, where the speed carries noise.

    With noise e of variance s^2, (W + e)|W + e| is W|W| + 2|W| e + e^2: the line of least squares
    is too flat by 4 s^2 W^2 over W^4, and the square too large by s^2 besides. A simulated speed
    is independent of e: with its square as instrument the first error vanishes. The slope that
    least squares lose against it gives s^2, by which the squares are then lowered. Without noise
    both lines agree. The noise of the thrust must be independent of the speed's; the simulated
    speed need not be exact.

    Source: Soderstrom & Stoica 1983, Instrumental Variable Methods, section 3; the standard error
    is that of unequal variances (White 1980, Econometrica 48, 817).
    """
    squared, instrument = speed * np.abs(speed), simulated * np.abs(simulated)
    if not instrument @ squared > 0.0:
        raise InputError(
            "dynamic_test: the measured speed is unrelated to the speed that a simulation of the "
            "command gives.",
            "Look at the signs of speed and command, and whether the record moves.",
        )
    flat = (squared @ thrust) / (squared @ squared)
    steep = (instrument @ thrust) / (instrument @ squared)
    flatter = 1.0 - flat / steep if steep else 0.0
    # from flat / steep = 1 - 4 s^2 sum W^2 / sum W^4, by samples in the place of expectations
    variance = max(flatter, 0.0) * (squared @ squared) / (4.0 * speed @ speed)
    squared = squared - variance * np.sign(speed)
    ct = (instrument @ thrust) / (instrument @ squared)
    residual = instrument * (thrust - ct * squared)
    return float(ct), float(np.sqrt(residual @ residual) / (instrument @ squared))
