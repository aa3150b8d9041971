"""The training logs of the stored fits."""

from places import FITS

import diffthrust as dft


def thruster_logs():
    return [
        dft.read_log(
            FITS / "jason_thruster" / "train.csv",
            time="t",
            inputs={"command": dft.Column("u", "V")},
            measured={"speed": dft.Column("rpm", "rpm"), "thrust": dft.Column("thrust", "N")},
        )
    ]


def vessel_logs():
    return [
        dft.read_log(
            FITS / "vessel_zigzag" / f"train_{name}.csv",
            time="t",
            inputs={
                "propeller_speed": dft.Column("n", "rps"),
                "rudder_angle": dft.Column("angle", "deg"),
            },
            measured={
                "surge": dft.Column("surge", "m/s"),
                "sway": dft.Column("sway", "m/s"),
                "yaw_rate": dft.Column("yaw_rate", "deg/s"),
            },
        )
        for name in ("straight", "circles", "zigzag")
    ]
