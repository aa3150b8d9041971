"""Which effects a diagnosis tries, and why it cannot try others."""

from __future__ import annotations

import math
import tomllib
from functools import cache
from importlib.metadata import EntryPoint

import jax.numpy as jnp
import numpy as np
import pytest
from components import effect_module
from one_truth import contradictions
from reference import inputs, thruster
from reference.hidden import THRUSTER, Effect
from steps import bind, candidates_of

import diffthrust as dft
from diffthrust import InputError
from diffthrust.effects import Formula


def log(*, inputs=(), measured=("speed", "thrust")):
    time = np.arange(50) * 0.05
    return dft.Log(
        time=time,
        inputs={n: np.sin(time) for n in ("command", *inputs)},
        measured={n: np.cos(time) for n in measured},
    )


def sorted_out(wanted=None, logs=None, model=None):
    """The effects to try in a model on some logs, and why the others cannot be tried."""
    model = model or dft.Thruster()
    return candidates_of(model, bind(model, logs or [log()]), wanted)


class Ripple(dft.Effect):
    """A user's own effect."""

    name = "ripple"
    port = "shaft"
    size: float = dft.parameter(1.0, "rad/s^2", null=0.0, probes=(0.1, 1.0))

    def __call__(self, value, s):
        return value - self.size * s.speed


@pytest.fixture
def installed(monkeypatch):
    """Packages that offer effects by entry points."""

    def install(*points):
        monkeypatch.setattr(effect_module, "entry_points", lambda group: points)
        effect_module.catalogue.cache_clear()

    yield install
    monkeypatch.undo()
    effect_module.catalogue.cache_clear()


def test_the_whole_catalogue_of_the_model_is_tried():
    tried, untestable = sorted_out(logs=[log(inputs=("inflow", "supply_voltage"))])
    assert len(tried) == 26
    assert not untestable


def test_what_a_log_lacks_is_told_by_channel():
    tried, untestable = sorted_out(logs=[log(measured=("speed",))])
    assert "inflow" in untestable["inflow_thrust_loss"]
    assert "supply_voltage" in untestable["supply_voltage_sag"]
    assert "thrust" in untestable["thrust_sensor_lag"]
    assert not {e.name for e in tried} & set(untestable)


def test_a_channel_that_only_some_logs_have_does_not_count():
    _, untestable = sorted_out(logs=[log(inputs=("inflow",)), log()])
    assert "inflow" in untestable["inflow_load_relief"]


def test_a_channel_that_the_model_does_not_take_is_no_ground_for_a_trial():
    """A diagnosis of a DC motor on a log with its battery ended in a signal that is not there."""
    model = dft.DCMotorThruster()
    tried, untestable = sorted_out(logs=[log(inputs=("supply_voltage",))], model=model)
    assert "supply_voltage_sag" not in {effect.name for effect in tried}
    assert untestable["supply_voltage_sag"] == (
        "reads the channel 'supply_voltage', which the model dc_motor_thruster does not take"
    )
    model = dft.Thruster()
    tried, _ = sorted_out(logs=[log(inputs=("supply_voltage",))], model=model)
    assert "supply_voltage_sag" in {effect.name for effect in tried}


def test_effects_that_the_model_has_and_those_of_other_models_are_left_out():
    model = dft.Thruster() + dft.effects.LinearDamping()
    tried, untestable = sorted_out(model=model)
    names = {e.name for e in tried} | set(untestable)
    assert "linear_damping" not in names
    assert "quadratic_surge_drag" not in names


def test_wanted_effects_by_name_class_and_object():
    wanted = ["command_delay", Ripple, dft.effects.CommandOffset(offset=0.1)]
    tried, _ = sorted_out(wanted)
    assert [e.name for e in tried] == ["command_delay", "ripple", "command_offset"]


def test_a_single_candidate_and_one_given_twice_count_once():
    for wanted in ("command_delay", dft.effects.CommandDelay, ["command_delay"] * 2):
        tried, _ = sorted_out(wanted)
        assert [e.name for e in tried] == ["command_delay"]


def test_what_is_no_effect_is_refused():
    with pytest.raises(dft.InputError, match="found 3"):
        sorted_out([3])


class Unanchored(dft.Effect):
    """A damping that does not say at which rate it is not there."""

    name = "unanchored"
    port = "shaft"
    rate: float = dft.parameter(0.3, "1/s", bounds=(0, None))

    def __call__(self, value, s):
        return value - self.rate * s.speed


def test_an_effect_that_names_no_null_is_no_candidate(installed):
    with pytest.raises(dft.InputError, match=r"'unanchored' has no parameter with a null"):
        sorted_out([Unanchored])
    installed(EntryPoint("unanchored", f"{__name__}:Unanchored", "diffthrust.effects"))
    tried, untestable = sorted_out()
    assert "null" in untestable["unanchored"]
    assert "unanchored" not in {e.name for e in tried}


class SpeedSensorMemory(dft.Effect):
    """The speed sensor shows what was."""

    name = "speed_sensor_memory"
    port = "speed"
    memory = True
    share: float = dft.parameter(0.1, null=0.0)

    def __call__(self, value, s):
        return value - self.share * jnp.diff(value, prepend=value[:1])


def test_a_memory_on_a_state_that_corrects_the_trials_cannot_be_tested():
    _, untestable = sorted_out([SpeedSensorMemory])
    assert "reads the past of 'speed'" in untestable["speed_sensor_memory"]


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(dft.InputError, match="command_delay"):
        sorted_out(["comand_delay"])


def test_a_wanted_effect_for_another_model_is_refused():
    with pytest.raises(dft.InputError, match="quadratic_surge_drag"):
        sorted_out(["quadratic_surge_drag"])


def test_effects_of_installed_packages_are_tried_too(installed):
    installed(EntryPoint("ripple", f"{__name__}:Ripple", "diffthrust.effects"))
    tried, _ = sorted_out()
    assert "ripple" in {e.name for e in tried}


def test_an_entry_point_that_is_no_effect_or_takes_a_name_is_refused(installed):
    installed(EntryPoint("wrong", "math:pi", "diffthrust.effects"))
    with pytest.raises(dft.InputError, match=r"(?s)'wrong'.*no effect"):
        sorted_out()
    installed(EntryPoint("again", "diffthrust.effects:CommandDelay", "diffthrust.effects"))
    with pytest.raises(dft.InputError, match=r"(?s)'command_delay'.*taken"):
        sorted_out()


def test_what_would_drive_a_prescribed_state_cannot_be_tested():
    time = np.arange(50) * 0.05
    speed = {"speed": 10.0 * np.sin(time), "command": np.sin(time)}
    given = dft.Log(time=time, inputs=speed, measured={"thrust": np.cos(time)})
    tried, untestable = sorted_out(logs=[given])
    assert {"axial_flow", "thrust_sensor_lag"} <= {effect.name for effect in tried}
    for name in ("linear_damping", "command_deadband", "actuator_lag"):
        assert "nothing that is measured depends on it" in untestable[name]
        assert "prescribe 'speed'" in untestable[name]


def test_what_no_channel_shows_cannot_be_tested():
    _, untestable = sorted_out(logs=[log(measured=("speed",))])
    assert "nothing that is measured depends on it" in untestable["cavitation"]


def test_all_stands_for_the_catalogue_beside_effects_of_ones_own():
    logs = [log(measured=("speed",))]
    every, lacking = sorted_out(logs=logs)
    more, still = sorted_out(["all", Ripple], logs=logs)
    assert [e.name for e in more] == [*(e.name for e in every), "ripple"]
    assert still == lacking
    assert [e.name for e in sorted_out("all", logs=logs)[0]] == [e.name for e in every]
    with pytest.raises(dft.InputError, match=r"my_effect\.py:MyEffect"):
        sorted_out(["all", "ripple"], logs=logs)
    mine = dft.effects.CommandDeadband(half_width=1.0)
    both = sorted_out([mine, "command_deadband", "all"], logs=logs)[0]
    assert [e.half_width for e in both if e.name == "command_deadband"] == [1.0]


def test_an_effect_that_is_called_like_a_parameter_is_refused_or_passed_over(monkeypatch):
    class Arm(dft.Effect):
        name = "lever_arm"
        port = "force"
        size: float = dft.parameter(0.0, null=0.0)

        def __call__(self, value, s):
            return value + self.size

    log = dft.Log(
        time=0.1 * np.arange(50),
        inputs={"propeller_speed": np.ones(50), "rudder_angle": np.zeros(50)},
        measured={"surge": np.ones(50)},
    )
    with pytest.raises(dft.InputError, match=r"'lever_arm' is called like a parameter"):
        sorted_out([Arm()], logs=[log], model=dft.Vessel())
    # the constant itself
    assert sorted_out(["lever_arm"], logs=[log], model=dft.Vessel()) == ([], {})
    monkeypatch.setattr(  # one of an installed package stops nothing
        "diffthrust.diagnosis._candidates.catalogue", lambda: {"lever_arm": Arm}
    )
    told = {"lever_arm": "it is called like a parameter of the model"}
    assert sorted_out(logs=[log], model=dft.Vessel()) == ([], told)
    with pytest.raises(dft.InputError, match="the nearest is 'lever_arm'"):
        sorted_out(["lever_arn"], logs=[log], model=dft.Vessel())


LEVEL, WIDTH = 8.0, 9.0
HUMP = "-a * speed / width * exp(-(speed / width)**2)"


def hump(acceleration, s, *, level=0.0, width=WIDTH):
    """What is hidden, and is in no catalogue: a resistance that fades where the shaft is fast."""
    return acceleration - level * s.speed / width * math.exp(-((s.speed / width) ** 2))


def asked(name="hump", text=HUMP, **more):
    parameters = {"a": "rad/s^2", "width": {"unit": "rad/s", "value": 6.0, "bounds": (0, None)}}
    return Formula("shaft", text, name=name, **{**parameters, **more})


@cache
def logs():
    """Two short logs, the second unseen, from the independent simulator."""
    out = []
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        time = inputs.grid(15.0, 0.05)
        command = inputs.staircase(time, list(rng.uniform(-1.5, 1.5, 20)), 0.75)
        table = {**THRUSTER, "hump": Effect("shaft", hump)}
        made = thruster.simulate(time, command, method="rk4", catalogue=table, hump=LEVEL)
        noise = {"speed": 0.1, "thrust": 0.1}
        seen = {n: made.truth[n] + rng.normal(0, level, time.size) for n, level in noise.items()}
        out.append(dft.Log(time, {"command": command}, seen))
    return out


@pytest.mark.thorough
def test_a_hypothesis_that_is_right_is_found_and_can_be_copied(tmp_path):
    train, unseen = logs()
    wrong = Formula("load", "value * (1 + b * cos(time))", name="wave", b="")
    diag = dft.diagnose(
        dft.Thruster(),
        train,
        holdout=unseen,
        candidates=[asked(), wrong, "linear_damping"],
        experiment=False,
    )
    assert diag.added == ("hump",)
    assert not contradictions(diag)
    assert diag.after.errors.nrmse < 0.5 * diag.before.errors.nrmse
    for name, value in (("hump.a", LEVEL), ("hump.width", WIDTH)):
        found = diag.fit.parameters[name]
        assert abs(found.value - value) < 4 * found.std_error  # 1 in 8000 each
    diag.save(tmp_path / "diag.html")
    assert HUMP in (tmp_path / "diag.html").read_text()  # what the effect does, in the page
    told = diag.report()
    scope = {"dft": dft}
    exec(next(row for row in told.splitlines() if row.startswith("model = ")), scope)
    line = next(row for row in told.splitlines() if row.startswith("effects = "))
    copied = Formula(**{
        {"formula": "expression"}.get(key, key): value
        for key, value in tomllib.loads(line)["effects"][0].items()
    })  # fmt: skip
    for effect in (scope["model"].effects[0], copied):
        assert effect.structure == asked().structure
        assert effect.declared == asked().declared
    diag.save(tmp_path / "diag.json")
    again = dft.load(tmp_path / "diag.json")
    assert again.report() == told
    assert dft.compare(again.fit, unseen).errors == dft.compare(diag.fit, unseen).errors


def test_it_stands_beside_the_catalogue_and_is_tried_for_what_it_needs():
    model, (train, unseen) = dft.Thruster(), logs()
    sag = Formula("drive", "value * (1 + k * (supply_voltage - 24))", name="sag", k="1/V")
    tried, untestable = sorted_out(["all", asked(), sag], logs=(train, unseen), model=model)
    assert [effect.name for effect in tried][-1] == "hump"
    assert len(tried) > 10
    assert untestable["sag"] == "needs the channel 'supply_voltage', which no log has"
    with pytest.raises(InputError, match="'sped' is no parameter"):
        sorted_out(asked(text=f"{HUMP} * sped"), logs=(train,), model=model)
    assert asked().name not in [
        e.name for e in sorted_out(asked(), logs=(train,), model=model + asked())[0]
    ]


def test_an_effect_that_reads_what_a_static_thruster_lacks_is_not_tried():
    """A curve of the command has the port of a propeller, but no speed of a shaft."""
    law = dft.actuators.StaticThruster()
    boat = dft.Craft(dft.bodies.Axis(), a=law.at((-1, 0, 0)), b=law.at((1, 0, 0)), share=["ab"])
    time = 0.1 * np.arange(40)
    inputs = dict.fromkeys(boat.inputs, np.sin(time))
    log = dft.Log(time, inputs, {"velocity": 0.1 * np.sin(time)}, units=dict(boat.inputs))
    tried, untestable = sorted_out(logs=[log], model=boat)
    for name in ("cavitation", "a.cavitation"):
        assert "reads the signal speed" in untestable[name]
    assert {"b.command_deadband", "thrust_degradation"} <= {effect.name for effect in tried}
