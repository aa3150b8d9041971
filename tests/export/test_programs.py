"""Exported programs give what `simulate` gives."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exported_programs import (
    SIZES,
    compiled,
    exciting_log,
    needs_compiler,
    run_c,
    run_python,
    worst,
)

import diffthrust as dft
from diffthrust.effects import EFFECTS, Formula
from diffthrust.export import export_model
from diffthrust.models import Relaxing

CLOSE = 1e-12
"""Of a signal's range: rounding, and no more."""
TWIN = dft.Vessel(
    drive="twin", m11=20.0, m22=30.0, i33=4.0, d11=12.0, d22=40.0, d33=6.0, lever_arm=0.3
)
MODELS = {
    "thruster": dft.Thruster(),
    "motor": dft.DCMotorThruster(),
    "loop": dft.SpeedLoopThruster(exponent=0.8),
    "axis": dft.AxisVehicle(),
    "sensor": dft.LinearSensor(),
    "propeller": dft.Vessel(),
    "twin": TWIN,
}
GROUPS = (
    ("thruster", ("command_offset", "command_deadband", "command_saturation", "actuator_lag",
                  "coulomb_friction", "thrust_sensor_lag", "speed_sensor_offset", "cavitation")),
    ("thruster", ("command_rate_limit", "command_delay", "axial_flow", "static_friction",
                  "thrust_sensor_delay", "thrust_sensor_scale", "reverse_thrust_asymmetry")),
    ("thruster", ("supply_voltage_sag", "inflow_load_relief", "inflow_thrust_loss",
                  "reverse_load_asymmetry", "reverse_drive_asymmetry", "linear_damping",
                  "thrust_degradation", "thrust_sensor_offset", "speed_sensor_scale")),
    ("motor", ("command_deadband", "reverse_drive_asymmetry", "cavitation")),
    ("thruster", ("thrust_exponent", "load_exponent")),
    ("loop", ("command_deadband", "slew_limit", "command_rate_limit", "thrust_sensor_lag")),
    ("propeller", ("propeller_lag", "rudder_lag", "rudder_offset", "rudder_inflow", "water_current",
                   "propeller_walk", "propeller_inflow", "reverse_propeller_asymmetry")),
    ("propeller", ("rudder_rate_limit", "sway_yaw_coupling", "quadratic_sway_drag", "wind")),
    ("twin", ("differential_gain", "quadratic_surge_drag", "quadratic_yaw_drag", "wind")),
    ("axis", ("buoyancy",)),
    ("twin", ("swapped_thrusters", "force_exponent", "water_current")),
)  # fmt: skip


def check_both(
    model, folder, *, even=True, substeps=1, inputs=None, start=None, hold="zero", **log
):
    """Compare both languages with `simulate`; the state is given by name."""
    needs = [name for effect in model.effects for name in effect.needs]
    names = inputs or list(dict.fromkeys([*model.inputs, *needs]))
    ranges = dict.fromkeys(names, (-1.0, 1.0))
    recorded = replace(exciting_log(names, even=even, **log), hold=hold)
    wanted = dft.simulate(model, recorded, initial=start, substeps=substeps)
    states = [name for name in model.all_states if name not in names]
    given = [start.get(name) for name in states] if start else None
    texts = {
        to: export_model(
            model, to, folder / f"made{suffix}", ranges=ranges, hold=hold, substeps=substeps
        ).text
        for to, suffix in (("python", ".py"), ("c", ".h"))
    }
    # a program takes its inputs in the order that it tells
    order = [name for name in (*model.inputs, *model.optional_inputs, *names) if name in names]
    ordered = dft.Log(recorded.time, {name: recorded.inputs[name] for name in order}, {})
    found = run_python(texts["python"], "Made", ordered, given)
    assert worst(found, wanted, model.outputs) < CLOSE
    found = run_c(texts["c"], "made", ordered, list(model.outputs), folder, given)
    assert worst(found, wanted, model.outputs) < CLOSE


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("even", [True, False], ids=["even", "uneven"])
def test_each_model_alone(name, even, tmp_path):
    check_both(MODELS[name], tmp_path, even=even, substeps=1 if even else 2)


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize(("name", "effects"), GROUPS, ids=lambda v: v if isinstance(v, str) else "")
def test_the_effects_together(name, effects, tmp_path):
    check_both(MODELS[name] + list(effects), tmp_path, even=False)


def test_every_effect_that_acts_on_these_models_is_among_them():
    tried = {effect for _, effects in GROUPS for effect in effects}
    places = {
        name
        for model in MODELS.values()
        for name in (*model.ports, *model.inputs, *model.outputs, *model.optional_inputs)
    }
    assert tried == {name for name, e in EFFECTS.items() if set(e.ports) <= places}


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("name", MODELS)
def test_each_effect_alone(name, effect, tmp_path):
    try:
        model = MODELS[name] + effect
    except dft.InputError:
        pytest.skip("the model has no such place")
    needs = [name for needing in model.effects for name in needing.needs]
    log = exciting_log([*model.inputs, *needs])
    coarse, fine = (dft.simulate(model, log, substeps=steps) for steps in (1, 2))
    if not worst(coarse, fine, model.outputs) < 0.1:  # rounding is all that is left of such a run
        pytest.skip("the effect, at its first guess, is too strong for this model and step")
    for even in (True, False):
        check_both(model, tmp_path, even=even)


@needs_compiler
def test_effects_at_their_null_do_nothing_there_either(tmp_path):
    nulls = [cls().at_null() for cls in EFFECTS.values() if cls.port in ("command", "drive")]
    model = dft.Thruster() + [effect for effect in nulls if not effect.needs]
    check_both(model, tmp_path)


@pytest.mark.thorough
@needs_compiler
def test_a_speed_that_is_given_and_states_that_are(tmp_path):
    check_both(dft.Thruster() + "cavitation", tmp_path, inputs=["speed"])
    check_both(dft.Thruster() + "actuator_lag", tmp_path, start={"speed": 12.0})
    check_both(dft.DCMotorThruster(), tmp_path, start={"current": -0.4}, even=False)


@pytest.mark.thorough
@needs_compiler
def test_inputs_that_run_straight_between_samples(tmp_path):
    check_both(dft.Thruster(), tmp_path, hold="linear", even=False, substeps=2)
    model = dft.DCMotorThruster() + "command_delay"
    check_both(model, tmp_path, hold="linear", substeps=2)
    mixed = {"propeller_speed": "zero", "rudder_angle": "linear"}
    check_both(dft.Vessel(), tmp_path, hold=mixed)


@pytest.mark.thorough
@needs_compiler
def test_measured_wind(tmp_path):
    inputs = ["propeller_speed", "rudder_angle", "wind_speed", "wind_direction"]
    check_both(dft.Vessel() + "wind", tmp_path, inputs=inputs)


@pytest.mark.thorough
@needs_compiler
def test_a_lag_far_below_and_far_above_the_step(tmp_path):
    for constant in (1e-6, 1e-3, 0.05, 3.0):
        lag = EFFECTS["actuator_lag"](time_constant=constant)
        check_both(dft.Thruster() + lag, tmp_path, duration=10.0)


class Odd(dft.Effect):
    """Everything that a user might write into an effect."""

    name = "odd"
    port = "shaft"
    switch: float = dft.parameter(0.7, "rad/s", null=0.0)  # a word of C
    exp: float = dft.parameter(0.2, null=0.0)  # a function of C and of Python's math

    def __call__(self, value, s):
        """A bit of each operation."""
        w = s.speed
        fast = jnp.logical_and(jnp.abs(w) > self.switch, jnp.logical_not(w < -20.0))
        fast = jnp.logical_or(fast, jnp.equal(w, 0.0))
        gone = jnp.where(fast, jnp.log1p(jnp.abs(w)), jnp.abs(w) ** 3 / (1.0 + w**4)) ** 0.5
        wave = jnp.sin(w) * jnp.tan(0.3 * jnp.cos(w)) + jnp.arctan2(w, 1.0 + w * w)
        rest = jnp.mod(w, 1.3) - jnp.floor(0.5 * w) + jnp.sign(w) * jax.nn.sigmoid(-w)
        soft = jnp.tanh(w / 7.0) + jnp.minimum(jnp.exp(-jnp.abs(w)), 0.5) - jnp.clip(w, -3.0, 1.0)
        safe = (
            jnp.where(w > 1.0, 1.0 / jnp.where(w > 1.0, w, 1.0), 0.0)
            + jnp.where(w > 30.0, w, 9.0) ** -2
        )
        return value - self.exp * (gone + wave + rest + soft + safe) - jnp.float_power(0.1, 2)


class Class(dft.Model):
    """A model of a user, with an inner state that relaxes and names that are taken."""

    name = "class"
    inputs = {"u": "V"}
    states = {"x": "", "lambda": ""}
    outputs = {"x": "", "register": ""}
    ports = {"m": "of nothing"}
    double: float = dft.parameter(3.0, "1/s")

    def equations(self, s, port):
        """Two states."""
        rate = port("m", self.double * (s.u - s.x))
        inner = 40.0 * (s.x - s["lambda"])
        return {"x": rate, "lambda": Relaxing(inner, 40.0)}, {
            "x": s.x,
            "register": s["lambda"] + s.u,
        }


@needs_compiler
@pytest.mark.parametrize(
    "law",
    [
        "-a * speed * abs(speed)**p - b * sign(speed) * sqrt(abs(command)) * cos(time)",
        "b * (log(abs(speed)) / (1 + speed**2) - exp(-abs(speed) / 9) * tanh(a * command) * p)",
        "where(abs(speed) > 3, min(value, 900), max(value, -900)) + a * b * (0 < speed <= p + 40)",
    ],
)
def test_formulas(law, tmp_path):
    values = {
        "a": dft.parameter(0.02, null=0.0),
        "p": {"value": 0.6},
        "b": {"value": 3.0, "null": 0},
    }
    check_both(dft.Thruster() + Formula("shaft", law, **values), tmp_path)


@needs_compiler
@pytest.mark.parametrize("signal", ["speed", "lag(command, T)"])
def test_curves(signal, tmp_path):
    shape = np.random.default_rng(6).normal(0.0, 5.0, 7)
    lagged = {"T": {"unit": "s", "value": 0.4}} if "T" in signal else {}
    curve = dft.effects.Curve(
        "load", signal, -9.0, 30.0, pieces=4, shape=shape, held=["slope"], **lagged
    )
    check_both(dft.Thruster() + curve, tmp_path)


@needs_compiler
def test_effects_and_models_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setitem(SIZES, "u", 2.0)
    check_both(dft.Thruster() + Odd(), tmp_path)
    model = Class()
    wanted = dft.simulate(model, exciting_log(["u"]))
    text = export_model(model, "python", tmp_path / "own.py").text
    found = run_python(text, "Own", exciting_log(["u"]))
    assert worst(found, wanted, model.outputs) < CLOSE
    text = export_model(model, "c", tmp_path / "own.h").text
    (tmp_path / "own.c").write_text('#include "own.h"\n')
    compiled(tmp_path / "own.c", tmp_path / "own.o", "-c")
    assert "register_; /* [1] */" in text


def test_numbers_of_numpy_are_taken_as_well():
    model = dft.Thruster() + "command_deadband" + "actuator_lag"
    log = exciting_log(["command"], duration=2.0)
    scope: dict = {}
    exec(export_model(model, "python").text, scope)
    program = scope["Thruster"]()
    program.reset(log.inputs["command"][0])
    out = program.step(np.float64(0.04), log.inputs["command"][1])
    assert out["speed"] == pytest.approx(dft.simulate(model, log)["speed"][1], rel=1e-12)


def test_an_operation_without_translation_is_named():
    class Sorted(dft.Effect):
        name = "sorted"
        port = "shaft"
        level: float = dft.parameter(0.1, "", null=0.0)

        def __call__(self, value, s):
            return value + jax.lax.cond(True, lambda v: v, lambda v: -v, value)

    class Tabulated(Sorted):
        name = "tabulated"

        def __call__(self, value, s):
            return jnp.interp(value, jnp.array([0.0, 1.0]), jnp.array([0.0, 2.0]))

    with pytest.raises(dft.InputError, match="operation 'cond' has no translation"):
        export_model(dft.Thruster() + Sorted(), "python")
    with pytest.raises(dft.InputError, match="a table of 2 numbers has no translation"):
        export_model(dft.Thruster() + Tabulated(), "c")


@needs_compiler
def test_a_header_is_c_plus_plus_too(tmp_path):
    other = shutil.which("c++")
    if other is None:
        pytest.skip("no C++ compiler on this machine")
    model = dft.Thruster() + "actuator_lag" + "command_delay" + "thrust_sensor_lag"
    export_model(model, "c", tmp_path / "left.h")
    export_model(model, "c", tmp_path / "right.h")  # two of them in one program
    (tmp_path / "both.cpp").write_text('#include "left.h"\n#include "right.h"\n')
    flags = ("-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror")
    compiled(tmp_path / "both.cpp", tmp_path / "both.o", "-c", compiler=other, flags=flags)


def test_the_module_imports_nothing_but_math(tmp_path):
    path = tmp_path / "jason.py"
    model = dft.Thruster() + "actuator_lag" + "axial_flow" + "command_delay"
    export_model(model, "python", path)
    code = (
        "import sys; before = set(sys.modules); import jason; m = jason.Jason(); m.reset(1.0); "
        "m.step(0.1, 1.0); print(m.step(0.1, 1.0)['speed'] > 0, *sorted(set(sys.modules) - before))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() in (["True", "jason"], ["True", "jason", "math"])


@needs_compiler
def test_a_delay_longer_than_its_memory_is_told_and_cut(tmp_path):
    model = dft.Thruster() + EFFECTS["command_delay"](delay=2.0)
    exported = export_model(model, "c", tmp_path / "late.h")
    assert "MADE_HISTORY" not in exported.text
    assert any("LATE_HISTORY" in note for note in exported.notes)
    roomy = exported.text.replace("#define LATE_HISTORY 256", "#define LATE_HISTORY 2560")
    log = exciting_log(["command"], step=0.005, duration=10.0)
    wanted = dft.simulate(model, log)
    found = run_c(roomy, "late", log, list(model.outputs), tmp_path)
    assert worst(found, wanted, model.outputs) < CLOSE
    (tmp_path / "cut").mkdir()
    found = run_c(exported.text, "late", log, list(model.outputs), tmp_path / "cut")
    assert np.all(np.isfinite(found["speed"]))
    assert worst(found, wanted, model.outputs) > 0.1
