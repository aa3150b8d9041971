"""What runs in a process of its own: it reads the name of a fit, runs it, and tells the outcome."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from diffthrust._cache import enable_compilation_cache
from diffthrust._check_run import run_again


def serve() -> None:
    """Answer each line of standard input, ``[fit, file, update]`` as JSON, by one line of output.

    A line before all answers says that it is ready. What a fit or a user's script
    prints goes to standard error, so that answers stay answers.
    """
    enable_compilation_cache()
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)
        print("ready", file=answers, flush=True)
        for line in sys.stdin:
            fit, file, update = json.loads(line)
            run = run_again(fit, Path(file), update)
            answer = {
                "rows": [vars(row) for row in run.rows],
                "updated": run.updated,
                "seconds": run.seconds,
                "warnings": run.warnings,
            }
            print(json.dumps(answer), file=answers, flush=True)
