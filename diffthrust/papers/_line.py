"""A straight line and a time constant, as the papers fit one parameter after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.results import Brief
from diffthrust.uncertainty._prediction.physical import Quantity


@dataclass(frozen=True)
class FittedLine:
    """y = slope x + intercept, by least squares.

    Args:
        slope: unit of y over that of x.
        intercept: unit of y; zero where the line goes through the origin.
        slope_error: standard error, from the scatter of the points about the line, and no less than
            the points' own errors make it where these are known; NaN where as many points as
            coefficients leave no scatter, and no errors are known.
        intercept_error: likewise; zero where the line goes through the origin.
        x: the points, ``(n,)``.
        y: ``(n,)``.

    Example:
        >>> line = dft.papers.fit_line([0.0, 1.0, 2.0], [1.0, 3.0, 5.1], "test")
        >>> round(line.slope, 2), line.quantity("N").unit
        (2.05, 'N')
    """

    slope: float
    intercept: float
    slope_error: float
    intercept_error: float
    x: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)

    def __call__(self, x: Any) -> Any:
        return self.slope * x + self.intercept

    def quantity(self, unit: str) -> Quantity:
        """The slope with its standard error, ``None`` where the points leave none."""
        return Quantity(self.slope, None if np.isnan(self.slope_error) else self.slope_error, unit)


def numbers(what: str, values: ArrayLike) -> np.ndarray:
    """Values as floats; ``what`` names them where they are none."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: expected numbers ({error}).", "Correct them.") from None


def fit_line(
    x: ArrayLike,
    y: ArrayLike,
    what: str,
    *,
    through_origin: bool = False,
    errors: ArrayLike | None = None,
) -> FittedLine:
    """The line of least squares through points.

    Args:
        x: ``(n,)``.
        y: ``(n,)``.
        what: names the line in errors.
        through_origin: leave the intercept at zero.
        errors: standard error of each point's distance from the line, ``(n,)``, where it is known.
            They weigh no point; few points that scatter little by chance no longer promise more
            than they can tell, and points of unequal errors not more than the worst allow.

    Raises:
        InputError: fewer points than coefficients, or points that lie above each other.

    Example:
        >>> line = dft.papers.fit_line(
        ...     [1.0, 2.0, 3.0], [2.0, 4.0, 6.0], "test", through_origin=True
        ... )
        >>> round(line.slope, 6), line.intercept
        (2.0, 0.0)
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    columns = [x] if through_origin else [x, np.ones_like(x)]
    matrix = np.stack(columns, axis=1)
    if x.size < matrix.shape[1] or np.linalg.matrix_rank(matrix) < matrix.shape[1]:
        raise InputError(
            f"{what}: expected {matrix.shape[1]} or more different points, found "
            f"{np.unique(x).size}.",
            "Give records at more levels.",
        )
    coefficients, std_errors = least_squares(matrix, y)
    if errors is not None:
        # the larger of both: three points may lie on a line by chance; fmax passes over the NaN of
        # an exact line
        spread = np.linalg.pinv(matrix) * np.asarray(errors, float)
        std_errors = np.fmax(std_errors, np.sqrt(np.sum(spread**2, axis=1)))
    slope, intercept, *_ = [*map(float, coefficients), 0.0]
    slope_error, intercept_error, *_ = [*map(float, std_errors), 0.0]
    return FittedLine(slope, intercept, slope_error, intercept_error, x, y)


def least_squares(matrix: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients, and the standard errors that residuals without memory give them, or NaN."""
    coefficients, *_ = np.linalg.lstsq(matrix, y, rcond=None)
    degrees = matrix.shape[0] - matrix.shape[1]
    scatter = float(np.sum((y - matrix @ coefficients) ** 2)) / degrees if degrees else np.nan
    return coefficients, np.sqrt(scatter * np.sum(np.linalg.pinv(matrix) ** 2, axis=1))


Course = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Time, measured and fitted, ``(n,)`` each."""
Approach = tuple[np.ndarray, np.ndarray, Any]
"""Time and what was measured, ``(n,)`` each, and what it approaches."""


@dataclass(frozen=True, repr=False)
class Transient(Brief):
    """A time constant, from how a speed approaches its steady value.

    Args:
        time_constant: [s].
        runs: ``(time, measured, fitted)`` of the runs it was fitted to, from the step on.
        others: the same of the runs it was verified on.

    Example:
        >>> result = dft.papers.siramdasu.sequential(*manoeuvred)
        >>> result.yaw.time_constant > 0
        True
    """

    time_constant: float
    runs: tuple[Course, ...] = field(repr=False)
    others: tuple[Course, ...] = field(repr=False)


def fit_transient(
    what: str,
    runs: Sequence[Approach],
    others: Sequence[Approach],
    course: Callable[[np.ndarray, np.ndarray, Any, float], np.ndarray],
) -> Transient:
    """The time constant that runs have in common; ``course`` is that of a run with one of them.

    ``what`` names the quantity in errors. Samples that were not measured are left out.

    Raises:
        InputError: no sample is left.
    """
    from scipy.optimize import least_squares

    def residual(x: np.ndarray) -> np.ndarray:
        each = [course(time, y, end, np.exp(x[0])) - y for time, y, end in runs]
        joined = np.concatenate(each)
        finite = joined[np.isfinite(joined)]
        if not finite.size:  # of no residual SciPy makes the start value
            raise InputError(
                f"{what}: no sample of {len(runs)} run(s) can be held against the model.",
                "Look for gaps in their inputs and speeds.",
            )
        return finite

    lag = float(np.exp(least_squares(residual, [0.0]).x[0]))

    def fitted(runs: Sequence[Approach]) -> tuple[Course, ...]:
        return tuple((time, y, course(time, y, end, lag)) for time, y, end in runs)

    return Transient(lag, fitted(runs), fitted(others))
