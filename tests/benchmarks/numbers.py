"""The measured numbers of README, docs/, CONTRIBUTING and docstrings, worked out again.

    cd tests && python -m benchmarks.numbers                  # those that take seconds
    cd tests && python -m benchmarks.numbers --long           # all, in half an hour
    cd tests && python -m benchmarks.numbers docs/guides/many.md     # of some files

Each is printed as the text has it and as a run of today gives it; exit status 1 where they differ.
Times depend on the machine and are not judged here: the table names the command that prints them.
A new number in a text gets its line in `CLAIMS`.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from places import ROOT
from rich.console import Console
from rich.table import Table

NUMBER = r"(\d+(?:\.\d+)?)"


@dataclass(frozen=True)
class Claim:
    """Numbers of a text and where they are from.

    Args:
        where: the file, from the root of the repository.
        text: as it stands there, with ``{}`` for each number; line breaks do not matter.
        by: the command that gives the numbers.
        compute: the numbers in the order of the text; ``None`` for times.
        long: whether it takes minutes.
    """

    where: str
    text: str
    by: str
    compute: Callable[[], Sequence[float]] | None = None
    long: bool = False

    @property
    def told(self) -> tuple[str, ...]:
        """The numbers of the text as they are written; empty where it does not stand there."""
        words = (re.escape(word).replace(r"\{\}", NUMBER) for word in self.text.split())
        found = re.search(r"\s+".join(words), (ROOT / self.where).read_text(encoding="utf-8"))
        return found.groups() if found else ()


def differing(told: Sequence[str], given: Sequence[float]) -> list[str]:
    """What a run gives in place of written numbers, to their digits, where it is not the same."""
    out = []
    for written, value in zip(told, given, strict=True):
        digits = len(written.partition(".")[2])
        if f"{value:.{digits}f}" != written:
            out.append(f"{value:.{digits + 1}f} for {written}")
    return out


def inertia() -> list[float]:
    """What the sequence of Siramdasu & Fahimi makes of the inertia, in per cent too low."""
    from papers.test_papers_siramdasu import TRUE, scenarios

    from diffthrust.papers.siramdasu import sequential

    each = [sequential(*scenarios(), settle=9.0, transient=t).vessel.i33 for t in (None, 5.0)]
    return [100.0 * (1.0 - found / TRUE.i33) for found in each]


def spreads() -> list[float]:
    """By how many per cent alpha and beta of the dynamic test spread more than their errors say."""
    from papers.test_papers_yoerger import moving

    from diffthrust.papers.yoerger import dynamic_test

    found = [dynamic_test(moving(0.3, seed)) for seed in range(200)]
    out = []
    for name in ("alpha", "beta"):
        values, errors = np.array(
            [(getattr(one, name).value, getattr(one, name).std_error) for one in found]
        ).T
        out.append(100.0 * (np.std(values) / np.mean(errors) - 1.0))
    return out


def bend() -> list[float]:
    """What the limit of an observer's errors takes away, in per cent."""
    from observers import limited

    return [100.0 * (1.0 - float(limited(np.float64(x), 1.0)) / x) for x in (0.7, 1.0)]


def coverage() -> list[float]:
    """Shares of 95 % intervals that hold the truth, in the order of the text, in per cent."""
    from short_logs import fitted
    from uncertainty.test_coverage import shares

    white, _ = shares(fitted)
    lasting, _ = shares(fitted, correlation=0.8)
    slower, _ = shares(fitted, every=2, correlation=0.9)
    heavy, _ = shares(lambda log: fitted(log, loss="student_t"), law="student_t")
    best = [100.0 * told["recommended"] for told in (white, lasting, slower, heavy)]
    return [400.0, 95.0, best[0], best[1], 0.8, 100.0 * lasting["covariance"], *best[2:]]


def fleets() -> list[float]:
    """What pooling gains for vehicles with little data, by exact likelihood, and its coverage."""
    from many.test_fleet_study import FLEETS, study

    gain, hits = study()
    rms, median = gain["exact"]
    inside = hits["exact"][:, 1]
    return [FLEETS, 100.0 * rms, 100.0 * median, 100.0 * inside.mean(), len(inside), 95.0]


COVERAGE = "pytest -m slow -s tests/uncertainty/test_coverage.py"
BENCH = "cd tests && python -m hidden.bench --count 216 --seed N"
PEERS = "cd tests && python -m benchmarks.peers"
CLAIMS = (
    Claim(
        "diffthrust/papers/siramdasu.py",
        "of the paper's boat by {} % from circles of 15 s, by {} % from the first 5 s",
        "pytest tests/papers/test_papers_siramdasu.py",
        inertia,
    ),
    Claim(
        "diffthrust/papers/yoerger.py",
        "alpha spreads by {} % more, beta by {} %",
        "pytest tests/papers/test_papers_yoerger.py",
        spreads,
    ),
    Claim(
        "diffthrust/estimation/_observer.py",
        "({} % at 0.7 of the limit, {} % at the limit)",
        "the formula below it",
        bend,
    ),
    Claim(
        "docs/guides/uncertainty.md",
        "On {} logs with known truth the {} % interval with the star covers {} % under white "
        "noise, {} % under AR(1) noise of {} (the covariance of a fit that takes it as white: {} "
        "%), {} % where a channel is read at every second sample besides, and {} % under Student-t "
        "noise",
        COVERAGE,
        coverage,
        long=True,
    ),
    Claim(
        "docs/guides/many.md",
        "On {} simulated fleets of ten thrusters, three of them with a twentieth of the data at "
        "small commands, the RMS error of these three falls by {} % against separate fits (the "
        "median error by {} %), and {} % of {} intervals of {} % hold the truth",
        "pytest -m slow -s tests/many/test_fleet_study.py",
        fleets,
        long=True,
    ),
    Claim(
        "docs/guides/many.md",
        "from one start they take {} to {} times as long",
        "pytest -m benchmark -s tests/benchmarks/test_many_speed.py",
    ),
    Claim(
        "docs/numbers/hidden_effects.md",
        "| one effect, faint | {} of {} | {} of {} | {} of {} |",
        BENCH,
    ),
    Claim(
        "docs/numbers/benchmarks.md",
        "| simulation of 1000, 4000, 16 000 samples | diffthrust | {}, {}, {} ms |",
        PEERS,
    ),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 where a number differs, or its text no longer stands there."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.numbers")
    parser.add_argument("files", nargs="*", help="only claims of these files")
    parser.add_argument("--long", action="store_true", help="also what takes minutes")
    options = parser.parse_args(arguments)
    table = Table("Where", "Says", "Run", "By")
    wrong = 0
    for claim in CLAIMS:
        if options.files and claim.where not in options.files:
            continue
        told = claim.told
        if not told:
            outcome, wrong = f"no such text: {claim.text}", wrong + 1
        elif claim.compute is None:
            outcome = "a time or a bench: by hand"
        elif claim.long and not options.long:
            outcome = "not run (--long)"
        else:
            apart = differing(told, claim.compute())
            outcome, wrong = ", ".join(apart) or "the same", wrong + bool(apart)
        table.add_row(claim.where, ", ".join(told), outcome, claim.by)
    Console().print(table)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
