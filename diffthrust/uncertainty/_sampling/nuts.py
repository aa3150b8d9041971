"""Sampling by NUTS (BlackJAX), for posteriors of many parameters."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.batching import run_program
from diffthrust._support._running.programs import program
from diffthrust._support.extras import extra
from diffthrust._support.progress import Progress
from diffthrust.uncertainty._sampling.ensemble import Chains
from diffthrust.uncertainty._sampling.posterior import DensityShape, Posterior, log_density

_BLOCK = 50
"""Draws between progress reports; all blocks share one compilation."""
_INSIDE = 0.3
"""Least distance of the start from a bound, in standard errors: the bound maps to infinity."""


class Box(NamedTuple):
    """Which sides of each coordinate are bounded; static in the program."""

    low: tuple[bool, ...]
    high: tuple[bool, ...]


def to_coordinates(box: Box, data: Any, v: Any) -> tuple[Any, Any]:
    """Coordinates of a whitened, unbounded point ``(d,)``, and log |d(coordinates)/d(point)|.

    A coordinate with two bounds is a logistic function of an unbounded one, with one bound an
    exponential: NUTS cannot handle bounds. The fit's covariance is the unit matrix in the unbounded
    coordinates, which is where the adaptation of NUTS starts.
    """
    u = data["origin"] + data["root"] @ v
    below, above = jnp.array(box.low), jnp.array(box.high)
    both = below & above
    low = jnp.where(below, data["low"], 0.0)
    high = jnp.where(above, data["high"], 0.0)
    width = jnp.where(both, high - low, 1.0)
    one_sided = (below | above) & ~both
    grown = jnp.exp(jnp.where(one_sided, u, 0.0))
    x = jnp.where(below, low + grown, jnp.where(above, high - grown, u))
    x = jnp.where(both, low + width * jax.nn.sigmoid(u), x)
    slope = jnp.where(one_sided, u, 0.0)
    inner = jnp.log(width) + jax.nn.log_sigmoid(u) + jax.nn.log_sigmoid(-u)
    return x, jnp.sum(jnp.where(both, inner, slope))


def from_coordinates(box: Box, low: np.ndarray, high: np.ndarray, x: np.ndarray) -> Any:
    """Unbounded coordinates of a point within the bounds, and d(coordinate)/d(unbounded)."""
    below, above = np.array(box.low), np.array(box.high)
    u, slope = x.copy(), np.ones_like(x)
    both, lower, upper = below & above, below & ~above, above & ~below
    share = (x[both] - low[both]) / (high[both] - low[both])
    u[both] = np.log(share) - np.log1p(-share)
    slope[both] = (high[both] - low[both]) * share * (1.0 - share)
    u[lower], slope[lower] = np.log(x[lower] - low[lower]), x[lower] - low[lower]
    u[upper], slope[upper] = np.log(high[upper] - x[upper]), high[upper] - x[upper]
    return u, slope


def _density(shape: DensityShape, box: Box, data: Any, v: Any) -> Any:
    x, grown = to_coordinates(box, data, v)
    return log_density(shape, data, x)[0] + grown


smooth: Any = jax.custom_jvp(_density, nondiff_argnums=(0, 1))
"""Log density of a whitened, unbounded point, with a custom derivative in forward mode.

BlackJAX differentiates in reverse mode, which takes a hundred times as long through the loop over a
log. The custom rule computes the full gradient in one forward pass and multiplies it by the
tangent, a linear function that reverse mode transposes at no cost.
"""


@smooth.defjvp
def _(shape: DensityShape, box: Box, primals: Any, tangents: Any) -> tuple[Any, Any]:
    data, v = primals
    push = partial(jax.jvp, partial(_density, shape, box, data), (v,))
    basis = (jnp.eye(v.shape[0]),)
    value, gradient = jax.vmap(push, out_axes=(None, 0))(basis)
    # outside the density is -inf; a NaN in its slope would poison the whole trajectory, where a
    # zero ends it as a divergence
    fine = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
    return value, jnp.where(fine, gradient, 0.0) @ tangents[1]


class Target(Protocol):
    """A density to sample; hashable, as it is static in the program.

    Its points should be approximately independent standard normal: there the adaptation starts.
    """

    def density(self, data: Any, v: Any) -> Any:
        """Log density at a point ``(d,)``, without constants; differentiable."""
        ...

    def kept(self, data: Any, v: Any) -> Any:
        """The arrays to keep of a point."""
        ...


class _Unbounded(NamedTuple):
    """A posterior over whitened, unbounded points."""

    shape: DensityShape
    box: Box

    def density(self, data: Any, v: Any) -> Any:
        return smooth(self.shape, self.box, data, v)

    def kept(self, data: Any, v: Any) -> Any:
        return to_coordinates(self.box, data, v)


@contextmanager
def _mixing() -> Iterator[None]:
    """Relax JAX's promotion rules for BlackJAX, which mixes types and ranks freely."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


@program(1)
def warm_up(static: tuple[Target, int], numbers: Any) -> Any:
    """Step size and metric of each chain, and its state after the warmup."""
    import blackjax
    from blackjax.adaptation.base import get_filter_adapt_info_fn

    (target, steps), (data, starts, keys) = static, numbers
    density = partial(target.density, data)

    def chain(start: Any, key: Any) -> Any:
        (state, parameters), _ = warmup.run(key, start, num_steps=steps)
        return state, parameters["step_size"], parameters["inverse_mass_matrix"]

    with _mixing():
        warmup: Any = blackjax.window_adaptation(
            blackjax.nuts, density, adaptation_info_fn=get_filter_adapt_info_fn()
        )
        return jax.vmap(chain)(starts, jax.random.wrap_key_data(keys))


@program(1)
def draw_block(target: Target, numbers: Any) -> Any:
    """A block of draws of each chain."""
    import blackjax

    data, state, step, mass, keys = numbers
    density = partial(target.density, data)
    kernel = blackjax.nuts.build_kernel()

    def chain(state: Any, step: Any, mass: Any, keys: Any) -> Any:
        def turn(state: Any, key: Any) -> Any:
            state, info = kernel(key, state, density, step, mass)
            stats = (info.is_divergent, info.acceptance_rate, info.num_integration_steps)
            return state, (target.kept(data, state.position), state.logdensity, stats)

        return jax.lax.scan(turn, state, keys)

    with _mixing():
        return jax.vmap(chain)(state, step, mass, jax.random.wrap_key_data(keys))


class Walked(NamedTuple):
    """Draws of a target, each ``(chains, draws, ...)``: kept arrays, log densities, statistics."""

    kept: Any
    log_prob: np.ndarray
    stats: dict[str, np.ndarray]


def sample_target(
    target: Target,
    data: Any,
    dim: int,
    *,
    draws: int,
    warmup: int,
    chains: int,
    seed: int,
    progress: Progress,
) -> Walked:
    """Sample a target in ``dim`` coordinates by NUTS, from standard normal starts.

    Chains run in the lanes of the vector registers: four take hardly longer than one.
    """
    begin, adapt, on = jax.random.split(jax.random.key(seed), 3)
    # in whitened coordinates: spread as the posterior is, so that R-hat can see chains that do not
    # mix
    starts = jax.random.normal(begin, (chains, dim))
    progress("warmup", 0.0)
    keys = jax.random.key_data(jax.random.split(adapt, chains))
    state, step, mass = run_program(warm_up, (target, warmup), (data, starts, keys), rows=chains)
    parts = []
    for block in range(-(-draws // _BLOCK)):
        progress("drawing", (warmup + block * _BLOCK) / (warmup + draws))
        # by the number of the block: more draws continue the same stream
        keys = jax.random.split(jax.random.fold_in(on, block), (chains, _BLOCK))
        numbers = (data, state, step, mass, jax.random.key_data(keys))
        state, block_draws = run_program(draw_block, target, numbers, rows=chains)
        parts.append(jax.tree.map(np.asarray, block_draws))
    kept, log_prob, (diverging, rate, steps) = jax.tree.map(
        lambda *part: np.concatenate(part, axis=1)[:, :draws], *parts
    )
    stats = {"diverging": diverging, "acceptance_rate": rate, "n_steps": steps}
    return Walked(kept, log_prob, stats)


def run_nuts(posterior: Posterior, progress: Progress, **sizes: int) -> Chains:
    """Sample a posterior by NUTS; ``sizes`` are draws, warmup, chains and seed."""
    low, high, spread = posterior.low, posterior.high, np.sqrt(np.diagonal(posterior.covariance))
    box = Box(tuple(map(bool, np.isfinite(low))), tuple(map(bool, np.isfinite(high))))
    room = _INSIDE * np.minimum(spread, high - low)
    u, slope = from_coordinates(box, low, high, np.clip(posterior.centre, low + room, high - room))
    root = np.linalg.cholesky(posterior.covariance / np.outer(slope, slope))
    data = {**posterior.data, "origin": jnp.asarray(u), "root": jnp.asarray(root)}
    target = _Unbounded(posterior.shape, box)
    (points, grown), log_prob, stats = sample_target(
        target, data, posterior.dim, progress=progress, **sizes
    )
    levels = np.full((*log_prob.shape, len(posterior.problem.layout.channels)), np.nan)
    if set(posterior.unknown) - set(posterior.sampled):
        _, drawn = posterior.batch(points.reshape(-1, posterior.dim))
        levels = drawn.reshape(levels.shape)
    rate = float(np.mean(stats["acceptance_rate"]))
    return Chains(points, log_prob - grown, levels, stats, {"acceptance_rate": rate})


def available(what: str = "method='nuts'", instead: str = "sample with method='emcee'") -> None:
    """Raise `InputError` if BlackJAX is not installed, naming an alternative."""
    with extra("nuts", what, instead):
        import blackjax  # noqa: F401
