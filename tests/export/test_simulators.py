"""What simulators make of the exported parameters, by the update laws of their sources."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.effects import CommandSaturation, LinearDamping, ReverseThrustAsymmetry
from diffthrust.export import export_model

LIMITS = (-2.0, 2.0)
STEP = 0.0005
SEEN = {
    "yoerger": dft.Thruster(),
    "two constants": dft.Thruster() + ReverseThrustAsymmetry(change=-0.3),
    "clamped": dft.Thruster() + CommandSaturation(limit=1.2),
    "damped": dft.Thruster() + LinearDamping(rate=0.8),
    "tabulated": dft.Thruster() + "cavitation" + "reverse_thrust_asymmetry",
    "motor": dft.DCMotorThruster(coulomb=0.0, inductance=1e-7),
    "loop": dft.SpeedLoopThruster(gain=30.0),
}


def xml_of(exported) -> ElementTree.Element:
    return ElementTree.fromstring(f"<file>{exported.text}</file>")


def commands() -> tuple[np.ndarray, np.ndarray]:
    """Steps within the limits, over a minute."""
    rng = np.random.default_rng(11)
    count = int(60.0 / STEP) + 1
    held = np.repeat(rng.uniform(*LIMITS, count // 2000 + 1), 2000)[:count]
    return STEP * np.arange(count), held


def wanted_of(model) -> dict[str, np.ndarray]:
    time, command = commands()
    return dft.simulate(model, dft.Log(time, {"command": command}, {}))


def rotor(law, numbers, driven):
    """The speed by the forward Euler steps that both simulators take."""
    speed, found = 0.0, []
    for u in driven:
        found.append(speed)  # of this instant, before its command has acted
        if law == "yoerger":
            rate = numbers["beta"] * u - numbers["alpha"] * speed * abs(speed)
        elif law == "bessa":
            rate = numbers["kt"] / numbers["rm"] * u - numbers["kv1"] * speed
            rate = (rate - numbers["kv2"] * speed * abs(speed)) / numbers["jmsp"]
        else:
            rate = (u - speed) / numbers["tau"]
        speed += STEP * rate
    return np.array(found)


def of_uuv(text: ElementTree.Element, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """uuv_simulator: ThrusterPlugin::Update, Dynamics.cc, ThrusterConversionFcn.cc.

    With the clock of the dynamics moved on, as the notes ask.
    """
    plugin = text.find("gazebo/plugin")
    numbers = {e.tag: e.text for e in plugin.iter() if e.text and e.text.strip()}
    clamped = np.clip(command, float(numbers["clampMin"]), float(numbers["clampMax"]))
    law = plugin.find("dynamics/type").text
    keys = {"alpha": "alpha", "beta": "beta", "Jmsp": "jmsp", "Kv1": "kv1", "Kv2": "kv2"}
    keys |= {"Kt": "kt", "Rm": "rm", "timeConstant": "tau"}
    read = {ours: float(numbers[theirs]) for theirs, ours in keys.items() if theirs in numbers}
    law = {"Yoerger": "yoerger", "Bessa": "bessa", "FirstOrder": "first_order"}[law]
    speed = rotor(law, read, float(numbers["gain"]) * clamped)
    kind, basic = plugin.find("conversion/type").text, speed * np.abs(speed)
    if kind == "Basic":
        return speed, float(numbers["rotorConstant"]) * basic
    if kind == "Bessa":
        low, high = float(numbers["deltaL"]), float(numbers["deltaR"])
        astern = float(numbers["rotorConstantL"]) * (basic - low)
        ahead = float(numbers["rotorConstantR"]) * (basic - high)
        return speed, np.where(basic <= low, astern, np.where(basic >= high, ahead, 0.0))
    table = [np.array(numbers[n].split(), float) for n in ("inputValues", "outputValues")]
    return speed, np.interp(speed, *table)


def of_stonefish(text: ElementTree.Element, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stonefish: Thruster::setSetpoint, Thruster::Update, ActuatorDynamics.h."""
    actuator = text.find("actuator")
    largest = float(actuator.find("specs").get("max_setpoint"))
    assert actuator.find("specs").get("normalized_setpoint") == "true"
    driven = np.clip(command, -1.0, 1.0) * largest
    dynamics = actuator.find("rotor_dynamics")
    numbers = {e.tag: float(e.get("value")) for e in dynamics}
    numbers["tau"] = numbers.pop("time_constant", 0.0)
    speed = rotor(dynamics.get("type"), numbers, driven)
    assert np.max(np.abs(speed)) <= 2 * largest  # it holds the speed within this
    thrust = actuator.find("thrust_model")
    if thrust.get("type") == "deadband":
        basic, coefficients = speed * np.abs(speed), thrust.find("thrust_coeff")
        side = np.where(basic < 0, coefficients.get("reverse"), coefficients.get("forward"))
        return speed, side.astype(float) * basic
    tables = [np.array(thrust.find(n).get("value").split(), float) for n in ("input", "output")]
    return speed, np.interp(speed, *tables)


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["uuv", "stonefish"])
@pytest.mark.parametrize("name", SEEN)
def test_a_simulator_moves_as_the_model_does(name, target):
    model = SEEN[name]
    exported = export_model(model, target, limits=LIMITS)
    assert not [note for note in exported.notes if "left out" in note]
    wanted, (_, command) = wanted_of(model), commands()
    if target == "uuv":
        speed, thrust = of_uuv(xml_of(exported), command)
    else:
        largest = 1.2 if name == "clamped" else 2.0
        speed, thrust = of_stonefish(xml_of(exported), command / largest)
    # forward Euler, of the first order in their step
    assert np.max(np.abs(speed - wanted["speed"])) < 1e-3 * np.ptp(wanted["speed"])
    assert np.max(np.abs(thrust - wanted["thrust"])) < 2e-3 * np.ptp(wanted["thrust"])


@pytest.mark.thorough
def test_gz_gives_the_force_of_a_speed():
    model = dft.Thruster(ct=0.023)
    plugin = xml_of(export_model(model, "gz", limits=LIMITS)).find("plugin")
    names = ("thrust_coefficient", "fluid_density", "propeller_diameter")
    coefficient, density, diameter = (float(plugin.find(n).text) for n in names)
    wanted = wanted_of(model)
    limit = float(plugin.find("max_thrust_cmd").text)
    speed = np.clip(wanted["speed"], float(plugin.find("min_thrust_cmd").text), limit)
    # Thruster.cc, AngularVelToThrust
    thrust = coefficient * diameter**4 * np.abs(speed) * speed * density
    assert thrust == pytest.approx(wanted["thrust"], rel=1e-12)
    assert plugin.find("use_angvel_cmd").text == "true"
    plugin = xml_of(export_model(model, "gz", limits=(-1.0, 2.0))).find("plugin")
    low, high = (float(plugin.find(f"{end}_thrust_cmd").text) for end in ("min", "max"))
    assert (low, high) == pytest.approx((-np.sqrt(42.0 / 0.037), np.sqrt(84.0 / 0.037)))


def test_what_has_no_place_is_told_in_the_notes_and_in_the_file():
    effects = ("command_deadband", "actuator_lag", "coulomb_friction", "reverse_drive_asymmetry")
    model = dft.Thruster() + effects + ("command_delay", "thrust_sensor_lag")
    for target, name in (("gz", "gz-sim"), ("uuv", "uuv_simulator"), ("stonefish", "Stonefish")):
        exported = export_model(model, target, limits=LIMITS)
        for effect in model.effects:
            told = [note for note in exported.notes if f"'{effect.name}'" in note]
            assert len(told) == (effect.name != "thrust_sensor_lag")
            assert f"'{effect.name}'" in exported.text or not told
            if effect.port == "command":
                assert "before you send it" in told[0]
        assert f"{name} has no place" in exported.notes[-2 if target == "uuv" else -1]
        xml_of(exported)


def test_a_limit_before_a_dead_band_is_not_that_of_the_simulator():
    first = dft.Thruster() + CommandSaturation(limit=1.2) + "command_deadband"
    notes = export_model(first, "uuv", limits=LIMITS).notes
    assert any("'command_saturation'" in note for note in notes)
    last = dft.Thruster() + "command_deadband" + CommandSaturation(limit=1.2)
    exported = export_model(last, "uuv", limits=LIMITS)
    assert not any("'command_saturation'" in note for note in exported.notes)
    assert "<clampMax>1.2</clampMax>" in exported.text


def test_the_clock_of_uuv_simulator_is_told():
    assert "prevTime = _t;" in export_model(SEEN["yoerger"], "uuv", limits=LIMITS).notes[-1]
    assert not export_model(SEEN["loop"], "uuv", limits=LIMITS).notes


def test_one_coefficient_of_gz_is_told():
    notes = export_model(SEEN["two constants"], "gz", limits=LIMITS).notes
    assert any("0.700 times" in note for note in notes)
    notes = export_model(SEEN["tabulated"], "gz", limits=LIMITS).notes
    assert any("not proportional" in note for note in notes)


def test_uneven_limits_and_a_curve_are_told():
    exported = export_model(dft.SpeedLoopThruster(exponent=0.8), "stonefish", limits=(-0.5, 1.0))
    assert any("|command|^0.8" in note for note in exported.notes)
    assert any("as far astern as ahead" in note for note in exported.notes)


@pytest.mark.parametrize("target", ["gz", "uuv", "stonefish"])
def test_what_is_no_thruster_is_refused(target):
    with pytest.raises(dft.InputError, match="expected a thruster"):
        export_model(dft.AxisVehicle(), target, limits=LIMITS)
    with pytest.raises(dft.InputError, match="no place for the model"):
        export_model(dft.Thruster(), target, ranges={"speed": (-1.0, 1.0)})
