"""Compiled code is kept between processes, for scripts as for the command line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

SCRIPT = """
import numpy as np
import diffthrust as dft
time = np.arange(50) * 0.05
dft.simulate(dft.Thruster(), dft.Log(time, {"command": np.sin(time)}, {"speed": np.sin(time)}))
"""


def kept_after(script: str, **variables: str) -> None:
    others = ("JAX_COMPILATION_CACHE_DIR", "DIFFTHRUST_CACHE")
    env = {k: v for k, v in os.environ.items() if k not in others}
    env |= {"PYTHONPATH": str(ROOT), **variables}
    subprocess.run([sys.executable, "-c", script], check=True, env=env, timeout=300)


@pytest.mark.thorough
def test_a_second_script_compiles_nothing(tmp_path: Path) -> None:
    kept_after(SCRIPT, DIFFTHRUST_CACHE=str(tmp_path))
    first = {path.name for path in tmp_path.iterdir() if path.name.endswith("-cache")}
    assert first
    kept_after(SCRIPT, DIFFTHRUST_CACHE=str(tmp_path))
    assert {path.name for path in tmp_path.iterdir() if path.name.endswith("-cache")} == first


@pytest.mark.thorough
def test_a_folder_that_a_script_has_chosen_stays(tmp_path: Path) -> None:
    chosen = f"import jax\njax.config.update('jax_compilation_cache_dir', {str(tmp_path)!r})\n"
    check = f"\nassert jax.config.jax_compilation_cache_dir == {str(tmp_path)!r}\n"
    kept_after(chosen + SCRIPT + check)
