"""A craft as a user makes it: names, effects, what is refused, and what is kept."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError
from diffthrust.actuators import Azimuth, StaticThruster
from diffthrust.bodies import Axis, Planar, SixDegrees

THRUSTER = dft.SpeedLoopThruster()
TIME = 0.1 * np.arange(41)


def boat(**more) -> dft.Craft:
    return dft.Craft(
        Planar(),
        port=THRUSTER.at((-0.35, -0.285, 0)),
        starboard=THRUSTER.at((-0.35, 0.285, 0)),
        bow=Azimuth(dft.Thruster(command="effort"), slew_time=1.0).at((0.9, 0, 0)),
        share=[("port", "starboard")],
        **more,
    )


def log_of(model: dft.Craft, **series) -> dft.Log:
    inputs = {name: series.get(name, 0.0 * TIME + 0.3) for name in model.inputs}
    return dft.Log(TIME, inputs, units=dict(model.inputs))


def test_every_channel_port_and_parameter_stands_behind_its_actuator():
    model = boat()
    assert list(model.inputs) == ["port.command", "starboard.command", "bow.command", "bow.angle"]
    assert {"surge", "port.speed", "bow.azimuth"} <= {*model.states}
    assert {"port.thrust", "bow.side_thrust", "heading"} <= {*model.outputs}
    assert {"port.propeller", "port.push", "bow.drive", "yaw_moment"} <= {*model.ports}
    free = [name for name, p in model.parameters.items() if not p.fixed]
    assert free == [
        *("m11", "m22", "i33", "d11", "d22", "d33"),
        *("port.gain", "port.exponent", "port.time_constant", "port.ct"),
        *("bow.alpha", "bow.beta", "bow.ct", "bow.slew_time"),
    ]
    assert model.parameters["starboard.strength"].fixed
    assert model.replace({"port.y": -0.3}).parameters["port.y"].value == -0.3


def test_shared_numbers_move_all_of_a_group():
    model, log = boat(), log_of(boat(), **{"bow.angle": 0.0 * TIME})
    out = dft.simulate(model.replace({"port.gain": 500.0}), log)
    # to rounding: compilers may fuse what one of both adds up
    np.testing.assert_allclose(out["port.thrust"], out["starboard.thrust"], rtol=1e-14)
    assert abs(out["yaw_rate"]).max() < 1e-12
    weak = dft.simulate(model.replace({"starboard.strength": 0.8}), log)
    assert weak["yaw_rate"][-1] > 0.01  # less push to starboard turns the bow there
    assert out["port.speed"][-1] > 100  # of 500 rad/s at full effort, 30 % are commanded


def test_units_of_commands_follow_the_logs():
    model = dft.Craft(Planar(), a=dft.Thruster().at((0, -1, 0)), b=dft.Thruster().at((0, 1, 0)))
    assert model.parameters["a.beta"].unit == "rad/(V s^2)"
    effort = model.commanded_in("effort")
    assert effort.inputs == {"a.command": "effort", "b.command": "effort"}
    assert effort.parameters["b.beta"].unit == "rad/s^2 per full effort"
    with pytest.raises(InputError, match="expected a command in 'V'"):
        model.commanded_in("knots")
    volts = dft.Craft(Planar(), a=THRUSTER.at((0, 0, 0))).commanded_in("V")
    assert volts.parameters["a.exponent"].fixed  # only of an effort is the curve fitted
    assert volts.commanded_in("effort").parameters["a.exponent"].fixed is False
    mixed = dft.Craft(Planar(), a=dft.Thruster().at((0, -1, 0)), b=THRUSTER.at((0, 1, 0)))
    assert mixed.inputs == {"a.command": "V", "b.command": "effort"}
    assert mixed.commands == ()


# -- effects ---------------------------------------------------------------------------------------


def test_an_effect_on_a_group_is_one_set_of_numbers_for_all():
    model = boat() + "command_deadband"
    assert [n for n in model.parameters if "deadband" in n] == [
        "command_deadband.half_width",
        "command_deadband.restored",
    ]
    assert model.effects[0].ports == ("port.command", "starboard.command")
    both = boat() + "port.command_deadband" + "starboard.command_deadband"
    log = log_of(boat(), **{"port.command": 0.02 * TIME, "bow.angle": TIME})
    one, two = dft.simulate(model, log), dft.simulate(both, log)
    np.testing.assert_allclose(one["heading"], two["heading"], rtol=1e-13)
    assert abs(one["heading"] - dft.simulate(boat(), log)["heading"]).max() > 1e-3


def test_a_group_wide_effect_with_states_has_one_for_each_of_its_actuators():
    pair = {n: dft.Thruster().at((0, y, 0)) for n, y in (("a", -1), ("b", 1))}
    model = dft.Craft(Planar(), **pair, share=[("a", "b")])
    lagged = model + "actuator_lag"
    assert list(lagged.all_states)[-2:] == ["actuator_lag.a.response", "actuator_lag.b.response"]
    apart = model + "a.actuator_lag" + "b.actuator_lag"
    log = log_of(model, **{"a.command": np.sin(TIME), "b.command": np.cos(TIME)})
    one, two = dft.simulate(lagged, log), dft.simulate(apart, log)
    for name in model.states:
        np.testing.assert_allclose(one[name], two[name], rtol=1e-12, atol=1e-14)


def test_effects_name_where_they_are_and_can_be_taken_out():
    model = boat() + "wind" + ("port", "cavitation") + "bow.actuator_lag"
    assert str(model) == "craft + wind + port.cavitation + bow.actuator_lag"
    assert str(model - "port.cavitation") == "craft + wind + bow.actuator_lag"
    assert "port.cavitation.onset" in model.parameters
    assert (
        model.replace({"bow.actuator_lag.time_constant": 0.7}).effects[2].inner.time_constant == 0.7
    )
    with pytest.raises(InputError, match="already has the effect 'wind'"):
        model + "wind"


def test_thrusters_bring_their_effects_along():
    lagging = dft.Thruster() + dft.effects.ActuatorLag(time_constant=0.4)
    model = dft.Craft(
        Planar(), a=lagging.at((0, -1, 0)), b=lagging.at((0, 1, 0)), share=[("a", "b")]
    )
    assert str(model) == "craft + actuator_lag"
    assert model.parameters["actuator_lag.time_constant"].value == 0.4


def test_the_water_that_passes_an_actuator_needs_no_sensor():
    model = dft.Craft(Axis(), aft=dft.Thruster(command="effort").at((0, 0, 0)))
    loss = dft.effects.InflowThrustLoss(loss=0.5)
    log = log_of(model)
    out = dft.simulate(model + ("aft", loss), log)
    speed = out["aft.speed"]
    expected = model.parameters["aft.ct"].value * speed**2 - 0.5 * speed * out["velocity"]
    np.testing.assert_allclose(out["aft.thrust"], expected, rtol=1e-12)
    assert out["velocity"][-1] > 0.01
    sideways = dft.Craft(Planar(), bow=dft.Thruster(command="effort").at((1, 0, 0), (0, 1, 0)))
    out = dft.simulate(sideways + ("bow", loss), log_of(sideways))
    past = out["sway"] + 1.0 * out["yaw_rate"]  # at its place, one metre ahead
    speed = out["bow.speed"]
    expected = sideways.parameters["bow.ct"].value * speed**2 - 0.5 * speed * past
    np.testing.assert_allclose(out["bow.thrust"], expected, rtol=1e-12)


def test_a_measured_inflow_goes_before_the_worked_out_one():
    model = dft.Craft(Axis(), aft=dft.Thruster(command="effort").at((0, 0, 0)))
    model = model + ("aft", dft.effects.InflowThrustLoss(loss=0.5))
    inputs = {"aft.command": 0.0 * TIME + 0.3, "aft.inflow": 0.0 * TIME}
    log = dft.Log(TIME, inputs, units={"aft.command": "effort", "aft.inflow": "m/s"})
    out = dft.simulate(model, log)
    speed = out["aft.speed"]
    np.testing.assert_allclose(
        out["aft.thrust"], model.parameters["aft.ct"].value * speed**2, rtol=1e-12
    )


def test_propellers_leave_their_torque_on_the_hull():
    law = StaticThruster(command="N")
    model = dft.Craft(SixDegrees(), aft=law.at((0, 0, 0), reaction=0.05))
    out = dft.simulate(model, log_of(model, **{"aft.command": 0.0 * TIME + 10.0}))
    assert out["roll"][5] > 1e-3
    straight = model.replace({"aft.reaction": 0.0})
    out = dft.simulate(straight, log_of(model, **{"aft.command": 0.0 * TIME + 10.0}))
    assert abs(out["roll"]).max() < 1e-12


def test_a_number_called_reaction_of_a_model_is_no_torque_on_the_hull():
    class Geared(dft.Model):
        name = "geared"
        inputs = {"command": "V"}
        outputs = {"thrust": "N"}
        reaction: float = dft.parameter(2.0, "N/V", bounds=(0, None))

        def equations(self, s, port):
            return {}, {"thrust": self.reaction * s.command}

    model = dft.Craft(SixDegrees(), aft=Geared().at((0, 0, 0)))
    out = dft.simulate(model, log_of(model))
    assert out["surge"][-1] > 0.01
    assert abs(out["roll"]).max() < 1e-12


# -- what a model must be --------------------------------------------------------------------------


def test_a_craft_is_a_pytree_and_crafts_of_other_numbers_share_a_program():
    model = boat() + "command_deadband"
    leaves, tree = jax.tree.flatten(model)
    assert len(leaves) == len(model.parameters)
    again = jax.tree.unflatten(tree, leaves)
    assert again.parameters == model.parameters
    other = model.replace({"port.gain": 1.0, "bow.x": 0.7})
    assert jax.tree.structure(other) == tree
    assert other.structure == model.structure
    turned = dft.Craft(Planar(), port=THRUSTER.at((0, 0, 0), (0, 1, 0)))
    assert turned.structure != dft.Craft(Planar(), port=THRUSTER.at((0, 0, 0))).structure


def test_derivatives_by_places_and_numbers():
    model, log = boat(), log_of(boat())

    def surge(values: dict) -> jax.Array:
        bound = model.bind(values)
        s = dft.models.Signals({"time": 0.0, **{n: 0.3 for n in (*model.states, *model.inputs)}})
        rates, _ = bound.equations(s, dft.models.Ports((), s))
        return jnp.asarray(rates["yaw_rate"], float)

    values = {"port.y": -0.285, "m11": 38.0, "bow.ct": 0.02}
    slopes = jax.grad(surge)(values)
    for name, value in values.items():
        step = 1e-6 * abs(value)
        up, down = surge({**values, name: value + step}), surge({**values, name: value - step})
        np.testing.assert_allclose(slopes[name], (up - down) / (2 * step), rtol=1e-5, atol=1e-9)
    assert log.name


@pytest.mark.thorough
def test_a_craft_is_saved_and_loaded_with_its_places_and_effects(tmp_path):
    model = boat() + "command_deadband" + ("bow", dft.effects.ActuatorLag(time_constant=0.3))
    model = model.replace({"port.y": -0.3, "bow.alpha": {"value": 0.04, "fixed": True}})
    log = log_of(model)
    out = dft.simulate(model, log)
    rng = np.random.default_rng(1)
    measured = {n: out[n] + rng.normal(0, 0.01, TIME.size) for n in ("surge", "yaw_rate")}
    log = dft.Log(TIME, dict(log.inputs), measured, units=dict(model.inputs))
    free = [n for n, p in model.parameters.items() if not p.fixed and n not in ("m11", "d11")]
    fit = dft.fit(model.fix(*free), [log], starts=1)
    fit.save(tmp_path / "fit.json")
    again = dft.load(tmp_path / "fit.json")
    assert again.model.parameters == fit.model.parameters
    assert again.model.structure == fit.model.structure
    np.testing.assert_array_equal(
        dft.simulate(again.model, log)["heading"], dft.simulate(fit.model, log)["heading"]
    )


def test_the_lines_to_copy_make_the_same_craft():
    from diffthrust.estimation._origin import python_lines  # private: no fit is needed

    model = boat() + "command_deadband" + ("bow", dft.effects.ActuatorLag(time_constant=0.3))
    model = model.replace({"port.y": -0.3, "bow.alpha": {"value": 0.04, "fixed": True}})
    lines = python_lines(model)
    scope = {"dft": dft}
    exec(lines, scope)
    again = scope["model"]
    assert again.structure == model.structure
    assert again.parameters == model.parameters


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: dft.Craft(Planar, a=THRUSTER.at((0, 0, 0))), "found the class Planar"),
        (lambda: dft.Craft(Planar(), a=THRUSTER), "expected an actuator or a sensor at its place"),
        (lambda: dft.Craft(Planar(), surge=THRUSTER.at((0, 0, 0))), "cannot be called 'surge'"),
        (lambda: dft.Craft(Planar(), m11=40.0), "numbers of the body are given with the body"),
        (lambda: boat().placed("actuator_lag", "stern"), "no actuator 'stern'"),
        (lambda: boat() + "axial_flo", "'axial_flo' is not known"),
        (lambda: boat() + "rudder_lag", "acts at the port"),
        (lambda: boat() + ("port", "actuator_lag"), "acts at the port 'drive'"),
        (lambda: dft.Vessel().at((0, 0, 0)), "model with an output 'thrust'"),
        (lambda: THRUSTER.at((0, 0)), "three numbers for place"),
        (lambda: THRUSTER.at((0, 0, 0), (0, 0, 0)), "a direction for pointing"),
        (lambda: THRUSTER.at((0, 0, float("nan"))), "finite numbers for place"),
        (
            lambda: dft.Craft(Planar(), a=THRUSTER.at((0, 0, 0)), share=[("a", "b")]),
            "'b' is no actuator",
        ),
        (
            lambda: dft.Craft(
                Planar(),
                a=THRUSTER.at((0, 0, 0)),
                b=dft.Thruster().at((0, 0, 0)),
                share=[("a", "b")],
            ),
            "one model for 'a', 'b'",
        ),
        (
            lambda: (
                dft.Craft(Planar(), a=dft.Thruster().at((0, 1, 0)), b=dft.Thruster().at((0, 0, 0)))
                + "actuator_lag"
            ),
            "Say where: craft",
        ),
    ],
)
def test_what_is_no_craft_is_refused_with_the_mend(make, message):
    with pytest.raises(InputError, match=message):
        make()
