"""A log in a line, and its channels as rows of a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.words import number
from diffthrust.logs._edits import LogEdits
from diffthrust.logs._held import Hold
from diffthrust.logs._written import ShownUnits


def line_of(log: LogEdits, duration: float, holds: Mapping[str, Hold]) -> str:
    """Its size, and its channels with their units."""
    display = ShownUnits([log.written])

    def described(channels: Mapping[str, np.ndarray]) -> str:
        texts = []
        for key, samples in channels.items():
            about = [f"{n} missing"] if (n := int(np.isnan(samples).sum())) else []
            about += ["unsigned"] if key in log.unsigned else []
            about += [f"{holds[key].readings} readings, repeated"] if key in holds else []
            unit = display.unit(key, log.units[key])
            texts.append(f"{key} [{unit}]" if unit else key)
            texts[-1] += f" ({', '.join(about)})" if about else ""
        return ", ".join(texts) or "none"

    return (
        f"Log({log.name!r}: {len(log)} samples over {duration:.6g} s, inputs: "
        f"{described(log.inputs)}; measured: {described(log.measured)})"
    )


def report_of(log: LogEdits, duration: float, step: float) -> Report:
    """Its size, its channels with their range, and its notes."""
    display, rows = ShownUnits([log.written]), []
    for name, samples in {**log.inputs, **log.measured}.items():
        valid = display.values(name, samples[np.isfinite(samples)], log.units[name])
        ends = [number(float(pick(valid)), 4) for pick in (np.min, np.mean, np.max)]
        kind = "input" if name in log.inputs else "measured"
        kind += ", unsigned" * (name in log.unsigned)
        unit = display.unit(name, log.units[name])
        rows.append((name, kind, *ends, unit, str(samples.size - valid.size)))
    headings = ("Channel", "", "Least", "Mean", "Greatest", "Unit", "Missing")
    size = f"Log {log.name!r}: {len(log)} samples over {duration:.6g} s, "
    size += f"a sample every {step:.4g} s"
    table = Rows.of(headings, rows, numbers=(2, 3, 4, 6))
    return Report(Section("", size, table, *log.notes))
