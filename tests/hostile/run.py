"""Hostile specs and logs through the command line: each is a result or one clear error.

From the folder ``tests``:

    python -m hostile.run --count 500 --seed 1

draws half of them as specs and half as logs, gives each to a command in a worker with a limit of
time and memory, and prints how they ended. Each that ended as it must not is printed with its seed
and kept in the folder of ``--keep``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from processes import ProcessDied, ProcessLate, Worker, WorkerPool, as_done, own_worker
from rich.console import Console
from rich.table import Table

from . import logs, specs
from .commands import TOLD, answer

SECONDS, BYTES = 60.0, 2 * 2**30
GOOD = ("result", "clear error")
BAD = ("traceback", "defect", "silent zero", "unclear error", "too slow", "too big", "died")
_FRESH = 40
"""Cases after which a worker is a new one, so that what it has compiled does not count."""
COMMANDS: dict[str, tuple[tuple[str, ...], ...]] = {
    "spec": (
        ("fit", "fit.toml", "--json", "out.json"),
        ("fit", "fit.toml", "--json", "out.json"),
        ("compare", "fit.toml", "--no-fit", "--json", "out.json"),
        ("check", ".", "--jobs", "1", "--json", "out.json"),
    ),
    "log": (
        ("fit", "fit.toml", "--json", "out.json"),
        ("look", "LOG", "--json", "out.json", "--spec", "draft.toml"),
        ("look", "LOG", "--json", "out.json", "--figure", "out.png"),
        ("compare", "fit.toml", "--no-fit", "--json", "out.json"),
    ),
}


@dataclass(frozen=True)
class Case:
    """One hostile folder and how a command ended in it.

    Args:
        kind: "spec" or "log".
        seed: of its draw.
        done: what is hostile about it.
        words: of the command.
        ended: one of `GOOD` and `BAD`.
        said: the last words of the command.
        seconds: that it took.
    """

    kind: str
    seed: int
    done: str
    words: tuple[str, ...]
    ended: str
    said: str
    seconds: float

    @property
    def good(self) -> bool:
        """Whether it ended as it may."""
        return self.ended in GOOD


def write_case(folder: Path, kind: str, seed: int) -> tuple[str, tuple[str, ...]]:
    """Make the folder of a case: what is hostile about it, and the words of its command."""
    write = specs.write_hostile_spec if kind == "spec" else logs.write_hostile_log
    done = write(folder, seed)
    rng = np.random.default_rng([seed, 3])
    words = COMMANDS[kind][int(rng.integers(len(COMMANDS[kind])))]
    log = next((path.name for path in folder.glob("log.*")), "")
    places = {"LOG": log, "fit.toml": "", "out.json": "", "out.png": "", "draft.toml": "", ".": ""}
    return done, tuple(
        str(folder / (log if w == "LOG" else w)) if w in places else w for w in words
    )


def ended(words: Sequence[str], status: int, out: str, err: str, way: str) -> str:
    """How a command ended, of `GOOD` and `BAD`."""
    if way or TOLD[0] in out + err:
        return "traceback"
    if TOLD[1] in out + err:
        return "defect"
    if status == 0:
        return "result" if out.strip() and _reports(words) else "silent zero"
    if status == 1 and words[0] == "check":  # a row for each fit that moved or cannot be run
        return "clear error" if out.strip() else "silent zero"
    return "clear error" if status == 2 and err.strip() else "unclear error"


def _reports(words: Sequence[str]) -> bool:
    """Whether the JSON of a command that ended well holds anything of what it was asked for."""
    data = json.loads(Path(words[words.index("--json") + 1]).read_text())
    held = {"fit": "parameters", "compare": "train", "check": "fits", "look": "files"}
    return bool(data.get(held[words[0]], data.get("columns")))


class Watched(Worker):
    """A worker that is killed when it holds too much memory."""

    too_big = False

    def watch(self, over: threading.Event) -> None:
        """Look at its memory until ``over``."""
        while not over.wait(0.1):
            with suppress(OSError, IndexError, ValueError):
                pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
                if pages * 4096 > BYTES:
                    self.too_big = True
                    self._process.kill()  # type: ignore[union-attr]


def tried(worker: Watched, folder: Path, kind: str, seed: int) -> Case:
    """Draw a case and give it to a worker."""
    done, words = write_case(folder, kind, seed)
    begun, over = time.monotonic(), threading.Event()
    worker.too_big = False
    guard = threading.Thread(target=worker.watch, args=(over,), daemon=True)
    guard.start()
    said = ""
    try:
        status, out, err, way = worker.ask(words, limit=SECONDS)
        how, said = ended(words, status, out, err, way), way or err or out
    except ProcessLate:
        how = "too slow"
    except ProcessDied as died:
        how, said = "too big" if worker.too_big else "died", str(died)
    finally:
        over.set()
        guard.join()
    return Case(kind, seed, done, words, how, said[-1500:], time.monotonic() - begun)


def cases(count: int, seed: int, jobs: int, root: Path) -> Iterator[Case]:
    """Half specs and half logs; those that ended badly stay in ``root``, by kind and seed."""
    tasks = [("spec" if i % 2 else "log", 100_000 * seed + i // 2) for i in range(count)]
    workers = [Watched(answer, quiet=True) for _ in range(min(jobs, count))]
    asked = Counter[int]()

    def work(task: tuple[str, int]) -> Case:
        worker = own_worker()
        assert isinstance(worker, Watched)
        asked[id(worker)] += 1
        if asked[id(worker)] % _FRESH == 0:
            worker.close()
        folder = root / f"{task[0]}_{task[1]}"
        case = tried(worker, folder, *task)
        if case.good:
            shutil.rmtree(folder, ignore_errors=True)
        return case

    with WorkerPool(workers) as pool:
        yield from (done[1].result() for done in as_done(pool, work, tasks) if done)


def table(found: Sequence[Case]) -> Table:
    """A row for each kind and command."""
    shown = Table("Hostile", "Command", title="Hostile specs and logs")
    for head in (*GOOD, *BAD, "longest [s]"):
        shown.add_column(head, justify="right")
    rows: dict[tuple[str, str], list[Case]] = {}
    for case in found:
        rows.setdefault((case.kind, case.words[0]), []).append(case)
    for (kind, command), here in sorted(rows.items()):
        ends = Counter(case.ended for case in here)
        longest = max(case.seconds for case in here)
        shown.add_row(kind, command, *(str(ends[h]) for h in (*GOOD, *BAD)), f"{longest:.1f}")
    return shown


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, run, report; exit status 1 where one ended badly."""
    parser = argparse.ArgumentParser(prog="python -m hostile.run", description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for those that ended badly")
    asked = parser.parse_args(words)
    found: list[Case] = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(asked.count, asked.seed, asked.jobs, asked.keep or Path(folder)):
            found.append(case)
            if not case.good:
                print(
                    f"{case.kind} {case.seed} ({case.done}): {case.ended}: {' '.join(case.words)}"
                )
                print(f"    {case.said}", flush=True)
    Console(width=140).print(table(found))
    raise SystemExit(not all(case.good for case in found))


if __name__ == "__main__":
    main()
