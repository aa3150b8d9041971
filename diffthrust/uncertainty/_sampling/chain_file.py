"""The file of a chain: always complete, resumed exactly, and tied to its problem."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import emcee
import h5py
import jax
import numpy as np

from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.files import is_full, write_by_rename
from diffthrust.uncertainty._sampling.posterior import Posterior

BLOCK = 64
"""Steps per checksum; a run can resume from the end of each block."""
Mark = tuple[np.ndarray, np.ndarray]
"""Accepted proposals of each walker, and the state of the generator, `packed`."""
_MARKS = ("accepted", "random_states")
_SCHEMA = 2
_OWN = "diffthrust"
"""Group with the identity of the problem; the chain itself is in emcee's group ``mcmc``."""
_AS_IT_WAS = "Name a file that does not exist yet; this one was left as it is."


class Chain(emcee.backends.Backend):
    """emcee's own record of a chain in memory, with what a run needs to resume it.

    The steps of the warmup come first. ``centre`` ``(d,)`` and ``root`` ``(d, d)``, the lower
    triangle of the covariance, are those of the first proposals; ``marks`` are taken at the end of
    every `BLOCK` steps.
    """

    def __init__(
        self, walkers: int, centre: np.ndarray, root: np.ndarray, random_state: Any
    ) -> None:
        super().__init__()
        self.reset(walkers, centre.size)
        self.centre, self.root, self.random_state = centre, root, random_state
        self.marks: tuple[Mark, ...] = ()

    def filled(
        self,
        chain: np.ndarray,
        log_prob: np.ndarray,
        levels: np.ndarray,
        accepted: np.ndarray,
        marks: Sequence[Mark],
    ) -> Chain:
        """This chain with steps ``(n, W, d)``, their log densities and noise levels."""
        self.chain, self.log_prob, self.accepted = chain, log_prob, accepted
        # emcee keeps a single number per walker without an axis of its own
        self.blobs = levels[..., 0] if levels.shape[-1] == 1 else levels
        self.iteration, self.marks = len(chain), tuple(marks)
        return self

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates ``(n, W, d)``, log densities ``(n, W)``, noise levels ``(n, W, C)``."""
        n = self.iteration
        # not reshaped to those of the chain: a damaged file may have fewer of one than of the other
        levels = self.blobs[:n]
        return self.chain[:n], self.log_prob[:n], levels if levels.ndim > 2 else levels[..., None]

    def save_step(self, state: Any, accepted: np.ndarray) -> None:
        """Add a step, and a mark at the end of a block."""
        super().save_step(state, accepted)
        if self.iteration == (len(self.marks) + 1) * BLOCK:
            self.marks += ((self.accepted.copy(), packed(self.random_state)),)

    def beginning(self, blocks: int) -> Chain:
        """The chain after the given number of blocks."""
        accepted, state = self.marks[blocks - 1]
        *words, place, has, spare = state
        generator = ("MT19937", np.array(words, np.uint32), int(place), int(has), spare)
        chain, log_prob, levels = (steps[: blocks * BLOCK] for steps in self.steps)
        begun = Chain(self.nwalkers, self.centre, self.root, generator)
        return begun.filled(chain, log_prob, levels, accepted, self.marks[:blocks])


def chain_bytes(chain: Chain, who: Mapping[str, Any], labels: tuple[str, ...]) -> bytes:
    """The bytes of the file: equal for equal chains, in the layout of `emcee.backends.HDFBackend`.

    The file is rebuilt in memory each time: its bytes then do not depend on how often it was saved,
    and a resumed run gives the same file as an uninterrupted one.
    """
    steps, log_prob, levels = chain.steps
    count, walkers, dim = steps.shape
    # never a file that is open, as emcee's own back end writes it: a process killed while HDF5
    # writes leaves a file that no one can read
    with h5py.File("memory", "w", driver="core", backing_store=False) as f:
        g = f.create_group("mcmc")
        g.attrs["version"] = emcee.__version__
        g.attrs["nwalkers"], g.attrs["ndim"] = walkers, dim
        g.attrs["has_blobs"], g.attrs["iteration"] = True, count
        for i, value in enumerate(chain.random_state):
            g.attrs[f"random_state_{i}"] = value
        g.create_dataset("accepted", data=chain.accepted)
        g.create_dataset("chain", data=steps, maxshape=(None, walkers, dim))
        g.create_dataset("log_prob", data=log_prob, maxshape=(None, walkers))
        kind = np.dtype((np.float64, levels.shape[2:]))
        blobs = g.create_dataset("blobs", (count, walkers), maxshape=(None, walkers), dtype=kind)
        blobs[...] = levels
        own_group = f.create_group(_OWN)
        text = json.dumps(who, sort_keys=True)
        own_group.attrs["schema"] = _SCHEMA
        # as bytes: HDF5 reads strings of free length from a heap, and a damaged heap for ever
        own_group.attrs["coordinates"] = np.array([label.encode() for label in labels])
        # an attribute could not hold a large model
        own_group.create_dataset("problem", data=np.frombuffer(text.encode(), np.uint8))
        own_group.create_dataset("centre", data=chain.centre)
        own_group.create_dataset("root", data=chain.root)
        for i, name in enumerate(_MARKS if chain.marks else ()):
            own_group.create_dataset(name, data=np.array([mark[i] for mark in chain.marks]))
        own_group.create_dataset("checksums", data=_checksums(chain, text))
        f.flush()
        return f.id.get_file_image()


def packed(state: tuple[Any, ...]) -> np.ndarray:
    """The state of a generator as numbers: MT19937's 624 words, its place, and a spare normal."""
    return np.array([*state[1], *state[2:]], float)


def _checksums(chain: Chain, problem: str) -> np.ndarray:
    """SHA-256 of the header, of each block, and of the end, ``(blocks + 2, 32)``."""

    def digest(*arrays: np.ndarray) -> np.ndarray:
        sha = hashlib.sha256()
        for array in arrays:
            sha.update(f"{array.shape}".encode())
            sha.update(np.ascontiguousarray(array, float).tobytes())
        return np.frombuffer(sha.digest(), np.uint8)

    sums = [digest(chain.centre, chain.root, np.frombuffer(problem.encode(), np.uint8))]
    ends = [*chain.marks, (chain.accepted, packed(chain.random_state))]
    for i, end in enumerate(ends):
        block = slice(i * BLOCK, (i + 1) * BLOCK if i < len(chain.marks) else None)
        sums.append(digest(*(steps[block] for steps in chain.steps), *end))
    return np.array(sums)


def write(path: Path, data: bytes) -> None:
    """Replace a file atomically: the new file is on the disk before the old one is replaced.

    Raises:
        InputError: the disk is full or the folder not writable; the old file is untouched.
    """
    target = Path(os.path.realpath(path))
    try:
        write_by_rename(target, _temporary(target), data, durable=True)
        with suppress(OSError):  # the folder's entry as well, if the system allows it
            handle = os.open(target.parent, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
    except FileNotFoundError:
        raise InputError(
            f"{path}: the chain cannot be saved: its temporary file or its folder is gone. Another "
            "run may be writing to the same file.",
            "Give each run a file of its own, in a folder that exists.",
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: the chain cannot be saved ({error.strerror or error}). What was saved before "
            "is intact.",
            "Make room on the disk and sample again with the same file: the run goes on from there."
            if is_full(error)
            else "Name a file in a folder that exists and that you may write to.",
        ) from None


def _temporary(target: Path) -> Path:
    # a fixed name: a resumed run overwrites what a killed run left behind
    return target.with_name(f".{target.name}.tmp")


def read(path: Path, who: Mapping[str, Mapping[str, str]]) -> Chain | None:
    """The chain in a file, or ``None`` if there is no file yet.

    Raises:
        InputError: the file is not a chain, is damaged, or belongs to another problem; or the
            folder is not writable. Nothing is changed.
    """
    target = Path(os.path.realpath(path))
    if not target.exists() or target.is_dir():
        _try(path, target)
        return None
    try:
        with h5py.File(target, "r") as opened:
            f: Any = opened  # h5py declares items as group, dataset or type
            if _OWN not in f or "mcmc" not in f:
                raise InputError(
                    f"{path}: an HDF5 file, but no chain of this library.",
                    "Name a file that does not exist yet, or that of the run to resume.",
                )
            g, own_group = f["mcmc"], f[_OWN]
            text = own_group["problem"][...].tobytes().decode()
            # the first, its name, is a string for emcee, in the heap
            words, place, has, spare = (g.attrs[f"random_state_{i}"] for i in range(1, 5))
            generator = ("MT19937", words, int(place), int(has), float(spare))
            steps = g["chain"][...]
            centre, root = own_group["centre"][...], own_group["root"][...]
            marks = [own_group[n][...] for n in _MARKS if n in own_group]
            chain = Chain(steps.shape[1], centre, root, generator).filled(
                steps,
                g["log_prob"][...],
                g["blobs"][...],
                g["accepted"][...],
                tuple(zip(*marks, strict=True)),
            )
            checksums = own_group["checksums"][...]
            labels = tuple(label.decode() for label in own_group.attrs["coordinates"])
    except InputError:  # a ValueError, too
        raise
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise InputError(
            f"{path}: expected the file of a chain, found a file that is damaged or of another "
            f"kind ({error}).",
            _AS_IT_WAS,
        ) from None
    _check_sums(path, chain, text, checksums, labels)
    same_problem(path, json.loads(text), who)
    _try(path, target)
    return chain


def _check_sums(
    path: Path, chain: Chain, text: str, expected: np.ndarray, labels: tuple[str, ...]
) -> None:
    """Raise `InputError` for a damaged chain; the sound blocks are saved to another file."""
    computed = _checksums(chain, text)
    if np.array_equal(computed, expected):
        return
    rows = min(len(computed), len(expected) if expected.shape[1:] == computed.shape[1:] else 0)
    same = (computed[:rows] == expected[:rows]).all(axis=1)
    sound = min(int(np.argmin([*same, False])) - 1, len(chain.marks))  # blocks after the first sum
    problem = f"{path}: the chain is damaged: what is read is not what was written"
    if sound < 1:
        raise InputError(f"{problem}, from its beginning on.", _AS_IT_WAS)
    kept = path.with_name(f"{path.stem}.sound{path.suffix}")
    write(kept, chain_bytes(chain.beginning(sound), json.loads(text), labels))
    raise InputError(
        f"{problem} from step {sound * BLOCK + 1} on. The sound beginning is kept in {kept.name}; "
        f"{path.name} was left as it is.",
        f"Sample again with {kept.name}: the run goes on from there.",
    )


def _try(path: Path, target: Path) -> None:
    """Raise `InputError` before the work starts if the file could not be saved."""
    mend = "Name a file in a folder that exists and that you may write to."
    with os_errors_as(f"{path}: the chain could not be saved there", mend):
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        with open(_temporary(target), "wb"):
            pass
        _temporary(target).unlink()


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
        is_known, level = layout.known_noise[i], numbers.noise[i]
        data[f"noise of {channel}"] = repr(float(level)) if is_known else "estimated"
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
    differing = []
    for section in {**current, **stored}:  # a later version may tell more of a problem
        filed, facts = stored.get(section, {}), current.get(section, {})
        names = [name for name in {**filed, **facts} if filed.get(name) != facts.get(name)]
        if section == "model" and names:
            differing.append(f"model: {', '.join(filed)} in the file, {', '.join(facts)} now")
        elif section == "data" and names:
            differing.append(f"data: {', '.join(names)}")
        else:
            ends = ((n, filed.get(n, "absent"), facts.get(n, "absent")) for n in names)
            differing += [f"{section}, {n}: {a} in the file, {b} now" for n, a, b in ends]
    if differing:
        raise InputError(
            f"{path}: the chain of another problem. What differs: {'; '.join(differing)}.",
            "Name another file, or sample with what this one was begun with. It was left as it is.",
        )
