"""The effects of a vessel: nothing at the null, finite everywhere, found in the reference."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow_but
from reference import inputs, noise, vessel
from scipy.integrate import solve_ivp
from trajectories import Grid, trajectory

import diffthrust as dft
from diffthrust.effects import EFFECTS

FOUND = {
    "quadratic_surge_drag": ({"drag": 2.0}, {}),
    "quadratic_sway_drag": ({"drag": 6.0}, {}),
    "quadratic_yaw_drag": ({"drag": 1.0}, {}),
    "sway_yaw_coupling": ({"mass": 0.3, "damping": 0.4}, {}),
    "rudder_inflow": ({"gain": 0.5}, {}),
    "propeller_inflow": ({"loss": 0.2}, {}),
    "propeller_walk": ({"fraction": -0.08}, {}),
    "rudder_offset": ({"offset": 0.06}, {}),
    "rudder_lag": ({"time_constant": 0.6}, {}),
    "propeller_lag": ({"time_constant": 0.8}, {}),
    "rudder_rate_limit": ({"rate": 0.3}, {}),
    "reverse_propeller_asymmetry": ({"change": -0.3}, {"lowest": -60.0}),
    "differential_gain": ({"gain": -0.1}, {"drive": "twin"}),
    "force_exponent": ({"exponent": 1.4}, {"drive": "twin"}),
    "water_current": ({"to_north": 0.1, "to_east": -0.15}, {}),
    "wind": ({"along": 0.02, "across": 0.05, "turning": -0.01}, {"blowing": True}),
}
"""Hidden values of an effect's parameters, and how the log is made."""
CATALOGUE = {*FOUND, "swapped_thrusters"}  # found by a test of its own
HINGED = {
    "rudder_inflow",
    "propeller_walk",
    "rudder_offset",
    "rudder_lag",
    "rudder_rate_limit",
    "propeller_lag",
}
TWIN = {"differential_gain", "swapped_thrusters", "force_exponent"}
AT_EACH_CHANGE = ("quadratic_yaw_drag", "rudder_lag", "wind")
CASES = [
    (name, drive)
    for name in sorted(CATALOGUE)
    for drive, absent in (("propeller", TWIN), ("twin", HINGED))
    if name not in absent
]


def excitation(drive, wind=False, duration=60.0, seed=0, lowest=60.0):
    """Inputs with both signs of steering, at several speeds."""
    rng = np.random.default_rng(seed)
    time = inputs.grid(duration, 0.1)
    if drive == "twin":
        given = {
            "left_force": 2.0 + inputs.low_passed_random(time, 1.5, rng, 0.15),
            "right_force": 2.0 + inputs.low_passed_random(time, 1.5, rng, 0.15),
        }
    else:
        given = {
            "propeller_speed": inputs.staircase(time, [98.0, lowest, 120.0, 80.0], 11.0),
            "rudder_angle": inputs.low_passed_random(time, 0.25, rng, 0.15)
            + inputs.zigzag(time, 0.2, 7.0, 3.0),
        }
    if wind:
        given["wind_speed"] = 5.0 + inputs.low_passed_random(time, 1.0, rng, 0.2)
        given["wind_direction"] = 0.6 + inputs.low_passed_random(time, 0.2, rng, 0.2)
    return time, given


def log_of(drive="propeller", seed=0, blowing=False, lowest=60.0, duration=60.0, **hidden):
    """A log of the reference vessel with a little noise."""
    time, given = excitation(drive, blowing, duration, seed, lowest)
    made = vessel.simulate(time, given, method="rk4", substeps=2, **hidden)
    rng = np.random.default_rng(seed + 100)
    made = noise.measure(made, rng, **dict.fromkeys(vessel.STATES, noise.Sensor(std=1e-3)))
    return dft.Log(time=made.time, inputs=dict(made.inputs), measured=dict(made.measured))


# What every effect has.


def test_the_catalogue_is_complete():
    places = {*dft.Vessel.ports, *dft.Vessel().inputs, *dft.Vessel(drive="twin").inputs}
    elsewhere = {*dft.Thruster.ports, *dft.AxisVehicle.ports}
    found = {
        effect.name
        for effect in EFFECTS.values()
        if {*effect.ports} <= places and not {*effect.ports} & elsewhere
    }
    assert found == CATALOGUE


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_is_described(name):
    effect = EFFECTS[name]
    places = {**dft.Vessel.ports, **dft.Vessel().inputs, **dft.Vessel(drive="twin").inputs}
    assert set(effect.ports) <= set(places)
    assert "Null:" in effect.__doc__
    assert "Source:" in effect.__doc__
    ratios = {"gain", "change", "fraction", "share", "exponent"}
    for parameter, described in effect.declared.items():
        assert bool(described.unit) != (parameter in ratios and described.unit == ""), parameter
        assert described.value != described.null
        if not described.fixed:
            tried = described.probes
            assert 1 <= len(getattr(tried, "factors", tried)) <= 4
    with pytest.raises(dft.InputError, match="does not have"):
        dft.Thruster() + effect()


# The null.


@pytest.mark.parametrize(("name", "drive"), CASES)
def test_nothing_changes_at_the_null(name, drive):
    log = log_of(drive, blowing=name == "wind", lowest=-60.0, duration=30.0)
    plain = dft.simulate(dft.Vessel(drive), log, substeps=2)
    null = dft.simulate(dft.Vessel(drive) + EFFECTS[name]().at_null(), log, substeps=2)
    changed = dft.simulate(dft.Vessel(drive) + EFFECTS[name](), log, substeps=2)
    for channel in vessel.STATES:
        np.testing.assert_allclose(null[channel], plain[channel], rtol=1e-12, atol=1e-13)
    assert max(np.max(np.abs(changed[c] - plain[c])) for c in vessel.STATES) > 1e-3


def trials(effect, log):
    """The effect at its null, at its own values and at every trial value."""
    yield effect.at_null()
    yield effect
    for name, described in effect.declared.items():
        probes = described.probes
        if not isinstance(probes, tuple):
            signal = {**log.inputs, **log.measured}.get(probes.signal, 3.0)  # a force at a port
            level = float(np.quantile(np.abs(signal), 0.9))
            probes = [factor * level**probes.power for factor in probes.factors]
        for value in probes:
            yield type(effect)(**{name: value})


@pytest.mark.parametrize(("name", "drive"), slow_but(AT_EACH_CHANGE, CASES))
def test_values_and_derivatives_are_finite(name, drive):
    log = log_of(drive, blowing=name == "wind", lowest=-60.0, duration=30.0)
    model = dft.Vessel(drive) + EFFECTS[name]()
    base = {k: jnp.asarray(p.value) for k, p in model.parameters.items()}
    grid = Grid(tuple((n, "zero") for n in sorted(log.inputs)), 1)
    given = {channel: jnp.asarray(series) for channel, series in log.inputs.items()}

    def run(own):
        whole = model.bind({**base, **own})
        out, _ = trajectory(whole, grid, jnp.asarray(log.time), given, {}, {})
        return out, out

    slopes = jax.jit(jax.jacfwd(run, has_aux=True))
    felt = set()
    for effect in trials(EFFECTS[name](), log):
        own = {f"{name}.{k}": jnp.asarray(getattr(effect, k)) for k in effect.declared}
        slope, out = slopes(own)
        for channel in vessel.STATES:
            assert np.isfinite(out[channel]).all(), (effect, channel)
            for parameter, values in slope[channel].items():
                assert np.isfinite(values).all(), (effect, channel, parameter)
                if np.max(np.abs(values)) > 0.0:
                    felt.add(parameter)
    assert felt >= {f"{name}.{k}" for k, p in EFFECTS[name].declared.items() if not p.fixed}


def test_a_mass_matrix_that_no_body_has_ends_a_simulation():
    """A fit of a boat had stepped over the pole between, to mass^2 above m22 i33."""
    model = dft.Vessel() + "sway_yaw_coupling"
    limit = (model.parameters["m22"].value * model.parameters["i33"].value) ** 0.5
    time = 0.1 * np.arange(50)
    log = dft.Log(time, {"propeller_speed": np.full(50, 20.0), "rudder_angle": np.full(50, 0.1)})
    for share in (0.94, -0.94):
        there = model.replace({"sway_yaw_coupling.mass": share * limit})
        assert np.isfinite(dft.simulate(there, log)["sway"]).all()
    for share in (0.96, -0.96, 1.1, -1.1):
        there = model.replace({"sway_yaw_coupling.mass": share * limit})
        with pytest.warns(
            dft.simulation.SimulationFailedWarning, match="leaves the finite numbers"
        ):
            dft.simulate(there, log)


# Recovery from the reference.


def fitted(effect, log, drive="propeller"):
    """The vessel with the effect, all its ratios free and none of them at the truth."""
    start = {name: 1.2 * vessel.SIRAMDASU[name] for name in ("m11", "m22", "i33", "d11", "d22")}
    return dft.fit(dft.Vessel(drive, **start) + effect, log, horizon=None, starts=1, substeps=4)


@pytest.mark.thorough
@pytest.mark.parametrize("name", slow_but(AT_EACH_CHANGE, FOUND))
def test_the_reference_s_effect_is_found(name):
    hidden, how = FOUND[name]
    fit = fitted(EFFECTS[name](), log_of(**{name: hidden}, **how), how.get("drive", "propeller"))
    assert fit.status is dft.estimation.Status.CONVERGED, fit.message
    for parameter, true in hidden.items():
        found = fit.parameters[f"{name}.{parameter}"].value
        assert found == pytest.approx(true, rel=0.02), parameter
    for parameter in ("m11", "m22", "i33", "d11", "d22", "d33"):
        true = vessel.SIRAMDASU[parameter]
        assert fit.parameters[parameter].value == pytest.approx(true, rel=0.01), parameter


@pytest.mark.thorough
def test_exchanged_channels_are_found_and_those_that_are_not_stay():
    log = log_of("twin", swapped_thrusters=1.0)  # half way, nothing steers: the start is at one
    fit = fitted(EFFECTS["swapped_thrusters"](), log, "twin")
    assert fit.status is dft.estimation.Status.AT_BOUND, fit.message
    assert fit.parameters["swapped_thrusters.share"].value == pytest.approx(1.0, abs=1e-6)
    assert fit.parameters["i33"].value == pytest.approx(vessel.SIRAMDASU["i33"], rel=1e-3)
    assert not EFFECTS["swapped_thrusters"](share=0.95).consequence(fit.model)
    half = EFFECTS["swapped_thrusters"](share=0.53).consequence(fit.model)
    assert half == "the two thrusters steer with -6 % of the logged moment"
    right = fitted(EFFECTS["swapped_thrusters"](share=0.3), log_of("twin"), "twin")
    assert right.status is dft.estimation.Status.CONVERGED, right.message
    assert right.parameters["swapped_thrusters.share"].value == pytest.approx(0.0, abs=5e-3)


def test_a_gain_belongs_to_its_channel_or_to_its_thruster_by_the_order_of_the_effects():
    _, given = excitation("twin", duration=30.0)
    log = dft.Log(np.arange(301) * 0.1, given)
    left, right = given["left_force"], given["right_force"]
    gain, swap = EFFECTS["differential_gain"](gain=0.2), EFFECTS["swapped_thrusters"]()
    for effects, forces in (
        ((swap, gain), {"left_force": 1.2 * right, "right_force": 0.8 * left}),
        ((gain, swap), {"left_force": 0.8 * right, "right_force": 1.2 * left}),
    ):
        model = dft.Vessel("twin")
        for effect in effects:
            model = model + effect
        found = dft.simulate(model, log, substeps=1)
        right_ones = dft.simulate(dft.Vessel("twin"), dft.Log(log.time, forces), substeps=1)
        for channel in vessel.STATES:
            np.testing.assert_allclose(found[channel], right_ones[channel], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "linear", "speed"),
    [
        ("quadratic_surge_drag", "d11", "surge and passes the linear drag at 0.25 m/s"),
        ("quadratic_sway_drag", "d22", "sway and passes the linear drag at 0.25 m/s"),
        ("quadratic_yaw_drag", "d33", "yaw rate and passes the linear drag at 0.25 rad/s"),
    ],
)
def test_a_drag_that_is_a_ratio_is_told_by_where_it_passes_the_linear_one(name, linear, speed):
    ratios = dft.Vessel(**{linear: 2.0}) + EFFECTS[name](drag=8.0)
    assert ratios.parameters[f"{name}.drag"].unit.endswith("/A")
    assert ratios.effects[0].consequence(ratios) == f"drag grows with the square of {speed}"
    forces = dft.Vessel("twin") + EFFECTS[name](drag=8.0)  # in newtons its number says enough
    assert not forces.effects[0].consequence(forces)
    none = dft.Vessel() + EFFECTS[name](drag=0.0)
    assert not none.effects[0].consequence(none)
    alone = dft.Vessel(**{linear: 1e-15}) + EFFECTS[name](drag=8.0)
    assert alone.effects[0].consequence(alone).endswith(", with no linear part left")


def test_a_drag_of_one_s_own_may_have_a_linear_part_of_that_name():
    linear = dft.parameter(0.1, "N s/m", bounds=(0, None), null=0.0)
    body = {"name": "both_drags", "linear": linear, "__annotations__": {"linear": float}}
    both = type("BothDrags", (EFFECTS["quadratic_surge_drag"],), body)
    model = dft.Vessel(d11=2.0) + both(drag=8.0)
    said = model.effects[0].consequence(model)
    assert said.endswith("and passes the linear drag at 0.25 m/s")


@pytest.mark.parametrize(
    ("gain", "command", "weak", "share"),
    [(0.049, "effort", "right", 79), (-0.049, "effort", "left", 79), (0.05, "N", "right", 90)],
)
def test_a_gain_says_what_it_does_to_the_forces(gain, command, weak, share):
    model = dft.Vessel(drive="twin", command=command)
    model = model.replace(exponent=2.35) if command == "effort" else model
    words = EFFECTS["differential_gain"](gain=gain).consequence(model)
    assert words.startswith(f"the {weak} thruster gives {share} % of the ")
    levels = np.array([0.6, 0.6])
    log = dft.Log(np.arange(2.0), {"left_force": levels, "right_force": levels})
    parts = []
    for side in ("left_force", "right_force"):  # surge after a second by one thruster alone
        one = dft.Log(log.time, {**log.inputs, side: 0.0 * levels})
        run = dft.simulate(model + EFFECTS["differential_gain"](gain=gain), one, substeps=50)
        parts.append(run["surge"][-1])
    assert 100 * min(parts) / max(parts) == pytest.approx(share, abs=1.0)


@pytest.mark.slow
def test_a_constant_wind_is_found_without_channels_for_it():
    true = {"along": 0.02, "across": 0.05, "turning": 0.01, "speed": 4.0, "direction": 2.0}
    fit = fitted(EFFECTS["wind"](speed=4.0, direction=1.0), log_of(wind=true))
    assert fit.status is dft.estimation.Status.CONVERGED, fit.message
    for parameter in ("along", "across", "turning", "direction"):
        found = fit.parameters[f"wind.{parameter}"].value
        assert found == pytest.approx(true[parameter], rel=0.02), parameter


@pytest.mark.thorough
def test_the_water_s_speed_counts_not_the_speed_over_ground():
    """A vessel that drifts with the current feels no drag, however the effects are ordered."""
    time = np.arange(51) * 0.1
    still = np.zeros(51)
    log = dft.Log(time, {"propeller_speed": still, "rudder_angle": still})
    current = EFFECTS["water_current"](to_north=0.3, to_east=-0.4)
    rest = [EFFECTS[n]() for n in sorted(CATALOGUE - TWIN - {"wind", "rudder_offset"})]
    for effects in ([current, *rest], [*rest, current]):
        model = dft.Vessel()
        for effect in effects:
            if effect is current or effect.name != "water_current":
                model = model + effect
        drift = {"surge": 0.3, "sway": -0.4, "yaw_rate": 0.0, "heading": 0.0}
        out = dft.simulate(model, log, initial=drift, substeps=1)
        np.testing.assert_allclose(out["north"], 0.3 * time, atol=1e-12)
        np.testing.assert_allclose(out["east"], -0.4 * time, atol=1e-12)
        np.testing.assert_allclose(out["heading"], 0.0, atol=1e-12)


def heave(seed, excess, mass=120.0, drag=60.0):
    """A heave axis with buoyancy, by DOP853 with the equation written out."""
    rng = np.random.default_rng(seed)
    time, level = np.arange(0.0, 30.0, 0.1), rng.uniform(-25.0, 25.0, 10)

    def rates(t, state):
        push = level[min(int(t / 3.0 + 1e-9), 9)] + excess
        return [state[1], (push - drag * state[1] * abs(state[1])) / mass]

    state, rows = [0.0, 0.0], []
    for t in time:
        rows.append(state)
        state = solve_ivp(rates, (t, t + 0.1), state, "DOP853", rtol=1e-9).y[:, -1]
    position, velocity = np.array(rows).T + 0.005 * rng.standard_normal((2, time.size))
    thrust = level[(time / 3.0 + 1e-9).astype(int)]
    return dft.Log(time, {"thrust": thrust}, {"position": position, "velocity": velocity},
                   {"thrust": "N", "position": "m", "velocity": "m/s"}, hold="zero",
                   name=f"dive {seed}")  # fmt: skip


def test_the_buoyancy_of_a_heave_axis_is_found():
    fit = dft.fit(dft.AxisVehicle() + "buoyancy", [heave(0, 6.0), heave(1, 6.0)], starts=1)
    for name, truth in {"buoyancy.excess": 6.0, "mass": 120.0, "drag": 60.0}.items():
        found = fit.parameters[name]
        assert abs(found.value - truth) < 4.0 * found.std_error
        assert found.std_error < 0.005 * truth


@pytest.mark.slow
def test_a_buoyancy_and_the_zero_of_a_thrust_sensor_are_rivals():
    """6 N of buoyancy were told as a thrust sensor's zero, and nothing else."""
    logs = [heave(seed, 6.0) for seed in range(3)]
    names = ["buoyancy", "thrust_sensor_offset"]
    diag = dft.diagnose(dft.AxisVehicle(), logs[:2], holdout=logs[2], candidates=names,
                        experiment=False)  # fmt: skip
    assert sorted(diag.groups[0]) == names  # in either order: they are the same
    assert re.search(", or it is (a thrust sensor offset|buoyancy).", diag.summary)
