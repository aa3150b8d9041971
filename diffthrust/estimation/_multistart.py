"""Several starts of one fit: which to try, how far to carry each, and whether they agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from diffthrust._support.progress import Progress, reporter, subtask
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import MOST_STEPS, Solved, solve

_DECADES = 1.0
"""Starts of a "log" parameter are drawn this many decades to either side of the guess."""
FIRST_BUDGET = 12
"""Steps given to every start before the best are carried on."""
_ENDED = 8
"""At least so many starts are carried to the end: the first steps favour the near basin, which need
not be the deep one, so that agreement among the best few alone would prove little."""
_CLOSE = 1e-6
"""Starts are compared where a full step would gain less log-likelihood than this; the best alone is
carried on from there: half of a search's steps would creep along the last digits."""
_SAME = 1e-4
"""Log-likelihoods nearer than this are the same optimum;"""
_ROUNDED = 0.1
_BESIDE = 0.05
"""and so are they with a difference up to the first, if their coordinates are no further apart than
the second, in standard errors: then it is of rounding, or of a kink."""
NOTICED = 1.0
"""Log-likelihood by which another optimum must be better to be one: a parameter that is off by a
standard error costs half of it."""
AGREED = 3
"""So many starts should end in the best optimum; with fewer, more are tried."""
_LOOK_STEPS = 25
"""Steps after which it is looked whether a start is on the way to an optimum that is known,"""
_NEAR_COST = 10.0
_ON_THE_WAY = (0.25, 0.5, 0.75)
"""which it is if its log-likelihood is within the second of that optimum's and rises all along the
straight line to it, here at these shares of the way."""

_ROUNDS = ((0.0, 0.8), (0.8, 0.9), (0.9, 1.0))
"""Rounds of starts, most often one, with the shares of the work from which to which each goes."""
_TURNED_STEPS = 3
"""Steps from the other sign of an initial state, the first of which looks at it: it soon differs
from the other or leads back to it. Of twelve runs of an NGS thruster twelve steps each were up to
half of a fit."""
_CARRIED = 3
"""So many distinct optima are followed from one horizon to the next."""


@dataclass(frozen=True)
class Search:
    """The outcome of a multi-start search.

    ``optima`` are the distinct ones, and where starts were given up, the best first, each with the
    number of starts that led to it.
    """

    problem: Problem
    optima: tuple[tuple[Solved, int], ...]
    begun: int  # starts, the caller's own guesses among them
    guesses: tuple[np.ndarray, ...] = ()
    failed: int = 0  # starts that could not be simulated

    @property
    def best(self) -> Solved:
        """The optimum of the highest likelihood."""
        return self.optima[0][0]

    @property
    def agreeing(self) -> int:
        """Starts that ended in it."""
        return self.optima[0][1]

    @property
    def agreeing_on_parameters(self) -> int:
        """Starts that ended in its parameters of the model, whatever an observer's gains.

        Where no random forces act, many gains and memories do as well as none.
        """
        if not self.problem.nuisance:
            return self.agreeing
        k = len(self.problem.own)
        length = np.sqrt(np.diagonal(self.best.quadratic.information))[:k]
        away = [np.abs(solved.z - self.best.z)[:k] * length for solved, _ in self.optima]
        return sum(n for (_, n), d in zip(self.optima, away, strict=True) if np.all(d <= 1.0))

    def followed(
        self, problem: Problem, passing: bool = False, with_guesses: bool = True
    ) -> Search:
        """The search carried on to a related problem from its best few optima and the guesses.

        It is solved to where optima are compared, and not to its last digits (`finished`); one
        that is only ``passing``, on the way to another, not even so far: on the BlueBoat one fit
        crept for minutes through segments of 2 and 7 s, whose optimum nobody asks for.
        """
        carried, guesses = self.optima[:_CARRIED], self.guesses if with_guesses else ()
        starts = [*(solved.z for solved, _ in carried), *guesses]
        if passing:
            reached = [solve(problem, z, _LOOK_STEPS, _CLOSE) for z in starts]
        else:
            reached = all_carried_on(problem, starts)
        counts = [*(n for _, n in carried), *(0 for _ in guesses)]  # these are counted already
        counted = distinct(list(zip(reached, counts, strict=True)))
        optima = tuple((solved, max(n, 1)) for solved, n in counted)
        return replace(self, problem=problem, optima=optima)

    def with_best(self, best: Solved) -> Search:
        """The search with its best optimum carried on."""
        (_, count), *rivals = self.optima
        return replace(self, optima=((best, count), *rivals))

    def finished(self) -> Search:
        """The search with its best optimum carried to the last digits, unless it creeps."""
        best = self.best
        creeps = best.steps >= MOST_STEPS and not best.done
        if creeps or not np.isfinite(best.cost):
            return self
        return self.with_best(solve(self.problem, best.z))

    def moved(self, problem: Problem) -> Search:
        """The search with its best optimum a few steps on in a related problem."""
        best = solve(problem, self.best.z, _LOOK_STEPS, _CLOSE)
        return replace(self.with_best(best), problem=problem)

    def upheld(self, finer: Problem) -> Search | None:
        """The search without the optima that only the steps of its problem have, if any is left.

        At the edge of its stability a scheme has slopes of its own: of a boat with a rudder inflow
        a fit ended with an inertia of 0.013 kg m^2 where 0.86 is the optimum, better by 100 in
        log-likelihood with the steps that it had, and worse by 2400 with half of them.
        """

        def holds(solved: Solved) -> bool:
            return abs(solve(finer, solved.z, budget=1).cost - solved.cost) <= NOTICED

        kept = tuple((solved, count) for solved, count in self.optima if holds(solved))
        if not kept:
            return None
        upheld = replace(self, optima=kept).finished()
        # one that was given up may end at the edge after all
        return upheld if holds(upheld.best) else None

    def improves_on(self, other: Search) -> bool:
        """Whether it ended in another optimum, which is better than that of the other search."""
        return self.best.cost < other.best.cost - NOTICED

    @property
    def rivals(self) -> tuple[str, ...]:
        """Parameters in which an equally good optimum differs from the best by over an error."""
        length = np.sqrt(np.diagonal(self.best.quadratic.information))
        names: dict[str, None] = {}
        for solved, _ in self.optima[1:]:
            if solved.cost <= self.best.cost + _SAME:
                away = np.abs(solved.z - self.best.z) * length
                names |= {name: None for i, name in enumerate(self.problem.own) if away[i] > 1.0}
        return tuple(names)


def draw(problem: Problem, count: int, rng: np.random.Generator) -> np.ndarray:
    """Coordinates of ``count`` starts; the first is the user's own guess."""
    low, high = problem.limits()
    guess = problem.start()
    out = np.repeat(guess[None], count, axis=0)
    named = problem.named
    guesses = problem.layout.likelihood.guesses(problem.nuisance)
    for i, name in enumerate(problem.free):
        p = named[name]
        if any(name in values for values in guesses):
            tried = [values.get(name, p.value) / p.scale for values in guesses]
            drawn = np.resize(tried, count)
        elif p.transform == "log":
            away = rng.uniform(-_DECADES, _DECADES, count) * np.log(10.0)
            drawn = guess[i] + away
        elif p.null is not None:  # an effect may be absent, faint or strong, whatever the guess
            null = p.null / p.scale
            sign = np.where(rng.random(count) < 0.5, -1.0, 1.0) if low[i] < null else 1.0
            drawn = null + sign * 10 ** rng.uniform(-_DECADES, 0.5 * _DECADES, count)
        elif np.all(np.isfinite([low[i], high[i]])):
            drawn = rng.uniform(low[i], high[i], count)
        else:
            drawn = guess[i] + rng.normal(0.0, 1.0, count)
        out[1:, i] = drawn[1:]
    return np.clip(out, low, high)


def search(
    problem: Problem,
    starts: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
    first: Solved | None = None,
    guesses: Sequence[np.ndarray] = (),
    once: bool = False,
    passing: bool = False,
) -> Search:
    """Minimise from several starts.

    Every start is carried a few steps; the best quarter (at least `_ENDED`) are carried on until
    little is left to be gained or they are no rivals, and the best of them to the end.
    While the best optimum was found fewer than `AGREED` times, the next best are carried on too,
    and then as many starts again are drawn, twice at most, and not if ``once``. ``first`` is the
    first start where it was begun already. All ``guesses`` are carried on before any other start;
    where there are some, one start less has to agree: they were not drawn, but known to be good. If
    ``passing``, on the way to another problem, the best is not carried to its last digits, and
    guesses beside a single start, with which nothing has to agree, are only led on.
    """
    tell, enough = reporter(progress), AGREED - bool(guesses)
    if passing and starts == 1 and guesses:
        begin = first.z if first else problem.start()
        led = [solve(problem, z, _LOOK_STEPS, _CLOSE) for z in (begin, *guesses)]
        finite = [(solved, 1) for solved in led if np.isfinite(solved.cost)]
        optima, failed = distinct(finite or [(led[0], 1)]), not np.isfinite(led[0].cost)
        return _mirrored(Search(problem, optima, len(led), tuple(guesses), failed))
    begun: list[Solved] = []
    ended = all_carried_on(problem, guesses)
    total = failed = 0
    for shares in _ROUNDS:
        say = subtask(tell, *shares)
        drawn = draw(problem, starts + 1, rng)
        fresh = drawn[1:] if total else drawn[:starts]
        total += starts
        for i, z in enumerate(fresh):
            begun.append(first or solve(problem, z, budget=FIRST_BUDGET))
            first = None
            failed += not np.isfinite(begun[-1].cost)
            say(f"start {len(begun)}", 0.5 * (i + 1) / len(fresh))
        begun.sort(key=_rank)
        wanted = max(_ENDED, len(begun) // 4)
        while begun and (wanted > 0 or _agreeing(ended) < enough):
            candidate = begun.pop(0)
            if np.isfinite(candidate.cost):
                ended.append(carried_on(problem, candidate, ended))
            wanted -= 1
            say(f"refining {len(ended)}", 1.0 - 0.5 * len(begun) / total)
        if starts == 1 or once or _agreeing(ended) >= enough:
            break
    if not ended:  # not one start could be simulated
        ended.append(solve(problem, problem.start(), budget=1))
    optima = distinct([(solved, 1) for solved in ended])
    result = Search(problem, optima, total + len(guesses), tuple(guesses), failed)
    return _mirrored(result if passing else result.finished())


def carried_on(problem: Problem, start: Solved, ended: Sequence[Solved]) -> Solved:
    """Where a start ends: at its own optimum, or at the best known one if it is on the way there.

    The last digits are most of the work. A curve learned on the EMPS axis: from within 10 of its
    log-likelihood each of eight starts went some 200 steps to the same optimum.

    A start stays where it is if the pace of its last steps, kept to the end, would not bring it
    down to the best known optimum. A basic boat on logs with a current and a weak thruster: 22 of
    24 starts over whole runs crept for 300 steps through valleys that were no rivals, four fifths
    of the time of the fit.
    """
    reached, steps = start, start.steps
    best = min(ended, key=lambda solved: solved.cost, default=None)
    while not reached.done and steps < MOST_STEPS:
        if best is not None and _leads(problem, reached, best):
            return best
        last, reached = reached, solve(problem, reached.z, budget=_LOOK_STEPS, tolerance=_CLOSE)
        taken, steps = reached.steps, steps + reached.steps
        reached = reached._replace(steps=steps)
        if taken < _LOOK_STEPS:  # at its optimum, or stuck beside a kink
            break
        pace, looks = last.cost - reached.cost, max(0, MOST_STEPS - steps) / _LOOK_STEPS
        if best is not None and reached.cost - looks * pace > best.cost:
            return best if _leads(problem, reached, best) else reached
    return reached


def all_carried_on(problem: Problem, starts: Sequence[np.ndarray]) -> list[Solved]:
    """Where starts end that are known to be good, in their order.

    The one that begins best goes to its end, and the others as `carried_on`: of the optima that a
    boat's fit followed to whole runs, each crept there for 300 steps.
    """
    begun = [solve(problem, z, budget=1) for z in starts]
    ended: dict[int, Solved] = {}
    for i in sorted(range(len(begun)), key=lambda i: begun[i].cost):
        if ended:
            ended[i] = carried_on(problem, begun[i], list(ended.values()))
        else:
            ended[i] = solve(problem, starts[i], tolerance=_CLOSE)
    return [ended[i] for i in range(len(begun))]


def _leads(problem: Problem, start: Solved, optimum: Solved) -> bool:
    """Whether the likelihood rises all along the straight line to an optimum that is near.

    The line is straight in the parameters themselves: a valley along which one drag takes over what
    another does is curved in their logarithms.
    """
    if not optimum.cost <= start.cost <= optimum.cost + _NEAR_COST:
        return False
    logs = [i for i, name in enumerate(problem.free) if problem.named[name].transform == "log"]
    costs = [start.cost]
    for share in _ON_THE_WAY:
        z = (1.0 - share) * start.z + share * optimum.z
        z[logs] = np.log((1.0 - share) * np.exp(start.z[logs]) + share * np.exp(optimum.z[logs]))
        costs.append(solve(problem, z, budget=1).cost)
    return all(after <= before for before, after in pairwise([*costs, optimum.cost]))


def distinct(ended: list[tuple[Solved, int]]) -> tuple[tuple[Solved, int], ...]:
    """Optima that differ in likelihood or by over an error in a coordinate, the best first.

    Among equals stands first one that met the stopping rule rather than one stuck beside a kink.
    """
    lowest = min(solved.cost for solved, _ in ended)
    ended = sorted(ended, key=lambda e: (e[0].cost > lowest + _SAME, not e[0].done, _rank(e[0])))
    optima: list[tuple[Solved, int]] = []
    for solved, count in ended:
        for i, (optimum, starts) in enumerate(optima):
            if _same(solved, optimum):
                optima[i] = (optimum, starts + count)
                break
        else:
            optima.append((solved, count))
    return tuple(optima)


def _same(first: Solved, second: Solved) -> bool:
    """Equal likelihoods, and nothing between them that either of the two would notice."""
    if not np.isfinite(second.cost):
        return not np.isfinite(first.cost)
    apart, away = abs(first.cost - second.cost), first.z - second.z
    if apart > _ROUNDED:
        return False
    nearest = min(float(away @ s.quadratic.information @ away) for s in (first, second))
    return nearest <= (1.0 if apart <= _SAME + 1e-9 * abs(second.cost) else _BESIDE**2)


def _mirrored(search: Search) -> Search:
    """Try the other sign of every initial state that only an unsigned sensor reads."""
    problem = search.problem
    (best, count), *rivals = search.optima
    for i in problem.sign_free():
        turned = best.z.copy()
        turned[i] = -turned[i]
        trial = solve(problem, turned, _TURNED_STEPS)
        if trial.cost < best.cost - _SAME:
            best = solve(problem, trial.z)
    return replace(search, optima=distinct([(best, count), *rivals]))


def _rank(solved: Solved) -> float:
    """The cost without what rounding changes: of equal optima the one begun first is taken."""
    return round(solved.cost, 6)


def _agreeing(ended: list[Solved]) -> int:
    best = min((solved.cost for solved in ended), default=np.inf)
    near = best + _SAME + 1e-9 * abs(best)
    return sum(solved.cost <= near for solved in ended) if np.isfinite(best) else 0
