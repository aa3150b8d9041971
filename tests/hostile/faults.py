"""Faults at random times over every command that writes: files whole, and the next run equal.

From the folder ``tests``:

    python -m hostile.faults --count 200 --seed 1

ends commands by a kill or an interrupt, fills or locks the place that they write to, or takes it
away, at a moment drawn for each. Thereafter every file must be whole or absent, nothing may still
run, nobody may have been told of a defect, and the same command again must give what an unbroken
run gives. Full and read-only places are file systems of their own, which only root on Linux can
mount; they are left out elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from .commands import COMMANDS, TOLD, contents, faults_of, here, make_specs

MARK = "DIFFTHRUST_FAULT"
LIMIT = 120.0
"""Seconds after which a command that does not end is one that hangs."""
ROOM = "32m"
"""Of the file systems on which places are filled and locked: a page with live figures takes 2.1 MB,
a campaign writes four, and each beside the one that it replaces."""
_FILL = "filler"


@dataclass
class Outcome:
    """What a fault did.

    Args:
        command: the command.
        kind: the fault.
        moment: the share of an unbroken run after which it came.
        status: the exit status.
        seconds: from the fault to the end of the process.
        wrong: what must not be.
    """

    command: str
    kind: str
    moment: float
    status: int = 0
    seconds: float = 0.0
    wrong: list[str] = field(default_factory=list)


class Bench:
    """Commands and their unbroken runs, in a folder of its own.

    Args:
        root: an empty folder.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.specs = root, root / "specs"
        make_specs(self.specs)
        self._unbroken: dict[str, tuple[float, dict[str, Any]]] = {}

    def unbroken(self, name: str) -> tuple[float, dict[str, Any]]:
        """How long a command takes where its code is compiled, and what it leaves."""
        if name not in self._unbroken:
            place = self._place(name)
            status, said = here(COMMANDS[name].call(self.specs, place))
            assert status == 0, said
            expected = contents(place)
            self._gone(place)
            place = self._place(name)
            begun = time.monotonic()
            process = self._begin(name, place, "unbroken")
            said, _ = process.communicate(timeout=LIMIT)
            assert process.returncode == 0, said
            assert contents(place) == expected
            self._unbroken[name] = (time.monotonic() - begun, expected)
            self._gone(place)
        return self._unbroken[name]

    def tried(self, name: str, kind: str, moment: float) -> Outcome:
        """Let a fault meet a command, look at what it left, and run it once more."""
        whole, expected = self.unbroken(name)
        outcome = Outcome(name, kind, moment)
        place = self._place(name, own=kind in ("full", "read-only"))
        mark = uuid.uuid4().hex
        try:
            process = self._begin(name, place, mark)
            with suppress(subprocess.TimeoutExpired):
                process.wait(moment * whole)
            FAULTS[kind](process, place)
            begun = time.monotonic()
            try:
                said, _ = process.communicate(timeout=LIMIT)
            except subprocess.TimeoutExpired:
                process.kill()
                said, _ = process.communicate()
                outcome.wrong.append("hangs")
            outcome.status, outcome.seconds = process.returncode, time.monotonic() - begun
            outcome.wrong += [f"said {word!r}: {said[-800:]}" for word in TOLD if word in said]
            outcome.wrong += _left_running(mark)
            outcome.wrong += self._status(outcome)
            _healed(kind, place)
            if kind == "vanished":
                self._gone(place)
                place = self._place(name)
            outcome.wrong += faults_of(place, temporaries=kind == "killed")
            outcome.wrong += self._again(name, place, expected)
        finally:
            self._gone(place)
        return outcome

    def _status(self, outcome: Outcome) -> list[str]:
        """Whether the exit status says what happened; a fault may come too late to matter."""
        usual = {"killed": (-signal.SIGKILL,), "interrupted": (130, -signal.SIGINT)}
        allowed = (0, *usual.get(outcome.kind, (1, 2)))
        return [] if outcome.status in allowed else [f"exit status {outcome.status}"]

    def _again(self, name: str, place: Path, expected: dict[str, Any]) -> list[str]:
        status, said = here(COMMANDS[name].call(self.specs, place))
        if status:
            return [f"again: exit status {status}: {said[-800:]}"]
        found = {
            k: v for k, v in contents(place).items() if not k.rpartition("/")[2].startswith(".")
        }
        missing = sorted(set(expected) ^ set(found))
        other = [n for n in expected if n in found and expected[n] != found[n]]
        return [f"again: {n} is there once" for n in missing] + [
            f"again: {n} differs" for n in other
        ]

    def _place(self, name: str, own: bool = False) -> Path:
        place = self.root / "place"
        place.mkdir()
        if own:
            _mount(place)
        COMMANDS[name].prepare(place)
        return place

    def _begin(self, name: str, place: Path, mark: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "diffthrust", *COMMANDS[name].call(self.specs, place)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, MARK: mark},
            start_new_session=True,
        )

    def _gone(self, place: Path) -> None:
        if os.path.ismount(place):
            subprocess.run(["umount", "-l", str(place)], check=True)
        shutil.rmtree(place, ignore_errors=True)


def _killed(process: subprocess.Popen[str], place: Path) -> None:
    process.kill()


def _interrupted(process: subprocess.Popen[str], place: Path) -> None:
    process.send_signal(signal.SIGINT)


def _vanished(process: subprocess.Popen[str], place: Path) -> None:
    """Taken away as a whole; what was written there is looked at no more."""
    place.rename(place.with_name("away"))
    shutil.rmtree(place.with_name("away"))


def _full(process: subprocess.Popen[str], place: Path) -> None:
    with suppress(OSError), (place / _FILL).open("wb") as file:
        while True:
            file.write(bytes(4096))
            file.flush()


def _read_only(process: subprocess.Popen[str], place: Path) -> None:
    """Locked as soon as no file is open for writing, which a mount waits for."""
    while process.poll() is None:
        if subprocess.run([*_REMOUNT, "ro", str(place)], capture_output=True).returncode == 0:
            return
        time.sleep(0.01)


_REMOUNT = ("mount", "-o", "remount,size=" + ROOM, "-o")
FAULTS: dict[str, Callable[[subprocess.Popen[str], Path], None]] = {
    "killed": _killed,
    "interrupted": _interrupted,
    "vanished": _vanished,
    "full": _full,
    "read-only": _read_only,
}


def _healed(kind: str, place: Path) -> None:
    if kind == "read-only":
        subprocess.run([*_REMOUNT, "rw", str(place)], check=True)
    if kind == "full":
        (place / _FILL).unlink(missing_ok=True)


def _mount(place: Path) -> None:
    words = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "tmpfs", str(place)]
    subprocess.run(words, check=True, capture_output=True)


@cache
def kinds() -> tuple[str, ...]:
    """The faults that can be made here."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            _mount(Path(folder))
        except (OSError, subprocess.CalledProcessError):
            return ("killed", "interrupted", "vanished")
        subprocess.run(["umount", folder], check=True)
    return tuple(FAULTS)


def _left_running(mark: str) -> list[str]:
    """The processes that live on, of those that a command began; they are given some seconds."""
    needle = f"{MARK}={mark}".encode()
    left: list[str] = []
    for _ in range(50):
        left = []
        for entry in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                if needle in entry.read_bytes():
                    left.append(f"process {entry.parent.name} still runs")
        if not left:
            break
        time.sleep(0.1)
    return left


def drawn(count: int, seed: int) -> list[tuple[str, str, float]]:
    """Commands, faults and moments: all pairs by turns, half of the moments late, among writes."""
    rng = np.random.default_rng(seed)
    pairs = [(name, kind) for kind in kinds() for name in COMMANDS]
    out = []
    while len(out) < count:
        for i in rng.permutation(len(pairs)):
            low = 0.0 if rng.random() < 0.5 else 0.6
            out.append((*pairs[i], float(rng.uniform(low, 1.0))))
    return out[:count]


def table(outcomes: Sequence[Outcome]) -> Table:
    """A row for each command and fault."""
    shown = Table("Command", "Fault", title="Faults at random times")
    for head in ("Tried", "Met it", "Longest end [s]", "Wrong"):
        shown.add_column(head, justify="right")
    rows: dict[tuple[str, str], list[Outcome]] = {}
    for outcome in outcomes:
        rows.setdefault((outcome.command, outcome.kind), []).append(outcome)
    for (name, kind), found in sorted(rows.items()):
        met = sum(o.status != 0 for o in found)
        ends = max(o.seconds for o in found) if kind in ("interrupted", "killed") else float("nan")
        wrong = sum(bool(o.wrong) for o in found)
        end = f"{ends:.2f}" if ends == ends else ""
        shown.add_row(name, kind, str(len(found)), str(met), end, str(wrong))
    return shown


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, run, report."""
    parser = argparse.ArgumentParser(prog="python -m hostile.faults", description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="*", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--kinds", nargs="*", choices=FAULTS, default=list(FAULTS))
    parser.add_argument("--out", type=Path, help="JSON-lines file of results")
    asked = parser.parse_args(words)
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        for name, kind, moment in drawn(asked.count, asked.seed):
            if name in asked.commands and kind in asked.kinds:
                outcomes.append(bench.tried(name, kind, moment))
                if asked.out:
                    with asked.out.open("a") as file:
                        file.write(json.dumps(vars(outcomes[-1])) + "\n")
                for wrong in outcomes[-1].wrong:
                    print(f"{name}, {kind} at {moment:.3f}: {wrong}", flush=True)
    Console().print(table(outcomes))
    statuses = Counter(o.status for o in outcomes)
    print(f"{len(outcomes)} faults; exit statuses {dict(statuses)}.")


if __name__ == "__main__":
    main()
