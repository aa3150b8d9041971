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


def test_no_name_at_the_door_brings_a_package_that_is_slow_to_import():
    slow = ("arviz", "emcee", "h5py", "matplotlib.pyplot", "pandas", "pint", "pyarrow", "scipy")
    code = f"""import sys, diffthrust as dft
assert "jax" not in sys.modules
touched = [getattr(dft, name) for name in dft.__all__]
print([name for name in {slow} if name in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("order", ["jax, diffthrust", "diffthrust, jax"])
def test_importing_the_package_switches_double_precision_on(order):
    code = f"import {order}; import jax.numpy as jnp; print(jnp.ones(()).dtype)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "float64"


@pytest.mark.parametrize("order", ["jax, diffthrust", "diffthrust, jax"])
@pytest.mark.parametrize(
    ("chosen", "device"),
    [
        ({}, "cpu"),
        ({"JAX_DEFAULT_DEVICE": "gpu"}, "gpu"),
        ({"JAX_PLATFORMS": "cuda,cpu"}, "None"),
    ],
)
def test_the_processor_computes_unless_a_device_was_chosen(order, chosen, device):
    """A fit takes a hundred times as long on a GPU, which JAX would take where it finds one."""
    kept = {n: v for n, v in os.environ.items() if n not in ("JAX_PLATFORMS", "JAX_DEFAULT_DEVICE")}
    done = subprocess.run(
        [sys.executable, "-c", f"import {order}; print(jax.config.jax_default_device)"],
        env={**kept, **chosen},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == device


@pytest.mark.thorough
def test_the_types_of_all_public_names_are_told():
    command = [sys.executable, "-m", "pyright", "--verifytypes", "diffthrust", "--ignoreexternal"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "Type completeness score: 100%" in done.stdout
