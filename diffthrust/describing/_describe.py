"""Describing functions: what a model makes of a sinusoid, over its amplitude and frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter
from diffthrust._support.words import joined
from diffthrust.describing._map import DescribingMap
from diffthrust.describing._periodic.harmonic_balance import (
    HarmonicBalance,
    left_out,
    more_than,
    too_few,
)
from diffthrust.describing._periodic.period import Cycle, Lane, remembers
from diffthrust.describing._periodic.respond import (
    PeriodicResponses,
    Reason,
    Solver,
    respond_with_neighbours,
)
from diffthrust.describing._periodic.shooting import Shooting
from diffthrust.describing._request import FORMULAS, MapRequest, request
from diffthrust.estimation._result import Fit
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.simulation._linearise import states_behind


@progressing
def describing_function(
    model: Any,
    amplitudes: Sequence[float] | np.ndarray | float,
    frequencies: Sequence[float] | np.ndarray | float,
    *,
    input: str = "command",
    output: str = "thrust",
    method: str = "simulation",
    harmonics: int = 15,
    samples: int | None = None,
    bias: float = 0.0,
    others: Mapping[str, float] | None = None,
    sensors: bool = False,
    progress: ProgressOption = None,
) -> DescribingMap:
    """Gain and phase of a model under a sinusoid, over amplitude and frequency.

    The input is ``bias + A sin(w t)`` for ever; the describing function is the first harmonic of
    the output over that of the input. Methods:

    - ``"simulation"``: the model and its effects are simulated to their periodic steady state,
      which shooting finds and one further period confirms.
    - ``"harmonic_balance"``: the states are Fourier series of ``harmonics`` terms that satisfy the
      equations in the Galerkin sense. It does not show whether the response is stable. Its
      truncation error is judged by more harmonics and many more instants (``left_out``).
    - ``"paper"``: the quasi-linear lag of Yoerger et al. as printed; the plain thruster only.
    - ``"consistent"``: the same with the amplitude of the thrust's fundamental throughout.

    The first two work for every model, effect, input and output. The period is divided ever more
    finely until the first harmonic is known to 2e-4. Points without an answer (a response
    that diverges, drifts, is unstable, has not settled, or would change by more than 0.1 % or 0.1
    degree with more harmonics) are marked in ``settled`` with their ``reason``. A model may have
    several responses to one input, as where static friction catches a shaft whose speed swings
    about a mean; each method gives one of them. Effects act on the input as on a command that is
    known at every instant: a rate limit or a delay sees a smooth sinusoid and not the samples of a
    log.

    Args:
        model: a model with its effects, or a fit.
        amplitudes: of the input, in its unit, ``(A,)``; positive and increasing.
        frequencies: [rad/s], ``(F,)``; positive and increasing.
        input: the channel that is a sinusoid.
        output: the output that is looked at.
        method: see above.
        harmonics: of the states, for the harmonic balance.
        samples: steps to the period; ``None`` chooses them point by point.
        bias: what the input swings about, in its unit.
        others: constant values of other inputs that the model or its effects read.
        sensors: count the effects on what the sensors report. They are left out by default: what
            acts on a vehicle is the thrust, and not its measurement.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        A `DescribingMap`.

    Raises:
        InputError: an argument that cannot be meant, or a formula for another model than its own.

    Source: Yoerger, Cooke & Slotine 1990, section IV; Gelb & Vander Velde 1968, Multiple-Input
    Describing Functions, chapter 2.

    Example:
        >>> result = dft.describing_function(fit, [0.5, 2.0], [0.5, 2.0], method="harmonic_balance")
        >>> result.gain.shape, bool(result.gain[1, 0] > result.gain[1, 1])
        ((2, 2), True)
    """
    asked = request(
        model, amplitudes, frequencies, input=input, output=output, method=method,
        harmonics=harmonics, samples=samples, bias=bias, others=others, sensors=sensors,
    )  # fmt: skip
    return maps_of([asked], [model], reporter(progress))[0]


def maps_of(
    asked: Sequence[MapRequest], models: Sequence[Any], progress: Progress | None = None
) -> list[DescribingMap]:
    """The maps of models that differ in the values of their parameters, worked out together.

    ``models`` are as the user gave them, for the notes and the units for people.
    """
    first = asked[0]
    parameters = {
        name: np.array([query.model.parameters[name].value for query in asked])
        for name in first.model.parameters
    }
    values = values_of(first, parameters, progress)
    return [
        DescribingMap(
            model=query.model,
            bias=query.bias,
            harmonics=query.harmonics if query.method == "harmonic_balance" else None,
            notes=notes_of(query, source, values["reason"][i]),
            written=source.written if isinstance(source, Fit) else {},
            **query.path,
            **{name: value[i] for name, value in values.items()},
        )
        for i, (query, source) in enumerate(zip(asked, models, strict=True))
    ]


def values_of(
    asked: MapRequest, parameters: Mapping[str, np.ndarray], progress: Progress | None = None
) -> dict[str, np.ndarray]:
    """Fields of `DescribingValues` for parameters ``(D,)``, those that the method gives.

    They are ``(D, A, F)``; of points without an answer NaN, but for their reason and steps.
    """
    if asked.method in FORMULAS:
        spread = {name: value[:, None, None] for name, value in parameters.items()}
        thruster = asked.model.bind(spread).quadratic_load
        assert thruster is not None  # `check_plain` has refused other models
        a, w = asked.amplitudes[None, :, None], asked.frequencies[None, None, :]
        values = quasi_linear(thruster, a, w, asked.output, paper=asked.method == "paper")
        return {"complex": values, "reason": np.zeros(values.shape, int)}
    responses, error = periodic_values(asked, parameters, progress)
    shape = (-1, asked.amplitudes.size, asked.frequencies.size)
    settled = responses.reason == Reason.SETTLED

    def answers(values: np.ndarray) -> np.ndarray:
        return np.where(settled, values, np.nan).reshape(shape)

    return {
        "complex": answers(responses.first),
        "reason": responses.reason.reshape(shape),
        "distortion": answers(responses.distortion),
        "mean": answers(responses.mean),
        "samples": responses.samples.reshape(shape),
        **({} if error is None else {"left_out": error.reshape(shape)}),
    }


def quasi_linear(
    thruster: QuadraticLoad, amplitudes: Any, frequencies: Any, output: str, *, paper: bool
) -> np.ndarray:
    """The describing function, complex: from the command to the thrust [N/V] or speed [rad/(s V)].

    With the speed taken as a sinusoid, speed |speed| is replaced by (8 / 3 pi) times its amplitude
    times the speed; from commanded to delivered thrust the thruster is then a first-order lag. That
    to the thrust is a lag of static gain ct beta / alpha and of the break frequency

        lambda^2 = (-w^2 + sqrt(w^4 + 4 g (Fc / ct)^2)) / 2

    with Fc = ct (beta / alpha) c and gamma = 8 alpha / (3 pi); for the speed the static gain is
    beta / lambda. The paper has g = gamma^4, having taken the amplitude of the thrust as ct times
    the squared amplitude of the speed. With the amplitude of the fundamental of the thrust
    throughout, g = (gamma alpha)^2. In the numbers of the thruster alpha is the load, beta the
    drive's gain.

    Source: Yoerger, Cooke & Slotine 1990, section IV, figure 12.
    """
    w = np.asarray(frequencies)
    gamma = np.asarray(thruster.sine_load)
    weight = gamma**4 if paper else (gamma * thruster.load) ** 2
    steady = thruster.drive_gain / thruster.load * np.asarray(amplitudes)  # speed |speed| at rest
    level = 4.0 * weight * steady**2
    # (-a + sqrt(a^2 + b)) / 2 loses its digits where b is small; this does not
    lag = np.sqrt(0.5 * level / (w**2 + np.sqrt((w**2) ** 2 + level)))
    if output == "speed":
        return np.asarray(thruster.drive_gain) / (lag + 1j * w)
    return np.asarray(thruster.thrust_per_command) * lag / (lag + 1j * w)


def periodic_values(
    asked: MapRequest, parameters: Mapping[str, np.ndarray], progress: Progress | None = None
) -> tuple[PeriodicResponses, np.ndarray | None]:
    """Periodic responses ``(D * A * F,)`` of parameters ``(D,)``; of a balance also `left_out`."""
    draws = next((value.size for value in parameters.values()), 1)
    shape = (draws, asked.amplitudes.size, asked.frequencies.size)

    def spread(values: Any, axis: int) -> np.ndarray:
        place = [1, 1, 1]
        place[axis] = -1
        return np.broadcast_to(np.asarray(values, float).reshape(place), shape).reshape(-1)

    lanes = Lane(
        amplitude=spread(asked.amplitudes, 1),
        frequency=spread(asked.frequencies, 2),
        values={name: spread(value, 0) for name, value in parameters.items()},
        bias=spread(asked.bias, 0),
        others={name: spread(value, 0) for name, value in sorted(asked.others.items())},
        clock=spread(0.0, 0),
    )
    # some instant away from zero, where a slope may vanish by chance and hide a state that matters
    signals = {asked.input: asked.bias + 0.5, **asked.others, "time": 0.5}
    states = states_behind(asked.model, asked.output, asked.states, signals)
    count = len(states)
    cycle = Cycle(asked.input, asked.output, 1, 4 if remembers(asked.model) else 1, states=states)

    def solved_by(solver: Solver) -> PeriodicResponses:
        return respond_with_neighbours(
            solver, cycle, lanes, shape, samples=asked.samples, progress=progress
        )

    if asked.method != "harmonic_balance" or not count:
        return solved_by(Shooting(asked.model, count)), None
    responses = solved_by(HarmonicBalance(asked.model, count, asked.harmonics))
    richer = HarmonicBalance(asked.model, count, more_than(asked.harmonics))
    error = left_out(richer, cycle, lanes, responses)
    responses.reason[too_few(error)] = Reason.FEW_HARMONICS
    return responses, error


def notes_of(asked: MapRequest, source: Any, reason: np.ndarray) -> tuple[str, ...]:
    """Effects that were left out, points without an answer, inputs beyond a limit."""
    complete = source.model if isinstance(source, Fit) else source
    notes = []
    counted = {e.name for e in asked.model.effects}
    sensors = [e.name for e in complete.effects if e.name not in counted]
    if sensors:
        notes.append(
            f"Left out, being effects on what the sensors report: {joined(sensors)} "
            "(sensors=True counts them)."
        )
    size = reason.size
    for kind in Reason:
        count = int(np.sum(reason == kind))
        if count and kind is not Reason.SETTLED:
            notes.append(f"{count} of {size} points are marked: {kind.words}.{_mend(kind, asked)}")
    reach = float(asked.amplitudes[-1]) + abs(asked.bias)
    for effect in asked.model.effects:
        limit = getattr(effect, "limit", None) if asked.input in effect.ports else None
        if limit is not None and reach > limit:
            units = ShownUnits((source.written,) if isinstance(source, Fit) else ())
            size, unit = units.size(asked.input, limit, asked.path["input_unit"])
            notes.append(
                f"Inputs beyond {size:.4g} {unit} are cut by '{effect.name}': the gain falls "
                "with the amplitude there."
            )
    return tuple(notes)


def _mend(kind: Reason, asked: MapRequest) -> str:
    """What to do about a mark, where something can be done."""
    if kind is Reason.FEW_HARMONICS:
        return (
            f" {asked.harmonics} harmonics are too few for corners as sharp as there: give "
            f'harmonics={more_than(asked.harmonics)}, or method="simulation".'
        )
    if kind is Reason.COARSE and asked.method == "harmonic_balance":
        return ' Give method="simulation", which takes shorter steps.'
    if kind is Reason.MEMORY:
        names = joined([e.name for e in asked.model.effects if e.memory])
        return (
            f" Amplitude times frequency is far beyond a rate limit there, or a delay lasts many "
            f"periods: ask for smaller amplitudes or frequencies, or take out {names}."
        )
    return ""
