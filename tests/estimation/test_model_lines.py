"""The lines of a report that are to be copied make the same model: it errs as the one it is of."""

from __future__ import annotations

import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
import short_logs as short
from lines_to_copy import effects_line, python_lines, spec_lines

import diffthrust as dft
from diffthrust.effects import CommandDeadband, CoulombFriction, Curve, Formula


class Tanks(dft.Model):
    """Two tanks, one above the other; a user's own class."""

    name = "own_tanks"
    inputs = {"pump": "V"}
    states = {"upper": "cm", "lower": "cm"}
    outputs = {"lower": "cm"}
    ports = {"inflow": "into the upper tank"}
    k1: float = dft.parameter(0.05, "cm/(V s)", bounds=(0, 1))
    k2: float = dft.parameter(0.05, "cm^0.5/s", bounds=(0, 1))

    def equations(self, s, port):
        upper, lower = (jnp.sqrt(jnp.maximum(x, 1e-3)) for x in (s.upper, s.lower))
        rates = {
            "upper": port("inflow", self.k1 * s.pump) - self.k2 * upper,
            "lower": self.k2 * (upper - lower),
        }
        return rates, {"lower": s.lower}


class Shaped(dft.LinearSensor):
    """A class with arguments of its own, of which it keeps the second only."""

    name = "shaped"

    def __init__(self, table=None, slow=False, **values):
        self._set(slow=slow)
        super().__init__(**values)


class Leak(dft.Effect):
    """An effect of the user's own, with a parameter."""

    name = "own_leak"
    port = "inflow"
    rate: float = dft.parameter(0.01, "cm/s", null=0.0)

    def __call__(self, value, s):
        return value - self.rate


OWN = {"dft": dft, "Tanks": Tanks, "Shaped": Shaped, "Leak": Leak}


def _series(seed, count=200):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, count // 20), 20), 0.1 * rng.standard_normal((3, count))


def _boat_log():
    left, noise = _series(1)
    right, _ = _series(2)
    names = ("surge", "sway", "yaw_rate")
    return dft.Log(
        time=0.1 * np.arange(200),
        inputs={"left_force": 20 * left, "right_force": 20 * right},
        measured=dict(zip(names, noise, strict=True)),
    )


def _tank_log():
    volts, noise = _series(3)
    return dft.Log(
        time=2.0 * np.arange(200), inputs={"pump": 3 + volts}, measured={"lower": 3 + noise[0]}
    )


DRAG = Formula(
    "shaft", "value - a * abs(speed)**p", name="drag", a="rad/s^2", p={"unit": "", "value": 0.5}
)
CURVE = Curve("load", "speed", -10.0, 10.0, name="law", shape=(0.3, 0.2, 0.1), held=["bend2"])
CASES = {
    "held and bounded": (
        dft.Thruster(alpha=0.0345678912).fix("ct").replace(beta={"bounds": (1.0, None)}),
        short.made_log,
    ),
    "form of an effect": (
        dft.Thruster() + CommandDeadband(half_width=0.123, restored=1.0) + "actuator_lag",
        short.made_log,
    ),
    "vessel": (
        dft.Vessel(drive="twin", lever_arm=0.285).replace(
            i33={"value": 1.7, "fixed": True}, m11={"value": 21.3, "bounds": (5.0, 80.0)}
        )
        + "wind",
        _boat_log,
    ),
    "own classes": (Tanks(k1=0.041).fix("k2") + Leak(rate=0.0123), _tank_log),
    "learned laws": (
        (dft.Thruster() + DRAG + CURVE).replace({"drag.p": 0.77, "law.bend1": 0.4}),
        short.made_log,
    ),
    "prior": (
        dft.Thruster().replace(ct={"prior": dft.models.Normal(0.02, 0.001), "value": 0.021}),
        short.made_log,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_lines_give_the_same_errors(case):
    model, made = CASES[case]
    log = made(0) if made is short.made_log else made()
    if case == "vessel":
        model = model - "wind"  # which the log does not have
    scope = dict(OWN)
    exec(python_lines(model), scope)
    copied = scope["model"]
    expected, errors = (dft.compare(m, log).errors.channels for m in (model, copied))
    for channel, error in expected.items():
        assert errors[channel].rmse == pytest.approx(error.rmse, rel=1e-6)
    for name, parameter in model.parameters.items():
        assert copied.parameters[name].fixed is parameter.fixed
        assert copied.parameters[name].bounds == parameter.bounds
        assert copied.parameters[name].prior == parameter.prior
    assert copied.structure == model.structure


@pytest.mark.parametrize("case", CASES)
def test_a_spec_gives_the_same_numbers(case):
    model, _ = CASES[case]
    table = tomllib.loads(spec_lines(model))
    assert len(table["effects"]) == len(model.effects)
    plain = [word if isinstance(word, str) else "" for word in table["effects"]]
    assert [w.rpartition(":")[2] for w in plain] == [
        {"own_leak": "Leak", "drag": "", "law": ""}.get(e.name, e.name) for e in model.effects
    ]
    for name, entry in table["parameters"].items():
        parameter = model.parameters[name]
        fields = entry if isinstance(entry, dict) else {"value": entry}
        if "value" in fields:
            assert fields["value"] == pytest.approx(parameter.value, rel=1e-7)
        assert fields.get("fixed", parameter.fixed) is parameter.fixed


@pytest.mark.parametrize(
    "model",
    [
        dft.Thruster(),
        dft.Thruster(command="effort") + "command_deadband" + "actuator_lag",
        dft.Vessel(drive="twin") + "wind",
        dft.Vessel(drive="twin", command="effort"),
        dft.LinearSensor(),
        dft.DCMotorThruster() + CoulombFriction(),
    ],
    ids=str,
)
def test_only_what_was_given_is_written(model):
    scope = dict(OWN)
    lines = python_lines(model)
    exec(lines, scope)
    assert scope["model"].structure == model.structure
    assert "replace" not in lines
    assert spec_lines(model) == effects_line(model.effects)


def test_what_a_class_does_not_keep_is_left_open():
    lines = python_lines(Shaped(slow=True)).splitlines()
    assert lines[0] == "# Shaped: a class of your own, in test_model_lines.py"
    assert lines[1] == "model = Shaped(table=..., slow=True)"
    assert python_lines(dft.Thruster()) == "model = dft.Thruster()"
    assert python_lines(dft.Vessel(drive="twin")).startswith('model = dft.Vessel(drive="twin"')


def test_a_fit_writes_what_was_given_and_not_what_it_found():
    model = dft.Thruster(alpha=0.03).replace(ct={"value": 0.021, "fixed": True})
    given = "ct = { value = 0.021, fixed = true }"
    assert spec_lines(model, estimates=False).splitlines() == [
        "effects = []",
        "[parameters]",
        given,
    ]
    assert spec_lines(model).splitlines()[2:] == ["alpha = 0.03", given]
