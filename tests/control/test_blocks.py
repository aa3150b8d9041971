"""Controllers, compensators and references by themselves, and gains that are tuned."""

import math
from dataclasses import make_dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

import diffthrust as dft
from diffthrust import InputError, control
from diffthrust.control import HarmonicPath, Loop, Sinusoid, Step, StraightPath, Trajectory
from diffthrust.control._loop_scan import loop_signals  # private: to be differentiated
from diffthrust.models import Signals

THRUSTER = dft.Thruster(alpha=0.037, beta=42.0, ct=0.022)
VEHICLE = dft.AxisVehicle()


class Asks(control.Controller):
    """Asks for the reference itself as the thrust."""

    reads = ()

    def __call__(self, s, kept, period):
        return s.wanted, {}


def asked(reference, compensator, duration=10.0, rate=500.0, **more):
    """A thruster that is asked for a thrust over time, with a compensator and no vehicle."""
    loop = Loop(thruster=THRUSTER, vehicle=VEHICLE, controller=Asks(), compensator=compensator,
                rate=rate)  # fmt: skip
    return loop.simulate(reference, duration, **more)


# Compensators.


def test_the_command_at_rest_gives_the_wanted_thrust():
    for kind in (control.NoCompensator, control.Lead, control.PoleCancellation, control.Sliding):
        run = asked(Step(20.0), kind.of(THRUSTER), rate=100.0, duration=15.0)
        expected = 20.0 if kind is not control.Sliding else 20.0 * 20.0 / 21.0  # its floor
        assert run["thrust"][-1] == pytest.approx(expected, rel=1e-3), kind.__name__


def test_the_lead_network_answers_as_scipy_says():
    block = control.Lead(zero=2.43, pole=6.5, thrust_per_volt=1.0)
    run = asked(Sinusoid(3.0, 2.0, offset=1.0), block, duration=4.0, rate=50.0)
    network = ([6.5 / 2.43, 6.5], [1.0, 6.5])
    numerator, denominator, _ = signal.cont2discrete(network, 0.02, "zoh")
    truth = signal.lfilter(np.ravel(numerator), denominator, run["wanted_thrust"])
    np.testing.assert_allclose(run["command"], truth, rtol=1e-9)


def test_pole_cancellation_is_the_inverse_of_the_thruster():
    # Away from rest the thrust is the wanted one, apart from half a sample of the hold.
    reference = Sinusoid(15.0, 3.0, offset=30.0)
    start = {"initial": {"speed": math.sqrt(30.0 / 0.022)}}
    exact = asked(reference, control.PoleCancellation.of(THRUSTER), **start)
    plain = asked(reference, control.NoCompensator.of(THRUSTER), **start)
    late = exact.time > 5.0
    off = [np.max(np.abs(run["thrust"] - run["wanted_thrust"])[late]) for run in (exact, plain)]
    assert off[0] < 0.01 * 15.0
    assert off[1] > 0.5 * 15.0


def test_within_the_boundary_layer_the_sliding_error_is_a_first_order_lag():
    block = control.Sliding.of(THRUSTER, gain=1.5, width=5.0)
    run = asked(Step(20.0), block, 1.0, initial={"speed": math.sqrt(20.0 * 20.0 / 21.0 / 0.022)})
    rest = run["compensator.wanted_speed"][0]
    run = asked(Step(20.0), block, 0.3, rate=2000.0, initial={"speed": float(rest) + 4.0})
    lag = 1.5 / (5.0 / 42.0)
    truth = 4.0 * np.exp(-lag * run.time)
    np.testing.assert_allclose(run["compensator.sliding_error"], truth, atol=0.02)


def test_nothing_is_learned_within_the_boundary_layer():
    block = control.AdaptiveSliding.of(THRUSTER, width=8.0)
    s = {"time": 0.0, "wanted": 0.0}
    kept = {"load_estimate": 1e-3, "inertia_estimate": 0.02, "smoothed": 5.0, "begun": 1.0}
    for excess, moves in ((7.9, False), (-7.9, False), (8.2, True), (-8.2, True)):
        thrust = jnp.asarray(20.0)
        speed = 20.0 / math.sqrt(0.022 * 21.0) + excess
        _, after = block(thrust, Signals({**s, "speed": jnp.asarray(speed)}), kept, 0.01)
        learned = 1e-3 - float(after["load_estimate"])
        assert (abs(learned) > 0) == moves
        outside = math.copysign(max(abs(excess) - 8.0, 0.0), excess)
        assert learned == pytest.approx(0.01 * block.load_rate * speed**2 * outside, abs=1e-15)


def test_a_compensator_needs_a_thruster_that_it_knows():
    with pytest.raises(InputError, match=r"(?s)Lead.of: .*Lead\(thrust_per_volt=...\)"):
        control.Lead.of(dft.DCMotorThruster())
    with pytest.raises(InputError, match=r"has no gain 'zro' \(the nearest is 'zero'\)"):
        control.Lead().replace(zro=1.0)
    assert control.Lead.of(THRUSTER, zero=3.0).zero == 3.0
    assert repr(control.PD(mass=5.0)) == "PD(frequency=1, damping=0.707, mass=5)"


# The speed loop.


MOTOR = dft.DCMotorThruster()


def test_the_pi_speed_loop_has_no_lasting_error_and_a_p_loop_has():
    for gains, left in (({"kp": 5.0, "ki": 15.0}, 0.0), ({"kp": 5.0}, 0.5)):
        loop = Loop(thruster=MOTOR, controller=control.PID(**gains, limit=13.0), rate=200.0)
        run = loop.simulate(Step(120.0), 8.0)
        assert np.max(run["command"]) <= 13.0
        assert "wanted_thrust" not in run.signals
        if left:
            balance = 5.0 * run["error"][-1]  # what the proportional term gives is the command
            assert balance == pytest.approx(run["command"][-1], rel=1e-6)
            assert run["error"][-1] > left
        else:
            assert run["error"][-1] == pytest.approx(0.0, abs=1e-3)


def test_a_limited_output_does_not_wind_up():
    def overshoot(unwinding):
        controller = control.PID(kp=5.0, ki=15.0, limit=13.0, unwinding=unwinding)
        run = Loop(thruster=MOTOR, controller=controller, rate=200.0).simulate(Step(180.0), 5.0)
        return np.max(run["speed"]) / 180.0 - 1.0

    assert overshoot(5.0 / 15.0) < 0.02
    assert overshoot(math.inf) > 0.1


def test_the_derivative_is_that_of_the_measurement():
    controller = control.PID(of="position", gives="thrust", kp=300.0, kd=400.0, smoothing=0.02)
    loop = Loop(thruster=dft.Thruster(alpha=4.0, beta=4000.0), vehicle=VEHICLE,
                controller=controller, rate=100.0)  # fmt: skip
    run = loop.simulate(Step(1.0, time=0.5), 20.0)
    assert np.max(run["wanted_thrust"]) == pytest.approx(300.0, rel=1e-6)  # no kick
    late = run.time > 2.0
    damped = 300.0 * run["error"] - 400.0 * run["velocity"]
    np.testing.assert_allclose(run["wanted_thrust"][late], damped[late], atol=4.0)
    with pytest.raises(InputError, match="reference of PID is for 'depth', which nothing in the"):
        Loop(thruster=MOTOR, controller=control.PID(of="depth"))
    with pytest.raises(InputError, match="PID, gives: expected command or thrust"):
        control.PID(gives="torque")  # pyright: ignore[reportArgumentType]


# References.


def test_references_give_a_value_and_its_derivatives():
    time = np.linspace(0.0, 4.0, 4001)
    value, rate, curve = Sinusoid(0.2, 3.0, offset=1.0, phase=0.4).at(time)
    np.testing.assert_allclose(np.gradient(value, time)[1:-1], rate[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(rate, time)[1:-1], curve[1:-1], atol=1e-5)
    assert value[0] == pytest.approx(1.0 + 0.2 * math.sin(0.4))
    value, rate, curve = Step(2.0, time=1.0, before=-1.0).at(np.array([0.0, 0.999, 1.0, 3.0]))
    assert value.tolist() == [-1.0, -1.0, 2.0, 2.0]
    assert not rate.any()
    assert not curve.any()
    way = Trajectory([0.0, 1.0, 3.0], [0.0, 1.0, 1.0], rate=[1.0, 1.0, 0.0])
    value, rate, curve = way.at(np.array([-1.0, 0.5, 2.0, 9.0]))
    assert value.tolist() == [0.0, 0.5, 1.0, 1.0]
    assert rate.tolist() == [0.0, 1.0, 0.5, 0.0]
    assert Trajectory([0.0, 1.0], [0.0, 2.0]).at(np.array([0.5]))[1].tolist() == [2.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sinusoid(0.0, 1.0), "Sinusoid, amplitude: expected a positive number, found 0.0"),
        (lambda: Sinusoid(1.0, -1.0), "Sinusoid, frequency"),
        (lambda: Sinusoid(1.0, 1.0, offset="x"), "Sinusoid, offset"),
        (lambda: Step(math.nan), "Step, value: expected a number, found nan"),
        (lambda: Trajectory([0.0, 0.0], [1.0, 1.0]), "two or more increasing instants"),
        (lambda: Trajectory([0.0, 1.0], [1.0, 1.0, 1.0]), "value: expected 2 finite numbers"),
        (lambda: Trajectory([0.0, 1.0], [1.0, math.inf]), "value: expected 2 finite numbers"),
        (lambda: Trajectory([0.0, 1.0], [1.0, 1.0], rate=[1.0]), "rate: expected 2"),
        (lambda: Trajectory("ab", [1.0, 1.0]), "time: expected finite numbers"),
    ],
)
def test_references_that_cannot_be_meant_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("kind", "values"),
    [(Sinusoid, (1.0, 2.0)), (Step, (1.0,)), (StraightPath, (0.8,)), (HarmonicPath, (0.8, 1.0, 9))],
)
def test_a_subclass_of_a_reference_has_fields_of_its_own(kind, values):
    named = make_dataclass("Named", [("label", str, "a")], bases=(kind,), frozen=True)
    assert named(*values).label == "a"


def test_a_trajectory_is_followed():
    time = np.linspace(0.0, 10.0, 201)
    way = Trajectory(time, 0.2 * (1 - np.cos(0.6 * time)), 0.12 * np.sin(0.6 * time),
                     0.072 * np.cos(0.6 * time))  # fmt: skip
    loop = Loop(thruster=THRUSTER, vehicle=VEHICLE, controller=control.PositionController(),
                compensator=control.Sliding.of(THRUSTER), rate=100.0)  # fmt: skip
    assert loop.simulate(way, 10.0).tracking(4.0).relative < 0.05


# Gains through the simulation.


def lead_loop():
    return Loop(
        thruster=THRUSTER,
        vehicle=VEHICLE,
        controller=control.PD(frequency=0.5, damping=0.8),
        compensator=control.Lead.of(THRUSTER),
        noise={"position": 1e-4},
        faults=[control.duct_obstruction(at=4.0)],
    )


GAINS = ["controller.frequency", "controller.damping", "compensator.zero"]


def test_the_gradient_is_that_of_finite_differences():
    loop, reference = lead_loop(), Sinusoid(0.1, 0.8)
    price = control.Effort(price=0.01, start=1.0)
    tuned = control.tune(loop, reference, 8.0, GAINS, cost=price, most=1)

    def cost(parameters):
        run = loop.replace(parameters).simulate(reference, 8.0)
        counts = run.time >= 1.0
        squares = np.sum((run["error"] ** 2 + (0.01 * run["command"]) ** 2)[counts])
        return squares / (2 * run.time.size)

    assert tuned.cost[0] == pytest.approx(cost({}), rel=1e-9)
    for name in GAINS:
        value = loop.parameters[name].value
        step = 1e-5 * value
        slope = (cost({name: value + step}) - cost({name: value - step})) / (2 * step)
        assert tuned.gradient[name] == pytest.approx(slope, rel=1e-4), name


def test_tuned_gains_track_better():
    loop, reference = lead_loop(), Sinusoid(0.1, 0.8)
    tuned = control.tune(loop, reference, 15.0, GAINS, cost=control.Effort(price=1e-3))
    assert tuned.converged
    assert tuned.cost[1] < 0.3 * tuned.cost[0]
    before, after = (one.simulate(reference, 15.0).tracking(5.0).rms for one in (loop, tuned.loop))
    assert after < 0.6 * before
    for name, (first, last) in tuned.gains.items():
        assert first == loop.parameters[name].value
        assert last == tuned.loop.parameters[name].value
    text = tuned.report()
    assert text.splitlines()[0].split() == ["Gain", "Before", "After"]
    assert "controller.frequency" in text
    # a minimum: small steps to either side cost more
    again = control.tune(tuned.loop, reference, 15.0, GAINS, cost=control.Effort(price=1e-3))
    assert again.cost[1] == pytest.approx(tuned.cost[1], rel=1e-3)


def test_a_cost_of_ones_own_and_gains_within_their_bounds():
    def late(signals):
        return jnp.where(signals["time"] > 4.0, signals["error"], 0.0)

    bounded = dft.Parameter(0.5, bounds=(0.1, 0.9), transform="log")
    loop = lead_loop().replace({"controller.frequency": bounded})
    reference = Sinusoid(0.1, 0.8)
    tuned = control.tune(loop, reference, 10.0, "controller.frequency", cost=late)
    assert 0.1 <= tuned.gains["controller.frequency"][1] <= 0.9
    assert tuned.cost[1] < tuned.cost[0]


def test_gains_that_cannot_be_tuned_are_refused():
    loop, reference = lead_loop(), Step(0.1)
    for gains, message in (
        ([], "expected at least one gain"),
        (["controller.freq"], r"no gain 'controller.freq' \(the nearest is 'controller.frequ"),
    ):
        with pytest.raises(InputError, match=message):
            control.tune(loop, reference, 1.0, gains)
    pid = Loop(thruster=MOTOR, controller=control.PID())
    with pytest.raises(InputError, match=r"'controller\.limit' is infinite"):
        control.tune(pid, reference, 1.0, ["controller.limit"])
    with pytest.raises(InputError, match="cost is not finite"):
        control.tune(loop, reference, 1.0, GAINS, cost=lambda s: s["error"] * jnp.nan)


def test_a_loop_is_differentiable_with_respect_to_anything_in_it():
    loop = lead_loop()
    parts, values, given, faults, rows, start = loop.prepared(Sinusoid(0.1, 0.8), 4.0)

    @jax.jit
    def end(values, start):
        return loop_signals(parts, values, given, faults, rows, start)["position"][-1]

    start = {"position": jnp.asarray(0.05)}
    found, from_start = jax.jit(jax.jacfwd(end, (0, 1)))(values, start)
    for name in ("thruster.alpha", "vehicle.mass", "controller.mass", "compensator.pole"):
        step = 1e-5 * values[name]
        slope = (end({**values, name: values[name] + step}, start)
                 - end({**values, name: values[name] - step}, start)) / (2 * step)  # fmt: skip
        assert float(found[name]) == pytest.approx(float(slope), rel=1e-4, abs=1e-9), name
    assert abs(float(from_start["position"])) > 1e-3


def test_the_rate_of_a_ramp_is_its_slope_once_the_low_pass_has_settled():
    smoothed, rates = jnp.zeros(()), []
    for k in range(200):
        begun = jnp.asarray(float(k > 0))
        value = jnp.asarray(3.0 * 0.01 * k)
        rate, smoothed = dft.control.rate_of(value, smoothed, begun, 0.05, jnp.asarray(0.01))
        rates.append(float(rate))
    assert rates[0] == 0.0
    lag = 1 - (0.05 / 0.06) ** np.arange(200)  # of the backward difference, in closed form
    np.testing.assert_allclose(rates, 3.0 * lag, atol=1e-12)
