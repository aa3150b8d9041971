"""The thruster's catalogue of effects: null, derivatives, recovery from the reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow_but
from reference import inputs, noise, thruster
from trajectories import grid_of, trajectory

import diffthrust as dft

PLACES = {**dft.Thruster.inputs, **dft.Thruster.ports, **dft.Thruster.outputs}
CATALOGUE = {n: e for n, e in dft.effects.EFFECTS.items() if all(p in PLACES for p in e.ports)}
AT_EACH_CHANGE = (
    "command_deadband",
    "command_saturation",
    "actuator_lag",
    "coulomb_friction",
    "axial_flow",
    "thrust_sensor_delay",
)
RECOVERED = {
    "command_deadband": {"half_width": (0.25, 2e-3)},
    "command_saturation": {"limit": (2.0, 4e-3)},
    "command_rate_limit": {"rate": (6.0, 0.02)},
    "command_delay": {"delay": (0.13, 2e-3)},
    "command_offset": {"offset": (-0.15, 1e-3)},
    "actuator_lag": {"time_constant": (0.12, 1e-3)},
    "reverse_drive_asymmetry": {"change": (-0.2, 1e-3)},
    "supply_voltage_sag": {"share": (0.7, 0.02)},
    "linear_damping": {"rate": (0.4, 4e-3)},
    "coulomb_friction": {"level": (6.0, 0.06)},
    "static_friction": {"level": (8.0, 0.8)},  # known to some steps of the held command
    "reverse_load_asymmetry": {"change": (0.25, 2e-3)},
    "inflow_load_relief": {"relief": (0.3, 2e-3)},
    "reverse_thrust_asymmetry": {"change": (-0.2, 1e-3)},
    "inflow_thrust_loss": {"loss": (0.2, 1e-3)},
    "axial_flow": {"loss": (0.15, 2e-3), "mass": (12.0, 0.1)},
    "cavitation": {"shortfall": (0.4, 4e-3), "onset": (35.0, 0.2)},
    "thrust_degradation": {"fraction": (0.3, 3e-3), "instant": (11.7, 0.25)},
    "speed_sensor_scale": {"change": (0.06, 1e-3)},
    "speed_sensor_offset": {"offset": (-1.5, 0.01)},
    "thrust_sensor_scale": {"change": (-0.08, 1e-3)},
    "thrust_sensor_offset": {"offset": (2.0, 0.01)},
    "thrust_sensor_lag": {"time_constant": (0.15, 2e-3)},
    "thrust_sensor_delay": {"delay": (0.08, 2e-3)},
    "thrust_exponent": {"exponent": (1.7, 2e-3)},
    "load_exponent": {"exponent": (1.6, 2e-3)},
}
"""Hidden values of an effect's parameters, the main one first, and how near a fit must come."""
NAMES = [*RECOVERED]
PURE_NUMBERS = {"change", "share", "fraction", "shortfall", "restored", "spread", "exponent"}
PARAMETERS = [f"{n}.{k}" for n in NAMES for k, p in CATALOGUE[n].declared.items() if not p.fixed]


def rich_command(time):
    """Slow ramps away from rest, large and small steps in both directions, smooth parts."""
    rng = np.random.default_rng(32)
    ramp, large, small, slow, fast = np.split(time, [120, 320, 440, 600])
    ramp, slow = ramp - ramp[0], slow - slow[0]
    return np.concatenate(
        [
            np.where(ramp < 0.5, 0.0, 0.6 * np.sin(np.pi * (ramp - 0.5) / 2.75)),
            inputs.staircase(large, [3.0, -2.0, 1.0, -3.0, 2.0, 0.5, -1.0, 0.0], 1.25),
            inputs.staircase(small, [0.15, 0.3, -0.1, -0.35, 0.2, -0.2], 1.0),
            inputs.chirp(slow, 1.2, 0.1, 0.4),
            inputs.low_passed_random(fast, 1.5, rng, 0.6),
        ]
    )


TIME = inputs.grid(38.0, 0.05)
COMMAND = rich_command(TIME)
AROUND = {"inflow": 0.5 + 0.4 * np.sin(0.7 * TIME), "supply_voltage": 22.0 + np.sin(0.3 * TIME)}
GIVEN = {"command": COMMAND, **AROUND}


# The catalogue.


def test_the_catalogue_is_complete():
    assert sorted(CATALOGUE) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_is_described_for_people_and_for_a_diagnosis(name):
    effect = CATALOGUE[name]
    assert effect.name == name
    assert "Source:" in effect.__doc__
    assert set(effect.needs) <= set(dft.Thruster.optional_inputs)
    assert any(p.null is not None for p in effect.declared.values())
    attached = (dft.Thruster() + effect()).parameters
    for key, p in effect.declared.items():
        if p.unit:
            unit = attached[f"{name}.{key}"].unit
            dft.Log([0.0, 1.0], {key: [0.0, 1.0]}, {}, units={key: unit})  # a unit that is known
        else:
            assert key in PURE_NUMBERS
        if p.fixed:
            continue
        assert p.value != p.null
        factors = getattr(p.probes, "factors", p.probes)
        assert 2 <= len(set(factors)) <= 4
        if p.null == 0 and p.limits[0] < 0:
            assert min(factors) < 0 < max(factors)
        for value in probes_of(name, key):
            effect(**{key: value})  # within its bounds


def probes_of(name, key):
    """Trial values of a parameter, worked out for the log of this file."""
    probes = CATALOGUE[name].declared[key].probes
    if isinstance(probes, tuple):
        return probes
    level = LEVELS[probes.signal]
    return tuple(factor * level**probes.power for factor in probes.factors)


@pytest.mark.parametrize("name", NAMES)
def test_effects_on_a_channel_say_whether_they_read_other_samples(name):
    effect = CATALOGUE[name]()
    if effect.port in dft.Thruster.ports:
        assert not effect.memory
        return
    values = jnp.asarray(COMMAND)
    s = dft.models.Signals({"time": jnp.asarray(TIME)})
    half = dft.models.Signals({"time": jnp.asarray(TIME[::2])})
    same = np.array_equal(effect(values, s)[::2], effect(values[::2], half))
    assert same is not effect.memory


# At the null.


def plain_log(hold="zero", **more):
    return dft.Log(TIME, GIVEN, hold=hold, **more)


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("name", NAMES)
def test_an_effect_at_its_null_leaves_every_output_unchanged(name, hold):
    effect = CATALOGUE[name]
    plain = dft.simulate(dft.Thruster(), plain_log(hold), substeps=1)
    model = dft.Thruster() + effect().at_null()
    null = dft.simulate(model, plain_log(hold), substeps=1)
    away = dft.simulate(dft.Thruster() + effect(), plain_log(hold), substeps=1)
    for output, values in plain.items():
        if effect.port in dft.Thruster.ports:  # the compiler may fuse differently: one last digit
            np.testing.assert_allclose(null[output], values, rtol=1e-14, atol=1e-14)
        else:
            assert np.array_equal(null[output], values), output
    change = {o: np.max(np.abs(away[o] - values)) for o, values in plain.items()}
    assert max(change.values()) > 1e-2


@pytest.mark.thorough
def test_all_effects_together_at_their_nulls_leave_every_output_unchanged():
    rng = np.random.default_rng(33)
    plain = dft.simulate(dft.Thruster(), plain_log(), substeps=1)
    for _ in range(2):
        model = dft.Thruster()
        for name in rng.permutation(NAMES):
            model = model + CATALOGUE[name]().at_null()
        null = dft.simulate(model, plain_log(), substeps=1)
        for output, values in plain.items():
            np.testing.assert_allclose(null[output], values, rtol=1e-13, atol=1e-13)


# Derivatives.


def slopes(model, names):
    """Derivatives of both outputs with respect to some parameters, ``(2, T)`` each."""
    log = plain_log()
    grid = grid_of(model, log)
    series = {name: jnp.asarray(values) for name, values in GIVEN.items()}
    start = {"speed": jnp.asarray(0.0)}

    def run(values):
        outputs, _ = trajectory(model.bind(values), grid, jnp.asarray(TIME), series, start, {})
        return jnp.stack([outputs["speed"], outputs["thrust"]])

    return jax.jit(jax.jacfwd(run)), {n: jnp.asarray(model.parameters[n].value) for n in names}


PLAIN = dft.simulate(dft.Thruster(), plain_log(), substeps=1)
LEVELS = {
    name: float(np.percentile(np.abs(values), 90))
    for name, values in {
        **GIVEN,
        "speed": PLAIN["speed"],
        "thrust": PLAIN["thrust"],
        "propeller": PLAIN["thrust"],
        "drive": dft.Thruster().beta * COMMAND,
    }.items()
} | {"duration": float(TIME[-1] - TIME[0])}


@pytest.mark.parametrize("name", slow_but(AT_EACH_CHANGE, NAMES))
def test_derivatives_are_finite_at_the_null_and_at_every_probe(name):
    effect = CATALOGUE[name]()
    own = [n for n in PARAMETERS if n.startswith(name + ".")]
    derivative, values = slopes(dft.Thruster() + effect, own)
    null = effect.at_null()
    points = [("null", {n: jnp.asarray(float(getattr(null, n.split(".")[1]))) for n in own})]
    for n in own:
        probes = probes_of(name, n.split(".")[1])
        points += [(n, {**values, n: jnp.asarray(float(probe))}) for probe in probes]
    felt = dict.fromkeys(own, 0.0)
    for at, point in points:
        for n, slope in derivative(point).items():
            assert np.all(np.isfinite(slope)), (n, point)
            here = float(np.max(np.abs(slope * values[n])))
            if n == at and name != "static_friction":  # of which a small level catches no shaft
                assert here > 1e-3, f"a probe that nothing feels: {point}"
            felt[n] = max(felt[n], here)
    assert all(most > 0.1 for most in felt.values()), felt


# Recovery from the reference simulator.


HELD = {"speed_sensor_scale": {"alpha": 0.037}, "thrust_sensor_scale": {"ct": 0.02}}
"""What would take the place of the effect, and its true value."""
STARTS = {"static_friction": 4, "thrust_degradation": 4}
"""Starts of the fit where the class's own first guess is too far away to lead to the truth."""


@pytest.mark.thorough
@pytest.mark.parametrize("name", slow_but(AT_EACH_CHANGE, NAMES))
def test_an_effect_is_recovered_from_the_reference(name):
    truth = RECOVERED[name]
    main, *others = (value for value, _ in truth.values())
    size = main if not others else {key: value for key, (value, _) in truth.items()}
    made = thruster.simulate(TIME, COMMAND, method="rk4", substeps=4, **AROUND, **{name: size})
    sensor = noise.Sensor(std=0.05)
    made = noise.measure(made, np.random.default_rng(34), speed=sensor, thrust=sensor)
    log = dft.Log(TIME, made.inputs, made.measured)
    model = dft.Thruster(alpha=0.03, beta=50.0) + CATALOGUE[name]()
    held = HELD.get(name, {})
    fit = dft.fit(model.replace(held).fix(*held), log, starts=STARTS.get(name, 1))
    for key, (value, tolerance) in truth.items():
        found = fit.parameters[f"{name}.{key}"].value
        assert abs(found - value) < tolerance, (key, found, fit.message)
    assert fit.parameters["beta"].value == pytest.approx(42.0, rel=5e-3)
    assert fit.train.nrmse < 0.01


# What a shaft does at rest.


def at_rest(effect, command):
    log = dft.Log(TIME, {"command": command})
    return dft.simulate(dft.Thruster() + effect, log, initial={"speed": 0.0}, substeps=1)["speed"]


def test_what_a_dead_band_leaves_is_restored_past_its_edge():
    at = jnp.asarray([0.3, 0.4, 0.41, 0.5, -0.5])
    s = dft.models.Signals({})
    plain = dft.effects.CommandDeadband(half_width=0.4)(at, s)
    np.testing.assert_allclose(plain, [0.0, 0.0, 0.01, 0.1, -0.1], atol=1e-12)
    restored = dft.effects.CommandDeadband(half_width=0.4, restored=1.0)(at, s)
    np.testing.assert_allclose(restored, [0.0, 0.2, 0.31, 0.5, -0.5], atol=1e-9)


def test_stiction_bears_a_push_below_its_level_and_lets_a_larger_one_pass():
    stuck = at_rest(dft.effects.StaticFriction(level=10.0), np.full(TIME.size, 0.8 * 10.0 / 42.0))
    assert np.all(stuck == 0.0)
    large = np.full(TIME.size, 1.3 * 10.0 / 42.0)
    free = at_rest(dft.effects.StaticFriction(level=0.0), large)
    np.testing.assert_array_equal(at_rest(dft.effects.StaticFriction(level=10.0), large), free)
    assert free[-1] > 15.0


def test_stiction_catches_a_shaft_that_slows_to_rest():
    command = np.where(TIME < 5.0, 1.0, -0.15)  # a push back of 6.3 rad/s^2
    speed = at_rest(dft.effects.StaticFriction(level=8.0), command)
    assert speed[99] > 20.0
    assert np.all(np.abs(speed[200:]) < 1e-6)
    assert at_rest(dft.effects.StaticFriction(level=5.0), command)[-1] < -10.0


@pytest.mark.parametrize("level", [1.0, 10.0, 1000.0])
def test_dry_friction_stops_the_shaft_however_strong_it_is(level):
    command = np.where(TIME < 5.0, 3.0, 0.4 * np.minimum(level / 42.0, 3.0))
    speed = at_rest(dft.effects.CoulombFriction(level=level), command)
    creep = (np.sqrt(1.0 + 4.0 * 0.037 * 42.0 * command[-1] * 0.03**2) - 1.0) / (2.0 * 0.037 * 0.03)
    assert creep < 0.03 * level
    np.testing.assert_allclose(speed[-100:], creep, rtol=1e-6)


def test_the_water_in_the_duct_begins_settled():
    speed = np.full(TIME.size, 40.0)
    effect = dft.effects.AxialFlow(loss=0.3)
    found = dft.simulate(dft.Thruster() + effect, dft.Log(TIME, {"speed": speed}))
    np.testing.assert_allclose(found["thrust"], found["thrust"][0], rtol=1e-9)
    assert found["thrust"][0] < 0.8 * dft.Thruster().ct * 40.0**2
    flow = found["axial_flow.flow"][-1]
    assert found["thrust"][-1] == pytest.approx(flow + 10.0 * flow**2, rel=1e-9)
