"""Levenberg-Marquardt within bounds, as an Optimistix minimiser."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from diffthrust._support._running.batching import shared_runs
from diffthrust._support._running.programs import KEPT, Programs, program
from diffthrust._support.box import least_in_box
from diffthrust.estimation._likelihood import Quadratic, evaluate
from diffthrust.estimation._problem import Problem, Turn

MOST_STEPS = 300
_COMPARED_STEPS = 100
"""Numerics: steps of a fit that is only compared. Those of an EMPS take less than 20; one curve
beside three effects of a BlueBoat crept through 300 at each of two ends, in 340 s of processor
time, and was then refused."""
_CONTACT = 1e-9  # a coordinate this near to its bound counts as lying on it
_FLAT = 1e-10  # added to the undamped curvature, so that flat directions have a finite step
NOTHING = 1e-13
"""Numerics: root of the information of a coordinate that is rounding: a move of one, or by itself,
changes the log-likelihood by 1e-26. The colour of a boat's noise was nought, and its correlation,
of information 1e-31, went through all of its range at every damping: no step was taken, at a
log-likelihood of 331 below the optimum."""
_AT_A_TIME = 8  # steps side by side with others, before those that have ended make room
_CREEPING, _CREPT = 8, 1e-4
"""Numerics: so many accepted steps that together gain less log-likelihood end a search. Beside
kinks a Gauss-Newton step always promises more than it gains: on the bench of the NGS (a dead band)
25 of 480 steps came within 0.001 of the end, and an error bar takes notice of 0.5. Newton's method
takes a fit from there to its last digits (`polished`)."""
_SHARP = 0.8
"""Numerics: the share that a kink leaves of what a slope misses, over a step half as long or less;
of a curved valley half is left."""
_ALONE = 0.9
"""Numerics: of what all slopes miss, on the scale of the information, the least share of one."""
_SHORTER = 30.0
"""Numerics: by so much a coordinate at a kink is damped more each time its slope turns round."""
_DAMPING = 1e-3
"""Numerics: damping of the first step, and of the first after a kink was found."""
EQUAL = 1e-13
"""Numerics: costs that differ by less than this share are equal. Of eight thrusters on 9 000
samples (a cost of -4.2e5) a search came within 1e-10 of its end, saw 1e-8 to 1e-6 ahead for what
rounding made of its slope along the weakest axis, and was refused 30 steps: a third of the fit."""

_QUICK_PASS, _QUICK_WORK = 30_000, 2_000_000
"""Numerics: a search is quickly compiled if a pass is no more work than the first, and until all
its passes were the second. For a thruster on 3 000 samples that saved 2.6 s, and a pass took 3.5 ms
for 1.5; for a vessel on as many (33 000) it saved 1.7 s, and a pass took 26 ms for 6. The second is
where these are even: a refit of a Kingfisher made 2 500 passes of 35 ms that take 8."""


class _State(eqx.Module):
    trial: Any
    quadratic: Quadratic
    curvature: Any  # of the residuals: what the information lacks of the cost's Hessian
    curved: Any  # whether steps count it in
    damping: Any
    predicted: Any  # by the information alone, and with the curvature
    steps: Any
    mark: Any  # the cost where the accepted steps were counted from,
    since: Any  # and their number
    own: Any  # further damping of coordinates at a kink
    missed: Any  # lengths of the last step rejected from here, and by how much slopes missed there
    done: Any
    failed: Any


class BoundedLevenbergMarquardt(optx.AbstractMinimiser):
    """Levenberg-Marquardt on a likelihood given as a `Quadratic`, within a box.

    The objective returns ``(cost, Quadratic)``, so that one evaluation serves value, gradient and
    information. Damping is by the information's diagonal (Marquardt's scaling, Moré 1978), which
    makes the steps independent of the parameters' units. A step is the best that the damped
    quadratic allows within the box. What the information lacks of the cost's Hessian, the residuals
    times their second derivatives, is learned from the gradients as steps go (NL2SOL: Dennis, Gay &
    Welsch 1981), and counted in after a step whose gain it foretold better than the information
    alone did. Where much is missing from a model residuals are large, and steps without it creep: a
    basic boat on logs with a current and a weak thruster took 197 steps on segments, and takes 17.
    A coordinate at a kink of its own has a damping of its own, so that the others move on: a
    command's limit ended at the highest command of one of a T200's tables, where any step raised
    the cost, and the digits of BLAS decided how far the others had come.

    The iteration ends where a Gauss-Newton step, damped at kinks alone, would gain less than
    ``atol`` in log-likelihood or than the cost resolves (`EQUAL`); where a step is refused that
    costs nothing, for what rounding makes of a slope along a weak axis promises more than there is;
    or where steps creep (`_CREEPING`). A trial whose cost is not finite is rejected like any other
    bad trial.
    """

    rtol: float
    atol: float
    lower: Any
    upper: Any
    norm: Callable[[Any], Any] = optx.max_norm

    def init(
        self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any
    ) -> _State:
        channels = aux_struct.sigma.shape[0]
        return jax.tree.map(jnp.asarray, _begin(y, channels, aux_struct.scores.shape))

    def step(
        self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any
    ) -> tuple[Any, _State, Any]:
        _, new = fn(state.trial, args)
        old = state.quadratic
        gain = old.cost - new.cost
        first = state.steps == 0
        predicted = jnp.where(state.curved, state.predicted[1], state.predicted[0])
        # a failed simulation costs infinity: as zero residuals it would look like a perfect fit
        accept = (first | (gain > 1e-4 * predicted)) & jnp.isfinite(new.cost)
        move = state.trial - y
        curvature = jnp.where(
            accept & ~first, _secant(state.curvature, move, old, new), state.curvature
        )
        miss = new.gradient - old.gradient - old.information @ move
        kinks = self._kinks(y, move, miss, old, new, state)
        away = jnp.abs(state.predicted - gain)
        curved = ~first & accept & (away[1] < away[0])
        y = jnp.where(accept, state.trial, y)
        q = jax.tree.map(lambda a, b: jnp.where(accept, a, b), new, old)
        good = accept & (gain > 0.7 * predicted)
        factor = jnp.where(good, 0.1, jnp.where(accept, 0.5, 5.0))
        damping = jnp.where(first, state.damping, jnp.clip(state.damping * factor, 1e-12, 1e14))
        caught = ~accept & kinks
        missed = jnp.where(
            accept, jnp.stack([jnp.full_like(y, jnp.inf), jnp.zeros_like(y)]), state.missed
        )
        missed = jnp.where(~accept & jnp.isfinite(new.cost), jnp.stack([abs(move), miss]), missed)
        own = jnp.where(accept & ~kinks, state.own / 2.0, state.own)
        own = jnp.where(caught, jnp.maximum(own, 1.0) * _SHORTER, jnp.where(own < 1.0, 0.0, own))
        # its own damping shortens the step from now on; the others had no part in the loss
        damping = jnp.where(jnp.any(caught), state.damping, damping)
        damping = jnp.where(jnp.any(caught & (state.own == 0)), _DAMPING, damping)
        move, curved, remaining = self._move(y, q, curvature, curved, damping, own)
        plain = -(q.gradient @ move + 0.5 * move @ q.information @ move)
        predicted = jnp.stack([plain, plain - 0.5 * move @ curvature @ move])
        stuck = (damping >= 1e13) & ~accept
        since = state.since + jnp.where(accept, 1, 0)
        full = since >= _CREEPING
        creeps = full & (state.mark - q.cost < _CREPT)
        since, mark = jnp.where(full | first, 0, since), jnp.where(full | first, q.cost, state.mark)
        # lest its damping hide what a coordinate could gain by itself
        promised = jnp.where((own > 0) & ~self._is_blocked(y, q), _promised(q, own), 0.0)
        least = jnp.maximum(self.atol, jnp.minimum(EQUAL * jnp.abs(q.cost), _CREPT))
        lost = ~accept & (jnp.abs(gain) <= EQUAL * jnp.abs(old.cost)) & (remaining < _CREPT)
        ends = ((remaining < least) | lost) & (jnp.max(promised) < jnp.minimum(least, _CREPT))
        settled = jnp.isfinite(q.cost) & (ends | creeps)
        failed = ~jnp.isfinite(q.cost) | stuck | (state.steps >= args[1])
        steps = state.steps + 1
        ahead = (y + move, q, curvature, curved, damping, predicted)
        return y, _State(*ahead, steps, mark, since, own, missed, settled, failed), q

    def _kinks(
        self, y: Any, move: Any, miss: Any, old: Quadratic, new: Quadratic, state: _State
    ) -> Any:
        """Which coordinate's kink a step crossed, if it crossed that of one alone.

        Its slope turned round, by so much that this may be all that the step lost, and all other
        slopes missed little: where runs stick and slip, kinks are along no coordinate. Before it is
        damped a first time it must have missed by as much over a longer step: a curved valley has
        less of it the shorter the step. Never one that promises less than ``atol``. Two kinks that
        one step crosses are not told apart.
        """
        length, missed = state.missed
        loss = state.predicted[0] - (old.cost - new.cost)
        blocked = self._is_blocked(y, old)
        share = jnp.where(blocked, 0.0, miss**2 / _information(old))
        alone = share > _ALONE * jnp.sum(share)
        sharp = (abs(move) < 0.5 * length) & (missed != 0) & (miss / missed > _SHARP)
        turns = (old.gradient * new.gradient < 0) & (abs(miss) > abs(old.gradient))
        turns &= miss * move > 0.99 * loss
        worth = _promised(old, jnp.zeros_like(y)) > self.atol
        return alone & turns & worth & (sharp | (state.own > 0)) & jnp.isfinite(new.cost)

    def _is_blocked(self, y: Any, q: Quadratic) -> Any:
        """Which coordinates cannot move downhill: held, at a bound, or without any influence."""
        low, high = y <= self.lower + _CONTACT, y >= self.upper - _CONTACT
        still = q.information.diagonal() <= NOTHING**2
        return (low & (q.gradient >= 0)) | (high & (q.gradient <= 0)) | still

    def _move(
        self, y: Any, q: Quadratic, curvature: Any, curved: Any, damping: Any, own: Any
    ) -> tuple[Any, Any, Any]:
        """The damped step within the box, and what one damped at kinks alone would still gain."""
        # Unit columns first, so that damping with the identity is Marquardt's scaling. Optimistix's
        # own solver damps unscaled: with units 1e3 apart it reported success at a cost of 188,
        # where the optimum costs 0.085. A coordinate that nothing depends on stays where it is.
        scale = jnp.sqrt(jnp.diagonal(q.information))
        held = (scale * jnp.maximum(1.0, abs(y)) < NOTHING) | ~jnp.isfinite(scale)
        scale = jnp.where(held, 1.0, scale)
        scaled = q.information / scale[:, None] / scale[None, :]
        held_pair = held[:, None] | held[None, :]
        scaled = jnp.where(held_pair, 0.0, scaled)
        scaled = jnp.where(jnp.isfinite(scaled), scaled, 0.0)
        slope = jnp.where(held, 0.0, q.gradient / scale)
        low, high = (jnp.where(abs(side - y) <= _CONTACT, 0.0, side - y) * scale
                     for side in (self.lower, self.upper))  # fmt: skip
        damped, flat = (scaled + jnp.diag(least + own) for least in (damping, _FLAT))
        scaled_curvature = curvature / scale[:, None] / scale[None, :]
        hessian = damped + jnp.where(held_pair, 0.0, scaled_curvature)
        curved = curved & jnp.all(jnp.isfinite(jnp.linalg.cholesky(hessian)))  # it has a minimum
        damped = jnp.where(curved, hessian, damped)
        # one after the other, so that the search within the box is compiled once for both
        move, full = jax.lax.map(
            lambda matrix: least_in_box(matrix, slope, low, high), jnp.stack([damped, flat])
        )
        # of that step: under strong damping every step is short, also far from an optimum
        remaining = -(slope @ full + 0.5 * full @ scaled @ full)
        return jnp.clip(y + move / scale, self.lower, self.upper) - y, curved, remaining

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: _State, tags: Any
    ) -> tuple[Any, Any]:
        result = optx.RESULTS.where(
            state.failed & ~state.done,
            optx.RESULTS.nonlinear_divergence,
            optx.RESULTS.successful,
        )
        return state.done | state.failed, result

    def postprocess(
        self,
        fn: Any,
        y: Any,
        aux: Any,
        args: Any,
        options: Any,
        state: _State,
        tags: Any,
        result: Any,
    ) -> tuple[Any, Any, dict[str, Any]]:
        return y, state.quadratic, {}


def _information(q: Quadratic) -> Any:
    """Of each coordinate by itself; never zero."""
    return q.information.diagonal() + NOTHING**2


def _promised(q: Quadratic, own: Any) -> Any:
    """What each coordinate would gain by itself under a damping of its own."""
    return q.gradient**2 / (_information(q) * (1.0 + own))


def _secant(curvature: Any, step: Any, old: Quadratic, new: Quadratic) -> Any:
    """The curvature after a step, sized, and changed no more than the gradients ask for.

    As in Nocedal & Wright 2006, section 10.3, but for what the information leaves of the change of
    the gradient: there it is taken from the residuals, which are not kept here.
    """
    change = new.gradient - old.gradient
    residual_part = change - new.information @ step
    before = jnp.abs(step @ curvature @ step)
    size = jnp.abs(step @ residual_part) / jnp.maximum(before, 1e-300)
    curvature = jnp.minimum(1.0, size) * curvature
    slope = change @ step
    error = residual_part - curvature @ step
    product = jnp.outer(error, change)
    update = (product + product.T) / slope - (step @ error) * jnp.outer(change, change) / slope**2
    updated = curvature + update
    sound = (slope > 0) & jnp.all(jnp.isfinite(updated))
    return jnp.where(sound, updated, curvature)


class Solved(NamedTuple):
    """One start, carried as far as its budget went."""

    z: np.ndarray
    quadratic: Quadratic
    done: bool  # the stopping rule was met
    steps: int
    kinked: np.ndarray  # coordinates at a kink, along which nothing is to be gained either way

    @property
    def cost(self) -> float:
        """Negative log-likelihood; infinite where the simulation fails."""
        cost = float(self.quadratic.cost)
        return cost if np.isfinite(cost) else np.inf


@program(1)
def solved_by_passes(
    layout: Any, numbers: Any, z: Any, low: Any, high: Any, budget: Any, atol: Any, turn: Any = None
) -> Any:
    solver = BoundedLevenbergMarquardt(rtol=0.0, atol=atol, lower=low, upper=high)
    solution = optx.minimise(
        _objective(layout), solver, z, (numbers, budget, turn), has_aux=True, max_steps=MOST_STEPS,
        throw=False,
    )  # fmt: skip
    state = solution.state
    return solution.value, solution.aux, state.done, solution.stats["num_steps"], state.own


_solved_quickly_compiled = Programs(solved_by_passes.function, 1, quick_compile=True)


@lru_cache(maxsize=KEPT)
def _spent(layout: Any) -> list[int]:
    """The work so far of all searches with a quickly compiled program."""
    return [0]


def _runs_quickly_compiled(problem: Problem) -> bool:
    if not problem.quick_compile or problem.work > _QUICK_PASS:
        return False
    return _spent(problem.layout)[0] < _QUICK_WORK


@program(1)
def _further(layout: Any, arguments: Any) -> Any:
    """Some steps from where the last ones ended: the iteration of `solved_by_passes`, in parts."""
    numbers, y, state, low, high, budget, atol, turn = arguments
    solver = BoundedLevenbergMarquardt(rtol=0.0, atol=atol, lower=low, upper=high)
    objective = _objective(layout)

    def on(carry: Any) -> Any:
        _, state, count = carry
        return ~(state.done | state.failed) & (count < _AT_A_TIME)

    def step(carry: Any) -> Any:
        y, state, count = carry
        y, state, _ = solver.step(objective, y, (numbers, budget, turn), {}, state, frozenset())
        return y, state, count + 1

    return jax.lax.while_loop(on, step, (y, state, 0))[:2]


def _objective(layout: Any) -> Callable[[Any, Any], tuple[Any, Quadratic]]:
    def objective(y: Any, args: Any) -> tuple[Any, Quadratic]:
        if (turn := args[2]) is None:
            q = evaluate(layout, args[0], y)
            return q.cost, q
        matrix, shift = turn
        q = evaluate(layout, args[0], matrix @ y + shift)
        return q.cost, q.turned(matrix)

    return objective


def solve(
    problem: Problem,
    z: np.ndarray,
    budget: int = MOST_STEPS,
    tolerance: float = 1e-9,
    limits: tuple[np.ndarray, np.ndarray] | None = None,
) -> Solved:
    """Minimise the negative log-likelihood from ``z`` in at most ``budget`` steps.

    Other ``limits`` than the problem's own hold a coordinate where both are equal; they are numbers
    like all others, so that nothing is compiled for them.
    """
    budget = min(budget, _COMPARED_STEPS) if problem.compared else budget
    low, high = problem.limits() if limits is None else limits
    z, layout, numbers, turn = np.clip(z, low, high), problem.layout, problem.numbers, problem.turn
    if turn is not None:
        low, high = turn.limited(low, high)
        z = np.clip(turn.to(z), low, high)
    affine = None if turn is None else (turn.matrix, turn.shift)
    bounds = (low, high, np.asarray(budget - 1), np.asarray(tolerance))
    side_by_side = shared_runs()
    if side_by_side is None:
        quick = _runs_quickly_compiled(problem)
        search = _solved_quickly_compiled if quick else solved_by_passes
        value, quadratic, settled, steps, own = search(layout, numbers, z, *bounds, affine)
        if quick:
            _spent(layout)[0] += int(steps) * problem.work
        quadratic = Quadratic(*(np.asarray(component) for component in quadratic))
        return _ended(np.asarray(value), quadratic, settled, steps, np.asarray(own), turn)
    state = _begin(z, len(layout.channels), (layout.width or len(layout.free), 0))
    while not (state.done or state.failed):
        carried = (numbers, z, state, *bounds, affine)
        z, state = side_by_side.ask(_further, layout, carried)
    return _ended(z, state.quadratic, state.done, state.steps, state.own, turn)


def _ended(
    z: np.ndarray, q: Quadratic, done: Any, steps: Any, own: np.ndarray, turn: Turn | None
) -> Solved:
    """Where a search ended, in the coordinates of the problem."""
    kinked = (own > 0) & (_promised(q, own) < _CREPT)  # their damping hides nothing more to gain
    if turn is not None:
        inverse = 2.0 * np.eye(turn.shift.size) - turn.matrix
        z, q = turn.matrix @ z + turn.shift, q.turned(inverse)
        kinked &= (turn.matrix == np.eye(z.size)).all(axis=0)
    return Solved(z, q, bool(done), int(steps), kinked)


def _begin(z: Any, channels: int, scores: tuple[int, ...]) -> _State:
    """Before the first step."""
    n, sigma = z.size, np.zeros(channels)
    zero, no, far, none = np.asarray(0.0), np.asarray(False), np.asarray(np.inf), np.asarray(0)
    q = Quadratic(far, np.zeros(n), np.zeros((n, n)), zero, sigma, np.zeros(scores))
    flat, pair = np.zeros((n, n)), np.stack([far, far])
    own, missed = np.zeros(n), np.stack([np.full(n, np.inf), np.zeros(n)])
    return _State(z, q, flat, no, np.asarray(_DAMPING), pair, none, far, none, own, missed, no, no)
