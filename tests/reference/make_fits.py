"""Write the logs shipped under ``fits/``, the same bytes every time.

From the folder of the tests: ``python -m reference.make_fits [FITS]``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from places import FITS

from . import inputs, noise, thruster, vessel
from .records import Column, Record, write_csv, write_rows

RPM = 30.0 / np.pi
DEGREES = 180.0 / np.pi

#: M. S. M. Aras, S. S. Abdullah, A. Abd Rahman, M. A. A. Aziz, 2013, "Thruster modelling for
#: underwater vehicle using system identification method", table 4 (CC BY 3.0): depth [m] and
#: three readings of the pressure sensor [V].
DEPTH_SENSOR = (
    (0.0, 1.622, 1.614, 1.593),
    (0.3048, 1.683, 1.671, 1.648),
    (0.6096, 1.731, 1.716, 1.694),
    (0.9144, 1.779, 1.758, 1.735),
    (1.2192, 1.825, 1.802, 1.774),
    (1.524, 1.869, 1.846, 1.826),
    (1.8288, 1.922, 1.896, 1.870),
    (2.1336, 1.973, 1.944, 1.886),
    (2.4384, 2.024, 1.994, 1.938),
    (2.7432, 2.054, 2.030, 1.983),
    (3.048, 2.122, 2.085, 2.032),
    (3.3528, 2.168, 2.156, 2.097),
    (3.6576, 2.223, 2.207, 2.174),
)

THRUSTER_COLUMNS = {
    "t": Column("time", 1.0, 2),
    "u": Column("command", 1.0, 3),
    "rpm": Column("speed", RPM, 0),
    "thrust": Column("thrust", 1.0, 2),
}
THRUSTER_SENSORS = {
    "speed": noise.Sensor(std=2.0 / RPM, quantum=1.0 / RPM),
    "thrust": noise.Sensor(std=0.5, quantum=0.05),
}
VESSEL_COLUMNS = {
    "t": Column("time", 1.0, 1),
    "n": Column("propeller_speed", 1.0, 1),
    "angle": Column("rudder_angle", DEGREES, 1),
    "surge": Column("surge", 1.0, 3),
    "sway": Column("sway", 1.0, 3),
    "yaw_rate": Column("yaw_rate", DEGREES, 2),
    "north": Column("north", 1.0, 2),
    "east": Column("east", 1.0, 2),
    "heading": Column("heading", DEGREES, 1),
}
VESSEL_SENSORS = {
    "surge": noise.Sensor(std=0.01),
    "sway": noise.Sensor(std=0.01),
    "yaw_rate": noise.Sensor(std=0.5 / DEGREES),
    "north": noise.Sensor(std=0.05),
    "east": noise.Sensor(std=0.05),
    "heading": noise.Sensor(std=0.5 / DEGREES),
}


def jason_thruster() -> dict[str, Record]:
    """The thruster of Yoerger 1990 under a random command, and unseen under steps both ways."""
    rng = np.random.default_rng(1990)
    time = inputs.grid(60.0, 0.05)
    commands = {
        "train": inputs.low_passed_random(time, 1.2, rng),
        "holdout": inputs.staircase(time, [0, 1, 2, 3, 1.5, 0.5, -0.5, -1.5, -3, -1, 2, -2], 5.0),
    }
    return {
        name: noise.measure(thruster.simulate(time, np.round(command, 3)), rng, **THRUSTER_SENSORS)
        for name, command in commands.items()
    }


def vessel_zigzag() -> dict[str, Record]:
    """The vessel of Siramdasu 2013: its two scenarios and a zigzag; unseen, another zigzag."""
    rng = np.random.default_rng(2013)
    straight = inputs.grid(60.0, 0.1)
    circles = inputs.grid(100.0, 0.1)
    zigzag = inputs.grid(60.0, 0.1)
    # Angle and time in turn: 5 s ahead, then 15 s of circle (section 3.2).
    angles = [a for circle in (-24, -16, 8, 16, 24) for a in (0, circle, circle, circle)]
    runs = {
        "train_straight": (straight, inputs.staircase(straight, [69.2, 98, 120, 98], 15.0), 0.0),
        "train_circles": (circles, 98.0, inputs.staircase(circles, angles, 5.0)),
        "train_zigzag": (zigzag, 98.0, inputs.zigzag(zigzag, 24.0, 6.0, 5.0)),
        "holdout": (
            zigzag,
            inputs.staircase(zigzag, [98, 80, 110], 20.0),
            inputs.zigzag(zigzag, 16.0, 8.0, 4.0),
        ),
    }
    return {
        name: noise.measure(
            vessel.simulate(
                time,
                {
                    "propeller_speed": n + np.zeros(len(time)),
                    "rudder_angle": angle / DEGREES + np.zeros(len(time)),
                },
            ),
            rng,
            **VESSEL_SENSORS,
        )
        for name, (time, n, angle) in runs.items()
    }


def depth_sensor(folder: Path) -> None:
    """The measured readings, one row each: the first two to train, the third unseen."""
    for name, readings in {"train": (1, 2), "holdout": (3,)}.items():
        cells = [(f"{row[0]:.4f}", f"{row[k]:.3f}") for k in readings for row in DEPTH_SENSOR]
        rows = [(str(i), *pair) for i, pair in enumerate(cells)]
        write_rows(folder / f"{name}.csv", ["t", "depth_m", "reading_V"], rows)


def make(folder: Path = FITS) -> None:
    """Write every shipped log under ``folder``."""
    for name, record in jason_thruster().items():
        write_csv(record, folder / "jason_thruster" / f"{name}.csv", THRUSTER_COLUMNS)
    for name, record in vessel_zigzag().items():
        write_csv(record, folder / "vessel_zigzag" / f"{name}.csv", VESSEL_COLUMNS)
    depth_sensor(folder / "depth_sensor")


if __name__ == "__main__":
    make(*map(Path, sys.argv[1:2]))
