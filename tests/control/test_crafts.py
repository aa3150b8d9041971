"""Crafts in closed loops: a depth loop by a gauge, a path by two thrusters."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import diffthrust as dft
from diffthrust import InputError, control
from diffthrust.actuators import StaticThruster
from diffthrust.bodies import Heave, Planar
from diffthrust.sensors import GNSS, Pressure

LIFT = StaticThruster(gain=30.0, exponent=1.0).at((0, 0, 0), (0, 0, 1))
DIVE = dft.Craft(Heave(), lift=LIFT, bar=Pressure().at((0, 0, 0.2)))
DEPTH = control.PID(of="bar.depth", kp=0.4, kd=0.6, limit=0.5)


def test_a_depth_loop_of_a_craft_is_that_of_its_equations():
    loop = control.Loop(thruster=DIVE, controller=DEPTH, rate=10.0)
    run = loop.simulate(control.Step(2.0), 12.0)
    state, expected, last = np.zeros(2), [], 0.0
    for k in range(run.time.size):
        expected.append(state[0] + 0.2)
        error = 2.0 - expected[-1]
        slope = 0.0 if k == 0 else (error - last) * 10.0
        last = error
        command = np.clip(0.4 * error + 0.6 * slope, -0.5, 0.5)

        def rates(t, x, command=command):
            net = 30.0 * command - (5.0 + 37.0 * abs(x[1])) * x[1] + 112.8 - 114.8
            return [x[1], net / 26.0]

        state = solve_ivp(rates, (0, 0.1), state, rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(run["bar.depth"], expected, atol=1e-6)
    assert abs(run["command"]).max() == 0.5  # the limit did matter
    assert run.log.inputs["lift.command"] is not None
    again = dft.simulate(DIVE, run.log, initial={"depth": 0.0, "heave": 0.0})
    np.testing.assert_allclose(again["bar.depth"], run["bar.depth"], atol=1e-6)


def test_effects_on_the_thruster_act_in_the_loop():
    craft = DIVE + "command_delay" + "command_deadband"
    craft = craft.replace(
        {"lift.command_delay.delay": 0.25, "lift.command_deadband.half_width": 0.1}
    )
    run = control.Loop(thruster=craft, controller=DEPTH, rate=10.0).simulate(control.Step(2.0), 6.0)
    again = dft.simulate(craft, run.log, initial={"depth": 0.0, "heave": 0.0})
    np.testing.assert_allclose(again["bar.depth"], run["bar.depth"], atol=1e-6)


def test_a_craft_of_several_commands_is_no_thruster_of_a_loop():
    with pytest.raises(InputError, match="or a craft of one thruster, found craft"):
        control.Loop(thruster=boat(), controller=DEPTH)


def boat() -> dft.Craft:
    law = StaticThruster(gain=30.0, exponent=1.0)
    return dft.Craft(
        Planar(),
        port=law.at((-0.4, -0.285, 0)),
        starboard=law.at((-0.4, 0.285, 0)),
        share=[("port", "starboard")],
        gps=GNSS().at((0.4, 0, -1)),
    )


@pytest.mark.thorough
def test_two_thrusters_of_a_craft_follow_a_path_as_those_of_a_vessel():
    """Within limits of the forces and of their change; `Vessel` has the same equations."""
    ratios = {n: boat().parameters[n].value for n in ("m11", "m22", "i33", "d11", "d22", "d33")}
    vessel = dft.Vessel(drive="twin", lever_arm=0.285, **ratios)
    runs = {}
    for model, size in ((boat(), 1.0), (vessel, 30.0)):
        mpc = control.MPC(
            model=model,
            limits=dict.fromkeys(model.inputs, (-0.4 * size, 0.8 * size)),
            slew=dict.fromkeys(model.inputs, size),
            horizon=8,
        )
        loop = control.VesselLoop(vessel=model, controller=mpc)
        runs[size] = loop.simulate(control.StraightPath(0.6), 8.0, initial={"east": 0.5})
    craft, twin = runs.values()
    assert craft.diverged is None
    for name in ("north", "east", "heading"):
        np.testing.assert_allclose(craft[name], twin[name], atol=1e-6, err_msg=name)
    forces = 30.0 * craft["port.command"], 30.0 * craft["starboard.command"]
    np.testing.assert_allclose(forces, [twin["left_force"], twin["right_force"]], atol=1e-4)
    assert craft["east"][-1] < 0.42 < craft["east"].max()  # on its way back to the path
