"""What models say of their equations, against these equations: closed forms believe it."""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.models import MODELS, Ports, QuadraticLoad, Signals

COUNT = 50


def at_random(model, seed):
    """The model at other values of its parameters."""
    rng = np.random.default_rng(seed)
    values = {name: p.value * rng.uniform(0.3, 3.0) for name, p in model.parameters.items()}
    return model.replace({name: v for name, v in values.items() if v})


def obeys(model, seed):
    """Whether shaft and thrust follow ``quadratic_load`` at random commands, speeds and values."""
    model = at_random(model, seed)
    said = model.quadratic_load
    rng = np.random.default_rng(100 + seed)
    s = Signals({name: rng.normal(scale=20.0, size=COUNT) for name in (*model.inputs, "speed")})
    rates, outputs = model.equations(s, Ports((), s))
    pairs = (
        (rates["speed"], said.acceleration(s.command, s.speed)),
        (outputs["thrust"], said.thrust(s.speed)),
    )
    return list(rates) == ["speed"] and all(np.allclose(a, b, rtol=1e-12) for a, b in pairs)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", MODELS)
def test_a_model_obeys_the_quadratic_load_that_it_names(name, seed):
    model = MODELS[name]()
    assert model.quadratic_load is None or obeys(model, seed)


def test_the_thruster_names_one_in_all_its_commands():
    for unit in dft.Thruster().commands:
        model = dft.Thruster(alpha=0.03, beta=41.0, ct=0.02, command=unit)
        assert model.quadratic_load == QuadraticLoad(drive_gain=41.0, load=0.03, thrust_gain=0.02)
        assert obeys(model, 7)


class Steeper(dft.Thruster):
    """Equations of its own, of which its parent knows nothing."""

    name = "steeper"

    def equations(self, s, port):
        rates, outputs = super().equations(s, port)
        return {"speed": rates["speed"] - 0.001 * s.speed**3}, outputs


class Renamed(dft.Thruster):
    """The parent's equations."""

    name = "renamed"


class Surer(Steeper):
    """Equations of its own, and what they are."""

    def equations(self, s, port):
        return dft.Thruster.equations(self, s, port)

    @property
    def quadratic_load(self):
        return QuadraticLoad(self.beta, self.alpha, self.ct)


def test_other_equations_inherit_no_quadratic_load():
    assert Steeper().quadratic_load is None
    assert Renamed().quadratic_load == dft.Thruster().quadratic_load
    assert obeys(Surer(), 0)


def test_effects_are_not_counted():
    model = dft.Thruster() + "linear_damping"
    assert model.quadratic_load == dft.Thruster().quadratic_load


@pytest.mark.parametrize("load", [None, 0.05])
def test_a_thruster_is_held_against_what_is_simulated(load):
    """Steady thrust and the load at a swing of the speed follow from the same numbers."""
    model = dft.Thruster() if load is None else dft.Thruster(alpha=load)
    said, time = model.quadratic_load, 0.01 * np.arange(2000)
    run = dft.simulate(model, dft.Log(time, {"command": np.full(2000, 2.0)}))
    assert run["thrust"][-1] == pytest.approx(2.0 * said.thrust_per_command, rel=1e-6)
    phase = 2.0 * np.pi * np.arange(1000) / 1000
    swing = 30.0 * np.sin(phase)
    fundamental = 2.0 * np.mean(said.load * swing * np.abs(swing) * np.sin(phase))
    assert fundamental == pytest.approx(30.0 * (30.0 * said.sine_load), rel=1e-5)


@pytest.mark.parametrize(
    "asked",
    [
        lambda model: dft.control.Lead.of(model),
        lambda model: dft.cycles.thruster_loop_cycle(model, verify=False),
        lambda model: dft.describing_function(model, [1.0], [1.0], method="paper"),
    ],
    ids=["compensator", "limit cycle", "formula"],
)
def test_closed_forms_refuse_a_thruster_with_other_equations(asked):
    with pytest.raises(dft.InputError, match="thruster"):
        asked(Steeper())
