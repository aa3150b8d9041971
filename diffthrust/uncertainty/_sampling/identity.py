"""Identity of the problem that a chain file belongs to, in readable form."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.uncertainty._sampling.posterior import Posterior


def problem_identity(posterior: Posterior, **settings: Any) -> dict[str, dict[str, str]]:
    """Everything that identifies a problem, in readable form: model, parameters, data, settings."""
    problem, fit = posterior.problem, posterior.fit
    layout, numbers = problem.layout, problem.numbers
    # addresses of functions differ from process to process
    structure = re.sub(r" at 0x[0-9a-f]+", "", repr(problem.model.structure))
    parameters = {}
    for name, p in problem.named.items():
        held = f"fixed at {p.value!r}" if p.fixed or name not in layout.free else "free"
        parameters[name] = f"{held}, {p.transform}, within {p.range_text()}, prior {p.prior}"
    data, restarts = {}, hashlib.sha256()
    for batch, indices in zip(numbers.batches, problem.order, strict=True):
        _digest(restarts, {name: restart.value for name, restart in batch.restarts.items()})
        lasting = {n: (r.series, r.unsigned) for n, r in batch.restarts.items()}
        arrays = {**vars(batch), "restarts": lasting}
        for row, index in enumerate(indices):
            digest = hashlib.sha256()
            _digest(digest, jax.tree.map(lambda a, row=row: a[row], arrays))
            data[f"log {index + 1}"] = digest.hexdigest()
    for i, channel in enumerate(layout.channels):
        level = float(numbers.noise[i]) if layout.known_noise[i] else None
        data[f"noise of {channel}"] = "estimated" if level is None else repr(level)
    facts = {
        **settings,
        "likelihood": fit.likelihood,
        "loss": layout.likelihood.law.word,
        "lasting noise": layout.likelihood.noise.lasts,
        "substeps": [problem.substeps] * len(layout.grids),
        "horizon": fit.horizon,
        "restarts": restarts.hexdigest()[:12] if fit.horizon is not None else None,
        "coordinates": posterior.labels,
        # nine digits: the last ones differ between machines, on which a chain may be resumed
        "scales": [f"{s:.9g}" for s in np.asarray(numbers.scales)],
        "limits of errors": [f"{s:.9g}" for s in np.asarray(numbers.clip)],
    }
    return {
        "model": {str(problem.model): hashlib.sha256(structure.encode()).hexdigest()},
        "parameters": parameters,
        "data": data,
        "settings": {name: str(value) for name, value in facts.items()},
    }


def _digest(digest: Any, tree: Any) -> None:
    for path, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]:
        array = np.asarray(leaf)
        digest.update(f"{jax.tree_util.keystr(path)} {array.dtype} {array.shape}".encode())
        digest.update(array.tobytes())


def same_problem(path: Path, stored: Any, current: Mapping[str, Mapping[str, str]]) -> None:
    """Raise `InputError` if a file holds the chain of another problem; names the differences."""
    if stored == current:
        return
    differing = []
    for section in ("model", "parameters", "data", "settings"):
        a, b = stored.get(section, {}), current[section]
        names = [name for name in {**a, **b} if a.get(name) != b.get(name)]
        if section == "model" and names:
            differing.append(f"model: {', '.join(a)} in the file, {', '.join(b)} now")
        elif section == "data" and names:
            differing.append(f"data: {', '.join(names)}")
        elif names:
            differing += [
                f"{section}, {n}: {a.get(n, 'absent')} in the file, {b.get(n, 'absent')} now"
                for n in names
            ]
    raise InputError(
        f"{path}: the chain of another problem. What differs: {'; '.join(differing)}.",
        "Name another file, or sample with what this one was begun with. It was left as it is.",
    )
