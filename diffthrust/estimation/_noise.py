"""What noise a simulation's residuals are taken for: white, or of a kind that lasts.

A noise model is one class: its parameters, what it makes of the residuals, and what a fit says
where they are not of its kind. `_arguments` lists them by the words of `fit`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from diffthrust.estimation._laws import Law
from diffthrust.estimation._numbers import AnyArray, Batch, ProblemNumbers
from diffthrust.models._base.parameter import Parameter

WHITE = 0.1
"""Errors with no reason to be correlated at all are reported beyond this lag-one correlation."""
_CORRELATED = 0.5
"""The same for residuals of a simulation, which always are a little."""


class Whiteness(NamedTuple):
    """Where errors are correlated that a likelihood takes as white."""

    limit: float  # the lag-one correlation beyond which it is said
    sentence: str  # with `{}` for the channels
    whole_runs: bool = False  # of the residuals of whole runs, not of what the likelihood sums


class Likeliest(NamedTuple):
    """How likely a noise makes residuals, at its best parameters."""

    cost: float  # negative log-likelihood, with all constants
    lag_one: float = 0.0  # correlation from one step to the next


class NoiseModel(ABC):
    """A model of measurement noise; fixes the compiled code of a problem."""

    word: ClassVar[str]
    """Its name among the noise models of `fit`."""
    lasts: ClassVar[bool] = True
    """From sample to sample: what a likelihood sums is what is new in each, and a noise level that
    a log gives is not its level."""

    def parameters(self, channels: Sequence[str]) -> dict[str, Parameter]:
        """Its parameters, by name, which are estimated with those of the model."""
        return {}

    def guesses(self, names: Collection[str]) -> tuple[Mapping[str, float], ...]:
        """Values of them from which to start, in turn; those not named stay as they are."""
        return ({},)

    def arranged(self, numbers: ProblemNumbers, step: float) -> ProblemNumbers:
        """The numbers, whose restarts are set, with what it needs to know of the samples.

        ``step`` is the shortest step of the logs [s].
        """
        return numbers

    def new(
        self,
        channels: Sequence[str],
        rests: Sequence[Any],
        log: Batch,
        numbers: ProblemNumbers,
        values: Mapping[str, Any],
    ) -> Sequence[Any]:
        """What is new in each residual of one log, ``(T,)`` by channel; traceable."""
        return rests

    def levels(
        self, channels: Sequence[str], numbers: ProblemNumbers, values: Mapping[str, Any]
    ) -> Any:
        """The level of what is new over that of the noise, ``(C,)``."""
        return np.ones(len(channels))

    def likeliest(
        self, runs: Sequence[np.ndarray], times: Sequence[np.ndarray], law: Law, step: float
    ) -> Likeliest | None:
        """How likely it makes the residuals of one channel, without a fit.

        Of each run the residuals, ``(n,)``, NaN where nothing was measured, and the ``times`` of
        the samples [s]; ``law`` is that of what is new in each residual. Correlations are those
        over one ``step`` [s]. ``None`` where it does not say: the advice on noise leaves it out.
        """
        return None

    def independent(
        self, channels: Sequence[str], numbers: ProblemNumbers, values: Mapping[str, float]
    ) -> float:
        """How many independent samples tell as much about a mean."""
        return float(np.sum(numbers.counts))

    @abstractmethod
    def whiteness(self, tables: bool) -> Whiteness:
        """What is said where the residuals are not of this kind.

        The logs may be ``tables`` of readings, without a time of their own.
        """


@dataclass(frozen=True)
class White(NoiseModel):
    """Noise that knows nothing of the sample before."""

    word: ClassVar[str] = "white"
    lasts: ClassVar[bool] = False

    def likeliest(
        self, runs: Sequence[np.ndarray], times: Sequence[np.ndarray], law: Law, step: float
    ) -> Likeliest:
        return Likeliest(law.level_cost(np.concatenate([run[np.isfinite(run)] for run in runs])))

    def whiteness(self, tables: bool) -> Whiteness:
        """Residuals of a simulation are seldom white: a little correlation is no news."""
        return Whiteness(
            _CORRELATED,
            "Residuals are correlated from sample to sample ({}): something is missing from the "
            "model, or the noise is coloured. The standard errors assume white noise and are too "
            "small" + ("." if tables else "; see Comparison.noise_advice."),
            whole_runs=True,
        )


_DIGITS = 6
"""Gaps of time are equal where they agree to so many digits."""
_FAR = 1e15
"""The gap where there is no earlier sample: nothing lasts so long, and it has a derivative."""
RANGE = (1e-3, 0.9999)
"""Of the correlation from one step to the next: from white noise to a random walk."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Links:
    """For each sample the one measured before it."""

    past: Int[AnyArray, "logs channels time"]  # its index,
    gap: Float[AnyArray, "logs channels time"]  # how long before [steps]; _FAR if there is none


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Gaps:
    """The gaps of all logs: their sizes [steps], and how often each occurs."""

    steps: Float[AnyArray, "channels sizes"]
    counts: Float[AnyArray, "channels sizes"]


@dataclass(frozen=True)
class AR1(NoiseModel):
    """Each channel's noise is a first-order autoregression, whose correlation is estimated.

    The noise of a sample is a share of the previous sample's noise plus an innovation. A residual r
    at a gap of d steps after the previous one, p, becomes its innovation, scaled to the same level
    whatever the gap,

        w = (r - phi p) / sqrt(1 - phi^2),    phi = lag_one ^ d,

    which is white where the model is right; the first residual of a run stands for itself. The
    density also has the factors 1 / sqrt(1 - phi^2). They are taken into the residuals, all
    multiplied by the geometric mean of sqrt(1 - phi^2): with an estimated level this gives the
    exact likelihood (Box & Jenkins 1970, section 7.1, and a change of scale), for the Gaussian and
    for the Student-t law, as a sum of squares with a forward-mode derivative. In the correlation
    from one step to the next it is a linear regression, which a fit solves from anywhere.
    """

    word: ClassVar[str] = "ar1"

    def parameters(self, channels: Sequence[str]) -> dict[str, Parameter]:
        """The correlations of the channels' noise, by name, with a value to start from.

        Example:
            >>> AR1().parameters(["speed"])["noise.speed.lag_one"].value
            0.5
        """
        return {_name(c): Parameter(0.5, "", RANGE, size=0.3) for c in channels}

    def guesses(self, names: Collection[str]) -> tuple[Mapping[str, float], ...]:
        """As given, and twice nearly white."""
        nearly = dict.fromkeys(names, 0.02)
        return {}, nearly, nearly

    def arranged(self, numbers: ProblemNumbers, step: float) -> ProblemNumbers:
        batches = []
        for batch in numbers.batches:
            time = np.asarray(batch.time)
            anew = np.zeros(time.shape, bool)
            for restart in batch.restarts.values():
                anew |= np.isfinite(np.asarray(restart.value))
            links = linked(time, np.asarray(batch.measured), anew, step)
            batches.append(replace(batch, links=links))
        return replace(numbers, batches=batches, gaps=_gaps([batch.links for batch in batches]))

    def new(
        self,
        channels: Sequence[str],
        rests: Sequence[Any],
        log: Batch,
        numbers: ProblemNumbers,
        values: Mapping[str, Any],
    ) -> Sequence[Any]:
        scales, links = self.levels(channels, numbers, values), log.links
        whitened = []
        for i, (name, residual) in enumerate(zip(channels, rests, strict=True)):
            finite = ~jnp.isnan(log.measured[i])
            past, gap = links.past[i], links.gap[i]
            lag_one = values[_name(name)]
            whitened.append(_whitened(residual, finite, past, gap, lag_one, scales[i]))
        return whitened

    def levels(
        self, channels: Sequence[str], numbers: ProblemNumbers, values: Mapping[str, Any]
    ) -> Any:
        gaps: Gaps = numbers.gaps
        kept = jnp.stack([jnp.asarray(values[_name(c)]) for c in channels])
        by_channel = zip(kept, gaps.steps, gaps.counts, numbers.counts, strict=True)
        return jnp.stack([_level(*channel) for channel in by_channel])

    def likeliest(
        self, runs: Sequence[np.ndarray], times: Sequence[np.ndarray], law: Law, step: float
    ) -> Likeliest:
        from scipy.optimize import minimize_scalar  # slow to import

        links = [
            linked(time[None], run[None, None], np.zeros((1, run.size), bool), step)
            for run, time in zip(runs, times, strict=True)
        ]

        def cost(lag_one: float) -> float:
            series, jacobian = [], 0.0
            for run, link in zip(runs, links, strict=True):
                measured, kept = np.isfinite(run), lag_one ** link.gap[0, 0]
                scale = np.sqrt(1 - kept**2)
                new = (run - kept * np.nan_to_num(run)[link.past[0, 0]]) / scale
                series.append(new[measured])
                jacobian += float(np.sum(np.log(scale[measured])))
            return law.level_cost(np.concatenate(series)) + jacobian

        (lag,) = self.parameters([""]).values()
        if lag.fixed:
            return Likeliest(cost(lag.value), lag.value)
        best: Any = minimize_scalar(cost, bounds=RANGE, method="bounded")
        return Likeliest(float(best.fun), float(best.x))

    def independent(
        self, channels: Sequence[str], numbers: ProblemNumbers, values: Mapping[str, float]
    ) -> float:
        """Of the samples that are measured, as far apart as they are on the whole."""
        gaps: Gaps = numbers.gaps
        total = 0.0
        for i, name in enumerate(channels):
            often = np.asarray(gaps.counts[i])
            apart = float(often @ np.asarray(gaps.steps[i])) / max(float(often.sum()), 1.0)
            kept = values[_name(name)] ** apart  # between neighbours, some steps apart
            total += float(numbers.counts[i]) * (1 - kept) / (1 + kept)
        return max(total, 2.0)

    def whiteness(self, tables: bool) -> Whiteness:
        """What is new has no reason to be correlated."""
        return Whiteness(
            WHITE,
            "What is new in the noise at each sample is still correlated with the sample before "
            "({}): the noise is of another kind, or something is missing from the model. The "
            "standard errors assume an autoregression and are too small.",
        )


def _name(channel: str) -> str:
    """The parameter of a channel's noise: its correlation from one step to the next."""
    return f"noise.{channel}.lag_one"


def linked(time: np.ndarray, measured: np.ndarray, anew: np.ndarray, step: float) -> Links:
    """For each sample the one measured before it, and how long before, counted in ``step`` [s].

    Of ``measured``, ``(B, C, T)``, at times ``(B, T)`` [s]; NaN where nothing was measured. Where a
    simulation begins ``anew``, ``(B, T)``, the noise does so, too.
    """
    finite = np.isfinite(measured)
    place = np.arange(time.shape[1])
    latest = np.maximum.accumulate(np.where(finite, place, -1), axis=2)
    past = np.concatenate([np.full((*finite.shape[:2], 1), -1), latest[..., :-1]], axis=2)
    segment = np.cumsum(anew, axis=1)
    row = np.arange(time.shape[0])[:, None, None]
    previous = np.maximum(past, 0)
    together = finite & (past >= 0) & (segment[row, previous] == segment[:, None, :])
    gap = np.where(together, (time[:, None, :] - time[row, previous]) / step, _FAR)
    return Links(np.where(together, past, 0), gap)


def _gaps(links: Sequence[Links]) -> Gaps:
    """The gaps of all logs."""
    by_channel = []
    for channel in zip(*(np.moveaxis(np.asarray(b.gap), 1, 0) for b in links), strict=True):
        all_gaps = np.concatenate([gaps.ravel() for gaps in channel])
        finite = all_gaps[all_gaps < _FAR]
        size = 10.0 ** np.floor(np.log10(finite))
        rounded = np.round(finite / size, _DIGITS - 1) * size
        _, first, counts = np.unique(rounded, return_index=True, return_counts=True)
        by_channel.append((finite[first], counts))
    widest = max(steps.size for steps, _ in by_channel)

    def padded(values: np.ndarray, fill: float) -> np.ndarray:
        return np.concatenate([values, np.full(widest - values.size, fill)])

    return Gaps(
        steps=np.stack([padded(steps, _FAR) for steps, _ in by_channel]),
        counts=np.stack([padded(counts.astype(float), 0.0) for _, counts in by_channel]),
    )


def _level(lag_one: Any, gap: Any, often: Any, samples: Any) -> Any:
    """Geometric mean of sqrt(1 - phi^2): the level of what is new over that of the noise."""
    return jnp.exp(0.5 * jnp.sum(often * jnp.log1p(-(lag_one ** (2.0 * gap)))) / samples)


def _whitened(residual: Any, finite: Any, past: Any, gap: Any, lag_one: Any, scale: Any) -> Any:
    """What is new in each residual of one channel, ``(T,)``; zero where nothing was measured."""
    phi = lag_one**gap
    return jnp.where(
        finite, scale * (residual - phi * residual[past]) / jnp.sqrt(1.0 - phi**2), 0.0
    )
