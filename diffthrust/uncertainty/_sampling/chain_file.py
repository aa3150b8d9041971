"""The file of a chain: whole at every moment, resumed exactly, and never another problem's."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import emcee
import h5py
import jax
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.uncertainty._sampling.posterior import Posterior

_SCHEMA = 1
_OWN = "diffthrust"
"""The group in which the file says whose chain it is; the chain itself is in emcee's ``mcmc``."""


@dataclass(frozen=True)
class Stored:
    """A chain as far as it went.

    Args:
        chain: coordinates by step and walker, ``(n, W, d)``, those of the warmup first.
        log_prob: log densities, ``(n, W)``.
        levels: noise levels, ``(n, W, C)``.
        accepted: accepted proposals of each walker, ``(W,)``.
        random_state: of the generator after the last step.
        centre: of the proposals, ``(d,)``.
        root: of their covariance, lower triangle, ``(d, d)``.
    """

    chain: np.ndarray
    log_prob: np.ndarray
    levels: np.ndarray
    accepted: np.ndarray
    random_state: tuple[Any, ...]
    centre: np.ndarray
    root: np.ndarray


def problem_identity(posterior: Posterior, **settings: Any) -> dict[str, dict[str, str]]:
    """What makes a chain that of one problem, in words: model, parameters, data, settings."""
    problem, fit = posterior.problem, posterior.fit
    layout, numbers = problem.layout, problem.numbers
    structure = re.sub(r" at 0x[0-9a-f]+", "", repr(problem.model.structure))
    parameters = {}
    for name, p in problem.named.items():
        held = f"fixed at {p.value!r}" if p.fixed or name not in layout.free else "free"
        parameters[name] = f"{held}, {p.transform}, within {p.range_text()}, prior {p.prior}"
    data, begun = {}, hashlib.sha256()
    for batch, indices in zip(numbers.batches, problem.order, strict=True):
        _digest(begun, {name: restart.value for name, restart in batch.restarts.items()})
        lasting = {n: (r.series, r.unsigned) for n, r in batch.restarts.items()}
        rest = {**vars(batch), "restarts": lasting}
        for row, index in enumerate(indices):
            digest = hashlib.sha256()
            _digest(digest, jax.tree.map(lambda a, row=row: a[row], rest))
            data[f"log {index + 1}"] = digest.hexdigest()
    for i, channel in enumerate(layout.channels):
        known = float(numbers.noise[i]) if layout.known_noise[i] else None
        data[f"noise of {channel}"] = "estimated" if known is None else repr(known)
    facts = {
        **settings,
        "likelihood": fit.likelihood,
        "loss": layout.likelihood.law.word,
        "lasting noise": layout.likelihood.noise.lasts,
        "substeps": [grid.substeps for grid in layout.grids],
        "horizon": fit.horizon,
        "restarts": begun.hexdigest()[:12] if fit.horizon is not None else None,
        "coordinates": posterior.labels,
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


def chain_bytes(stored: Stored, who: Mapping[str, Any], labels: tuple[str, ...]) -> bytes:
    """The bytes of the file: equal for equal chains, in the layout of `emcee.backends.HDFBackend`.

    The file is made anew in memory each time, so that nothing in it tells how often it was saved.
    """
    steps, walkers, dim = stored.chain.shape
    with h5py.File("memory", "w", driver="core", backing_store=False) as f:
        g = f.create_group("mcmc")
        g.attrs["version"] = emcee.__version__
        g.attrs["nwalkers"], g.attrs["ndim"] = walkers, dim
        g.attrs["has_blobs"], g.attrs["iteration"] = True, steps
        for i, part in enumerate(stored.random_state):
            g.attrs[f"random_state_{i}"] = part
        g.create_dataset("accepted", data=stored.accepted)
        g.create_dataset("chain", data=stored.chain, maxshape=(None, walkers, dim))
        g.create_dataset("log_prob", data=stored.log_prob, maxshape=(None, walkers))
        kind = np.dtype((np.float64, stored.levels.shape[2:]))
        blobs = g.create_dataset("blobs", (steps, walkers), maxshape=(None, walkers), dtype=kind)
        blobs[...] = stored.levels
        ours = f.create_group(_OWN)
        text = json.dumps(who, sort_keys=True)
        ours.attrs["schema"] = _SCHEMA
        ours.attrs["hash"] = hashlib.sha256(text.encode()).hexdigest()
        ours.attrs["coordinates"] = list(labels)
        ours.create_dataset("problem", data=text)  # an attribute could not hold a large model
        ours.create_dataset("centre", data=stored.centre)
        ours.create_dataset("root", data=stored.root)
        f.flush()
        return f.id.get_file_image()


def write(path: Path, data: bytes) -> None:
    """Replace a file by a whole new one, which is on the disk before the old one goes.

    Raises:
        InputError: a full disk or a folder that cannot be written to; the old file is untouched.
    """
    target = path.resolve()
    temporary = _temporary(target)
    try:
        with open(temporary, "wb") as f:
            f.write(data)
            f.flush()
            os.fsync(f.fileno())
        os.replace(temporary, target)
        _settle(target.parent)
    except FileNotFoundError:
        raise InputError(
            f"{path}: the chain cannot be saved: its temporary file or its folder is gone. Another "
            "run may be writing to the same file.",
            "Give each run a file of its own, in a folder that exists.",
        ) from None
    except OSError as error:
        if temporary.is_file():
            temporary.unlink()
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        raise InputError(
            f"{path}: the chain cannot be saved ({error.strerror or error}). What was saved before "
            "is intact.",
            "Make room on the disk and sample again with the same file: the run goes on from there."
            if full
            else "Name a file in a folder that exists and that you may write to.",
        ) from None


def _settle(folder: Path) -> None:
    """The folder's entry on the disk as well, where the system allows it."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:  # some file systems have no such thing for folders
        pass
    finally:
        os.close(handle)


def _temporary(target: Path) -> Path:
    # always the same name: what a killed run left behind is overwritten by the one that resumes
    return target.with_name(f".{target.name}.tmp")


def read(path: Path, who: Mapping[str, Mapping[str, str]]) -> Stored | None:
    """The chain in a file, or ``None`` where there is no file yet.

    Raises:
        InputError: a file that is no chain, is damaged, or belongs to another problem; a folder
            that cannot be written to. Nothing is changed.
    """
    target = path.resolve()
    if not target.exists() or target.is_dir():
        _try(path, target)
        return None
    try:
        with h5py.File(target, "r") as opened:
            f: Any = opened  # a group, a dataset and a type in one, for all that h5py declares
            if _OWN not in f or "mcmc" not in f:
                raise InputError(
                    f"{path}: an HDF5 file, but no chain of this library.",
                    "Name a file that does not exist yet, or that of the run to resume.",
                )
            g, ours = f["mcmc"], f[_OWN]
            text = ours["problem"][()].decode()
            theirs = json.loads(text)
            _same(
                path, theirs, who, hashlib.sha256(text.encode()).hexdigest() == ours.attrs["hash"]
            )
            a = g.attrs
            state = tuple(a[f"random_state_{i}"] for i in range(5))
            stored = Stored(
                chain=g["chain"][...],
                log_prob=g["log_prob"][...],
                levels=g["blobs"][...],
                accepted=g["accepted"][...],
                random_state=(
                    str(state[0]),
                    state[1],
                    int(state[2]),
                    int(state[3]),
                    float(state[4]),
                ),
                centre=ours["centre"][...],
                root=ours["root"][...],
            )
            if stored.chain.shape[0] != a["iteration"] or not np.isfinite(stored.log_prob).all():
                raise ValueError("the chain is not whole")
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{path}: expected the file of a chain, found a file that is damaged or of another "
            f"kind ({error}).",
            "Name a file that does not exist yet; this one was left as it is.",
        ) from None
    _try(path, target)
    return stored


def _try(path: Path, target: Path) -> None:
    """Raise `InputError` before the work where nothing could be saved after it."""
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        with open(_temporary(target), "wb"):
            pass
        _temporary(target).unlink()
    except OSError as error:
        raise InputError(
            f"{path}: the chain could not be saved there ({error.strerror or error}).",
            "Name a file in a folder that exists and that you may write to.",
        ) from None


def _same(path: Path, theirs: Any, ours: Mapping[str, Mapping[str, str]], whole: bool) -> None:
    if whole and theirs == ours:
        return
    differing = []
    for part in ("model", "parameters", "data", "settings"):
        a, b = theirs.get(part, {}), ours[part]
        names = [name for name in {**a, **b} if a.get(name) != b.get(name)]
        if part == "model" and names:
            differing.append(f"model: {', '.join(a)} in the file, {', '.join(b)} now")
        elif part == "data" and names:
            differing.append(f"data: {', '.join(names)}")
        elif names:
            differing += [
                f"{part}, {n}: {a.get(n, 'absent')} in the file, {b.get(n, 'absent')} now"
                for n in names
            ]
    if not differing:
        raise ValueError("its description does not match its hash")
    raise InputError(
        f"{path}: the chain of another problem. What differs: {'; '.join(differing)}.",
        "Name another file, or sample with what this one was begun with. It was left as it is.",
    )
