"""Folders of stored fits on short simulated logs of one model, each with parameters of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import diffthrust as dft

SAMPLES = 200
NOISE = {"speed": 0.3, "thrust": 0.2}
SPEC = """\
model = "thruster"

[logs]
train = ["log.csv"]
time = { column = "time", unit = "s" }

[channels]
command = { column = "command", unit = "V" }
speed = { column = "speed", unit = "rad/s" }
thrust = { column = "thrust", unit = "N" }
"""


def made_fits(folder: Path, count: int) -> Path:
    """Write so many fits of a thruster, ten to a folder, without [expected] blocks."""
    time = 0.05 * np.arange(SAMPLES)
    for i in range(count):
        rng = np.random.default_rng([83, i])
        command = np.repeat(rng.uniform(-4.0, 4.0, SAMPLES // 20), 20)
        truth = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}
        model = dft.Thruster(**{name: v * rng.uniform(0.7, 1.4) for name, v in truth.items()})
        found = dft.simulate(model, dft.Log(time, {"command": command}, {}))
        columns = [time, command]
        columns += [found[name] + rng.normal(0.0, size, SAMPLES) for name, size in NOISE.items()]
        place = folder / f"set_{i // 10:02}" / f"fit_{i:03}"
        place.mkdir(parents=True)
        rows = (",".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True))
        (place / "log.csv").write_text("\n".join(["time,command,speed,thrust", *rows, ""]))
        (place / "fit.toml").write_text(SPEC)
    return folder
