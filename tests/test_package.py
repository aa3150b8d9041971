"""What importing the package sets up."""

import os
import subprocess
import sys

import pytest

OPTIONS = (
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000,"
    "xla_cpu_disable_new_fusion_emitters"
)
TRUNCATED = "--xla_cpu_multi_thread_eigen=false y=1"  # XLA reads up to 'y=1' only


@pytest.mark.parametrize(
    ("given", "left"),
    [
        ("", OPTIONS),
        (TRUNCATED, f"{OPTIONS} {TRUNCATED}"),
        ("--xla_backend_extra_options=z=1", "--xla_backend_extra_options=z=1"),
    ],
)
def test_the_flag_stands_where_xla_reads_it(given, left):
    done = subprocess.run(
        [sys.executable, "-c", "import os, diffthrust; print(os.environ['XLA_FLAGS'])"],
        env={**os.environ, "XLA_FLAGS": given},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == left


def test_import_brings_no_package_that_is_slow_to_import():
    slow = ("arviz", "emcee", "h5py", "matplotlib.pyplot", "pandas", "pint", "pyarrow", "scipy")
    code = f"import sys, diffthrust; print([m for m in {slow} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
