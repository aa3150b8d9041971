"""A suggested experiment: inputs to send, and predictions of the rival models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from diffthrust._support.figures import showing
from diffthrust._support.files import write_whole
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust.logs._written import ShownUnits, Written

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Trial(NamedTuple):
    """A design that was tried.

    Args:
        kind: the family, such as "staircase".
        parameters: lowest and highest value of each input, ``share`` of the way to the limits, and
            ``hold`` [s], the time per level or half the shortest period.
        separation: the criterion for the worst separated pair.
        words: the design in words.
    """

    kind: str
    parameters: dict[str, tuple[float, float] | float]
    separation: float
    words: str


@dataclass(frozen=True, repr=False)
class Experiment(Result):
    """A test that separates rival models, and its expected result.

    Args:
        sentence: the test and its expected result in words.
        time: sample instants [s], ``(T,)``.
        inputs: the series to send to the vehicle, ``(T,)`` each, each value held to the next.
        log_inputs: these and the constant inputs: the inputs of the future log.
        ranking: all designs tried, the best first.
        rivals: names of the models.
        separation: the criterion for the worst separated pair: the sum of squared differences over
            the noise, after one rival has imitated the other as well as it can. Half of it is the
            expected log-likelihood ratio, whose standard deviation is the square root of the
            separation. It is an upper bound, from the best of 16 searches for an imitation: for
            large models with poorly known parameters it may be too high by a factor of two.
        separations: the same for every pair ``(truth, imitator)``; for nested models only with the
            larger one as the truth, since the smaller is its special case.
        decisive: whether the test is expected to discriminate the rivals.
        truth: the rival that, if true, is hardest to discriminate from another.
        predictions: outputs by rival and channel, ``(T,)`` each: of ``truth`` itself, and of the
            others imitating it.
        noise: standard deviation of each channel's noise.
        units: of inputs and channels.
        written: how the logs so far wrote them; used as display units.

    Example:
        >>> rivals = [dft.Thruster(), dft.Thruster() + dft.effects.CommandDeadband(half_width=0.4)]
        >>> test = dft.suggest_experiment(
        ...     rivals,
        ...     limits={"command": (-2, 2)},
        ...     duration=6.0,
        ...     step=0.1,
        ...     noise={"speed": 0.3, "thrust": 0.2},
        ... )
        >>> test.decisive, test.rivals
        (True, ('thruster', 'thruster + command_deadband'))
        >>> test.expected_log_likelihood_ratio > 3, test.difference("speed", *test.rivals).shape
        (True, (61,))
        >>> test.to_csv("test.csv")
        >>> figure = test.plot()
    """

    sentence: str
    time: np.ndarray = field(repr=False)
    inputs: Mapping[str, np.ndarray] = field(repr=False)
    log_inputs: Mapping[str, np.ndarray] = field(repr=False)
    ranking: tuple[Trial, ...] = field(repr=False)
    rivals: tuple[str, ...]
    separation: float
    separations: Mapping[tuple[str, str], float]
    decisive: bool
    truth: str
    predictions: Mapping[str, Mapping[str, np.ndarray]] = field(repr=False)
    noise: Mapping[str, float]
    units: Mapping[str, str] = field(repr=False)
    written: Mapping[str, Written] = field(default_factory=dict, repr=False)

    @property
    def expected_log_likelihood_ratio(self) -> float:
        """Expected log-likelihood ratio of the true to the wrong rival, for the worst pair."""
        return 0.5 * self.separation

    def difference(self, channel: str, one: str, other: str) -> np.ndarray:
        """The prediction of one rival minus that of another, ``(T,)``."""
        return self.predictions[one][channel] - self.predictions[other][channel]

    @showing
    def plot(self) -> Figure:
        """Plot the inputs, the predictions of the rivals with noise, and the difference."""
        from diffthrust.experiments._figures import experiment_figure

        shown, units = ShownUnits((self.written,)), self.units

        def series(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            return {name: shown.values(name, x, units[name]) for name, x in values.items()}

        order = [self.truth, *(name for name in self.rivals if name != self.truth)]
        predictions = {name: series(self.predictions[name]) for name in order}
        noise = {n: shown.size(n, level, units[n]).value for n, level in self.noise.items()}
        units_shown = {name: shown.unit(name, unit) for name, unit in units.items()}
        return experiment_figure(
            self.sentence, self.time, series(self.inputs), predictions, noise, units_shown
        )

    def to_csv(self, path: str | Path) -> None:
        """Write time and inputs, in ``units``, as a table for the controller, every digit kept.

        Raises:
            InputError: the file cannot be written.
        """
        rows = zip(self.time, *self.inputs.values(), strict=True)
        lines = [",".join(["time", *self.inputs])]
        lines += [",".join(repr(float(value) + 0.0) for value in row) for row in rows]
        write_whole(Path(path), ("\n".join(lines) + "\n").encode())

    def _line(self) -> str:
        promise = "decisive" if self.decisive else "not decisive"
        return f"{' or '.join(self.rivals)}: {promise}, separation {self.separation:.3g}"

    def _report(self) -> Report:
        from diffthrust._support.words import number

        rows = [(t.words, t.kind.replace("_", " "), number(t.separation, 3)) for t in self.ranking]
        table = Rows.of(("Design", "Kind", "Separation"), rows, numbers=(2,))
        return Report(Section("", self.sentence, table))
