"""Select kind and order of a black-box model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.validation import check_word
from diffthrust._support.words import number
from diffthrust.blackbox._model import BlackBox, ModelKind
from diffthrust.blackbox._polynomial import armax, arx, output_error
from diffthrust.blackbox._prediction_error import check_order
from diffthrust.blackbox._subspace import state_space
from diffthrust.logs._log import Log

_POLYNOMIAL: tuple[ModelKind, ...] = ("arx", "armax", "output_error")


@dataclass(frozen=True)
class Candidate:
    """One row of a selection.

    Args:
        kind: of the model.
        order: of A (or F), B and C alike, or the number of states.
        delay: in samples.
        model: ``None`` if it could not be estimated, for the reason in ``remark``.
        prediction: NRMSE of one-step prediction of the training logs.
        simulation: NRMSE of free simulation of the training logs.
        unseen: NRMSE of free simulation of the unseen logs; NaN without them.
        remark: a caveat, or empty.

    Example:
        >>> chosen = dft.blackbox.select(
        ...     log, input="command", output="thrust", kinds=["arx"], orders=(1, 2)
        ... )
        >>> one = chosen.candidates[0]
        >>> one.kind, one.order, bool(np.isfinite(one.bic))
        ('arx', 1, True)
    """

    kind: ModelKind
    order: int
    delay: int
    model: BlackBox | None = field(repr=False)
    prediction: float = np.nan
    simulation: float = np.nan
    unseen: float = np.nan
    remark: str = ""

    @property
    def bic(self) -> float:
        """Of the one-step errors; infinite if there is no model."""
        return self.model.bic if self.model else np.inf


@dataclass(frozen=True, repr=False)
class Selection(Result):
    """All candidates tried.

    Args:
        candidates: in the order in which they were tried.
        by: "bic" or "unseen".

    Example:
        >>> chosen = dft.blackbox.select(
        ...     log, input="command", output="thrust", kinds=["arx"], orders=(1, 2)
        ... )
        >>> chosen.best is chosen.chosen.model, chosen.chosen.order
        (True, 2)
    """

    candidates: tuple[Candidate, ...]
    by: str

    @property
    def chosen(self) -> Candidate:
        """The candidate with the least criterion, among converged ones if there are any."""
        # the least BIC of all may be that of a search which broke off
        sound = [row for row in self.candidates if row.model and row.model.status.ok]
        return min(sound or self.candidates, key=self._score)

    @property
    def best(self) -> BlackBox:
        """Its model."""
        model = self.chosen.model
        assert model is not None  # `select` refuses a selection without any
        return model

    def _report(self) -> Report:
        headings = ("", "Kind", "Order", "Delay", "BIC", "One step", "Simulated", "Unseen", "")
        chosen = self.chosen
        rows = (
            (
                "*" if row is chosen else "",
                row.kind.replace("_", " "),
                str(row.order),
                str(row.delay),
                f"{row.bic:.1f}" if row.model else "-",
                number(row.prediction, 3),
                number(row.simulation, 3),
                number(row.unseen, 3),
                row.remark,
            )
            for row in self.candidates
        )
        criterion = "BIC" if self.by == "bic" else "the NRMSE of unseen logs"
        legend = f"A star marks the one chosen by {criterion}; the other errors are NRMSE, too."
        return Report(Section("", Rows.of(headings, rows, numbers=range(2, 8)), legend))

    def _score(self, row: Candidate) -> float:
        value = row.bic if self.by == "bic" else row.unseen
        return np.inf if np.isnan(value) else value

    def _line(self) -> str:
        count = len(self.candidates)
        return f"{self.chosen.kind.replace('_', ' ')}, order {self.chosen.order}, of {count} tried"


def select(
    logs: Log | Sequence[Log],
    *,
    input: str | Sequence[str],
    output: str | Sequence[str],
    kinds: Iterable[ModelKind] | None = None,
    orders: Iterable[int] = (1, 2, 3, 4),
    delays: Iterable[int] = (1,),
    by: Literal["bic", "unseen"] = "bic",
    holdout: Log | Sequence[Log] = (),
    offset: bool = False,
) -> Selection:
    """Try kinds, orders and delays, and select by an information criterion or by unseen logs.

    BIC rates one-step predictions, in which ARMAX and ARX use the measured output; unseen logs are
    simulated freely, and state spaces are then fitted for simulation. If the two disagree, decide
    by the purpose of the model.

    Args:
        logs: to estimate from, as for `arx`.
        input: one or several.
        output: one, or several for state spaces.
        kinds: kinds to try; by default ARX, ARMAX and output error, or state space with several
            outputs. (With one output a state space is an ARMAX of equal orders.)
        orders: of A (or F), B and C alike.
        delays: in samples.
        by: "bic" or "unseen".
        holdout: unseen logs, needed for ``by="unseen"``.
        offset: estimate a constant beside the inputs.

    Raises:
        InputError: no candidate can be estimated, a word is unknown, or there are no unseen logs.

    Source: Schwarz 1978 for BIC.

    Example:
        >>> chosen = dft.blackbox.select(
        ...     log,
        ...     input="command",
        ...     output="thrust",
        ...     kinds=["arx"],
        ...     orders=(1, 2),
        ...     by="unseen",
        ...     holdout=unseen,
        ... )
        >>> chosen.chosen.kind, len(chosen.candidates)
        ('arx', 2)
    """
    unseen = [holdout] if isinstance(holdout, Log) else list(holdout)
    check_word("by", by, "bic", "unseen")
    if by == "unseen" and not unseen:
        raise InputError("by='unseen': no unseen logs were passed.", "Give holdout=[...].")
    several = not isinstance(output, str) and len(output) > 1
    usual: tuple[ModelKind, ...] = ("state_space",) if several else _POLYNOMIAL
    available = (*_POLYNOMIAL, "state_space")
    chosen = usual if kinds is None else tuple(kinds)
    if not chosen or any(kind not in available for kind in chosen):
        raise InputError(
            f"kinds: expected some of {listing(available)}, found {listing(chosen)}.", "Correct it."
        )
    orders = [check_order("select", "order", n) for n in orders]
    delays = [check_order("select", "delay", d) for d in delays]
    for what, values in {"orders": orders, "delays": delays}.items():
        if not values:
            raise InputError(f"{what}: none was given.", f"Write {what}=(1, 2).")
    common: dict[str, Any] = {"input": input, "output": output, "offset": offset}
    # fitted for what it is judged by
    focus = "simulation" if by == "unseen" else "prediction"
    rows, problems = [], []
    for kind, delay, order in product(chosen, delays, orders):
        try:
            model = _made(kind, logs, order, delay, focus, common)
        except InputError as error:
            # one impossible order (more coefficients than samples) must not end the selection
            problems.append(error)
            rows.append(Candidate(kind, order, delay, None, remark=error.problem))
            continue
        rows.append(_judged(kind, order, delay, model, logs, unseen))
    if not any(row.model for row in rows):
        raise problems[0]
    return Selection(tuple(rows), by)


def _made(
    kind: ModelKind,
    logs: Log | Sequence[Log],
    order: int,
    delay: int,
    focus: Literal["prediction", "simulation"],
    common: dict[str, Any],
) -> BlackBox:
    if kind == "state_space":
        return state_space(logs, order=order, delay=delay, focus=focus, **common)
    if kind == "armax":
        return armax(logs, orders=(order, order, order, delay), **common)
    method = arx if kind == "arx" else output_error
    return method(logs, orders=(order, order, delay), **common)


def _judged(
    kind: ModelKind,
    order: int,
    delay: int,
    model: BlackBox,
    logs: Log | Sequence[Log],
    unseen: list[Log],
) -> Candidate:
    remarks = ["not stable"] * (not model.stable)
    remarks += [model.status.value] * (not model.status.ok)
    errors = model.errors(logs, "prediction").nrmse, model.errors(logs).nrmse
    beyond = model.errors(unseen).nrmse if unseen else np.nan
    return Candidate(kind, order, delay, model, *errors, beyond, ", ".join(remarks))
