"""Parameters and components: what can be said, what is refused, and how they print."""

import copy
import math
import pickle
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import inputs
from trajectories import grid_of, trajectory

import diffthrust as dft
from diffthrust import InputError, Log, simulate
from diffthrust.effects import ActuatorLag, CommandDeadband, ReverseThrustAsymmetry


class ViscousFriction(dft.Effect):
    """Friction of the seals, proportional to speed."""

    name = "viscous_friction"
    port = "shaft"
    rate: float = dft.parameter(0.5, unit="1/s", bounds=(0, None), null=0.0)

    def __call__(self, value, s):
        return value - self.rate * s.speed


class Rig(dft.Model):
    """A guided cart with a spring."""

    name = "rig"
    inputs: ClassVar = {"push": "N"}
    states: ClassVar = {"place": "m", "velocity": "m/s"}
    outputs: ClassVar = {"place": "m"}
    ports: ClassVar = {"force": "net force [N]"}
    mass: float = dft.parameter(2.0, "kg", bounds=(0, None))
    stiffness: float = dft.parameter(8.0, "N/m", bounds=(0, None))

    def equations(self, s, port):
        force = port("force", s.push - self.stiffness * s.place)
        return {"place": s.velocity, "velocity": force / self.mass}, {"place": s.place}


# Parameters.


def test_declared_parameters_are_plain_numbers_with_a_description():
    model = dft.Thruster(alpha=0.03)
    assert model.alpha == 0.03
    assert isinstance(model.alpha, float)
    described = model.parameters["alpha"]
    assert (described.value, described.unit, described.bounds) == (0.03, "1/rad", (0, None))
    assert described.transform == "log"
    assert not described.fixed


def test_the_curve_of_a_motor_controller_is_fitted_for_an_effort_alone():
    model = dft.SpeedLoopThruster()
    fixed = {unit: model.commanded_in(unit).parameters["exponent"].fixed for unit in ("V", "rad/s")}
    assert fixed == {"V": True, "rad/s": True}
    assert not model.commanded_in("V").commanded_in("effort").parameters["exponent"].fixed


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"alpha": -1.0}, r"'alpha': expected a value within \[0, inf\) 1/rad, found -1"),
        ({"alpha": math.nan}, "'alpha': expected a value within"),
        ({"alpha": math.inf}, "'alpha': expected a value within"),
        ({"alpha": 0.0}, "'alpha': expected a positive value"),
        ({"alpha": dft.Parameter(1.0, bounds=(3, 2))}, "lower bound 3 is not below the upper"),
        ({"alpha": "much"}, "'alpha': expected a number in 1/rad, found 'much'"),
        ({"alfa": 1.0}, r"no parameter 'alfa'.*the nearest is 'alpha'"),
    ],
)
def test_values_that_cannot_be_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        dft.Thruster(**given)
    with pytest.raises(InputError):
        dft.Thruster().replace(given)


@pytest.mark.parametrize(
    ("mean", "std"), [(0.0, 0.0), (0.0, -1.0), (math.nan, 1.0), (0.0, math.inf)]
)
def test_a_prior_without_a_width_is_refused(mean, std):
    with pytest.raises(InputError, match="positive std"):
        dft.models.Normal(mean, std)


def test_numpy_numbers_are_numbers():
    assert dft.Thruster(alpha=np.float32(0.5)).alpha == 0.5
    assert dft.Thruster(beta=np.int64(40)).beta == 40.0
    assert isinstance(dft.Thruster(beta=40).beta, float)


# Immutability and copies.


def test_components_cannot_be_changed():
    model = dft.Thruster() + ActuatorLag()
    with pytest.raises(AttributeError, match=r"model\.replace\(alpha=\.\.\.\)"):
        model.alpha = 1.0
    with pytest.raises(AttributeError):
        model.effects[0].time_constant = 1.0
    assert model.alpha == 0.037


def test_replace_fix_and_free_leave_the_original_alone():
    model = dft.Thruster() + ActuatorLag()
    other = model.replace({"actuator_lag.time_constant": 0.2}, alpha={"value": 0.05, "fixed": True})
    assert other.parameters["actuator_lag.time_constant"].value == 0.2
    assert other.effects[0].time_constant == 0.2
    assert (other.alpha, other.parameters["alpha"].fixed) == (0.05, True)
    assert (model.alpha, model.parameters["alpha"].fixed) == (0.037, False)
    assert model.effects[0].time_constant == 0.05
    assert other.free("alpha").parameters["alpha"].fixed is False
    assert other.parameters["alpha"].unit == "1/rad"
    fixed = model.fix("beta", "actuator_lag.time_constant")
    assert [n for n, p in fixed.parameters.items() if p.fixed] == [
        "beta",
        "actuator_lag.time_constant",
    ]


def test_replace_refuses_what_it_does_not_know():
    model = dft.Thruster() + ActuatorLag()
    with pytest.raises(InputError, match=r"no parameter 'betta'.*nearest is 'beta'"):
        model.replace(betta=1.0)
    with pytest.raises(InputError, match=r"the nearest is 'actuator_lag\.time_constant'"):
        model.replace({"actuator_lag.time": 1.0})
    with pytest.raises(InputError, match="no field 'bound'"):
        model.replace(alpha={"bound": (0, 1)})
    with pytest.raises(InputError, match="within"):
        model.replace({"actuator_lag.time_constant": -1.0})
    with pytest.raises(InputError, match="no parameter 'gamma'"):
        model.fix("gamma")


@pytest.mark.parametrize(
    "model",
    [
        dft.Vessel(drive="twin", m11=9.0) + "wind",
        dft.Thruster() + ViscousFriction(rate=0.7),
        dft.layouts.OTTER.craft() + "port.command_delay",
    ],
    ids=str,
)
def test_models_can_be_copied_and_pickled(model):
    for other in (copy.copy(model), copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert repr(other) == repr(model)
        assert other.structure == model.structure


# Algebra.


def test_effects_are_added_in_order_and_taken_out_by_name():
    model = dft.Thruster() + CommandDeadband() + ActuatorLag()
    assert str(model) == "thruster + command_deadband + actuator_lag"
    assert str(model - "command_deadband") == "thruster + actuator_lag"
    assert str(dft.Thruster()) == "thruster"
    with pytest.raises(InputError, match=r"no effect 'deadband'.*'command_deadband'"):
        model - "deadband"
    with pytest.raises(InputError, match="already has the effect 'actuator_lag'"):
        model + ActuatorLag()


def test_an_effect_on_a_port_that_the_model_lacks_is_refused():
    with pytest.raises(InputError, match=r"acts at the port 'drive'.*'hull', 'force'"):
        dft.AxisVehicle() + ActuatorLag()


def test_a_lag_on_a_whole_series_is_refused():
    class SensorLag(ActuatorLag):
        name = "sensor_lag"
        port = "speed"

    with pytest.raises(InputError, match="states of its own"):
        dft.Thruster() + SensorLag()


def test_effects_can_be_added_by_name():
    assert repr(dft.Thruster() + "actuator_lag") == repr(dft.Thruster() + ActuatorLag())
    both = ["actuator_lag", dft.effects.CommandOffset()]
    several = dft.Thruster() + both
    assert [effect.name for effect in several.effects] == ["actuator_lag", "command_offset"]
    with pytest.raises(InputError, match="nearest are 'actuator_lag'"):
        dft.Thruster() + "actuator_lagg"


def test_only_effects_can_be_added():
    with pytest.raises(TypeError):
        dft.Thruster() + 3
    with pytest.raises(
        InputError, match=r"(?s)the class ActuatorLag.*Write model \+ ActuatorLag\(\)"
    ):
        dft.Thruster() + ActuatorLag


def test_a_model_prints_its_parts():
    model = dft.Thruster(alpha=0.0371234567) + ActuatorLag(time_constant=0.25)
    assert repr(model) == (
        "Thruster(alpha=0.03712, beta=42, ct=0.019) + ActuatorLag(time_constant=0.25)"
    )


def test_an_effect_without_a_port_or_a_name_is_refused_at_once():
    with pytest.raises(InputError, match="expected name and port"):

        class Nameless(dft.Effect):
            pass


def test_an_unfinished_model_or_effect_says_what_is_missing():
    class Empty(dft.Model):
        name = "empty"
        states: ClassVar = {"x": ""}
        outputs: ClassVar = {"x": ""}

    with pytest.raises(InputError, match="'empty' has no equations"):
        simulate(Empty(), Log([0.0, 1.0]), substeps=1)

    class Idle(dft.Effect):
        name = "idle"
        port = "shaft"

    with pytest.raises(InputError, match="'idle' has no __call__"):
        simulate(dft.Thruster() + Idle(), Log([0.0, 0.1], {"command": [1.0, 1.0]}), substeps=1)


def test_a_vessel_has_one_of_two_drives():
    assert set(dft.Vessel().inputs) == {"propeller_speed", "rudder_angle"}
    twin = dft.Vessel(drive="twin")
    assert set(twin.inputs) == {"left_force", "right_force"}
    assert twin.parameters["exponent"].fixed
    assert twin.parameters["m11"].unit == "kg"
    assert dft.Vessel().parameters["m11"].unit == "kg/A"
    with pytest.raises(InputError, match="'propeller' or 'twin', found 'paddle'"):
        dft.Vessel(drive="paddle")


# Structure and pytrees.


def test_structure_is_equal_where_the_equations_are():
    assert dft.Thruster().structure == dft.Thruster(alpha=1.0).fix("beta").structure
    assert dft.Thruster().structure != dft.DCMotorThruster().structure
    assert dft.Vessel().structure != dft.Vessel(drive="twin").structure
    both = dft.Thruster() + ActuatorLag() + ReverseThrustAsymmetry()
    other = dft.Thruster() + ReverseThrustAsymmetry() + ActuatorLag()
    assert both.structure != other.structure  # the order of effects matters
    assert both.structure == (dft.Thruster() + ActuatorLag() + ReverseThrustAsymmetry()).structure
    assert hash(both.structure) != hash(other.structure)


MODEL = dft.Thruster(alpha=0.05) + CommandDeadband(half_width=0.2) + ActuatorLag()


def test_a_model_is_a_pytree_of_its_values():
    leaves, tree = jax.tree.flatten(MODEL)
    assert leaves == [0.05, 42.0, 0.019, 0.2, 0.0, 0.05]
    again = jax.tree.unflatten(tree, leaves)
    assert repr(again) == repr(MODEL)
    doubled = jax.tree.map(lambda v: 2.0 * v, MODEL)
    assert doubled.alpha == 0.1
    assert doubled.effects[1].time_constant == 0.1
    assert MODEL.alpha == 0.05
    assert tree == jax.tree.structure(dft.Thruster() + CommandDeadband() + ActuatorLag())
    assert tree != jax.tree.structure(dft.Thruster() + CommandDeadband())


def test_jit_accepts_models_and_compiles_once():
    traces = []

    @jax.jit
    def double(model):
        traces.append(1)
        return jax.tree.map(lambda v: 2.0 * v, model)

    assert float(double(MODEL).beta) == 84.0
    assert float(double(MODEL.replace(beta=1.0)).beta) == 2.0
    assert len(traces) == 1


@pytest.mark.thorough
def test_gradients_with_respect_to_a_model_agree_with_differences():
    time = inputs.grid(2.0, 0.05)
    command = 2.0 * np.sin(3.0 * time)
    log = Log(time, {"command": command})
    grid = grid_of(MODEL, log, 2)
    given = (jnp.asarray(time), {"command": jnp.asarray(command)}, {"speed": jnp.array(3.0)}, {})

    @jax.jit
    def cost(model):
        outputs, _ = trajectory(model, grid, *given)
        return jnp.mean(outputs["thrust"] ** 2) + jnp.mean(outputs["speed"])

    gradient = jax.tree.leaves(jax.jit(jax.grad(cost))(MODEL))
    slopes = dict(zip(MODEL.parameters, gradient, strict=True))
    for name, p in MODEL.parameters.items():
        if name == "command_deadband.restored":  # at its bound
            continue
        step = 1e-6 * p.value
        ahead = float(cost(MODEL.replace({name: p.value + step})))
        behind = float(cost(MODEL.replace({name: p.value - step})))
        exact = (ahead - behind) / (2.0 * step)
        assert float(slopes[name]) == pytest.approx(exact, rel=2e-6), name


def test_a_batch_of_models_can_be_mapped():
    time = inputs.grid(1.0, 0.05)
    log = Log(time, {"command": np.full(21, 2.0)})
    grid = grid_of(MODEL, log)
    given = (jnp.asarray(time), {"command": jnp.full(21, 2.0)}, {"speed": jnp.array(0.0)}, {})
    factors = jnp.array([0.5, 1.0, 2.0])
    models = jax.tree.map(lambda v: v * factors, MODEL)
    run = jax.jit(lambda m: trajectory(m, grid, *given)[0]["speed"])
    speeds = jax.jit(jax.vmap(run))(models)
    for factor, speed in zip(factors, speeds, strict=True):
        one = jax.tree.map(lambda v, f=float(factor): v * f, MODEL)
        np.testing.assert_allclose(speed, run(one), rtol=1e-12)


# A user's own.


def test_a_users_model_and_effect_work_like_ours():
    time = inputs.grid(6.0, 0.02)
    log = Log(time, {"push": np.zeros(time.size)}, {"place": np.cos(2.0 * time)})
    free = simulate(Rig(), log, substeps=2)
    np.testing.assert_allclose(free["place"], np.cos(2.0 * time), atol=1e-7)

    class Damper(dft.Effect):
        """A damper beside the spring."""

        name = "damper"
        port = "force"
        size: float = dft.parameter(1.6, "N s/m", bounds=(0, None), null=0.0)

        def __call__(self, value, s):
            return value - self.size * s.velocity

    damped = simulate(Rig() + Damper(), log, substeps=2)
    # place'' + 0.8 place' + 4 place = 0 from rest at 1
    w = np.sqrt(4.0 - 0.16)
    exact = np.exp(-0.4 * time) * (np.cos(w * time) + 0.4 / w * np.sin(w * time))
    np.testing.assert_allclose(damped["place"], exact, atol=1e-7)


def test_a_users_effect_on_our_model_has_its_steady_state():
    log = Log(inputs.grid(30.0, 0.05), {"command": np.full(601, 1.0)})
    path = simulate(dft.Thruster(alpha=0.04, beta=40.0) + ViscousFriction(rate=0.5), log)
    exact = (-0.5 + np.sqrt(0.25 + 4 * 0.04 * 40.0)) / 0.08
    assert path["speed"][-1] == pytest.approx(exact, rel=1e-9)


def test_effects_at_one_port_act_in_their_order():
    class Half(dft.Effect):
        name = "half"
        port = "propeller"

        def __call__(self, value, s):
            return 0.5 * value

    class More(dft.Effect):
        name = "more"
        port = "propeller"

        def __call__(self, value, s):
            return value + 1.0

    log = Log([0.0, 0.1], {"speed": [10.0, 20.0]})
    first = simulate(dft.Thruster(ct=0.01) + Half() + More(), log)["thrust"]
    second = simulate(dft.Thruster(ct=0.01) + More() + Half(), log)["thrust"]
    np.testing.assert_allclose(first, [1.5, 3.0])
    np.testing.assert_allclose(second, [1.0, 2.5])
