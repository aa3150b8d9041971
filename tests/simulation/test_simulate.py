"""Simulation held against diffrax and the reference simulator, and its messages."""

from types import SimpleNamespace
from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from reference import axis, dc_motor, inputs, thruster, vessel

import diffthrust as dft
from diffthrust import InputError, Log, Model, simulate
from diffthrust.effects import ActuatorLag, CommandDeadband, ReverseThrustAsymmetry
from diffthrust.models import MODELS, Ports, Relaxing, Signals
from diffthrust.simulation import CoarseStepWarning

JASON = thruster.JASON


# Cases: one for each model, with the reference's answer.


def random_command(seed: int, count: int = 81, step: float = 0.05) -> tuple:
    rng = np.random.default_rng(seed)
    time = step * np.arange(count)
    return time, inputs.low_passed_random(time, 1.5, rng)


def thruster_case(hold):
    time, command = random_command(11)
    record = thruster.simulate(time, command, hold=hold)
    return dft.Thruster(**JASON), record, {"speed": 0.0}


def ducted_thruster_case(hold):
    """The sizes of the duct against the three coefficients that they stand for, and a torque."""
    time, command = random_command(26)
    advance, volume = 0.2 * 0.101, 0.016
    beta = 1.0 / (1000.0 * volume * advance**2)
    given = {"alpha": 0.0527 * advance / (2.0 * volume), "ct": 1000.0 * 0.0527 * advance**2}
    record = thruster.simulate(time, command / 4.0, beta=beta, hold=hold, **given)
    truth = {**record.truth, "flow": advance * record.truth["speed"]}
    record = SimpleNamespace(time=time, inputs={"command": command / 4.0}, truth=truth)
    return dft.models.DuctedThruster(), record, {"speed": 0.0}


def thruster_with_effects_case(hold):
    # The package applies the deadband to the samples and then holds them, the reference to the
    # held command: the same for a zero-order hold, so only there is it part of the case.
    time, command = random_command(12)
    width = 0.3 if hold == "zero" else 0.0
    sizes = {"command_deadband": width, "actuator_lag": 0.08, "reverse_thrust_asymmetry": -0.2}
    record = thruster.simulate(time, command, hold=hold, **sizes)
    model = (
        dft.Thruster(**JASON)
        + CommandDeadband(half_width=width)
        + ActuatorLag(time_constant=0.08 - 1e-9)
        + ReverseThrustAsymmetry(change=-0.2)
    )
    return model, record, {"speed": 0.0, "actuator_lag.response": 0.0}


def dc_motor_case(hold):
    # Without dry friction: the package smooths it over 0.1 rad/s, the reference does not.
    time, command = random_command(13, step=0.002)
    p = {**dc_motor.ARAS, "friction": 0.0}
    record = dc_motor.simulate(time, 3.0 * command, parameters=p, hold=hold)
    record.inputs["command"] = record.inputs.pop("voltage")
    model = dft.DCMotorThruster(
        back_emf=p["ke"],
        torque_constant=p["km"],
        coulomb=0.0,
        load=p["kq"],
        thrust_quadratic=p["kt"],
    )
    return model, record, {"speed": 0.0, "current": 0.0}


def axis_case(hold):
    time, command = random_command(14, step=0.5)
    record = axis.simulate(time, 100.0 * command, hold=hold, initial_velocity=0.3)
    return dft.AxisVehicle(**axis.JASON_JR), record, {"position": 0.0, "velocity": 0.3}


def propeller_vessel_case(hold):
    time = 0.25 * np.arange(81)
    given = {
        "propeller_speed": np.where(time < 12.0, 98.0, -40.0),
        "rudder_angle": inputs.zigzag(time, 0.35, 4.0, 2.0),
    }
    if hold == "linear":  # |n|^0.27 has an infinite slope where n passes through zero
        given["propeller_speed"] = 80.0 + 20.0 * np.sin(time)
    start = {"surge": 0.2, "heading": 0.4}
    p = vessel.SIRAMDASU
    record = vessel.simulate(time, given, parameters=p, initial=start, hold=hold)
    return dft.Vessel(**p), record, start


def twin_vessel_case(hold):
    rng = np.random.default_rng(15)
    time = 0.25 * np.arange(81)
    given = {
        "left_force": 5.0 + 3.0 * rng.standard_normal(81),
        "right_force": 5.0 + 3.0 * rng.standard_normal(81),
    }
    p = {"m11": 14.0, "m22": 22.0, "i33": 2.5, "d11": 9.0, "d22": 30.0, "d33": 4.0}
    p |= {"lever_arm": 0.285}
    start = {"sway": 0.1, "east": 3.0}
    full = {**p, "exponent": 1.0}
    record = vessel.simulate(time, given, parameters=full, initial=start, hold=hold)
    return dft.Vessel(drive="twin", **p), record, start


def speed_loop_case(hold):
    """The closed form of a first-order lag, of a held command or of one that runs straight."""
    time, command = random_command(25)
    command = command / 4.0
    exponent = 0.8 if hold == "zero" else 1.0
    model = dft.SpeedLoopThruster(gain=320.0, exponent=exponent, time_constant=0.13, ct=5e-4)
    curve, step = 320.0 * np.sign(command) * np.abs(command) ** exponent, np.diff(time)
    slope = np.diff(curve) / step * (hold == "linear")
    speed = np.zeros(len(time))
    for i, dt in enumerate(step):
        lag = 0.13 * slope[i]
        end = curve[i] + slope[i] * dt - lag
        speed[i + 1] = end + (speed[i] - curve[i] + lag) * np.exp(-dt / 0.13)
    truth = {"speed": speed, "thrust": 5e-4 * speed * np.abs(speed)}
    record = SimpleNamespace(time=time, inputs={"command": command}, truth=truth)
    return model, record, {"speed": 0.0}


CASES = {
    "thruster": thruster_case,
    "speed_loop_thruster": speed_loop_case,
    "ducted_thruster": ducted_thruster_case,
    "thruster_with_effects": thruster_with_effects_case,
    "dc_motor_thruster": dc_motor_case,
    "axis_vehicle": axis_case,
    "vessel_propeller": propeller_vessel_case,
    "vessel_twin": twin_vessel_case,
}


def rates_of(model, states, inputs):
    s = Signals({"time": 0.0, **states, **inputs})
    port = Ports(model.effects, s)
    own, _ = model.equations(s, port)
    found = {**own, **port.rates}
    return {name: k.rate if isinstance(k, Relaxing) else k for name, k in found.items()}


def log_of(record, hold="zero", **more):
    return Log(record.time, record.inputs, hold=hold, **more)


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("case", CASES)
def test_every_model_agrees_with_the_reference_simulator(case, hold):
    model, record, start = CASES[case](hold)
    found = simulate(model, log_of(record, hold), initial=start, substeps=64)
    for name, truth in record.truth.items():
        scale = max(np.max(np.abs(truth)), 1.0)
        if case == "dc_motor_thruster" and name == "current":
            scale = 10.0
        np.testing.assert_allclose(found[name], truth, rtol=0.0, atol=1e-8 * scale, err_msg=name)


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("case", CASES)
def test_every_model_agrees_with_diffrax(case, hold):
    model, record, start = CASES[case](hold)
    series = {name: jnp.asarray(value) for name, value in record.inputs.items()}
    if case == "thruster_with_effects":
        width = model.parameters["command_deadband.half_width"].value
        c = np.asarray(record.inputs["command"])
        series["command"] = jnp.asarray(np.sign(c) * np.maximum(np.abs(c) - width, 0.0))
    states = {name: jnp.asarray(start.get(name, 0.0)) for name in model.all_states}
    stiff = case in ("dc_motor_thruster", "thruster_with_effects")
    solver = diffrax.Kvaerno5() if stiff and hold == "zero" else diffrax.Dopri8()

    def rates(t, y, args):
        begin, span, early, late = args
        share = (t - begin) / span if hold == "linear" else 0.0
        u = {name: early[name] + share * (late[name] - early[name]) for name in early}
        found = rates_of(model, y, u)
        return {name: found[name] for name in y}

    def one(y, x):
        begin, end, early, late = x
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rates),
            solver,
            begin,
            end,
            (end - begin) / 4,
            y,
            args=(begin, end - begin, early, late),
            stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-12),
            saveat=diffrax.SaveAt(t1=True),
        )
        y = {name: value[-1] for name, value in solution.ys.items()}
        return y, y

    time = jnp.asarray(record.time)
    early = {name: value[:-1] for name, value in series.items()}
    late = {name: value[1:] for name, value in series.items()}
    _, path = jax.jit(lambda: jax.lax.scan(one, states, (time[:-1], time[1:], early, late)))()
    found = simulate(model, log_of(record, hold), initial=start, substeps=64)
    for name, values in path.items():
        scale = max(float(jnp.max(jnp.abs(values))), 1.0)
        np.testing.assert_allclose(
            found[name][1:], values, rtol=0.0, atol=1e-8 * scale, err_msg=name
        )


def test_every_model_is_held_against_the_references():
    covered = {
        case.replace("_with_effects", "").split("_prop")[0].split("_twin")[0] for case in CASES
    }
    assert covered | {"linear_sensor"} == set(MODELS)


def test_the_sensor_is_its_straight_line():
    depth = np.array([0.5, 1.0, 0.2])
    log = Log([0.0, 1.0, 2.0], {"depth": depth})
    reading = simulate(dft.LinearSensor(slope=0.2, offset=-0.1), log)["reading"]
    np.testing.assert_allclose(reading, 0.2 * depth - 0.1, rtol=1e-15)


# Time and holds.


def test_time_need_not_be_uniform():
    rng = np.random.default_rng(21)
    time = np.cumsum(rng.uniform(0.005, 0.1, 120))
    command = inputs.low_passed_random(time, 1.5, rng)
    for hold in ("zero", "linear"):
        record = thruster.simulate(time, command, hold=hold)
        found = simulate(
            dft.Thruster(**JASON), log_of(record, hold), initial={"speed": 0.0}, substeps=32
        )
        np.testing.assert_allclose(found["speed"], record.truth["speed"], atol=1e-6)


def test_a_clock_that_starts_late_changes_nothing():
    time, command = random_command(22)
    now = simulate(dft.Thruster(), Log(time, {"command": command}), substeps=2)
    late = simulate(dft.Thruster(), Log(time + 1024.0, {"command": command}), substeps=2)
    np.testing.assert_allclose(late["speed"], now["speed"], atol=1e-9)


def test_a_held_command_is_the_limit_of_a_steep_linear_one():
    time = inputs.grid(4.0, 0.05)
    command = inputs.staircase(time, [1.0, -2.0, 3.0, 0.5], 1.0)
    held = simulate(
        dft.Thruster(), Log(time, {"command": command}), initial={"speed": 0.0}, substeps=8
    )
    corner = np.sort(np.concatenate([time, time[1:] - 1e-7]))
    steep = np.concatenate([[command[0]], np.repeat(command, 2)[:-1]])
    steep = np.where(np.isin(corner, time), np.interp(corner, time, command), np.nan)
    steep[1::2] = command[:-1]
    linear = simulate(
        dft.Thruster(),
        Log(corner, {"command": steep}, hold="linear"),
        initial={"speed": 0.0},
        substeps=8,
    )
    np.testing.assert_allclose(linear["speed"][::2], held["speed"], atol=1e-4)
    ramps = simulate(
        dft.Thruster(),
        Log(time, {"command": command}, hold="linear"),
        initial={"speed": 0.0},
        substeps=8,
    )
    assert np.max(np.abs(ramps["speed"] - held["speed"])) > 1.0


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_substeps_are_the_same_as_a_finer_log(hold):
    time, command = random_command(23)
    fine = np.linspace(time[0], time[-1], 4 * (time.size - 1) + 1)
    if hold == "zero":
        finer = np.append(np.repeat(command[:-1], 4), command[-1])
    else:
        finer = np.interp(fine, time, command)
    model = dft.Thruster() + ActuatorLag(time_constant=0.03)
    coarse = simulate(model, Log(time, {"command": command}, hold=hold), substeps=4)
    dense = simulate(model, Log(fine, {"command": finer}, hold=hold), substeps=1)
    for name, values in coarse.items():
        np.testing.assert_allclose(values, dense[name][::4], atol=1e-9, err_msg=name)


def test_a_zero_step_rests():
    # What a problem pads its logs with; a log of one sample is the start alone.
    log = Log([3.0], {"command": [1.0]}, {"speed": [7.0]})
    found = simulate(dft.Thruster(), log)
    assert found["speed"] == 7.0
    assert found["thrust"] == pytest.approx(0.019 * 49.0)


# Special inputs.


def test_speed_as_an_input_simulates_the_thrust_alone():
    time = inputs.grid(2.0, 0.05)
    speed = 30.0 * np.sin(time)
    log = Log(time, {"speed": speed}, {"thrust": np.zeros(time.size)})
    found = simulate(dft.Thruster(ct=0.02), log)
    np.testing.assert_allclose(found["thrust"], 0.02 * speed * np.abs(speed), rtol=1e-14)
    rpm = Log(time, {"speed": speed * 30.0 / np.pi}, units={"speed": "rpm"})
    np.testing.assert_allclose(simulate(dft.Thruster(ct=0.02), rpm)["thrust"], found["thrust"])
    both = Log(time, {"speed": speed, "command": 0.0 * time})
    np.testing.assert_allclose(simulate(dft.Thruster(ct=0.02), both)["thrust"], found["thrust"])


def test_the_start_is_the_first_measurement_unless_given():
    time, command = random_command(24)
    seen = np.full(time.size, 25.0)
    seen[0] = np.nan
    log = Log(time, {"command": command}, {"speed": seen}, units={"speed": "rpm"})
    measured = simulate(dft.Thruster(), log, substeps=1)["speed"]
    assert measured[0] == pytest.approx(25.0 * np.pi / 30.0)
    given = simulate(dft.Thruster(), log, initial={"speed": 3.0}, substeps=1)["speed"]
    assert given[0] == 3.0
    with pytest.raises(InputError, match="no state 'sped'"):
        simulate(dft.Thruster(), log, initial={"sped": 3.0}, substeps=1)


# Limits and conventions of the models.


def test_a_lag_starts_settled_at_the_first_drive():
    log = Log(inputs.grid(1.0, 0.05), {"command": np.full(21, 2.0)})
    path = simulate(dft.Thruster(beta=42.0) + ActuatorLag(), log)
    np.testing.assert_allclose(path["actuator_lag.response"], 84.0, rtol=1e-12)


@pytest.mark.parametrize("inductance", [1e-5, 1e-7, 1e-9, 1e-12])
def test_the_dc_motor_becomes_the_torque_driven_thruster(inductance):
    time, command = random_command(25)
    motor = dft.DCMotorThruster(
        resistance=2.0,
        inductance=inductance,
        back_emf=dft.Parameter(0.0, transform="linear"),
        viscous=0.0,
        coulomb=0.0,
        torque_constant=0.05,
        inertia=1e-3,
        load=4e-5,
        thrust_quadratic=0.02,
    )
    plain = dft.Thruster(alpha=4e-5 / 1e-3, beta=0.05 / (2.0 * 1e-3), ct=0.02)
    log = Log(time, {"command": command})
    given = {"speed": 0.0}
    full = simulate(motor, log, initial=given, substeps=4)
    simple = simulate(plain, log, initial=given, substeps=4)
    late = inductance / 2.0 * 25.0 * np.ptp(command)  # the lag's delay, as a speed
    np.testing.assert_allclose(full["speed"], simple["speed"], atol=5.0 * late + 1e-9)
    slip = 0.02 * 2.0 * np.max(np.abs(simple["speed"])) * (5.0 * late + 1e-9)
    np.testing.assert_allclose(full["thrust"], simple["thrust"], atol=2.0 * slip)


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_the_dc_motor_with_back_emf_loses_its_current_as_inductance_vanishes(hold):
    # current = (command - back_emf speed) / resistance: a damping in proportion to speed.
    time, command = random_command(26)
    resistance, torque, inertia = 2.0, 0.05, 1e-3
    motor = dft.DCMotorThruster(
        resistance=resistance,
        inductance=1e-12,
        back_emf=0.05,
        viscous=0.0,
        coulomb=0.0,
        torque_constant=torque,
        inertia=inertia,
        load=4e-5,
    )
    record = thruster.simulate(
        time,
        command,
        alpha=4e-5 / inertia,
        beta=torque / (resistance * inertia),
        linear_damping=torque * 0.05 / (resistance * inertia),
        hold=hold,
    )
    found = simulate(motor, log_of(record, hold), initial={"speed": 0.0}, substeps=8)
    np.testing.assert_allclose(found["speed"], record.truth["speed"], atol=1e-3)


def test_a_push_of_the_stern_to_starboard_turns_the_bow_to_port():
    time = inputs.grid(2.0, 0.05)
    given = {"propeller_speed": np.full(41, 50.0), "rudder_angle": np.full(41, 0.2)}
    path = simulate(dft.Vessel(), Log(time, given), initial=dict.fromkeys(["surge"], 0.0))
    assert path["surge"][-1] > 0
    assert path["yaw_rate"][5] < 0
    assert path["heading"][-1] < 0
    assert path["sway"][1] > 0  # the hull is pushed to starboard first


def test_more_force_on_the_left_turns_to_starboard():
    time = inputs.grid(2.0, 0.05)
    given = {"left_force": np.full(41, 6.0), "right_force": np.full(41, 4.0)}
    path = simulate(dft.Vessel(drive="twin", lever_arm=0.3), Log(time, given))
    assert path["yaw_rate"][-1] > 0
    assert path["heading"][-1] > 0
    assert path["east"][-1] > 0


@pytest.mark.parametrize(
    ("heading", "north", "east"),
    [(0.0, 1.0, 0.0), (np.pi / 2, 0.0, 1.0), (np.pi, -1.0, 0.0), (-np.pi / 2, 0.0, -1.0)],
)
def test_heading_is_clockwise_from_north(heading, north, east):
    time = inputs.grid(5.0, 0.1)
    given = {"propeller_speed": np.full(51, 50.0), "rudder_angle": np.zeros(51)}
    path = simulate(dft.Vessel(), Log(time, given), initial={"heading": heading, "surge": 0.5})
    way = np.hypot(path["north"][-1], path["east"][-1])
    assert path["north"][-1] == pytest.approx(north * way, abs=1e-9)
    assert path["east"][-1] == pytest.approx(east * way, abs=1e-9)


def test_a_propeller_at_rest_gives_no_force_and_a_finite_gradient():
    time = inputs.grid(1.0, 0.1)
    given = {"propeller_speed": np.zeros(11), "rudder_angle": np.full(11, 0.3)}
    path = simulate(dft.Vessel(), Log(time, given))
    assert all(np.all(values == 0.0) for values in path.values())


# Traced once.


class Counted(Model):
    """Counts how often its equations are traced."""

    name = "counted"
    inputs: ClassVar = {"push": "N"}
    states: ClassVar = {"velocity": "m/s"}
    outputs: ClassVar = {"velocity": "m/s"}
    traces = 0

    mass: float = dft.parameter(2.0, "kg", bounds=(0, None))

    def equations(self, s, port):
        Counted.traces += 1
        return {"velocity": (s.push - s.velocity) / self.mass}, {"velocity": s.velocity}


@pytest.mark.usefixtures("nothing_stored")
def test_another_log_of_the_same_shape_and_other_values_trace_nothing():
    time = inputs.grid(3.0, 0.1)
    rng = np.random.default_rng(28)

    def run(mass, start=0.1):
        log = Log(time, {"push": rng.normal(size=31)}, {"velocity": rng.normal(size=31)})
        return simulate(Counted(mass=mass), log, substeps=2, initial={"velocity": start})

    run(1.0)
    before = Counted.traces
    assert before > 0
    for mass in (2.0, 3.0, 0.5):
        run(mass, mass)
    run(dft.Parameter(4.0, "kg", bounds=(1.0, 9.0), fixed=True))
    assert Counted.traces == before
    simulate(Counted(), Log(time[:20], {"push": time[:20]}), substeps=2)
    assert Counted.traces > before  # another shape: the count does count


# The step.


def quick_log(step):
    time = step * np.arange(200)
    command = inputs.staircase(time, [2.0, -2.0, 1.0, 3.0], 25 * step)
    record = thruster.simulate(time, command)
    return Log(time, record.inputs, record.truth, noise={"speed": 0.3, "thrust": 0.5})


def test_substeps_are_chosen_by_the_error_against_the_noise():
    assert dft.simulation.choose_substeps(dft.Thruster(**JASON), quick_log(0.02)) == 1
    coarse = quick_log(0.4)
    chosen = dft.simulation.choose_substeps(dft.Thruster(**JASON), coarse)
    assert 1 < chosen <= 32
    # The claim behind the choice, against the truth instead of a halved step.
    found = simulate(dft.Thruster(**JASON), coarse, substeps=chosen)
    for name, noise in (("speed", 0.3), ("thrust", 0.5)):
        error = np.sqrt(np.mean((found[name] - coarse.measured[name]) ** 2))
        assert error < 0.011 * noise
        assert dft.simulation.step_error(dft.Thruster(**JASON), coarse, chosen)[name] < 0.01
    rough = simulate(dft.Thruster(**JASON), coarse, substeps=chosen // 2)
    assert np.sqrt(np.mean((rough["speed"] - coarse.measured["speed"]) ** 2)) > 0.0025 * 0.3


def test_the_step_is_chosen_where_a_log_measures_nothing():
    """A planned run: with one step a sample its speeds were off by hundredths, without a word."""
    coarse = quick_log(0.4)
    plan = Log(coarse.time, coarse.inputs, {})
    found = simulate(dft.Thruster(**JASON), plan)
    rough = simulate(dft.Thruster(**JASON), plan, substeps=1)
    for name, truth in coarse.measured.items():
        error = np.sqrt(np.mean((found[name] - truth) ** 2)) / np.std(truth)
        assert error < 1e-4
        assert np.sqrt(np.mean((rough[name] - truth) ** 2)) / np.std(truth) > 10 * error
    chosen = dft.simulation.choose_substeps(dft.Thruster(**JASON), plan)
    errors = [dft.simulation.step_error(dft.Thruster(**JASON), plan, n) for n in (chosen, 1)]
    assert max(errors[0].values()) <= 0.01 < max(errors[1].values())
    level = Log(coarse.time, {"command": np.full(coarse.time.size, 2.0)}, {})
    settled = simulate(dft.Thruster(**JASON), level)["speed"][-1]
    still = {"initial": {"speed": float(settled)}}  # constant but for rounding
    assert dft.simulation.choose_substeps(dft.Thruster(**JASON), level, **still) == 1
    moving = dft.Thruster(**JASON) + dft.effects.AxialFlow(loss=1.0, mass=1.0)
    assert np.isfinite(simulate(moving, plan)["thrust"]).all()


def test_a_grid_too_coarse_for_the_model_is_warned_of():
    time = 0.9 * np.arange(60)
    command = np.where(np.arange(60) % 2 == 0, 1.0, -1.0)
    log = Log(time, {"command": command}, {"speed": 0.1 * command})
    fast = dft.Thruster(alpha=50.0, beta=4e4)
    with pytest.warns(CoarseStepWarning, match=r"with 32 integrator steps .*'speed'"):
        assert dft.simulation.choose_substeps(fast, log) == 32
    plan = Log(time, {"command": command}, {})
    with pytest.warns(CoarseStepWarning, match=r"of its spread \(allowed: 0.0001\)"):
        dft.simulation.choose_substeps(dft.Thruster(alpha=3.0, beta=1e3), plan)
    assert dft.simulation.choose_substeps(fast, plan) == 32  # overflows, which `simulate` tells
    with pytest.warns(dft.simulation.SimulationFailedWarning):
        dft.simulate(fast, plan)


# Messages.


def test_a_missing_input_is_named():
    log = Log([0.0, 0.1], {"sped": [1.0, 2.0]})
    with pytest.raises(InputError, match=r"(?s)needs the input 'command'.*'sped'.*Mend: Map"):
        simulate(dft.Thruster(), log)
    with pytest.raises(InputError, match="needs the input 'rudder_angle'"):
        simulate(dft.Vessel(), Log([0.0, 0.1], {"propeller_speed": [1.0, 2.0]}))


def test_a_unit_of_the_wrong_dimension_is_refused():
    log = Log([0.0, 0.1], {"push": [1.0, 2.0]}, units={"push": "m"})
    with pytest.raises(InputError, match=r"(?s)'push'.*\bN\b"):
        simulate(Counted(), log)


def test_the_unit_of_a_measured_output_matters_only_where_it_chooses_the_step():
    time = 0.1 * np.arange(20)
    log = Log(time, {"command": np.ones(20)}, {"thrust": np.ones(20)}, units={"thrust": "rad/s"})
    assert np.isfinite(simulate(dft.Thruster(), log, substeps=2)["thrust"]).all()
    with pytest.raises(InputError, match="channel 'thrust'"):
        simulate(dft.Thruster(), log)


def test_milliseconds_declared_as_seconds_are_seen():
    time = np.arange(0.0, 10_000.0, 50.0)
    log = Log(time, {"command": np.sin(time)}, name="run3.csv")
    with pytest.raises(InputError, match=r"(?s)run3.csv: .*a sample every 50 s.*is it 'ms'"):
        simulate(dft.Thruster(), log)
    simulate(dft.Thruster(), Log(time, {"command": np.sin(time)}, units={"time": "ms"}))
    short = Log(np.linspace(0.0, 0.004, 9), {"command": np.ones(9)})
    with pytest.raises(InputError, match=r"a whole log of 0\.004 s"):
        simulate(dft.Thruster(), short)


def test_an_effect_names_the_channel_that_it_needs():
    class Leeway(dft.Effect):
        name = "leeway"
        port = "load"
        needs = ("inflow",)
        share: float = dft.parameter(0.1, null=0.0)

        def __call__(self, value, s):
            return value * (1.0 - self.share * s.inflow)

    model = dft.Thruster() + Leeway()
    log = Log([0.0, 0.1], {"command": [1.0, 2.0]})
    with pytest.raises(InputError, match=r"(?s)'leeway' needs the input 'inflow'.*'command'"):
        simulate(model, log)
    flowing = Log([0.0, 0.1], {"command": [1.0, 2.0], "inflow": [0.0, 0.0]})
    simulate(model, flowing)


def test_equations_that_read_an_absent_signal_say_so():
    class Blind(dft.Effect):
        name = "blind"
        port = "shaft"
        share: float = dft.parameter(0.1, null=0.0)

        def __call__(self, value, s):
            return value * s.inflow

    with pytest.raises(InputError, match="read the signal 'inflow'"):
        simulate(dft.Thruster() + Blind(), Log([0.0, 0.1], {"command": [1.0, 2.0]}))


def test_logs_of_many_lengths_share_few_programs():
    """And simulate as they are: what they are padded with has no length."""
    rng = np.random.default_rng(3)
    time = 0.05 * np.arange(400)
    log = dft.Log(time, {"command": rng.uniform(-4.0, 4.0, time.size)}, {})
    whole = dft.simulate(dft.Thruster(), log, substeps=3)
    before = compilations("simulation")
    for count in range(257, 300):
        part = dft.Log(time[:count], {"command": log.inputs["command"][:count]}, {})
        speed = dft.simulate(dft.Thruster(), part, substeps=3)["speed"]
        assert speed == pytest.approx(whole["speed"][:count], rel=1e-12)
    assert compilations("simulation") <= before + 1


def test_outputs_are_in_si_or_as_the_log_was_written():
    time = 0.1 * np.arange(30)
    log = dft.Log(
        time,
        {"command": np.full(30, 1.0)},
        {"speed": np.full(30, 100.0), "thrust": np.full(30, 1.0)},
        units={"command": "V", "speed": "rpm", "thrust": "kgf"},
    )
    si = dft.simulate(dft.Thruster(command="V"), log, substeps=1)
    shown = dft.simulate(dft.Thruster(command="V"), log, substeps=1, in_units=True)
    np.testing.assert_allclose(shown["speed"], si["speed"] * 60.0 / (2.0 * np.pi))
    np.testing.assert_allclose(shown["thrust"], si["thrust"] / 9.80665)
    assert log.measured["thrust"][0] == pytest.approx(9.80665)
    np.testing.assert_allclose(log.values("thrust", in_units=True), 1.0)
    np.testing.assert_allclose(log.values("command", in_units=True), 1.0)
