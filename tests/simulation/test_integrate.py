"""The integrator held against closed forms, high-precision arithmetic and SciPy."""

from decimal import Decimal, getcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import inputs
from reference.thruster import exact_spin
from scipy.integrate import solve_ivp
from trajectories import exponential_weights, integrate

import diffthrust as dft
from diffthrust import Log, simulate
from diffthrust.effects import ActuatorLag
from diffthrust.models import Relaxing

# Order.

SWING = 1.5 + 0.8 * np.sin(3.0 * inputs.grid(2.0, 0.05))


@pytest.mark.parametrize(
    ("model", "step", "volts", "start", "finest"),
    [
        (dft.Thruster(), 0.05, SWING, {"speed": 30.0}, 8),
        (dft.Thruster() + ActuatorLag(time_constant=0.08), 0.05, SWING, {"speed": 30.0}, 32),
        (dft.Thruster() + ActuatorLag(time_constant=0.01), 0.02, SWING, {"speed": 30.0}, 32),
        (dft.DCMotorThruster(), 0.002, 6.0 * SWING, {"speed": 200.0, "current": 1.0}, 32),
        (dft.AxisVehicle(), 1.0, 100.0 * SWING, {"velocity": 1.0}, 8),
    ],
    ids=lambda value: str(value) if isinstance(value, dft.Model) else None,
)
def test_fourth_order_where_everything_is_smooth(model, step, volts, start, finest):
    name = "thrust" if isinstance(model, dft.AxisVehicle) else "command"
    log = Log(step * np.arange(len(volts)), {name: volts}, hold="linear")
    seen = "velocity" if isinstance(model, dft.AxisVehicle) else "speed"

    def run(substeps):
        return simulate(model, log, initial=start, substeps=substeps)[seen]

    fine = run(16 * finest)
    errors = np.array([np.max(np.abs(run(k) - fine)) for k in (finest // 2, finest, 2 * finest)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders > 3.8) & (orders < 4.2)), (orders, errors)


def test_the_lag_as_a_whole_converges_to_its_own_equations_at_fourth_order():
    # The order above is measured against the integrator itself; this is what it converges to.
    tau, alpha, beta = 0.08, 0.037, 42.0
    time = inputs.grid(2.0, 0.05)
    log = Log(time, {"command": SWING}, hold="linear")
    model = dft.Thruster(alpha=alpha, beta=beta) + ActuatorLag(time_constant=tau)

    state, exact = [30.0, beta * SWING[0]], [30.0]
    for a, b, u, w in zip(time[:-1], time[1:], SWING[:-1], SWING[1:], strict=True):

        def rates(t, x, a=a, b=b, u=u, w=w):
            drive = beta * (u + (w - u) * (t - a) / (b - a))
            return [
                x[1] - alpha * x[0] * abs(x[0]),
                (drive - x[1]) / (tau + 1e-9),
            ]  # as ActuatorLag

        state = solve_ivp(rates, (a, b), state, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        exact.append(state[0])
    errors = np.array(
        [
            np.max(
                np.abs(simulate(model, log, initial={"speed": 30.0}, substeps=k)["speed"] - exact)
            )
            for k in (8, 16, 32)
        ]
    )
    assert errors[-1] < 1e-8
    assert np.all(np.abs(np.log2(errors[:-1] / errors[1:]) - 4.0) < 0.2), errors


# Closed forms.


@pytest.mark.parametrize(
    ("command", "initial"), [(2.0, 0.0), (2.0, 30.0), (1.0, 80.0), (2.0, -50.0), (-3.0, 60.0)]
)
def test_constant_command_agrees_with_tanh_coth_and_tan(command, initial):
    time = inputs.grid(3.0, 0.02)
    log = Log(time, {"command": np.full(time.size, command)})
    speed = simulate(dft.Thruster(), log, initial={"speed": initial}, substeps=32)["speed"]
    exact, turned = exact_spin(time, command, initial, 0.037, 42.0)
    assert turned[-1]
    np.testing.assert_allclose(speed, exact, rtol=1e-8, atol=1e-8)


def test_a_long_log_stays_accurate():
    # 200 000 steps of a staircase through both directions; the closed form chained stair by stair.
    rng = np.random.default_rng(2)
    stairs, dwell, step = 400, 500, 0.01
    levels = rng.uniform(0.5, 3.0, stairs) * np.where(np.arange(stairs) % 2, 1.0, -1.0)
    time = step * np.arange(stairs * dwell + 1)
    log = Log(time, {"command": np.append(np.repeat(levels, dwell), levels[-1])})
    speed = simulate(dft.Thruster(), log, initial={"speed": 0.0}, substeps=1)["speed"]
    within = step * np.arange(1, dwell + 1)
    exact, last = [np.zeros(1)], 0.0
    for level in levels:
        exact.append(exact_spin(within, level, last, 0.037, 42.0)[0])
        last = exact[-1][-1]
    errors = np.abs(speed - np.concatenate(exact))
    assert np.max(errors) < 1e-5
    half = errors.size // 2
    assert np.max(errors[half:]) < 3.0 * np.max(errors[:half])


def test_an_oscillation_keeps_its_phase_over_many_turns():
    def rates(s, u):
        return {"x": s["v"], "v": -s["x"]}

    count, step = 100_000, 0.01
    steps = jnp.full(count, step)
    path = integrate(rates, {"x": 1.0, "v": 0.0}, {"u": (jnp.zeros(count),)}, steps, {})
    # The classical method turns too slowly by h^4 / 120 of the angle; nothing else may add.
    late = step**4 / 120.0 * count * step
    np.testing.assert_allclose(path["x"], np.cos(step * np.arange(count + 1)), atol=1.01 * late)


@pytest.mark.parametrize("steps_per_lag", [1e-3, 1e-2, 0.1, 0.5, 1.0, 2.0, 10.0, 1e2, 1e3])
def test_the_step_response_of_a_lag_is_exact(steps_per_lag):
    count, tau = 3000, steps_per_lag

    def rates(s, u):
        return {"y": Relaxing((u["u"] - s["y"]) / tau, 1.0 / tau)}

    held = {"u": (jnp.ones(count),)}
    path = integrate(rates, {"y": 0.0}, held, jnp.ones(count), {})
    exact = -np.expm1(-np.arange(count + 1.0) / tau)
    np.testing.assert_allclose(path["y"], exact, rtol=1e-12, atol=1e-15)


def test_a_lag_under_a_ramp_is_exact_at_any_speed():
    for tau in 10.0 ** np.arange(-6.0, 4.0):

        def rates(s, u, tau=tau):
            return {"y": Relaxing((u["u"] - s["y"]) / tau, 1.0 / tau)}

        edge = jnp.arange(51.0)
        path = integrate(rates, {"y": 0.0}, {"u": (edge[:-1], edge[1:])}, jnp.ones(50), {})
        t = np.arange(51.0)
        np.testing.assert_allclose(path["y"], t + tau * np.expm1(-t / tau), rtol=1e-9, atol=1e-10)


# A lag much shorter than the step.


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("share", [1e-9, 1e-6, 1e-5, 1e-4, 1e-3])
def test_a_lag_far_below_the_step_is_the_model_without_it(share, hold):
    rng = np.random.default_rng(3)
    time = inputs.grid(20.0, 0.05)
    command = inputs.staircase(time, rng.uniform(-3.0, 3.0, 40), 0.5)
    log = Log(time, {"command": command}, hold=hold)
    tau = 0.05 * share + 1e-9  # ActuatorLag adds a nanosecond
    plain = simulate(dft.Thruster(), log, initial={"speed": 0.0}, substeps=1)["speed"]
    lag = ActuatorLag(time_constant=0.05 * share)
    lagged = simulate(dft.Thruster() + lag, log, initial={"speed": 0.0}, substeps=1)["speed"]
    # A true lag delays the drive by tau: the speed differs by about tau times the jump of drive.
    delay = tau * 42.0 * np.ptp(command)
    assert np.max(np.abs(lagged - plain)) < 3.0 * delay + 1e-9


def test_a_short_lag_agrees_with_its_exact_drive():
    # The drive of a lag under held commands is known; the speed under it comes from DOP853.
    tau, alpha, beta = 1e-3, 0.037, 42.0
    time = inputs.grid(2.0, 0.05)
    command = inputs.staircase(time, [1.0, 3.0, 2.0, 4.0], 0.5)
    log = Log(time, {"command": command})
    model = dft.Thruster(alpha=alpha, beta=beta) + ActuatorLag(time_constant=tau)
    speed = simulate(model, log, initial={"speed": 20.0}, substeps=1)["speed"]
    plain = simulate(dft.Thruster(), log, initial={"speed": 20.0}, substeps=1)["speed"]
    drive, w, exact = beta * command[0], 20.0, [20.0]
    for h, u in zip(np.diff(time), command[:-1], strict=True):

        def rates(t, x, begin=drive, u=u):
            lagged = beta * u + (begin - beta * u) * np.exp(-t / tau)
            return [lagged - alpha * x[0] * abs(x[0])]

        w = solve_ivp(rates, (0.0, h), [w], "DOP853", rtol=1e-11, atol=1e-11).y[0, -1]
        drive = beta * u + (drive - beta * u) * np.exp(-h / tau)
        exact.append(w)
    effect = np.max(np.abs(plain - exact))
    assert effect > 0.05  # the lag can be seen,
    assert np.max(np.abs(speed - exact)) < 0.1 * effect  # and what is seen is its true size


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 1.0, 3.0, 10.0])
def test_no_lag_blows_up_whatever_its_size(share):
    rng = np.random.default_rng(4)
    time = inputs.grid(20.0, 0.05)
    log = Log(time, {"command": rng.uniform(-3.0, 3.0, time.size)})
    model = dft.Thruster() + ActuatorLag(time_constant=0.05 * share)
    path = simulate(model, log, initial={"speed": 0.0}, substeps=1)
    assert np.max(np.abs(path["actuator_lag.response"])) <= 42.0 * 3.0
    assert np.max(np.abs(path["speed"])) <= np.sqrt(42.0 * 3.0 / 0.037)


# Weights of the exponential form, against 80 digits.

getcontext().prec = 80
RATIOS = [1e-9, 1e-7, 1e-4, 0.03, 0.5, 0.999999, 1.0, 1.000001, 1.5, 4.0, 30.0, 1e3]


def exact_weights(r: Decimal) -> dict[str, Decimal]:
    """The weights as Cox and Matthews print them, and the corrections of `_integrate`."""
    z = -r
    e, eh = z.exp(), (z / 2).exp()
    simpson = (1 + 4 * eh + e) / 6
    short = 1 / (81 + r**4)
    return {
        "kept": e,
        "half": eh,
        "grown": (eh - 1) / (z / 2),
        "first": (-4 - z + e * (4 - 3 * z + z * z)) / z**3,
        "both": (2 + z + e * (z - 2)) / z**3,
        "last": (-4 - 3 * z - z * z + e * (4 - z)) / z**3,
        "start": r**3 * short,
        "mean": r**3 * (Decimal("1.5") * ((e - 1) / z - simpson) / z**4 + short / 4),
    }


@pytest.mark.parametrize("ratio", RATIOS)
def test_weights_have_all_their_digits(ratio):
    found = exponential_weights(jnp.array(1.0), jnp.array(ratio))
    for name, exact in exact_weights(Decimal(ratio)).items():
        assert float(found[name]) == pytest.approx(float(exact), rel=1e-12, abs=1e-300), name


@pytest.mark.parametrize("ratio", RATIOS)
def test_derivatives_of_the_weights_have_all_their_digits(ratio):
    slopes = jax.jacfwd(lambda r: exponential_weights(jnp.array(1.0), r))(jnp.array(ratio))
    r, d = Decimal(ratio), Decimal(ratio) * Decimal("1e-12")
    above, below = exact_weights(r + d), exact_weights(r - d)
    for name in above:
        exact = float((above[name] - below[name]) / (2 * d))
        assert float(slopes[name]) == pytest.approx(exact, rel=1e-9, abs=1e-7), name


def test_weights_and_their_derivatives_are_continuous_where_the_form_changes():
    both = jax.jit(
        lambda r: (
            exponential_weights(jnp.array(1.0), r),
            jax.jacfwd(exponential_weights, 1)(jnp.array(1.0), r),
        )
    )
    below, above = both(jnp.array(np.nextafter(1.0, 0.0))), both(jnp.array(1.0))
    for a, b in zip(jax.tree.leaves(below), jax.tree.leaves(above), strict=True):
        assert float(a) == pytest.approx(float(b), abs=1e-12)


@jax.jit
def lagged_end(tau):
    """The last speed of a thruster-like system behind a lag."""
    count, step = 50, 0.05
    command = jnp.asarray(np.sin(np.arange(count + 1.0)))
    decay = 1.0 / jnp.maximum(tau, 1e-9)

    def rates(s, u):
        lag = Relaxing(decay * (u["u"] - s["y"]), decay)
        return {"y": lag, "x": s["y"] - s["x"] * jnp.abs(s["x"])}

    held = {"u": (command[:-1],)}
    return integrate(rates, {"y": 0.0, "x": 0.0}, held, jnp.full(count, step), {})["x"][-1]


forward, reverse = jax.jit(jax.jacfwd(lagged_end)), jax.jit(jax.grad(lagged_end))


@pytest.mark.parametrize("tau", [0.0, 1e-300, 1e-12, 1e-9, 1e-6, 1e-3, 0.05, 1.0, 1e3, 1e9])
def test_gradients_of_a_lag_are_finite_at_every_time_constant(tau):
    slope = float(forward(tau))
    assert np.isfinite(float(lagged_end(tau)))
    assert np.isfinite(slope)
    assert float(reverse(tau)) == pytest.approx(slope, rel=1e-6, abs=1e-12)


# Restarts.


def test_a_restart_sets_the_state_with_its_own_sign_where_the_sensor_is_unsigned():
    def rates(s, u):
        return {"x": 0.0 * s["x"] - 1.0}

    anew = jnp.asarray([np.nan, np.nan, 5.0, np.nan])
    given = ({"x": -1.0}, {"u": (jnp.zeros(4),)}, jnp.ones(4))
    signed = integrate(rates, *given, {"x": (anew, False)})["x"]
    unsigned = integrate(rates, *given, {"x": (anew, True)})["x"]
    np.testing.assert_allclose(signed, [-1.0, -2.0, -3.0, 4.0, 3.0])
    np.testing.assert_allclose(unsigned, [-1.0, -2.0, -3.0, -6.0, -7.0])


def test_a_model_without_states_integrates_nothing():
    assert integrate(lambda s, u: {}, {}, {}, jnp.ones(3), {}) == {}


# How the same steps are compiled.

STEP = 0.05


def of_a_pair(steps, command, **how):
    """A fast relaxing state and a plain one behind it, driven by a command that runs linearly."""

    def rates(s, u):
        lag = Relaxing((u["u"] - s["y"]) / 0.01, 1 / 0.01)
        return {"y": lag, "x": s["y"] - s["x"] * jnp.abs(s["x"])}

    given = {"u": (jnp.asarray(command[:-1]), jnp.asarray(command[1:]))}
    return integrate(rates, {"y": 0.3, "x": -0.2}, given, jnp.asarray(steps), {}, **how)


@pytest.mark.parametrize("how", [{}, {"uniform": True}, {"substeps": 3}])
def test_stages_in_a_loop_give_what_stages_in_a_row_do(how):
    steps, command = np.full(40, STEP), np.sin(np.arange(41.0))
    plain, looped = (of_a_pair(steps, command, **how, compact=compact) for compact in (False, True))
    for name in plain:
        np.testing.assert_allclose(looped[name], plain[name], rtol=1e-12, atol=1e-14)


@pytest.mark.thorough
def test_a_divided_step_is_as_many_short_ones():
    time = STEP * np.arange(21)
    command = np.sin(np.arange(21.0))
    fine = np.linspace(0.0, time[-1], 4 * 20 + 1)
    short = of_a_pair(np.diff(fine), np.interp(fine, time, command))
    divided = of_a_pair(np.diff(time), command, substeps=4)
    for name in short:
        np.testing.assert_allclose(divided[name], short[name][::4], rtol=1e-11, atol=1e-13)


@pytest.mark.thorough
@pytest.mark.parametrize("how", [{}, {"substeps": 3}, {"compact": True}])
def test_what_a_log_is_padded_with_is_left_out(how):
    steps, command = np.full(30, STEP), np.sin(np.arange(31.0))
    whole = of_a_pair(steps, command, **how)
    longer = np.append(steps, np.zeros(12)), np.append(command, np.full(12, command[-1]))
    padded = of_a_pair(*longer, **how, padded=True)
    for name in whole:
        np.testing.assert_allclose(padded[name][:31], whole[name], rtol=1e-13, atol=0)
        np.testing.assert_array_equal(padded[name][31:], padded[name][0])
    slopes = jax.jacfwd(
        lambda level: of_a_pair(longer[0], level * longer[1], **how, padded=True)["x"]
    )
    short = jax.jacfwd(lambda level: of_a_pair(steps, level * command, **how)["x"])
    np.testing.assert_allclose(slopes(1.0)[:31], short(1.0), rtol=1e-11, atol=1e-14)
