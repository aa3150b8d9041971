"""Bodies and actuators held against matrices and DOP853, and against the systems they replace."""

from dataclasses import replace

import numpy as np
import pytest
from reference import craft

import diffthrust as dft
from diffthrust.actuators import Azimuth, HingedPropeller, RudderPropeller, StaticThruster
from diffthrust.bodies import Axis, FourDegrees, Heave, Planar, SixDegrees

JASON = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}
CURVE = {"gain": 30.0, "exponent": 1.6, "reverse": 0.7}
TIME = 0.1 * np.arange(81)


def steps(seed: int, low: float = -1.0, high: float = 1.0, hold: int = 10) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(low, high, TIME.size // hold + 1), hold)[: TIME.size]


def driven(model: dft.Craft, inputs: dict[str, np.ndarray], **start: float) -> dict:
    log = dft.Log(TIME, inputs, units={name: model.inputs[name] for name in inputs})
    at_rest = {name: 0.0 for name in model.states if name.endswith(".speed")}
    return dft.simulate(model, log, initial={**at_rest, **start}, substeps=8)


def agree(simulated: dict, reference: dict, names: tuple[str, ...], tolerance: float = 2e-6):
    for name in names:
        size = np.abs(reference[name]).max()
        assert size > 1e-4, name  # it moves
        np.testing.assert_allclose(
            simulated[name], reference[name], atol=tolerance * size, err_msg=name
        )


# -- each body, with thrusters that have states ----------------------------------------------------

SIX = {
    "m11": 17.0, "m22": 24.0, "m33": 26.0, "i44": 0.3, "i55": 0.5, "i66": 0.4,
    "d11": 4.0, "d22": 6.0, "d33": 5.0, "d44": 0.2, "d55": 0.3, "d66": 0.1,
    "q11": 18.0, "q22": 22.0, "q33": 37.0, "q44": 1.0, "q55": 1.5, "q66": 1.2,
}  # fmt: skip
PLACES = {
    "a": ((-0.2, -0.15, 0.02), (1.0, 0.0, 0.0)),
    "b": ((-0.2, 0.15, -0.03), (0.8, -0.6, 0.0)),
    "c": ((0.1, 0.05, 0.04), (0.0, 0.0, 1.0)),
}


def of_six(kind: str) -> list[float]:
    names = ("11", "22", "33", "44", "55", "66")
    return [SIX[f"{kind if kind != 'm' or int(n) < 40 else 'i'}{n}"] for n in names]


def thrusters(**more) -> tuple[dict, list, dict, list]:
    """The same actuators twice, and their commands."""
    ours = {
        name: dft.Thruster(**JASON).at(place, pointing, **more)
        for name, (place, pointing) in PLACES.items()
    }
    theirs = [
        craft.torque_driven(JASON, place, pointing=tuple(np.array(d) / np.linalg.norm(d)), **more)
        for place, d in PLACES.values()
    ]
    series = [0.5 * steps(seed) for seed in (1, 2, 3)]
    return ours, theirs, {f"{n}.command": c for n, c in zip("abc", series)}, [[c] for c in series]  # noqa: B905


@pytest.mark.thorough
def test_six_degrees():
    ours, theirs, inputs, commands = thrusters(reaction=0.02)
    body = SixDegrees(
        **SIX, weight=100.0, buoyancy=103.0, x_g=0.02, y_g=-0.01, z_g=0.05, x_b=0.01, z_b=-0.03
    )
    start = {"surge": 0.3, "sway": -0.1, "roll_rate": 0.2}
    from_angles = dft.Craft(body).start_from({"roll": 0.2, "pitch": -0.3, "heading": 1.0})
    out = driven(dft.Craft(body, **ours), inputs, **start, **from_angles)
    reference = craft.simulate(
        TIME,
        craft.Body(
            of_six("m"), of_six("d"), of_six("q"), (0.02, -0.01, 0.05),
            weight=100.0, buoyancy=103.0, lift=(0.01, 0.0, -0.03),
        ),
        theirs,
        commands,
        velocity=(0.3, -0.1, 0.0, 0.2, 0.0, 0.0),
        angles=(0.2, -0.3, 1.0),
    )  # fmt: skip
    out["heading"] = np.unwrap(out["heading"])
    agree(out, reference, (*craft.AXES, "north", "east", "depth", "roll", "pitch", "heading"))
    np.testing.assert_allclose(out["b.speed"], reference["(1, 0)"], atol=1e-6 * 20)
    np.testing.assert_allclose(out["qw"] ** 2 + out["qx"] ** 2 + out["qy"] ** 2 + out["qz"] ** 2, 1)


def test_four_degrees():
    ours, theirs, inputs, commands = thrusters()
    kept = {k: v for k, v in SIX.items() if k[1] not in "45"}
    body = FourDegrees(**kept, weight=100.0, buoyancy=103.0, x_g=0.03, x_d=-0.05)
    out = driven(dft.Craft(body, **ours), inputs, surge=0.3)
    reference = craft.simulate(
        TIME,
        craft.Body(
            of_six("m"), of_six("d"), of_six("q"), (0.03, 0.0, 0.0), (-0.05, 0.0, 0.0),
            weight=100.0, buoyancy=103.0, free=(0, 1, 2, 5),
        ),
        theirs,
        commands,
        velocity=(0.3, 0.0, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    names = ("surge", "sway", "heave", "yaw_rate", "north", "east", "depth", "heading")
    agree(out, reference, names)


def test_planar():
    ours, theirs, inputs, commands = thrusters()
    body = Planar(m11=38, m22=60, i33=6, d11=20, d22=80, d33=12, x_g=0.1, x_d=-0.2)
    out = driven(dft.Craft(body, **ours), inputs, surge=0.3)
    linear = (20.0, 80.0, 0.0, 0.0, 0.0, 12.0)
    reference = craft.simulate(
        TIME,
        craft.Body(
            (38.0, 60.0, 1.0, 1.0, 1.0, 6.0), linear, (0.0,) * 6, (0.1, 0.0, 0.0),
            (-0.2, 0.0, 0.0), free=(0, 1, 5),
        ),
        theirs,
        commands,
        velocity=(0.3, 0.0, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    agree(out, reference, ("surge", "sway", "yaw_rate", "north", "east", "heading"))


def test_heave():
    lift = dft.Thruster(**JASON).at((0.1, 0, 0), (0, 0, 1))
    body = Heave(m33=26.0, d33=5.0, q33=37.0, weight=100.0, buoyancy=103.0)
    command = 0.5 * steps(4)
    out = driven(dft.Craft(body, lift=lift), {"lift.command": command})
    reference = craft.simulate(
        TIME,
        craft.Body(of_six("m"), of_six("d"), of_six("q"), weight=100, buoyancy=103, free=(2,)),
        [craft.torque_driven(JASON, (0.1, 0.0, 0.0), pointing=(0.0, 0.0, 1.0))],
        [[command]],
    )
    agree(out, reference, ("heave", "depth"))


# -- each actuator, on a body in the plane ---------------------------------------------------------

PLAIN = {"gain": 30.0, "exponent": 1.6}
CASES = {
    "static": (
        StaticThruster(**CURVE),
        lambda place: craft.static(CURVE, place),
        {"command": steps(5)},
    ),
    "azimuth": (
        Azimuth(StaticThruster(**PLAIN), slew_time=0.8),
        lambda place: craft.azimuth({**PLAIN, "slew_time": 0.8}, place, 4.0 * steps(7)[0]),
        {"command": steps(6, 0.1), "angle": 4.0 * steps(7)},
    ),
    "rudder": (
        RudderPropeller(StaticThruster(**PLAIN), race=0.7, free_stream=3.0),
        lambda place: craft.rudder({**PLAIN, "race": 0.7, "free_stream": 3.0}, place),
        {"command": steps(8), "rudder_angle": 0.5 * steps(9)},
    ),
    "hinged": (
        HingedPropeller(gain=2.0, exponent=0.5),
        lambda place: craft.hinged({"gain": 2.0, "exponent": 0.5}, place),
        {"propeller_speed": 50.0 * steps(10), "rudder_angle": 0.5 * steps(11)},
    ),
}


@pytest.mark.parametrize("kind", CASES)
def test_actuators(kind):
    model, reference_of, inputs = CASES[kind]
    place = (-0.4, 0.1, 0.0)
    out = driven(
        dft.Craft(Planar(), stern=model.at(place)), {f"stern.{n}": v for n, v in inputs.items()}
    )
    reference = craft.simulate(
        TIME,
        craft.Body(
            (38.0, 60.0, 1.0, 1.0, 1.0, 6.0), (20.0, 80.0, 0.0, 0.0, 0.0, 12.0), free=(0, 1, 5)
        ),
        [reference_of(place)],
        [list(inputs.values())],
    )
    agree(out, reference, ("surge", "sway", "yaw_rate", "north", "east", "heading"))


@pytest.mark.parametrize("kind", CASES)
def test_a_weak_one_of_two_has_less_of_all_its_force(kind):
    model, reference_of, inputs = CASES[kind]
    places = {"port": (-0.4, -0.3, 0.0), "starboard": (-0.4, 0.3, 0.0)}
    boat = dft.Craft(
        Planar(), **{name: model.at(place) for name, place in places.items()}, share=[tuple(places)]
    )
    given = {f"{name}.{n}": v for name in places for n, v in inputs.items()}
    out = driven(boat.replace({"starboard.strength": 0.8}), given)
    port, whole = (reference_of(place) for place in places.values())

    def weak(*states):
        return tuple(0.8 * force for force in whole.force(*states))

    reference = craft.simulate(
        TIME,
        craft.Body(
            (38.0, 60.0, 1.0, 1.0, 1.0, 6.0), (20.0, 80.0, 0.0, 0.0, 0.0, 12.0), free=(0, 1, 5)
        ),
        [port, replace(whole, force=weak)],
        [list(inputs.values())] * 2,
    )
    agree(out, reference, ("surge", "sway", "yaw_rate", "north", "east", "heading"))
    if kind in ("static", "hinged"):  # the same command gives the same share, wherever it is
        np.testing.assert_allclose(out["starboard.thrust"], 0.8 * out["port.thrust"], rtol=1e-12)


def test_a_measured_azimuth_needs_no_commanded_angle():
    model = dft.Craft(Planar(), stern=Azimuth(StaticThruster()).at((-0.5, 0, 0)))
    angle = steps(3)
    commanded = {"stern.command": steps(4), "stern.azimuth": angle}
    units = {"stern.command": "effort", "stern.azimuth": "rad"}
    out = dft.simulate(model, dft.Log(TIME, commanded, units=units), substeps=4)
    hinged = dft.Craft(Planar(), stern=HingedPropeller(gain=40.0, exponent=1.0).at((-0.5, 0, 0)))
    same = {"stern.propeller_speed": commanded["stern.command"], "stern.rudder_angle": angle}
    other = dft.simulate(hinged, dft.Log(TIME, same), substeps=4)
    np.testing.assert_allclose(out["yaw_rate"], other["yaw_rate"], atol=1e-13)


# -- the systems that they replace -----------------------------------------------------------------

RATIOS = {"m11": 38.0, "m22": 60.0, "i33": 6.0, "d11": 20.0, "d22": 80.0, "d33": 12.0}


@pytest.mark.parametrize("command", ["N", "effort"])
def test_two_static_thrusters_are_a_twin_vessel(command):
    vessel = dft.Vessel(drive="twin", command=command, **RATIOS, lever_arm=0.3)
    law = StaticThruster(command=command)
    if command == "effort":
        vessel, law = vessel.replace(exponent=1.7), law.replace(gain=1.0, exponent=1.7)
    boat = dft.Craft(Planar(**RATIOS), left=law.at((-0.5, -0.3, 0)), right=law.at((-0.5, 0.3, 0)))
    left, right = 30 * steps(1), 30 * steps(2)
    if command == "effort":
        left, right = left / 30, right / 30
    inputs = {"left_force": left, "right_force": right}
    units = dict.fromkeys(inputs, command)
    expected = dft.simulate(vessel, dft.Log(TIME, inputs, units=units), substeps=2)
    inputs = {"left.command": left, "right.command": right}
    units = dict.fromkeys(inputs, command)
    out = dft.simulate(boat, dft.Log(TIME, inputs, units=units), substeps=2)
    for name, series in expected.items():
        np.testing.assert_allclose(out[name], series, rtol=1e-12, atol=1e-13, err_msg=name)


def test_a_hinged_propeller_is_that_of_the_vessel():
    vessel = dft.Vessel(**RATIOS, exponent=0.27, lever_arm=0.5)
    boat = dft.Craft(Planar(**RATIOS), stern=HingedPropeller(exponent=0.27).at((-0.5, 0, 0)))
    inputs = {"propeller_speed": 90.0 * steps(1), "rudder_angle": 0.4 * steps(2)}
    expected = dft.simulate(vessel, dft.Log(TIME, inputs), substeps=2)
    behind = {f"stern.{name}": series for name, series in inputs.items()}
    out = dft.simulate(boat, dft.Log(TIME, behind), substeps=2)
    for name, series in expected.items():
        np.testing.assert_allclose(out[name], series, rtol=1e-12, atol=1e-13, err_msg=name)


def test_numbers_of_a_curve_stay_as_given_in_any_unit_of_the_command():
    """A gain held in revolutions a second was free, and an exponent of 1.8 was 2."""
    for command in ("effort", "rev/s", "rad/s", "V"):
        held = {"value": 0.0147, "fixed": True}
        law = StaticThruster(command=command, gain=held, exponent={"value": 1.8, "fixed": False})
        gain, exponent = law.parameters["gain"], law.parameters["exponent"]
        assert (gain.value, gain.fixed) == (0.0147, True)
        assert gain.unit.startswith("N")
        assert (exponent.value, exponent.fixed) == (1.8, False)
        turned = dft.Craft(Planar(), bow=dft.actuators.Azimuth(law).at((1, 0, 0))).parameters
        assert (turned["bow.gain"].value, turned["bow.gain"].fixed) == (0.0147, True)
    plain = StaticThruster(command="rev/s", gain=0.02).parameters
    assert (plain["gain"].value, plain["gain"].fixed) == (0.02, False)
    assert (plain["exponent"].value, plain["exponent"].fixed) == (2.0, True)


@pytest.mark.parametrize("effects", [["water_current"], ["quadratic_surge_drag", "wind"],
                                     ["sway_yaw_coupling"]])  # fmt: skip
def test_effects_of_a_vessel_act_on_a_craft(effects):
    vessel = dft.Vessel(drive="twin", **RATIOS, lever_arm=0.3) + effects
    law = StaticThruster(command="N")
    boat = (
        dft.Craft(Planar(**RATIOS), left=law.at((0, -0.3, 0)), right=law.at((0, 0.3, 0))) + effects
    )
    left, right = 30 * steps(1), 30 * steps(2)
    log = dft.Log(TIME, {"left_force": left, "right_force": right})
    expected = dft.simulate(vessel, log, substeps=2)
    inputs = {"left.command": left, "right.command": right}
    out = dft.simulate(boat, dft.Log(TIME, inputs, units=dict.fromkeys(inputs, "N")), substeps=2)
    for name, series in expected.items():
        np.testing.assert_allclose(out[name], series, rtol=1e-11, atol=1e-12, err_msg=name)


def test_an_axis_under_a_measured_thrust_is_the_axis_vehicle():
    thrust = 20.0 * steps(1)
    expected = dft.simulate(dft.AxisVehicle(), dft.Log(TIME, {"thrust": thrust}), substeps=2)
    axis = dft.Craft(Axis(), aft=StaticThruster(command="N").at((-1, 0, 0)))
    log = dft.Log(TIME, {"aft.command": thrust}, units={"aft.command": "N"})
    out = dft.simulate(axis, log, substeps=2)
    for name, series in expected.items():
        np.testing.assert_allclose(out[name], series, rtol=1e-13, atol=1e-15, err_msg=name)


@pytest.mark.parametrize("effect", ["actuator_lag", "coulomb_friction", "command_delay",
                                    "axial_flow", "speed_sensor_offset"])  # fmt: skip
def test_a_thruster_on_a_craft_is_the_thruster_with_its_effects(effect):
    alone = dft.Thruster() + effect
    axis = dft.Craft(Axis(), aft=dft.Thruster().at((0, 0, 0)))
    command = steps(1)
    expected = dft.simulate(alone, dft.Log(TIME, {"command": command}), substeps=2)
    log = dft.Log(TIME, {"aft.command": command})
    pair = ("aft", effect)
    from_parts = dft.Craft(Axis(), aft=alone.at((0, 0, 0)))
    for placed in (axis + pair, axis + f"aft.{effect}", axis + effect, from_parts):
        assert placed.effects[0].name == f"aft.{effect}"
        out = dft.simulate(placed, log, initial={"aft.speed": 0.0}, substeps=2)
        for name, series in expected.items():
            np.testing.assert_allclose(out[f"aft.{name}"], series, rtol=1e-12, atol=1e-12)
