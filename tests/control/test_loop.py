"""Closed loops: held against SciPy, against open-loop simulation, and against the paper."""

import math
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import diffthrust as dft
from diffthrust import InputError, control, effects
from diffthrust.control import Loop, Sinusoid, Step

THRUSTER = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022)
VEHICLE = dft.AxisVehicle(mass=340.0, drag=67.0)
NO_DRAG = dft.AxisVehicle(mass=340.0, drag=dft.Parameter(0.0, transform="linear"))
PULL = {"initial": {"position": 0.1}}


def jason_junior(vehicle=VEHICLE, **more):
    """The loop of the paper's section IV: no compensator, a controller that knows no thruster."""
    return Loop(thruster=THRUSTER, vehicle=vehicle, controller=control.PD(frequency=1.0), **more)


def tracking_loop(compensator, **more):
    more = {"rate": 200.0, "thruster": THRUSTER, **more}
    controller = control.PositionController(bandwidth=1.0, mass=340.0, drag=67.0)
    return Loop(vehicle=VEHICLE, controller=controller, compensator=compensator, **more)


def there_and_back(amplitude):
    return Sinusoid(amplitude, 0.6 * math.pi, offset=amplitude, phase=-math.pi / 2)


def oscillation(time, signal, start):
    """Peak and frequency [rad/s] of what has settled, by the upward zero crossings."""
    t, x = time[time > start], signal[time > start]
    i = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossing = t[i] - x[i] * (t[i + 1] - t[i]) / (x[i + 1] - x[i])
    periods = np.diff(crossing)
    assert np.ptp(periods) < 2e-3 * periods.mean(), "not settled"
    return x.max(), 2 * np.pi / periods.mean()


# The limit cycle of Jason Jr.


@pytest.mark.parametrize(
    ("vehicle", "peak", "frequency"), [(VEHICLE, 15.70, 0.9755), (NO_DRAG, 15.94, 0.978)]
)
def test_the_uncompensated_loop_has_the_limit_cycle_of_the_paper(vehicle, peak, frequency):
    # Yoerger et al. 1990, section IV: 15.6 N at 1 rad/s; the figures are an independent solver's.
    run = jason_junior(vehicle, rate=1000.0).simulate(Step(0.0), 120.0, **PULL)
    found = oscillation(run.time, run["wanted_thrust"], 80.0)
    assert found == (pytest.approx(peak, rel=0.005), pytest.approx(frequency, rel=0.005))
    assert found[0] == pytest.approx(15.6, rel=0.03)
    assert run.diverged is None


def test_the_limit_cycle_is_that_of_scipy():
    p = {name: THRUSTER.parameters[name].value for name in ("alpha", "beta", "ct")}
    volts = p["alpha"] / (p["ct"] * p["beta"])

    def wanted(x, v):
        return -340.0 * (x + 1.414 * v)

    def rates(t, y):
        x, v, w = y
        command = volts * wanted(x, v)
        push = p["ct"] * w * abs(w) - 67.0 * v * abs(v)
        return [v, push / 340.0, p["beta"] * command - p["alpha"] * w * abs(w)]

    # near the cycle already, so that both settle soon
    start = {"position": -0.036, "velocity": 0.0, "speed": 0.0}
    t = np.arange(0.0, 60.0, 0.01)
    found = solve_ivp(rates, (0, 60.0), list(start.values()), "DOP853", t, rtol=1e-8, atol=1e-10)
    truth = oscillation(t, wanted(found.y[0], found.y[1]), 35.0)
    run = jason_junior(rate=2000.0).simulate(Step(0.0), 60.0, initial=start)
    ours = oscillation(run.time, run["wanted_thrust"], 35.0)
    assert ours == pytest.approx(truth, rel=2e-3)


def test_a_sampled_loop_is_that_of_scipy_from_sample_to_sample():
    period, late = 0.1, 1
    p = {name: THRUSTER.parameters[name].value for name in ("alpha", "beta", "ct")}
    volts = p["alpha"] / (p["ct"] * p["beta"])
    reference = Sinusoid(0.2, 1.0)
    y, sent, path = np.array([0.1, 0.0, 0.0]), [0.0] * late, []
    for k in range(60):
        (xd,), (vd,), _ = reference.at(np.array([k * period]))
        sent.append(volts * 340.0 * ((xd - y[0]) + 1.414 * (vd - y[1])))
        command = sent[k]
        path.append([*y, command])

        def rates(t, y, command=command):
            _, v, w = y
            push = p["ct"] * w * abs(w) - 67.0 * v * abs(v)
            return [v, push / 340.0, p["beta"] * command - p["alpha"] * w * abs(w)]

        y = solve_ivp(rates, (0, period), y, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    loop = jason_junior(rate=1.0 / period, delay=late * period)
    run = loop.simulate(reference, 60 * period, **PULL, substeps=16)
    for column, name in enumerate(("position", "velocity", "speed", "command")):
        truth = np.array(path)[:, column]
        np.testing.assert_allclose(run[name][:-1], truth, atol=1e-5 * np.ptp(truth), err_msg=name)


# The record of a loop is a log like any other.


COMMAND = (
    effects.CommandOffset(offset=0.05),
    effects.CommandRateLimit(rate=6.0),
    effects.CommandDeadband(half_width=0.1),
    effects.CommandDelay(delay=0.053),
    effects.CommandSaturation(limit=0.9),
)


def test_simulating_the_log_gives_what_moved_in_the_loop():
    # Streams of delay and rate limit, the order of effects, the hold: all must be as outside.
    missing = (*COMMAND, effects.LinearDamping(rate=0.4), effects.ThrustSensorLag())
    thruster = THRUSTER + missing
    run = tracking_loop(control.Lead.of(THRUSTER), thruster=thruster, rate=50.0).simulate(
        there_and_back(0.03), 12.0, substeps=2
    )
    again = dft.simulate(thruster, run.log, substeps=2, initial={"speed": 0.0})
    np.testing.assert_allclose(again["speed"], run["speed"], atol=1e-9)
    np.testing.assert_allclose(again["thrust"], run["measured.thrust"], atol=1e-9)
    assert np.ptp(run["motor_command"]) == pytest.approx(1.8, rel=0.01)  # the limits are reached
    moved = dft.simulate(VEHICLE, run.vehicle_log)
    np.testing.assert_allclose(moved["position"], run["position"], atol=1e-4)


def test_states_of_effects_and_of_other_models_run_in_a_loop():
    motor = dft.DCMotorThruster(thrust_quadratic=5e-3) + effects.AxialFlow(loss=0.01)
    loop = Loop(
        thruster=motor,
        vehicle=dft.AxisVehicle(mass=20.0, drag=30.0),
        controller=control.PD(frequency=0.7, mass=20.0),
        compensator=control.NoCompensator(thrust_per_volt=5.0),
    )
    run = loop.simulate(Step(1.0, time=1.0), 20.0, substeps=4)
    assert run["position"][-1] == pytest.approx(1.0, abs=0.05)
    again = dft.simulate(motor, run.log, substeps=4, initial={"speed": 0.0})
    np.testing.assert_allclose(again["speed"], run["speed"], atol=1e-6)
    np.testing.assert_allclose(again["axial_flow.flow"], run["axial_flow.flow"], atol=1e-6)


def test_the_inflow_is_the_velocity_of_the_vehicle():
    thruster = THRUSTER + effects.InflowThrustLoss()
    run = tracking_loop(control.Lead.of(THRUSTER), thruster=thruster).simulate(
        there_and_back(0.5), 6.0
    )
    loss = thruster.parameters["inflow_thrust_loss.loss"].value
    lost = loss * np.abs(run["speed"]) * run["velocity"]
    plain = 0.022 * run["speed"] * np.abs(run["speed"])
    np.testing.assert_allclose(run["thrust"], plain - lost, atol=1e-9)
    again = dft.simulate(thruster, run.log, initial={"speed": 0.0}, substeps=1)
    np.testing.assert_allclose(again["thrust"], run["thrust"], atol=1e-9)


@pytest.mark.slow
def test_a_closed_loop_record_is_fitted_and_its_hidden_effect_is_found():
    hidden = THRUSTER + effects.CommandDeadband(half_width=0.25)
    loop = tracking_loop(
        control.Lead.of(THRUSTER),
        thruster=hidden,
        rate=25.0,
        noise={"speed": 0.3, "thrust": 0.2, "position": 0.001},
    )
    train, unseen = (
        loop.simulate(there_and_back(amplitude), 14.0, seed=seed).log
        for seed, amplitude in enumerate((0.05, 0.03))
    )
    found = dft.diagnose(
        dft.Thruster(), train, holdout=unseen, candidates=["command_deadband", "linear_damping"]
    )
    assert found.verdict == "effects_found"
    assert list(found.added) == ["command_deadband"]
    for name in ("alpha", "beta", "ct"):
        truth = hidden.parameters[name].value
        assert found.fit.parameters[name].value == pytest.approx(truth, rel=0.03)
    assert found.fit.parameters["command_deadband.half_width"].value == pytest.approx(
        0.25, abs=0.01
    )


def test_the_vehicle_is_fitted_from_the_same_run():
    loop = tracking_loop(control.Lead.of(THRUSTER), noise={"position": 1e-4}, rate=25.0)
    run = loop.simulate(there_and_back(0.4), 25.0)
    fit = dft.fit(dft.AxisVehicle(mass=200.0, drag=20.0), run.vehicle_log)
    assert fit.parameters["mass"].value == pytest.approx(340.0, rel=0.01)
    assert fit.parameters["drag"].value == pytest.approx(67.0, rel=0.03)


# Compensators, as in the paper's figures 15 to 21.


COMPENSATORS = {
    "none": control.NoCompensator.of(THRUSTER),
    "lead": control.Lead.of(THRUSTER),
    "pole": control.PoleCancellation.of(THRUSTER, floor=0.3),
    "sliding": control.Sliding.of(THRUSTER, floor=0.3),
    "adaptive": control.AdaptiveSliding.of(THRUSTER, floor=0.3),
}


def test_the_compensators_rank_as_in_the_paper():
    def errors(amplitude, faults=()):
        runs = {
            name: tracking_loop(block, faults=faults).simulate(there_and_back(amplitude), 30.0)
            for name, block in COMPENSATORS.items()
            if name != "adaptive"
        }
        return {name: run.tracking(start=15.0).relative for name, run in runs.items()}

    large, small = errors(0.05), errors(0.01)
    for found in (large, small):
        assert found["none"] > 1.15 * found["lead"] > 3.0 * found["pole"]
        assert found["pole"] > 3.0 * found["sliding"]
    assert small["lead"] > 2.0 * large["lead"]  # figures 15 and 16
    assert max(small["pole"], large["pole"]) < 0.15  # figure 17
    assert max(small["sliding"], large["sliding"]) < 0.03  # figure 19
    blocked = errors(0.05, control.duct_obstruction(at=8.0))
    assert blocked["pole"] > 10.0 * large["pole"]  # figure 18
    assert blocked["sliding"] < 0.4 * blocked["pole"]  # its gain exceeds what the load is wrong by


def test_the_ranking_holds_with_noise_and_a_delay():
    noise = {"position": 5e-4, "velocity": 2e-3, "speed": 0.3}
    smooth = {
        name: block.replace(floor=1.0, smoothing=0.05) if name in ("pole", "sliding") else block
        for name, block in COMPENSATORS.items()
        if name != "adaptive"
    }
    loops = {
        name: tracking_loop(block, rate=50.0, delay=0.02, noise=noise)
        for name, block in smooth.items()
    }
    for amplitude in (0.05, 0.01):
        errors = [
            loop.simulate(there_and_back(amplitude), 30.0).tracking(15.0).relative
            for loop in loops.values()
        ]
        assert errors == sorted(errors, reverse=True)
        assert errors[2] < 0.4
        assert errors[3] < 0.12


def test_the_units_of_the_pole_cancellation_are_newtons():
    # 2 alpha / sqrt(ct) is the paper's 0.49; with u in volts it would cancel next to nothing.
    exact = control.PoleCancellation.of(THRUSTER, floor=0.3)
    assert exact.rate == pytest.approx(0.49, rel=0.02)
    volts = exact.replace(rate=0.49 / math.sqrt(exact.thrust_per_volt))
    good, bad = (
        tracking_loop(block).simulate(there_and_back(0.05), 20.0).tracking(10.0).relative
        for block in (exact.replace(rate=0.49), volts)
    )
    assert good < 0.05
    assert bad > 0.7


# Faults, delay, noise.


def test_a_change_of_parameters_acts_from_its_instant_to_its_end():
    fault = control.Change(at=2.0, until=3.0, factors={"thruster.ct": 0.5, "vehicle.drag": 2.0})
    run = tracking_loop(COMPENSATORS["lead"], faults=fault).simulate(there_and_back(0.1), 4.0)
    swept = run["speed"] * np.abs(run["speed"])
    factor = np.where((run.time > 2.0 - 1e-6) & (run.time < 3.0 - 1e-6), 0.5, 1.0)
    np.testing.assert_allclose(run["thrust"], 0.022 * factor * swept, atol=1e-12)
    sound = tracking_loop(COMPENSATORS["lead"]).simulate(there_and_back(0.1), 4.0)
    before = run.time <= 2.0
    np.testing.assert_allclose(run["position"][before], sound["position"][before], atol=1e-12)
    assert np.max(np.abs(run["position"] - sound["position"])) > 1e-3


def test_a_time_constant_may_change_in_a_fault():
    slow = "thruster.actuator_lag.time_constant"
    loop = Loop(
        thruster=THRUSTER + effects.ActuatorLag(time_constant=0.02),
        controller=control.PID(kp=0.0, ki=0.1, limit=2.0),
        faults=control.Change(at=1.0, factors={slow: 25.0}),
    )
    run = loop.simulate(Step(20.0), 3.0)
    reached, drive = run["actuator_lag.response"], 42.0 * run["motor_command"]
    rate = np.diff(reached) / np.diff(run.time)
    late = run.time[:-1] >= 1.2
    middle = 0.5 * (reached[1:] + reached[:-1])
    np.testing.assert_allclose(rate[late], (drive[:-1] - middle)[late] / 0.5, rtol=2e-3)


def test_a_coefficient_of_a_curve_may_change_in_a_fault():
    curve = effects.Curve("propeller", "speed", -60.0, 60.0, shape=(2.0, 1.0))
    loop = Loop(
        thruster=THRUSTER + curve,
        controller=control.PID(kp=0.0, ki=0.1, limit=2.0),
        faults=control.Change(at=1.0, factors={"thruster.curve.level": 3.0}),
    )
    run = loop.simulate(Step(20.0), 2.0)
    ct = THRUSTER.parameters["ct"].value
    added = run["thrust"] - ct * run["speed"] * np.abs(run["speed"])
    level = np.where(run.time > 1.0 - 1e-6, 6.0, 2.0)
    np.testing.assert_allclose(added, level + run["speed"] / 120.0, atol=1e-9)


def test_commands_that_stick_and_limits():
    reference = there_and_back(0.05)
    for fault, value in ((control.Stuck(at=2.0, value=0.7), 0.7), (control.Stuck(at=2.0), None)):
        run = tracking_loop(COMPENSATORS["none"], faults=fault).simulate(reference, 3.0)
        late = run.time >= 2.0
        last = run["command"][~late][-1] if value is None else value
        np.testing.assert_allclose(run["motor_command"][late], last)
        assert np.ptp(run["command"][late]) > 0.1
    fault = control.Limited(at=1.0, limit=0.2)
    run = tracking_loop(COMPENSATORS["none"], faults=fault).simulate(reference, 3.0)
    cut = np.where(run.time >= 1.0 - 1e-6, np.clip(run["command"], -0.2, 0.2), run["command"])
    np.testing.assert_allclose(run["motor_command"], cut)


@pytest.mark.parametrize(("delay", "samples", "late"), [(0.02, 1, 1), (0.01, 2, 1), (0.05, 2, 5)])
def test_the_command_arrives_late_by_the_delay(delay, samples, late):
    run = jason_junior(delay=delay).simulate(Step(0.3), 2.0)
    assert run.time[1] == pytest.approx(0.02 / samples)
    prompt = run["wanted_thrust"] / (0.022 * 42.0 / 0.037)
    np.testing.assert_allclose(run["command"][late:], prompt[:-late], rtol=1e-12)
    assert np.all(run["command"][:late] == 0.0)


def test_noise_reaches_the_controller_and_the_log_and_follows_its_seed():
    loop = jason_junior(noise={"position": 0.01, "speed": 0.5})
    one, same, other = (loop.simulate(Step(0.0), 20.0, seed=s, **PULL) for s in (1, 1, 2))
    np.testing.assert_array_equal(one["position"], same["position"])
    assert np.max(np.abs(one["position"] - other["position"])) > 1e-4
    seen = one.log.measured["position"] - one["position"]
    assert np.std(seen) == pytest.approx(0.01, rel=0.1)
    assert np.std(one.log.measured["speed"] - one["speed"]) == pytest.approx(0.5, rel=0.1)
    np.testing.assert_array_equal(one.log.measured["velocity"], one["velocity"])
    wanted = -340.0 * (one["measured.position"] + 1.414 * one["velocity"])
    np.testing.assert_allclose(one["wanted_thrust"], wanted, rtol=1e-9)


# Compiled once.


class Counted(dft.Thruster):
    """Counts how often its equations are traced."""

    name = "counted"
    traces: ClassVar = 0

    def equations(self, s, port):
        Counted.traces += 1
        return super().equations(s, port)


def test_other_numbers_trace_nothing():
    def run(gain, instant, ct=0.02, noise=0.1, **more):
        loop = Loop(
            thruster=Counted(ct=ct) + effects.CommandDelay(delay=0.01 + instant / 100),
            vehicle=VEHICLE,
            controller=control.PD(frequency=gain),
            compensator=control.Lead(zero=2.0 * gain),
            faults=[control.duct_obstruction(at=instant)],
            noise={"speed": noise},
            **more,
        )
        return loop.simulate(Step(gain), 2.0, initial={"position": gain})

    run(1.0, 1.0)
    before = Counted.traces
    assert before > 0
    run(0.5, 1.5, ct=0.03, noise=0.2)
    run(0.7, 1.2)
    assert Counted.traces == before
    run(0.7, 1.2, delay=0.02)
    assert Counted.traces > before  # the count does count


# Limits and messages.


def test_a_loop_that_runs_away_is_cut_and_marked():
    class Pushing(control.Controller):
        """Feeds back with the wrong sign."""

        reads = ("position", "velocity")

        def __call__(self, s, kept, period):
            return 1e4 * (s.position - s.wanted) * (1.0 + s.position**2), {}

    loop = Loop(thruster=THRUSTER, vehicle=VEHICLE, controller=Pushing())
    run = loop.simulate(Step(0.0), 60.0, **PULL)
    assert run.diverged is not None
    assert 0.5 < run.diverged < 60.0
    assert run.time[-1] < run.diverged
    assert all(np.all(np.isfinite(values)) for values in run.signals.values())
    assert "ran away" in repr(run)
    assert "ran away" in run.log.notes[1]
    figure = run.plot()
    for line in (line for axes in figure.axes for line in axes.get_lines()):
        assert np.all(np.isfinite(np.asarray(line.get_ydata(), float)))
    assert "ran away" in figure.get_suptitle()
    with pytest.raises(InputError, match=r"(?s)ran away at .*first samples.*Mend"):
        loop.replace(rate=0.001).simulate(Step(0.0), 2000.0, **PULL)


def test_the_figure_shows_references_faults_and_estimates():
    block = COMPENSATORS["adaptive"]
    loop = tracking_loop(block, faults=[control.Stuck(at=1.0, until=1.1)])
    figure = loop.simulate(there_and_back(0.05), 2.0).plot()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert len(labels) == 7
    assert labels[0] == "position\n[m]"
    assert labels[-1] == "load estimate\n[V s^2/rad^2]"
    assert any("stuck" in text.get_text() for text in figure.axes[0].texts)
    assert "AdaptiveSliding" in figure.get_suptitle()


class Echo(dft.Effect):
    """An effect of a user that reads the whole record."""

    name = "echo"
    port = "command"
    memory = True
    share: float = dft.parameter(0.1, null=0.0)

    def __call__(self, value, s):
        return value + self.share * jnp.roll(value, 5)


class LaggingSpeed(Echo):
    """The same, on the speed sensor."""

    name = "lagging_speed"
    port = "speed"


class LaggingThrust(Echo):
    """The same, between thruster and vehicle."""

    name = "lagging_thrust"
    port = "thrust"


def test_effects_that_cannot_run_in_a_loop_are_refused_by_name():
    with pytest.raises(InputError, match=r"(?s)'echo' acts on whole records of 'command'.*Mend"):
        jason_junior().replace(thruster=THRUSTER + Echo())
    lagging = THRUSTER + LaggingSpeed()
    with pytest.raises(InputError, match=r"'lagging_speed'.*whole records of 'speed'"):
        tracking_loop(COMPENSATORS["sliding"], thruster=lagging)
    tracking_loop(COMPENSATORS["lead"], thruster=lagging)  # nothing there reads the speed
    with pytest.raises(InputError, match=r"'lagging_thrust'.*between the thruster and the vehicle"):
        jason_junior(VEHICLE + LaggingThrust())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rate": 0.0}, "Loop, rate: expected samples in a second, above zero, found 0.0"),
        ({"rate": math.nan}, "Loop, rate"),
        ({"delay": -0.1}, "Loop, delay: expected seconds, zero or more, found -0.1"),
        ({"delay": 0.0137777}, "simple part of the controller's period, 0.02 s, found 0.01377"),
        ({"noise": {"sped": 0.1}}, r"no channel 'sped' \(the nearest is 'speed'\)"),
        ({"noise": {"speed": -1.0}}, "noise of 'speed': expected zero or more"),
        ({"noise": 0.1}, "Loop, noise: expected a dictionary by the names of channels, found 0.1"),
        ({"given": {"supply_voltage": "x"}}, "given 'supply_voltage': expected a number"),
        ({"gain": 1.0}, "Loop has no argument 'gain'"),
        ({"faults": None}, "faults: expected Change, Stuck or Limited, found None"),
        ({"faults": [3]}, "faults: expected Change, Stuck or Limited, found 3"),
        ({"given": {"inflow": 1.0}}, "given: the loop takes no 'inflow'"),
        ({"controller": "pd"}, "expected a controller, found 'pd'"),
        ({"compensator": "lead"}, "expected a compensator, found 'lead'"),
        ({"vehicle": dft.Vessel()}, "expected a vehicle with the one input 'thrust'"),
        ({"vehicle": None}, "reference of PD is for 'position', which nothing"),
        ({"thruster": dft.LinearSensor()}, "expected a thruster with the input 'command'"),
        ({"thruster": dft.DCMotorThruster(), "compensator": None}, "parameters 'alpha', 'beta'"),
        ({"thruster": THRUSTER + effects.SupplyVoltageSag()}, "needs the input 'supply_voltage'"),
        ({"controller": control.PID(of="position")}, "PID gives a command"),
    ],
)
def test_parts_that_do_not_fit_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        jason_junior(compensator=control.NoCompensator.of(THRUSTER)).replace(**given)


def test_other_arguments_are_refused():
    loop = jason_junior()
    for call, message in (
        (lambda: loop.simulate(Step(0.0), 0.0), "duration: expected seconds, above zero"),
        (lambda: loop.simulate(0.0, 1.0), "reference: expected Sinusoid, Step or Trajectory"),
        (lambda: loop.simulate(Step(0.0), 1.0, initial={"pos": 1}), "no state 'pos'"),
        (lambda: loop.simulate(Step(0.0), 1.0, initial={"speed": math.inf}), "finite number"),
        (lambda: loop.simulate(Step(0.0), 1.0, seed=-1), "seed: expected a whole number"),
        (lambda: loop.simulate(Step(0.0), 1.0, substeps=0), "substeps: expected a whole number"),
        (lambda: loop.replace({"controller.frequncy": 1.0}), "nearest is 'controller.frequency'"),
        (lambda: loop.replace({"controller.damping": -1.0}), "expected a value within"),
        (lambda: control.Change(at=1.0, factors={}), "expected factors"),
        (lambda: control.Stuck(at=1.0, until=0.5), "expected an instant after 1 s"),
        (
            lambda: loop.replace(faults=[control.Change(at=1.0, factors={"controller.mass": 2.0})]),
            "the plant has no parameter 'controller.mass'",
        ),
        (lambda: loop.simulate(Step(0.0), 1.0)["trust"], "no signal 'trust'"),
        (lambda: loop.simulate(Step(0.0), 1.0).tracking(2.0), "expected samples from 2 to 1 s"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_a_supply_is_given_to_the_thruster_and_the_log():
    thruster = THRUSTER + effects.SupplyVoltageSag(share=1.0, nominal=24.0)
    run = jason_junior(given={"supply_voltage": 12.0}).replace
    run = run(thruster=thruster).simulate(Step(0.1), 4.0)
    weak = dft.Thruster(alpha=0.037, beta=21.0, ct=0.022)
    given = {"compensator": control.NoCompensator.of(THRUSTER)}
    again = jason_junior(**given).replace(thruster=weak).simulate(Step(0.1), 4.0)
    np.testing.assert_allclose(run["position"], again["position"], atol=1e-12)
    assert np.all(run.log.inputs["supply_voltage"] == 12.0)


def test_a_record_with_a_lag_simulated_anew_is_the_run():
    lagged = THRUSTER + effects.ActuatorLag(time_constant=0.05)
    loop = Loop(thruster=lagged, vehicle=VEHICLE, controller=control.PD(frequency=1.0))
    run = loop.simulate(Step(0.0), 20.0, initial={"position": 0.3})
    again = dft.simulate(lagged, run.log, substeps=4)
    np.testing.assert_allclose(again["speed"], run["speed"], atol=1e-3)
    fit = dft.fit(lagged, run.log)
    assert fit.parameters["actuator_lag.time_constant"].value == pytest.approx(0.05, rel=1e-3)


def test_a_state_of_an_effect_begins_where_it_is_told():
    lagged = THRUSTER + effects.ActuatorLag(time_constant=0.5)
    time = np.arange(0.0, 2.0, 0.05)
    log = dft.Log(time=time, inputs={"command": np.ones(time.size)}, units={"command": "V"})
    settled = dft.simulate(lagged, log)["actuator_lag.response"]
    told = dft.simulate(lagged, log, initial={"actuator_lag.response": 0.0})[
        "actuator_lag.response"
    ]
    np.testing.assert_allclose(settled, settled[0], rtol=1e-12)
    np.testing.assert_allclose(told, settled[0] * (1.0 - np.exp(-time / 0.5)), atol=1e-6)
