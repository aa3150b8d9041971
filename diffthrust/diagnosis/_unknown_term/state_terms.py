"""Laws of states that are not measured: sums of terms at several ports, fitted together.

One-step errors hardly show them: the observer moves a state that is not measured as it likes. Whole
runs do. At the port of each state's rate stands a function of each state, of straight pieces: a
line, and bends at places on the range of the state. All are fitted to whole runs at once, in one
program; then the bends follow the ranges that the states have now, and terms that do not earn their
price are dropped one by one (backward elimination by the Bayesian information criterion). At last
the places of the bends that are left are estimated, too.

Two tanks of which the lower one is measured, with an overflow and flows in proportion to the levels
missing: as given the fit ends without a flow into the upper tank, where no term of its level does
anything; all terms together, from the values with which that fit began, come down to the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._candidates import DrivingPort
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._search_start import trial_substeps
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.diagnosis._unknown_term.closed_forms import as_estimated
from diffthrust.diagnosis._unknown_term.fit import worth_between_fits
from diffthrust.diagnosis._unknown_term.terms import units_at
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.estimation._arrange import build
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import Solved, solve
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model
from diffthrust.simulation._levels import port_readings
from diffthrust.simulation._record import Record, are_tables
from diffthrust.simulation._trajectory import simulate_fixed

_BENDS = (0.3, 0.6, 0.8)
"""Numerics: places of the bends, over the range of a state."""
_MOST_FUNCTIONS = 6
"""Numerics: functions of one state at one port that are fitted together, seven coordinates each:
two tanks have four, a vessel in the plane nine, which would take minutes."""
_SIZE = 0.1
"""Numerics: the typical size of a term, over what passes its port."""
_LONG, _SHORT = 150, 60
"""Numerics: steps of the fit of all terms, and of one without a term."""
_ROUNDS = 2
"""Numerics: how often the bends follow the ranges of the states: with other flows the levels of the
tanks are a third of what they were."""
_CLOSE = 1e-4
"""Numerics: fits end where a step gains less log-likelihood: a hundredth of a term's price."""
_FEW_TRIED = 3
"""Numerics: terms of least weight that are left out in turn before all are kept."""


class StateTerm(NamedTuple):
    """One straight piece: ``amplitude * state``, or ``amplitude * max(state - place, 0)``.

    Args:
        port: where it acts.
        state: the state.
        amplitude: the full name of its amplitude in the model of all terms.
        place: that of its place; "" for a line.
    """

    port: str
    state: str
    amplitude: str
    place: str

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that it has."""
        return tuple(filter(None, (self.amplitude, self.place)))


class Fitted(NamedTuple):
    """Some of the terms, fitted to whole runs."""

    terms: tuple[StateTerm, ...]
    names: tuple[str, ...]
    values: Mapping[str, float]
    solved: Solved

    @property
    def cost(self) -> float:
        """Its negative log-likelihood; infinite where it cannot be simulated."""
        cost = float(self.solved.quadratic.cost)
        return cost if math.isfinite(cost) else math.inf


def state_terms(context: SearchContext, baseline: Fit) -> tuple[LearnedLaw, ...]:
    """The terms of states that whole runs lack, if one of these states is not measured.

    Whole runs of unseen logs must surely be better with them than with the last stage.
    """
    fitter = context.fitter
    prescribed = context.records[0].inputs
    states = [name for name in fitter.model.states if name not in prescribed]
    places = [place for place in fitter.places if place.state]
    hidden = [name for name in states if name not in fitter.channels]
    if are_tables(fitter.records):
        return ()
    if not (context.unseen and hidden) or len(places) * len(states) > _MOST_FUNCTIONS:
        return ()
    guess = {n: v for n, v in context.guess.items() if n in baseline.model.parameters}
    begins = [baseline.model.replace(guess), baseline.model]
    ends = [end for model in begins if (end := _fitted_from(context, baseline, model, states))]
    if not ends:
        return ()
    search, fitted = min(ends, key=lambda end: end[1].cost)
    selected = _eliminated(search, fitted)
    begin = _begin(search, selected)
    freed = search.fitted(selected.terms, selected.values, begin, _LONG, free_places=True)
    return _laws(context, baseline, search, _eliminated(search, freed, free_places=True))


class _Search(NamedTuple):
    """All terms in one compiled problem.

    Args:
        model: with all terms.
        problem: of which some coordinates are moved.
        terms: all of them.
        own: the estimated parameters of the model without terms.
        records: the training logs.
        price: what a parameter must gain in log-likelihood.
    """

    model: Model
    problem: Problem
    terms: tuple[StateTerm, ...]
    own: tuple[str, ...]
    records: Sequence[Record]
    price: float

    def fitted(
        self,
        terms: Sequence[StateTerm],
        values: Mapping[str, float],
        begin: np.ndarray | None,
        budget: int,
        free_places: bool = False,
    ) -> Fitted:
        """The model with some of the terms, from these values and initial states."""
        absent = {t.amplitude: 0.0 for t in self.terms if t not in terms}
        moved = [name for t in terms for name in (t.names if free_places else (t.amplitude,))]
        names = (*self.own, *moved)
        focused = self.problem.focus(names, {**values, **absent}, begin)
        solved = solve(focused, focused.start(), budget, _CLOSE)
        return Fitted(tuple(terms), names, focused.values(solved.z), solved)


def _fitted_from(
    context: SearchContext, baseline: Fit, model: Model, states: Sequence[str]
) -> tuple[_Search, Fitted] | None:
    """All terms beside a model, fitted from its values; ``None`` where that cannot be done."""
    records = context.records
    ranges = _ranges(model, records, states)
    if ranges is None:
        return None
    effects, terms = library(context, model, ranges)
    own = tuple(n for n, p in model.parameters.items() if not p.fixed)
    model = model + effects
    free = [n for n, p in model.parameters.items() if not p.fixed]
    substeps = trial_substeps(baseline, records)
    problem = build(model, records, substeps=substeps, width=len(free))
    price = 0.5 * math.log(context.fitter.samples)
    search = _Search(model, problem, terms, own, records, price)
    values = {n: p.value for n, p in model.parameters.items()}
    current = search.fitted(terms, values, None, _LONG)
    for _ in range(_ROUNDS):
        if not math.isfinite(current.cost):
            return None
        moved = _moved_bends(search, current)
        current = search.fitted(terms, moved, _begin(search, current), _LONG)
    return (search, current) if math.isfinite(current.cost) else None


def _begin(search: _Search, fitted: Fitted) -> np.ndarray:
    """The initial states of a fit."""
    return fitted.solved.z[search.problem.shared :]


def _ranges(
    model: Model, records: Sequence[Record], states: Sequence[str]
) -> dict[str, np.ndarray] | None:
    """The values of each state over all logs, sorted; ``None`` where one does not move."""
    paths = [simulate_fixed(model, record, None, 1) for record in records]
    out = {n: np.sort(np.concatenate([np.asarray(path[n]) for path in paths])) for n in states}
    moves = all(np.all(np.isfinite(x)) and x[-1] > x[0] for x in out.values())
    return out if moves else None


def library(
    context: SearchContext, model: Model, ranges: Mapping[str, np.ndarray]
) -> tuple[list[Formula], tuple[StateTerm, ...]]:
    """One formula for each driving port with all its terms, at their null, and the terms."""
    places = [place for place in context.fitter.places if place.state]
    record = context.records[0]
    inputs = {n: record.at_samples(v) for n, v in record.inputs_for(model).items()}
    path = {"time": record.log.time, **inputs, **simulate_fixed(model, record, None, 1)}
    readings = port_readings(model, {n: np.asarray(x) for n, x in path.items()})
    effects, terms = [], []
    for k, place in enumerate(places):
        level = float(np.sqrt(np.mean(readings[place.port] ** 2))) or 1.0
        formula, added = _formula_of(context, place, f"terms{k}", level, ranges)
        effects.append(formula)
        terms += added
    return effects, tuple(terms)


def _formula_of(
    context: SearchContext,
    place: DrivingPort,
    name: str,
    level: float,
    ranges: Mapping[str, np.ndarray],
) -> tuple[Formula, list[StateTerm]]:
    units, pieces, parameters, terms = units_at(context.fitter, place.port), [], {}, []
    for i, (state, x) in enumerate(ranges.items()):
        low, high = float(x[0]), float(x[-1])
        unit = product_unit((units[ARRIVING], 1), (units[state], -1))
        size = _SIZE * level / (high - low)
        for j, share in enumerate((None, *_BENDS)):
            a, b = f"a{i}{j}", f"b{i}{j}"
            parameters[a] = {"unit": unit, "value": 0.0, "null": 0.0, "size": size}
            if share is None:
                pieces.append(f"{a} * {state}")
            else:
                pieces.append(f"{a} * max({state} - {b}, 0)")
                at = low + share * (high - low)
                # linear: a bend of two tanks that moved to an empty one, at zero, has no logarithm
                parameters[b] = {
                    "unit": units[state], "value": at, "bounds": (low, high), "transform": "linear",
                }  # fmt: skip
            place_name = "" if share is None else f"{name}.{b}"
            terms.append(StateTerm(place.port, state, f"{name}.{a}", place_name))
    return Formula(place.port, " + ".join(pieces), name=name, **parameters), terms


def _moved_bends(search: _Search, fitted: Fitted) -> dict[str, float]:
    """The values of a fit with its bends moved to the ranges of its states.

    The amplitudes are those of least squares over the values of the states.
    """
    values = dict(fitted.values)
    model = search.model.replace({n: values[n] for n in search.model.parameters})
    ranges = _ranges(model, search.records, [*dict.fromkeys(t.state for t in search.terms)])
    if ranges is None:
        return values
    functions = dict.fromkeys((t.port, t.state) for t in search.terms)
    for port, state in functions:
        terms = [t for t in search.terms if (t.port, t.state) == (port, state)]
        x = ranges[state]
        before = sum(values[t.amplitude] * _piece(t, x, values) for t in terms)
        for term, share in zip((t for t in terms if t.place), _BENDS, strict=True):
            limits = search.model.parameters[term.place].limits
            values[term.place] = float(np.clip(x[0] + share * (x[-1] - x[0]), *limits))
        rows = np.array([_piece(t, x, values) for t in terms])
        amplitudes = np.linalg.lstsq(rows.T, np.asarray(before), rcond=None)[0]
        values |= {t.amplitude: float(a) for t, a in zip(terms, amplitudes, strict=True)}
    return values


def _piece(term: StateTerm, x: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """A term of an amplitude of one over values of its state."""
    return np.maximum(x - values[term.place], 0.0) if term.place else x


def _eliminated(search: _Search, fitted: Fitted, free_places: bool = False) -> Fitted:
    """The terms without those that do not earn their price, the cheapest dropped first."""
    while True:
        weights = _weights(search, fitted)
        for term in sorted(weights, key=lambda t: weights[t])[:_FEW_TRIED]:
            remaining = [t for t in fitted.terms if t is not term]
            begin = _begin(search, fitted)
            fewer = search.fitted(remaining, fitted.values, begin, _SHORT, free_places)
            count = len(term.names) if free_places else 1
            if fewer.cost < fitted.cost + search.price * count:
                fitted = fewer
                break
        else:
            return fitted


def _weights(search: _Search, fitted: Fitted) -> dict[StateTerm, float]:
    """What each term's absence would cost, as far as the likelihood is quadratic."""
    count = len(fitted.names)
    information = fitted.solved.quadratic.information[:count, :count]
    length = np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    scaled = information / length / length[:, None]
    variance = np.diagonal(np.linalg.pinv(scaled, rcond=1e-10, hermitian=True)) / length**2
    out = {}
    for term in fitted.terms:
        i, scale = fitted.names.index(term.amplitude), search.model.parameters[term.amplitude].scale
        coordinate = fitted.values[term.amplitude] / scale
        out[term] = 0.5 * coordinate**2 / max(float(variance[i]), 1e-300)
    return out


def _laws(
    context: SearchContext, baseline: Fit, search: _Search, selected: Fitted
) -> tuple[LearnedLaw, ...]:
    """The terms as laws, fitted again as they are reported, if unseen runs are surely better."""
    if not selected.terms:
        return ()
    base = baseline.model.replace({n: selected.values[n] for n in baseline.model.parameters})
    formulas = [_as_formula(t, search, selected.values, k) for k, t in enumerate(selected.terms)]
    fit = context.refit(base + formulas, starts=1).fit
    if not math.isfinite(fit.train.nrmse):
        return ()
    worth = worth_between_fits(context, baseline, fit)
    if not worth.sure:  # of unseen runs alone: the terms were chosen by all of the training runs
        return ()
    estimated = {effect.name: effect for effect in fit.model.effects}
    ranges = _ranges(fit.model, search.records, [*dict.fromkeys(t.state for t in search.terms)])
    gain = 2.0 * (fit.log_likelihood - baseline.log_likelihood)
    return tuple(
        _law(context, term, as_estimated(estimated[formula.name]), fit, worth, gain, ranges)  # pyright: ignore[reportArgumentType]
        for term, formula in zip(selected.terms, formulas, strict=True)
    )


def _as_formula(
    term: StateTerm, search: _Search, values: Mapping[str, float], number: int
) -> Formula:
    amplitude = search.model.parameters[term.amplitude]
    value = values[term.amplitude]
    parameters = {
        "a": {"unit": amplitude.unit, "value": value, "null": 0.0, "size": abs(value) or 1.0}
    }
    text = f"a * {term.state}"
    if term.place:
        place = search.model.parameters[term.place]
        parameters["b"] = {
            "unit": place.unit, "value": values[term.place], "bounds": place.bounds,
            "transform": "linear",
        }  # fmt: skip
        text = f"a * max({term.state} - b, 0)"
    name = "curve" if number == 0 else f"curve{number + 1}"
    return Formula(term.port, text, name=f"{name}_form", **parameters)


def _law(
    context: SearchContext,
    term: StateTerm,
    formula: Formula,
    fit: Fit,
    worth: Worth,
    gain: float,
    ranges: Mapping[str, np.ndarray] | None,
) -> LearnedLaw:
    """A term as a law: its closed form, and a curve that draws it over the range of its state."""
    units = units_at(context.fitter, term.port)
    x = ranges[term.state] if ranges else np.array([0.0, 1.0])
    name = formula.name.removesuffix("_form")
    empty = Curve(term.port, term.state, float(x[0]), float(x[-1]), name=name, unit=units[ARRIVING])
    values = {n: getattr(formula, n) for n in formula.given}
    shape = values["a"] * (np.maximum(x - values["b"], 0.0) if term.place else x)
    weights = np.linalg.lstsq(empty.basis(x).T, shape, rcond=None)[0]
    form = "ramp above" if term.place else "linear"
    size = float(np.sqrt(np.mean(x**2)))
    return LearnedLaw(
        curve=Curve(**{**empty.arguments, "shape": tuple(map(float, weights))}),
        fit=fit,
        worth=worth,
        evidence=0.5 * gain,
        forms=(TriedForm(form, formula, fit, -gain, -gain, reference=size),),
        named=True,
        samples=x,
        signal_unit=units[term.state],
        channel=term.state if term.state in context.fitter.model.channel_units else "",
        port_unit=units[ARRIVING],
        together=True,
    )
