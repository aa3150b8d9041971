"""Table 4 of Aras et al. 2013 (CC BY 3.0), from the stored fit that stands beside the examples."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from diffthrust import Column, read_log

FOLDER = Path(__file__).resolve().parents[2] / "fits" / "depth_sensor"


def table_4() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Depths [m], ``(13,)``, and three readings of the sensor at them by name [V]."""
    depth, reading = {"depth": Column("depth_m", unit="m")}, Column("reading_V", unit="V")
    two, third = (
        read_log(FOLDER / name, time=None, inputs=depth, measured={"reading": reading})
        for name in ("train.csv", "holdout.csv")  # the first holds two series, one after the other
    )
    first, second = np.split(two.values("reading", "V"), 2)
    named = {"reading 1": first, "reading 2": second, "reading 3": third.values("reading", "V")}
    return third.values("depth", "m"), named
