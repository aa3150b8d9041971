"""Draws of a model's parameters: from a posterior, or from the covariance of a fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.results import Brief
from diffthrust._support.validation import whole_number
from diffthrust.estimation._rebuild import check_mark
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.models._base.model import Model

_ROUNDS = 200
"""Most rounds of redrawing draws of a covariance that lie outside the bounds."""


@dataclass(frozen=True, repr=False)
class Draws(Brief):
    """Draws of the parameters of a model and of its noise, each ``(n,)`` by name.

    Those of fixed parameters are constant.
    """

    model: Model
    values: Mapping[str, np.ndarray]
    noise: Mapping[str, np.ndarray]
    """Standard deviation by channel; the scale, for a Student-t loss."""
    nuisance: Mapping[str, np.ndarray]
    """Gains and memories of an observer, or correlation times of the noise."""
    kind: str
    """Where they are from: "posterior" or "covariance"."""
    likelihood: str = "simulation"
    loss: str = "gaussian"
    fit: Fit | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))


def draws_of(source: Any, model: Any, *, count: int, seed: int, level: float = 0.95) -> Draws:
    """At most ``count`` draws of the parameters, of a posterior or a fit.

    Those of a fit come from the Gaussian of its covariance in its own coordinates (logarithms of
    parameters that are positive by nature), redrawn if outside the bounds; parameters without a
    standard error keep their values, with a note. ``level`` is only checked.
    """
    whole_number("draws", count, 2)
    whole_number("seed", seed, 0)
    check_level(level)
    rng = np.random.default_rng(seed)
    fit = model if isinstance(model, Fit) else source if isinstance(source, Fit) else None
    drawn_model = model.model if isinstance(model, Fit) else model
    if drawn_model is None and fit is not None:
        drawn_model = fit.model
    if not isinstance(drawn_model, Model):
        raise InputError(
            f"Expected the model of the posterior or a fit of it, found {type(model).__name__}.",
            "Give the model or the fit besides the posterior.",
        )
    if isinstance(source, Fit):
        drawn = _of_fit(source, drawn_model, count, rng)
    else:
        drawn = _of_posterior(source, drawn_model, fit, count, rng)
    return _in_a_new_log(drawn, rng)


def check_level(level: Any, where: str = "level") -> None:
    """Raise `InputError` for an invalid probability of intervals."""
    if not (isinstance(level, float) and 0 < level < 1):
        raise InputError(
            f"{where}: expected a number between 0 and 1, found {level!r}.",
            "Write level=0.95 for 95 %.",
        )


def _in_a_new_log(draws: Draws, rng: np.random.Generator) -> Draws:
    """The draws of a log of which nothing is known: what differs by log is as wide as in others."""
    values = dict(draws.values)
    spread = []
    for name in draws.model.per_log:
        p = draws.model.parameters[name]
        if p.width is not None:
            away = p.width * rng.standard_normal(values[name].shape)
            moved = values[name] * np.exp(away) if p.transform == "log" else values[name] + away
            values[name] = np.clip(moved, *p.limits)
            spread.append(name)
    if not spread:
        return draws
    note = f"{listing(spread)} differs by log: drawn as in a log of which nothing is known."
    return replace(draws, values=values, notes=(*draws.notes, note))


def _of_fit(fit: Fit, model: Model, count: int, rng: np.random.Generator) -> Draws:
    if fit.status is Status.SIMULATION_FAILED:
        raise InputError("The fit failed, so that there is nothing to draw from.", fit.message)
    _same(model, fit.parameters, "The fit")
    determined = [i for i in range(len(fit.free)) if np.isfinite(fit.covariance[i, i])]
    names = [fit.free[i] for i in determined]
    if not names:
        raise InputError(
            "No parameter of the fit has a standard error, so that there is nothing to draw.",
            fit.message,
        )
    held = [n for n in fit.free if n not in names]
    notes = fit.correlation if fit.status.ok else (f"The fit is to be doubted. {fit.message}",)
    if held:
        has, them = "has no standard error and is held at its value", "it"
        if len(held) > 1:
            has, them = "have no standard error and are held at their values", "them"
        narrow = f"intervals that depend on {them} are too narrow."
        notes += (f"{listing(held)} {has}: {narrow}",)
    described = [fit.model.parameters[n] for n in names]
    best = np.array([fit.parameters[n].value for n in names])
    logs = np.array([p.transform == "log" for p in described])
    # to first order d(log p) = dp / p: the covariance of the fit's own coordinates
    slope = np.where(logs, best, 1.0)
    covariance = fit.covariance[np.ix_(determined, determined)] / np.outer(slope, slope)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    # no Cholesky factor: a covariance with a parameter at its bound is singular
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    low, high = np.array([p.limits for p in described]).T

    def some(wanted: int) -> np.ndarray:
        moved = rng.standard_normal((wanted, len(names))) @ root.T
        return np.where(logs, best * np.exp(np.where(logs, moved, 0.0)), best + moved)

    drawn = some(count)
    for _ in range(_ROUNDS):
        outside = np.any((drawn < low) | (drawn > high), axis=1)
        if not outside.any():
            break
        # redrawn and not clipped: a mass of draws at the bound would end every interval there
        drawn[outside] = some(int(outside.sum()))
    constant = {n: np.full(count, e.value) for n, e in fit.parameters.items()}
    return Draws(
        model=model,
        values=constant | dict(zip(names, np.clip(drawn, low, high).T, strict=True)),
        noise={c: np.full(count, s) for c, s in fit.noise.items()},
        nuisance={n: np.full(count, e.value) for n, e in (fit.disturbance or {}).items()},
        kind="covariance",
        likelihood=fit.likelihood,
        loss=fit.loss,
        fit=fit,
        notes=notes,
    )


def _of_posterior(
    source: Any, model: Model, fit: Fit | None, count: int, rng: np.random.Generator
) -> Draws:
    posterior = posterior_data(source)
    scalars = scalars_of(posterior)
    drawn = [n for n in scalars if n in model.parameters]
    _same(model, [n for n in scalars if not n.startswith("noise.")], "The posterior", subset=True)
    silent = {*drawn, *(set(fit.model.parameters) - set(fit.free) if fit else ())}
    absent = [n for n, p in model.parameters.items() if not p.fixed and n not in silent]
    if absent:
        raise InputError(
            f"The posterior has no draws of {listing(absent)}, which the model '{model}' leaves "
            f"free; it has {listing(drawn)}.",
            "Give the model that was sampled, or the fit that it was sampled from.",
        )
    if fit is not None:
        check_mark(source, fit, "draws of a posterior")
    total = posterior.sizes["chain"] * posterior.sizes["draw"]
    picked = np.sort(rng.choice(total, min(count, total), replace=False))

    fixed = {n: p.value for n, p in model.parameters.items()}
    fixed |= {n: e.value for n, e in fit.parameters.items() if n in fixed} if fit else {}
    values = {n: np.full(picked.size, value) for n, value in fixed.items()}
    values |= {n: scalars[n].reshape(-1)[picked] for n in drawn}
    bad = [n for n in drawn if not np.all(np.isfinite(values[n]))]
    if bad:
        raise InputError(
            f"The posterior's draws of {listing(bad)} are not all finite.", "Sample again."
        )
    noise = {c: np.full(picked.size, s) for c, s in (fit.noise if fit else {}).items()}
    if "sigma" in posterior and "channel" in posterior["sigma"].dims:
        sigma = posterior["sigma"].transpose("chain", "draw", "channel")
        levels = np.asarray(sigma.values, float).reshape(total, -1)[picked].T
        noise |= dict(zip(map(str, sigma["channel"].values), levels, strict=True))
    attrs = {**source.attrs, **posterior.attrs}
    held = (fit.disturbance if fit else None) or {}
    return Draws(
        model=model,
        values=values,
        noise=noise,
        nuisance={
            **{n: np.full(picked.size, e.value) for n, e in held.items()},
            **{n: v.reshape(-1)[picked] for n, v in scalars.items() if n.startswith("noise.")},
        },
        kind="posterior",
        likelihood=fit.likelihood if fit else str(attrs.get("likelihood", "simulation")),
        loss=fit.loss if fit else str(attrs.get("loss", "gaussian")),
        fit=fit,
        notes=tuple(filter(None, str(attrs.get("doubts", "")).split("\n"))),
    )


def posterior_data(source: Any) -> Any:
    """The posterior's data set in the result of `sample`."""
    posterior = getattr(source, "posterior", None)
    if posterior is None or not hasattr(posterior, "data_vars"):
        raise InputError(
            f"Expected a fit or a posterior, found {type(source).__name__}"
            f"{' without a posterior' if hasattr(source, 'groups') else ''}.",
            "Give what dft.fit or dft.sample returns.",
        )
    sizes = {str(name): int(size) for name, size in posterior.sizes.items()}
    if not posterior.data_vars or not sizes.get("chain") or not sizes.get("draw"):
        raise InputError(
            "The posterior is empty: expected draws by chain and draw, found "
            f"{listing(posterior.data_vars)} with {sizes or 'no dimensions'}.",
            "Sample again, with draws=2000.",
        )
    return posterior


def scalars_of(posterior: Any) -> dict[str, np.ndarray]:
    """The draws ``(chain, draw)`` of each parameter of the model and of its noise."""
    return {
        str(name): np.asarray(variable.transpose("chain", "draw").values, float)
        for name, variable in posterior.data_vars.items()
        if set(variable.dims) == {"chain", "draw"}
    }


def _same(model: Model, names: Collection[str], what: str, subset: bool = False) -> None:
    """Raise `InputError` if the parameters belong to another model."""
    unknown = [n for n in names if n not in model.parameters]
    missing = [] if subset else [n for n in model.parameters if n not in names]
    if unknown or missing:
        raise InputError(
            f"{what} is of another model: it has the parameters {listing(names)}, "
            f"'{model}' has {listing(model.parameters)}.",
            "Give the model that was fitted, with its effects.",
        )
