"""The measured logs of the study, with every channel that their files have."""

from pathlib import Path

import numpy as np

import diffthrust as dft
from diffthrust import Column

MODELS = {
    "ngs_thruster": dft.Thruster(),
    "blueboat": dft.Vessel("twin"),
    "esso_osaka": dft.Vessel("propeller"),
    "emps": dft.AxisVehicle(),
}


def ngs_thruster(path: Path) -> dft.Log:
    return dft.read_log(
        path,
        time="time_s",
        inputs={"command": Column("command_V", "V")},
        measured={
            "speed": Column("tach_rad_s", "rad/s", unsigned=True),
            "thrust": Column("thrust_N", "N"),
        },
    )


def blueboat(path: Path, mended: bool = True) -> dft.Log:
    """The files have left and right exchanged; ``mended`` puts them right."""
    sides = ("left_force", "right_force")
    columns = sides[::-1] if mended else sides
    return dft.read_log(
        path,
        time=Column("original_timestamp", "ms"),
        inputs={side: Column(name, "N") for side, name in zip(sides, columns, strict=True)},
        measured={
            "surge": Column("surge", "m/s"),
            "sway": Column("sway", "m/s"),
            "yaw_rate": Column("yaw_rate", "rad/s"),
            "heading": Column("yaw", "deg"),
            "north": Column("x_ned", "m"),
            "east": Column("y_ned", "m"),
        },
    )


def esso_osaka(path: Path) -> dft.Log:
    return dft.read_log(
        path,
        time=Column("t [s]", "s"),
        inputs={
            "propeller_speed": Column("n_prop [rps]", "rps"),
            "rudder_angle": Column("delta_rudder [rad]", "rad", scale=-1),
            "wind_speed": Column("wind_velo_true [m/s]", "m/s"),
            "wind_direction": Column("wind_dir_true [rad]", "rad"),
        },
        measured={
            "surge": Column("u_velo [m/s]", "m/s"),
            "sway": Column("vm_velo [m/s]", "m/s"),
            "yaw_rate": Column("r_angvelo [rad/s]", "rad/s"),
            "heading": Column("psi_hat [rad]", "rad"),
            "north": Column("x_position_mid [m]", "m"),
            "east": Column("y_position_mid [m]", "m"),
        },
    )


def emps(path: Path) -> dft.Log:
    return dft.read_log(
        path,
        time="time_exp",
        inputs={"force": Column("u_in", "N", scale=35.15, hold="linear")},
        measured={
            "position": Column("q_meas", "m", scale=0.125),
            "velocity": Column("v_est", "m/s", scale=0.125),
        },
    )


READERS = {f.__name__: f for f in (ngs_thruster, blueboat, esso_osaka, emps)}


def logs(root: Path, name: str, pattern: str = "*") -> list[dft.Log]:
    """The logs of one data set whose file names fit a pattern, sorted by name."""
    if name == "ngs_thruster" and pattern == "*":
        pattern = "CL*"
    return [READERS[name](path) for path in sorted((root / name).glob(f"{pattern}.csv"))]


def changed(log: dft.Log, time=None, **channels) -> dft.Log:
    """The log with some channels, or its time, put through functions."""

    def through(values):
        return {
            name: channels[name](np.array(v)) if name in channels else v
            for name, v in values.items()
        }

    return log.replaced(
        time=time(np.array(log.time)) if time else log.time,
        inputs=through(log.inputs),
        measured=through(log.measured),
    )
