"""What sensors on a craft read, held against rotation matrices and DOP853; their frames."""

import numpy as np
import pytest
from reference import craft

import diffthrust as dft
from diffthrust import InputError
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import Axis, Body, FourDegrees, Heave, Planar, Six, SixDegrees
from diffthrust.models._craft import attitude  # private: a quaternion of angles
from diffthrust.sensors import DVL, GNSS, IMU, Attitude, Pressure

TIME = 0.1 * np.arange(61)
LAW = {"gain": 30.0, "exponent": 1.6}
PLACES = {
    "a": ((-0.2, -0.15, 0.02), (1.0, 0.0, 0.0)),
    "b": ((-0.2, 0.15, -0.03), (0.6, -0.8, 0.0)),
    "c": ((0.1, 0.05, 0.04), (0.0, 0.0, 1.0)),
}
OFF = (0.4, -0.3, 0.25)
MASSES = {"m11": 17.0, "m22": 24.0, "m33": 26.0, "i44": 0.3, "i55": 0.5, "i66": 0.4}
LINEAR = {"d11": 4.0, "d22": 26.0, "d33": 25.0, "d44": 0.8, "d55": 0.9, "d66": 0.7}
# the second derivative of v |v| jumps at rest, where no method of fourth order is exact to 1e-8
QUADRATIC = {"q11": 18.0, **dict.fromkeys(("q22", "q33", "q44", "q55", "q66"), 0.0)}


def steps(seed: int, low: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(low, 1.0, 7), 10)[: TIME.size]


COMMANDS = {"a": steps(1, 0.4), "b": 0.3 * steps(2, 0.2), "c": 0.3 * steps(3, 0.2)}


def sensors() -> dict:
    return {
        "dvl": DVL().at(OFF),
        "imu": IMU().at(OFF),
        "gps": GNSS().at(OFF),
        "bar": Pressure(density=1025.0, tare=99_000.0).at(OFF),
        "att": Attitude(),
        "ros": Attitude(frame="ENU"),
        "flu": IMU(frame="FLU").at(OFF),
        "up": DVL(frame="FLU").at(OFF),
    }


@pytest.fixture(scope="module")
def both() -> tuple[dict, dict]:
    """One run of a body in six degrees, by the package and by DOP853."""
    centres = {"x_g": 0.02, "y_g": -0.01, "z_g": 0.05, "x_b": 0.01, "z_b": -0.03}
    body = SixDegrees(**MASSES, **LINEAR, **QUADRATIC, weight=100.0, buoyancy=101.0, **centres)
    mounts = {n: StaticThruster(**LAW).at(*place) for n, place in PLACES.items()}
    model = dft.Craft(body, **mounts, **sensors())
    inputs = {f"{n}.command": series for n, series in COMMANDS.items()}
    log = dft.Log(TIME, inputs, units=dict.fromkeys(inputs, "effort"))
    start = {"surge": 0.6, "roll_rate": 0.2}
    start |= model.start_from({"roll": 0.1, "pitch": -0.15, "heading": 1.0})
    ours = dft.simulate(model, log, initial=start, substeps=40)
    theirs = craft.simulate(
        TIME,
        craft.Body(
            [*MASSES.values()], [*LINEAR.values()], [*QUADRATIC.values()], (0.02, -0.01, 0.05),
            weight=100.0, buoyancy=101.0, lift=(0.01, 0.0, -0.03),
        ),
        [craft.static({**LAW, "reverse": 1.0}, place, pointing=d) for place, d in PLACES.values()],
        [[series] for series in COMMANDS.values()],
        velocity=(0.6, 0.0, 0.0, 0.2, 0.0, 0.0),
        angles=(0.1, -0.15, 1.0),
    )  # fmt: skip
    return ours, theirs


def agree(ours: dict, names: list[str], theirs: np.ndarray) -> None:
    for name, series in zip(names, theirs.T, strict=True):
        assert np.ptp(series) > 1e-2, name  # it moves
        np.testing.assert_allclose(ours[name], series, atol=1e-8, rtol=0, err_msg=name)


def test_a_doppler_log_reads_the_velocity_of_its_place(both):
    ours, theirs = both
    agree(ours, ["dvl.surge", "dvl.sway", "dvl.heave"], craft.dvl(theirs, OFF))
    agree(ours, ["up.surge", "up.sway", "up.heave"], craft.dvl(theirs, OFF) * [1, -1, -1])


def test_an_imu_reads_rates_and_the_specific_force_of_its_place(both):
    ours, theirs = both
    rates = np.stack([theirs[n] for n in craft.AXES[3:]], axis=1)
    agree(ours, ["imu.roll_rate", "imu.pitch_rate", "imu.yaw_rate"], rates)
    force = craft.accelerometer(theirs, OFF)
    agree(ours, ["imu.x_force", "imu.y_force", "imu.z_force"], force)
    agree(ours, ["flu.x_force", "flu.y_force", "flu.z_force"], force * [1, -1, -1])
    agree(ours, ["flu.roll_rate", "flu.pitch_rate", "flu.yaw_rate"], rates * [1, -1, -1])


def test_an_antenna_reads_where_it_is_and_how_it_moves(both):
    ours, theirs = both
    position, velocity = craft.antenna(theirs, OFF)
    agree(ours, ["gps.north", "gps.east", "gps.down"], position)
    agree(ours, ["gps.velocity_north", "gps.velocity_east", "gps.velocity_down"], velocity)
    agree(ours, ["gps.speed"], np.hypot(velocity[:, :1], velocity[:, 1:2]))


def test_pressure_grows_with_the_depth_of_its_place(both):
    ours, theirs = both
    down = craft.antenna(theirs, OFF)[0][:, 2:]
    agree(ours, ["bar.depth"], down)
    np.testing.assert_allclose(
        ours["bar.pressure"], 99_000 + 1025 * 9.80665 * down[:, 0], rtol=1e-9
    )


def test_a_quaternion_is_the_rotation_matrix_between_its_axes(both):
    ours, theirs = both
    angles = (theirs["roll"], theirs["pitch"], theirs["heading"])
    ned = np.array([craft.rotation_of(*each) for each in zip(*angles, strict=True)])
    flip = np.diag([1.0, -1.0, -1.0])
    enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    for name, matrices in (("att", ned), ("ros", enu @ ned @ flip)):
        w, x, y, z = (ours[f"{name}.q{k}"] for k in "wxyz")
        turned = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        np.testing.assert_allclose(turned, np.moveaxis(matrices, 0, 2), atol=1e-8)
        angles = [ours[f"{name}.{a}"] for a in ("roll", "pitch", "yaw")]
        again = np.array([craft.rotation_of(*each) for each in zip(*angles, strict=True)])
        np.testing.assert_allclose(again, matrices, atol=1e-8)


@pytest.mark.parametrize("frame", ["NED", "ENU"])
@pytest.mark.parametrize("body", [SixDegrees(), Planar()])
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_a_craft_begins_at_the_attitude_that_is_read(frame, body, turned):
    level = isinstance(body, Planar)
    model = dft.Craft(body, att=Attitude(frame=frame), ned=Attitude())
    angles = {"heading": -2.5} if level else {"roll": 0.3, "pitch": -0.4, "heading": -2.5}
    first = model.start_from(angles) or angles
    empty = dft.Log(TIME[:2], {})
    out = dft.simulate(model, empty, initial=first, substeps=1)
    for names in (("qw", "qx", "qy", "qz"), ("roll", "pitch", "yaw")):
        sign = turned if names[0] == "qw" else 1.0
        read = {f"att.{n}": sign * out[f"att.{n}"] for n in names}
        log = dft.Log(
            TIME[:2],
            {},
            read,
            units=dict.fromkeys(read, "rad") if sign == 1 and "att.yaw" in read else {},
        )
        again = dft.simulate(model, log, substeps=1)
        for name in ("ned.roll", "ned.pitch", "ned.yaw"):
            np.testing.assert_allclose(again[name], out[name], atol=1e-12, err_msg=name)
        for name, series in read.items():  # with the sign of the log, too
            np.testing.assert_allclose(again[name], series, atol=1e-12, err_msg=name)


def test_a_quaternion_that_turns_its_signs_is_the_same_attitude():
    boat = dft.Craft(Planar(), att=Attitude())
    empty = dft.Log(TIME, {})
    out = dft.simulate(boat, empty, initial={"heading": 2.0, "yaw_rate": 4.0}, substeps=4)
    assert out["att.qw"].min() < -0.1  # beyond half a turn
    read = {f"att.q{k}": out[f"att.q{k}"] * np.sign(out["att.qw"]) for k in "wz"}
    read |= {f"att.q{k}": 0.0 * TIME for k in "xy"}
    for flipped in (1.0, -1.0):
        log = dft.Log(TIME, {}, {n: flipped * v for n, v in read.items()}, name="turned")
        (run,) = dft.compare(boat, log, initial=[{"yaw_rate": 4.0}]).runs
        assert run.errors.channels["att.qz"].rmse < 1e-6


@pytest.mark.parametrize(
    ("body", "moving", "reads"),
    [
        (Axis(), {"velocity": 0.4, "position": 2.0},
         {"gps.north": 2.3, "gps.speed": 0.4, "dvl.surge": 0.4, "imu.x_force": -67 * 0.16 / 340}),
        (Heave(buoyancy=112.8), {"heave": 0.2, "depth": 3.0},
         {"gps.down": 2.0, "dvl.heave": 0.2, "bar.depth": 3.0,
          "imu.z_force": -(5 * 0.2 + 37 * 0.04) / 26 - 9.80665}),
        (FourDegrees(buoyancy=112.8), {"heading": np.pi / 2, "heave": 0.2, "yaw_rate": 0.5},
         {"gps.east": 0.3, "gps.velocity_north": -0.15, "dvl.sway": 0.15, "dvl.heave": 0.2}),
    ],
    ids=["axis", "heave", "four"],
)  # fmt: skip
def test_sensors_read_on_each_body(body, moving, reads):
    at = (0.3, 0.0, -1.0)
    model = dft.Craft(body, gps=GNSS().at(at), dvl=DVL().at(at), imu=IMU().at(at), bar=Pressure())
    out = dft.simulate(model, dft.Log(TIME[:2], {}), initial=moving, substeps=1)
    for name, value in reads.items():
        assert out[name][0] == pytest.approx(value, abs=1e-9), name


def test_mistakes_are_named_with_their_mend():
    with pytest.raises(InputError, match=r"(?s)found 'ENU'.*'FRD'.*Mend: Write frame='FLU'"):
        DVL(frame="ENU")
    with pytest.raises(InputError, match=r"(?s)found 'NED'.*Leave frame out"):
        GNSS(frame="NED")
    with pytest.raises(InputError, match="three numbers for place"):
        GNSS().at((1, 2))
    with pytest.raises(InputError, match="cannot be called 'heading'"):
        dft.Craft(Planar(), heading=GNSS())
    with pytest.raises(InputError, match=r"dvl: expected an actuator or a sensor"):
        dft.Craft(Planar(), dvl="dvl")


@pytest.mark.parametrize(
    "sensor",
    [DVL(), DVL(frame="FLU"), IMU(), IMU(frame="FLU"), Attitude(), Attitude(frame="ENU"), GNSS(),
     Pressure(density=1025.0, tare=99_000.0)],
    ids=lambda sensor: f"{sensor.name} {sensor.frame}",
)  # fmt: skip
def test_readings_lead_back_to_the_motion(sensor):
    moving = dft.sensors.Kinematics(
        Six(0.5, -0.2, 0.1, 0.3, -0.4, 0.6),
        Six(0.1, 0.2, 0.3, 0.0, 0.0, 0.0),
        (3.0, -2.0, 5.0),
        attitude.from_angles(0.2, -0.3, -2.5),
    )
    motion = dict(zip(("surge", "sway", "heave", *craft.AXES[3:]), moving.velocity, strict=True))
    motion |= {"north": 3.0, "east": -2.0, "depth": 5.0}
    motion |= {"roll": 0.2, "pitch": -0.3, "heading": -2.5}
    motion |= zip(("x_force", "y_force", "z_force"), moving.specific_force, strict=True)
    back = sensor.as_of_body(sensor.read(moving))
    assert back
    for name, value in back.items():
        assert value == pytest.approx(motion[name], abs=1e-12), name


def test_a_body_of_other_states_says_how_it_moves():
    class Cart(Body):
        """On rails."""

        name = "cart"
        states = outputs = {"velocity": "m/s"}

        def motion(self, s, port):
            return Six(surge=s.velocity)

        def equations(self, s, port, water, forces):
            return {"velocity": 0.0 * s.velocity}, {"velocity": s.velocity}

    with pytest.raises(InputError, match=r"'wheel' would read nothing of the body 'cart'"):
        dft.Craft(Cart(), wheel=DVL())
