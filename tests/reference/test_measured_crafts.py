"""The crafts of `measured_crafts` as a user writes them: the same logs, the same motion."""

import numpy as np
import pytest
from shared_data import data_folder

import diffthrust as dft
from diffthrust import Column

from . import measured_crafts as mc
from . import whole_runs as wr

ALIKE = 1e-2
"""Of a channel's standard deviation, at the worst sample, at the numbers from which fits begin.
Thrust curves have a kink at rest, and means over five samples run straight through it within a
step: of the Kingfisher and the BlueBoat the reference's five to seven steps a sample differ by 4e-3
from the package's 32, and by 5e-4 with as many. Elsewhere both agree to 1e-6."""


def twin(law: dft.Model, x: float, y: float, **body: float) -> dft.Model:
    sides = {"port": law.at((x, -y, 0)), "starboard": law.at((x, y, 0))}
    return dft.Craft(dft.bodies.Planar(**body), **sides, share=[tuple(sides)])


def kingfisher():
    law = dft.actuators.StaticThruster(gain=10.15, reverse=0.3)
    craft = twin(law, -0.5, 0.375, m11=31.0, m22=45.0, i33=4.0, d11=15.0, d22=60.0, d33=5.0)
    sides = ("port", "starboard")
    log = dft.read_log(
        data_folder("kingfisher") / "run_01.csv",
        time="time_s",
        inputs={f"{side}.command": Column(f"{side}_command", effort=True) for side in sides},
        measured={
            "surge": Column("speed_m_s", "m/s"),
            "heading": Column("heading_deg", "deg", scale=-1),
        },
    )
    return craft, log.averaged(5)


def blueboat():
    ahead = {"stop": 1511, "full": 1900, "reverse": 1100}
    turned = {"stop": 1511, "full": 1100, "reverse": 1900}
    log = dft.read_log(
        data_folder("blueboat") / "run_216.csv",
        time=Column("original_timestamp", "ms"),
        inputs={
            "port.command": Column("thr_right", pwm=ahead),
            "starboard.command": Column("thr_left", pwm=turned),
        },
        measured={
            "surge": Column("surge", "m/s"),
            "sway": Column("sway", "m/s"),
            "yaw_rate": Column("yaw_rate", "rad/s"),
        },
    )
    return dft.layouts.BLUEBOAT.craft(), log.averaged(5)


def esso_osaka():
    screw = dft.actuators.StaticThruster(command="rev/s", gain=0.02)
    stern = dft.actuators.RudderPropeller(screw).at((-1.45, 0, 0))
    masses = {"m11": 1.05 * 244.6, "m22": 2 * 244.6, "i33": 200.0, "x_g": 0.094}
    body = dft.bodies.Planar(**masses, d11=4.0, d22=40.0, d33=40.0)
    log = dft.read_log(
        min(data_folder("esso_osaka").glob("zigzag*.csv")),
        time=Column("t [s]", "s"),
        inputs={
            "stern.command": Column("n_prop [rps]", "rps"),
            "stern.rudder_angle": Column("delta_rudder [rad]", "rad", scale=-1),
            "wind_speed": Column("wind_velo_true [m/s]", "m/s"),
            "wind_direction": Column("wind_dir_true [rad]", "rad"),
            "heading": Column("psi_hat [rad]", "rad"),
        },
        measured={
            "surge": Column("u_velo [m/s]", "m/s"),
            "sway": Column("vm_velo [m/s]", "m/s"),
            "yaw_rate": Column("r_angvelo [rad/s]", "rad/s"),
        },
        stop=150.0,
    )
    return dft.Craft(body, stern=stern), log.averaged(5)


def swamp():
    jet = dft.actuators.StaticThruster(command="rev/s", gain=dft.Parameter(0.0147, fixed=True))
    names = ("RL", "FL", "RR", "FR")
    places = {n: (0.4 if n[0] == "F" else -0.4, 0.4 if n[1] == "R" else -0.4, 0) for n in names}
    mounts = {n: dft.actuators.Azimuth(jet).at(place) for n, place in places.items()}
    body = dft.bodies.Planar(m11=42.0, m22=70.0, i33=8.0, d11=30.0, d22=80.0, d33=20.0)
    (path,) = data_folder("swamp").glob("*.csv")
    log = dft.read_log(
        path,
        time=0.1,
        inputs={f"{n}.command": Column(f"{n}_thruster_speed", "rpm") for n in names}
        | {f"{n}.azimuth": Column(f"{n}_azimuth_angle", "deg") for n in names},
        measured={
            "north": Column("projection_x_coordinate", "m"),
            "east": Column("projection_y_coordinate", "m"),
            "yaw_rate": Column("yaw_rate", "deg/s"),
            "heading": Column("yaw", "deg"),
        },
    )
    return dft.Craft(body, **mounts, share=[names]), log.slice(0, mc.SWAMP_CUT)


def otter():
    import pandas as pd

    path = min(data_folder("otter").glob("2024*.csv"))
    table = pd.read_csv(path, sep=";").iloc[10:].dropna(subset=["n1", "tau_N"])
    table = table[table.current_speed < 5.0]
    channels = {
        "port.command": ("n1", "rpm"),
        "starboard.command": ("n2", "rpm"),
        "surge": ("current_speed", "m/s"),
        "yaw_rate": ("current_rotational_velocities_3", "deg/s"),
        "heading": ("current_orientation_3", "deg"),
    }
    series = {name: table[column].to_numpy() for name, (column, _) in channels.items()}
    time = table.current_time.to_numpy()
    inputs = {n: series.pop(n) for n in ("port.command", "starboard.command")}
    units = {name: unit for name, (_, unit) in channels.items()}
    log = dft.Log(time - time[0], inputs, series, units=units, name=path.stem)
    return dft.layouts.OTTER.craft(), log.averaged(5)


CRAFTS = (kingfisher, blueboat, esso_osaka, swamp, otter)


@pytest.mark.parametrize("written", CRAFTS, ids=lambda f: f.__name__)
def test_a_craft_reads_and_moves_as_the_reference(written):
    craft, log = written()
    case = mc.CASES[written.__name__]()
    run = case.train[0]
    units = {**craft.inputs, **craft.optional_inputs, **craft.states}
    for name, series in {**run.inputs, **run.measured}.items():
        read = log.values(name, units[name])
        if name in craft.angles:
            series, read = np.unwrap(series), np.unwrap(read)
            read = read + 2.0 * np.pi * np.round((series[0] - read[0]) / (2.0 * np.pi))
        seen = np.isfinite(series)  # the package averages what is left of a block
        np.testing.assert_allclose(read[seen], series[seen], rtol=1e-9, atol=1e-9, err_msg=name)
    system = case.system()
    start = {state: wr.beginning(run, state) for state in system.states}
    values = {name: craft.parameters[name].value for name in system.parameters}
    (modelled,) = wr.simulate(system, [wr.replace(run, initial=start)], values)
    package = dft.simulate(craft, log, initial=start, substeps=32)
    for name, series in modelled.items():
        worst = np.max(np.abs(package[name] - series))
        assert worst <= ALIKE * np.std(series), name


def test_a_start_that_nothing_measures_is_found_from_the_run():
    craft = mc.craft({}, mc._body(30.0, 50.0, 5.0, 10.0, 40.0, 8.0), measures=("surge", "heading"))
    time = np.arange(0.0, 8.0, 0.1)
    bare = wr.Run(time, {}, {}, {"surge": 0.8, "yaw_rate": 0.5, "sway": 0.3}, name="adrift")
    numbers = {name: r.start for name, r in craft.parameters.items()}
    (moved,) = wr.simulate(craft, [bare], numbers)
    run = wr.Run(time, {}, moved, name="adrift")
    (begun,) = wr.begun_best(craft, [run], numbers, "sway", "yaw_rate")
    assert begun.initial["yaw_rate"] == pytest.approx(0.5, abs=1e-3)
    assert begun.initial["sway"] == pytest.approx(0.3, abs=1e-2)
