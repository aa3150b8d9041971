"""From a raw .csv to a saved fit and an exported table: the README's commands, with their seconds.

    cd tests && python -m benchmarks.ten_minutes

Each command runs in a process of its own, in a new folder, with an empty cache of compiled code,
as on the day of the installation. The line with the effects is copied from the report into the spec
file, as a user does by hand.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BENCH = Path(__file__).parents[2] / "examples" / "bench"
COMMANDS = (
    "look {logs} --spec bench.toml --figure look.png",
    "fit bench.toml",
    "compare bench.toml --figure errors.png",
    "diagnose bench.toml --report diagnosis.html",
    "fit bench.toml --save bench.fit.json",
    "export bench.fit.json --to lut --output table.csv",
    "export bench.fit.json --to c --output bench.h",
)


def run(folder: Path) -> float:
    """Run the commands in a folder, print the seconds of each, and return their sum."""
    env = {**os.environ, "DIFFTHRUST_CACHE": str(folder / "cache"), "MPLBACKEND": "Agg"}
    effects, total = "", 0.0
    for command in COMMANDS:
        if "--save" in command and effects:
            spec = folder / "bench.toml"
            text = spec.read_text(encoding="utf-8")
            spec.write_text(re.sub(r"^effects = .*$", effects, text, flags=re.MULTILINE))
        begin = time.perf_counter()
        code = (
            "import sys; from diffthrust.cli._app import main; sys.argv[0] = 'diffthrust'; main()"
        )
        words = command.format(logs="logs").split()
        done = subprocess.run(
            [sys.executable, "-c", code, *words],
            cwd=folder,
            env=env,
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - begin
        total += seconds
        print(f"{seconds:7.1f} s  diffthrust {' '.join(words)}", flush=True)
        if done.returncode:
            raise SystemExit(done.stdout + done.stderr)
        found = re.search(r"^effects = \[.*\]$", done.stdout, flags=re.MULTILINE)
        effects = found[0] if found else effects
        if words[0] in ("fit", "diagnose"):
            print(done.stdout)
    print(f"{total:7.1f} s  in all; files: {', '.join(sorted(p.name for p in folder.iterdir()))}")
    return total


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(BENCH, Path(name) / "logs")
        run(Path(name))
