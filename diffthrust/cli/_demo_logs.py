"""Simulated logs of a thruster with hidden effects, for a diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from diffthrust import effects
from diffthrust._support.errors import InputError
from diffthrust._support.files import made_folder, write_whole
from diffthrust.logs._log import Log
from diffthrust.models import Thruster
from diffthrust.simulation._runs import simulate

_STEP = 0.05
_SAMPLES = 1200
_SEEDS = {"train_1.csv": 1, "train_2.csv": 2, "unseen.csv": 3}
HIDDEN = (effects.CommandDeadband(half_width=0.25), effects.ReverseThrustAsymmetry(change=-0.15))
_SPEC = """\
# A simulated thruster with effects that the plain model lacks. Which? Ask:
#
#     diffthrust diagnose {folder} --report diagnosis.html

model = "thruster"

[logs]
train = ["train_1.csv", "train_2.csv"]
holdout = ["unseen.csv"]
time = {{ column = "time", unit = "s" }}

[channels.command]
column = "command"
unit = "V"

[channels.speed]
column = "speed"
unit = "rad/s"

[channels.thrust]
column = "thrust"
unit = "N"
"""


def hidden_folder(folder: Path) -> Path:
    """Write three logs of a thruster with hidden effects, and a spec of the plain model."""
    folder_at(folder)
    spec = folder / "fit.toml"
    # A second run may overwrite its own files, never a spec that somebody wrote: the demo's starts
    # with its first comment.
    if spec.exists() and not spec.read_text(errors="replace").startswith(_SPEC.split(".")[0]):
        raise InputError(
            f"{spec}: expected an empty folder or that of an earlier demo, found another spec.",
            "Name another folder: diffthrust demo --missing --output DIR.",
        )
    for name, seed in _SEEDS.items():
        write_whole(folder / name, _table(seed).encode())
    write_whole(spec, _SPEC.format(folder=folder).encode())
    return folder


def folder_at(folder: Path) -> Path:
    """Create the folder if necessary."""
    return made_folder(folder, "Name another: diffthrust demo --output DIR.")


def _table(seed: int) -> str:
    """One log as CSV: a staircase of random commands, and sensors with noise."""
    rng = np.random.default_rng(seed)
    time = _STEP * np.arange(_SAMPLES)
    command = np.repeat(rng.uniform(-4.0, 4.0, _SAMPLES // 30), 30)
    real = Thruster(alpha=0.037, beta=42.0, ct=0.02)
    for effect in HIDDEN:
        real = real + effect
    outputs = simulate(real, Log(time, {"command": command}, {}))
    speed = outputs["speed"] + rng.normal(0.0, 0.3, _SAMPLES)
    thrust = outputs["thrust"] + rng.normal(0.0, 0.2, _SAMPLES)
    rows = zip(time, command, speed, thrust, strict=True)
    lines = [",".join(f"{value:.4f}" for value in row) for row in rows]
    return "\n".join(["time,command,speed,thrust", *lines, ""])
