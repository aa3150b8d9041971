"""Programs that were exported, run over logs: plain Python as it is, C through a compiler."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import diffthrust as dft

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2")

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")

SIZES = {
    **{"command": 2.0, "inflow": 0.5, "speed": 50.0, "propeller_speed": 90.0, "rudder_angle": 0.5},
    **{"left_force": 20.0, "right_force": 20.0, "thrust": 60.0, "depth": 5.0, "wind_speed": 4.0},
    **{"wind_direction": 2.0, "supply_voltage": 24.0},
}
_LOOP = """
#include "{name}.h"
void run(int n, const double *time, const double *inputs, const double *start, double *out);
void run(int n, const double *time, const double *inputs, const double *start, double *out)
{{
    {name} m;
    int i;
    for (i = 0; i < n; i++) {{
        const double *row = inputs + {columns} * i;
        const {name}_inputs now = {{ {fields} }};
        const {name}_outputs o = i ? {name}_step(&m, time[i] - time[i - 1], now)
                                   : {name}_reset(&m, now, start, time[0]);
        {stores}
    }}
}}
"""


def exciting_log(inputs, *, seed=0, duration=60.0, step=0.04, even=True) -> dft.Log:
    """Inputs that jump and swing, at samples equally far apart or not."""
    rng = np.random.default_rng([31, seed])
    count = int(duration / step) + 1
    gaps = np.full(count, step) if even else rng.uniform(0.5, 1.5, count) * step
    time = np.cumsum(gaps) - gaps[0]
    series = {}
    for name in inputs:
        jumps = np.repeat(rng.uniform(-1.0, 1.0, count // 25 + 1), 25)[:count]
        series[name] = SIZES[name] * (0.8 * jumps + 0.2 * np.sin(0.7 * time + rng.uniform(0, 6)))
        if name == "supply_voltage":
            series[name] = SIZES[name] + 3.0 * jumps
    return dft.Log(time, series, {})


def run_python(text: str, name: str, log: dft.Log, start=None) -> dict[str, np.ndarray]:
    """What an exported module gives at each sample of a log."""
    scope: dict = {}
    exec(compile(text, f"{name}.py", "exec"), scope)
    program, rows = scope[name](), []
    columns = [[float(v) for v in series] for series in log.inputs.values()]
    for i, now in enumerate(zip(*columns, strict=True)):
        gap = float(log.time[i] - log.time[i - 1]) if i else 0.0
        began = program.reset(*now, start=start, time=float(log.time[0])) if not i else None
        rows.append(began or program.step(gap, *now))
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def run_c(text: str, name: str, log: dft.Log, outputs, folder: Path, start=None):
    """What an exported header gives at each sample of a log."""
    inputs = list(log.inputs)
    (folder / f"{name}.h").write_text(text)
    (folder / "run.c").write_text(
        _LOOP.format(
            name=name,
            columns=len(inputs),
            fields=", ".join(f"row[{i}]" for i in range(len(inputs))),
            stores=" ".join(
                f"out[{len(outputs)} * i + {k}] = o.{n};" for k, n in enumerate(outputs)
            ),
        )
    )
    library = folder / f"run{len([*folder.glob('*.so')])}.so"  # one that is loaded stays loaded
    compiled(folder / "run.c", library, "-shared", "-fPIC")
    found = np.zeros((len(log), len(outputs)))
    values = np.ascontiguousarray(np.stack([log.inputs[n] for n in inputs], axis=1))
    begin = None if start is None else np.array([np.nan if v is None else v for v in start])
    double = ctypes.POINTER(ctypes.c_double)

    def address(array):
        return None if array is None else np.ascontiguousarray(array).ctypes.data_as(double)

    ctypes.CDLL(str(library)).run(
        len(log), address(log.time), address(values), address(begin), address(found)
    )
    return {name: found[:, k] for k, name in enumerate(outputs)}


def compiled(source: Path, target: Path, *more: str, compiler=COMPILER, flags=STRICT) -> None:
    """Compile, every warning being an error."""
    words = [compiler, *flags, *more, str(source), "-o", str(target), "-lm"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def worst(found, wanted, names) -> float:
    """The largest difference over all samples, as a share of each signal's range."""
    return max(np.max(np.abs(found[n] - wanted[n])) / (np.ptp(wanted[n]) or 1.0) for n in names)
