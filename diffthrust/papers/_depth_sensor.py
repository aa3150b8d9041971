"""The calibration of a depth sensor, and whether its datasheet's line suits it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.results import Brief
from diffthrust._support.validation import finite
from diffthrust._support.words import number
from diffthrust.papers._line import FittedLine, fit_line, numbers
from diffthrust.uncertainty._prediction.physical import Quantity


@dataclass(frozen=True)
class Datasheet:
    """A line reading = slope * depth + intercept; the defaults are equation 9 of the paper.

    Args:
        slope: [V/m].
        intercept: [V].

    Example:
        >>> round(dft.papers.aras.Datasheet().depth(0.4729), 3)  # metres, from a reading in V
        2.999
    """

    slope: float = 0.1901
    intercept: float = -0.0973

    def __call__(self, depth: Any) -> Any:
        return self.slope * depth + self.intercept

    def depth(self, reading: float, surface: float | None = None) -> float:
        """The depth that a reading stands for [m].

        Args:
            reading: [V].
            surface: reading at the surface [V]. The sensor measures absolute pressure, so the
                line's zero lies an atmosphere above the water; with the surface's own reading the
                depth is counted from there.
        """
        zero = 0.0 if surface is None else self.depth(surface)
        return (reading - self.intercept) / self.slope - zero


@dataclass(frozen=True)
class LineTest:
    """An F test of a line, or of one line for all readings.

    Args:
        statistic: F.
        degrees: of freedom, of the hypothesis and of the scatter.
        p_value: the probability of so large an F if the hypothesis holds.
        level: false alarms: the share of right hypotheses that are rejected.
    """

    statistic: float
    degrees: tuple[int, int]
    p_value: float
    level: float

    @property
    def rejected(self) -> bool:
        """Whether the hypothesis cannot be held at this level."""
        return self.p_value < self.level

    def __str__(self) -> str:
        p = "p < 1e-6" if self.p_value < 1e-6 else f"p = {self.p_value:.2g}"
        return f"F({self.degrees[0]}, {self.degrees[1]}) = {number(self.statistic, 3)}, {p}"


@dataclass(frozen=True, repr=False)
class Calibration(Brief):
    """Lines of a depth sensor against the line of its datasheet.

    Args:
        lines: one by reading.
        together: one through all points. Its standard errors take the points for independent;
            where ``same`` is rejected they are not, and `slope` and `offset` are to be taken.
        tests: of the datasheet's line by reading, and "together" (against a line for each).
        same: of one line for all readings.
        datasheet: the line that was tested.

    Example:
        >>> depth = np.linspace(0.0, 3.0, 7)
        >>> result = dft.papers.aras.calibrate(
        ...     depth, {"down": 0.19 * depth - 0.1 + 0.001 * depth**2, "up": 0.19 * depth - 0.09}
        ... )
        >>> result.slope.unit, result.offset.unit, abs(result.depth(0.2) - 1.5) < 0.1
        ('V/m', 'V', True)
        >>> result.fits, "datasheet" in result.sentence
        (False, True)
        >>> figure = result.plot()
    """

    lines: Mapping[str, FittedLine]
    together: FittedLine
    tests: Mapping[str, LineTest]
    same: LineTest
    datasheet: Datasheet = field(default_factory=Datasheet)

    @property
    def slope(self) -> Quantity:
        """Mean of the readings' slopes, and its standard error from how they differ."""
        return _mean([line.slope for line in self.lines.values()], "V/m")

    @property
    def offset(self) -> Quantity:
        """Mean of the readings' offsets, likewise."""
        return _mean([line.intercept for line in self.lines.values()], "V")

    @property
    def fits(self) -> bool:
        """Whether the datasheet's line can be held for all readings together."""
        return not self.tests["together"].rejected

    def depth(self, reading: float) -> float:
        """The depth that a reading stands for by the line through all points [m]."""
        return (reading - self.together.intercept) / self.together.slope

    @property
    def sentence(self) -> str:
        """What the tests say, in words."""
        d, test = self.datasheet, self.tests["together"]
        line = f"The datasheet line {d.slope:g} V/m x depth {d.intercept:+g} V"
        away = self.together(0.0) - d(0.0)
        if self.fits:
            return f"{line} fits the readings ({test}, level {test.level:g})."
        each = sum(t.rejected for name, t in self.tests.items() if name != "together")
        sentence = (
            f"{line} does not fit the readings ({test}, level {test.level:g}; rejected for {each} "
            f"of {len(self.lines)} readings by themselves): at the surface they lie {away:.2f} V "
            f"from it, and rise by {self.slope} where it rises by {d.slope:g} V/m."
        )
        if self.same.rejected:
            sentence += f" The readings differ among themselves, too ({self.same})."
        return sentence

    @showing
    def plot(self) -> Figure:
        """The readings, the line through them, and the datasheet's."""
        from diffthrust.papers._figures import calibration_figure

        d = self.datasheet
        return calibration_figure(self.lines, self.together, d.slope, d.intercept)


def calibrate(
    depth: ArrayLike,
    readings: Mapping[str, ArrayLike],
    *,
    datasheet: Datasheet | None = None,
    level: float = 0.01,
) -> Calibration:
    """Lines through the readings of a depth sensor, and a test of its datasheet's line.

    The F test compares the squared distances to the datasheet's line, which has nothing to fit,
    with those to a fitted line: ((S0 - S1) / 2) / (S1 / (n - 2)). It takes the scatter about the
    fitted line for independent and normal.

    Args:
        depth: [m], ``(n,)``.
        readings: by name, [V], ``(n,)`` each.
        datasheet: equation 9 of the paper where not given.
        level: false alarms of each test.

    Source: Aras et al. 2013, section 4.2, table 4 and equation 9; the F test is that of Draper &
    Smith 1998, Applied Regression Analysis, chapter 1.

    Example:
        >>> depth = np.linspace(0.0, 3.0, 7)
        >>> result = dft.papers.aras.calibrate(
        ...     depth, {"down": 0.19 * depth - 0.1, "up": 0.19 * depth - 0.09}
        ... )
        >>> round(result.slope.value, 2)
        0.19
    """
    line = datasheet or Datasheet()
    if not isinstance(readings, Mapping) or not readings:
        raise InputError(
            "calibrate, readings: expected some by name, found "
            f"{'none' if isinstance(readings, Mapping) else type(readings).__name__}.",
            "Write {'reading 1': ...}.",
        )
    finite("calibrate, level", level, lambda x: 0 < x < 1, "a share", "Write 0.01.")
    depth = numbers("calibrate, depth", depth)
    columns = {name: numbers(f"calibrate, {name!r}", y) for name, y in readings.items()}
    for name, values in columns.items():
        if depth.ndim != 1 or values.shape != depth.shape or depth.size < 3:
            raise InputError(
                f"calibrate, {name!r}: expected as many readings as depths, three or more, found "
                f"shapes {values.shape} and {depth.shape}.",
                "Leave out the depths without a reading.",
            )
        if not (np.isfinite(values).all() and np.isfinite(depth).all()):
            raise InputError(
                f"calibrate, {name!r}: a reading or a depth is not a finite number.",
                "Leave those points out.",
            )
    lines = {name: fit_line(depth, y, f"calibrate, {name}") for name, y in columns.items()}
    count, all_y = len(columns), np.concatenate(list(columns.values()))
    together = fit_line(np.tile(depth, count), all_y, "calibrate, together")
    remaining = {name: _squares(y - lines[name](depth)) for name, y in columns.items()}
    apart = {name: _squares(y - line(depth)) for name, y in columns.items()}
    free, scatter = depth.size - 2, sum(remaining.values())
    tests = {
        name: _f(apart[name] - remaining[name], 2, remaining[name], free, level) for name in columns
    }
    # against a line for each reading: if these differ among themselves, one pooled line would hide
    # it in its scatter
    tests["together"] = _f(sum(apart.values()) - scatter, 2 * count, scatter, count * free, level)
    joint = _squares(all_y - together(together.x))
    same = _f(joint - scatter, 2 * (count - 1), scatter, count * free, level)
    return Calibration(lines, together, tests, same, line)


def _f(more: float, hypothesis: int, scatter: float, free: int, level: float) -> LineTest:
    from scipy.stats import f  # takes a while

    if not hypothesis:
        return LineTest(0.0, (0, free), 1.0, level)
    # rounding: the fitted line cannot be worse than the datasheet's
    more = max(more, 0.0)
    statistic = (more / hypothesis) / (scatter / free) if scatter > 0 else np.inf * (more > 0)
    p_value = float(f.sf(statistic, hypothesis, free))
    return LineTest(float(statistic), (hypothesis, free), p_value, level)


def _squares(values: np.ndarray) -> float:
    return float(np.sum(values**2))


def _mean(values: list[float], unit: str) -> Quantity:
    error = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None
    return Quantity(float(np.mean(values)), error, unit)
