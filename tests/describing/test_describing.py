"""Describing functions: methods against each other, against closed forms, and at their edges."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import control
import jax.numpy as jnp
import numpy as np
import pytest
import written_fits
import xarray as xr
from compilations import compilations
from test_examples import run
from trajectories import states_behind

import diffthrust as dft
from diffthrust import effects
from diffthrust.describing import DescribingMap, Reason, describing_function, uncertainty

AMPLITUDES = np.geomspace(0.05, 10.0, 8)
FREQUENCIES = np.geomspace(0.1, 30.0, 8)
DEADBAND = dft.Thruster() + effects.CommandDeadband(half_width=0.3)
LAGGED = dft.Thruster() + effects.ActuatorLag(time_constant=0.2)


class Growing(dft.Thruster):
    """A propeller that drives itself above some speed."""

    name = "growing"

    def equations(self, s, port):
        rates, outputs = super().equations(s, port)
        swept = s.speed * jnp.abs(s.speed)
        pushed = jnp.where(jnp.abs(s.speed) > 20.0, 2.0 * self.alpha * swept, 0.0)
        return {"speed": rates["speed"] + pushed}, outputs


class Static(dft.Model):
    """What leaves is what arrives."""

    name = "static"
    inputs = {"command": "V"}
    outputs = {"reading": "V"}
    ports = {"path": "reading [V]"}

    def equations(self, s, port):
        return {}, {"reading": port("path", s.command)}


class FirstOrder(dft.Model):
    """Three times the command, with a lag; one that runs away where its rate is negative."""

    name = "first_order"
    inputs = {"command": "V"}
    states = {"y": "N"}
    outputs = {"y": "N"}
    rate: float = dft.parameter(2.0, "1/s")

    def equations(self, s, port):
        return {"y": self.rate * (3.0 * s.command - s.y)}, {"y": s.y}


class Relay(effects.Effect):
    """An ideal relay."""

    name = "relay"
    port = "path"

    def __call__(self, value, s):
        return 2.0 * jnp.sign(value)


class Backlash(effects.Effect):
    """Play between two gears, on a whole series."""

    name = "backlash"
    port = "command"
    memory = True

    def __call__(self, value, s):
        import jax

        def follow(last, x):
            kept = jnp.clip(last, x - 0.5, x + 0.5)
            return kept, kept

        return jax.lax.scan(follow, value[0], value)[1]


@pytest.fixture(scope="module")
def plain() -> DescribingMap:
    return describing_function(dft.Thruster(), AMPLITUDES, FREQUENCIES)


def compare(first: DescribingMap, second: DescribingMap) -> tuple[float, float]:
    """The largest difference in gain (relative) and phase [deg], where something comes out."""
    assert first.settled.all()
    assert second.settled.all()
    moves = first.gain > 0
    np.testing.assert_array_equal(moves, second.gain > 0)
    ratio = second.complex[moves] / first.complex[moves]
    return float(np.abs(np.abs(ratio) - 1).max()), float(np.abs(np.angle(ratio, deg=True)).max())


@pytest.mark.thorough
@pytest.mark.parametrize(
    "model",
    [dft.Thruster(), *(pytest.param(m, marks=pytest.mark.slow) for m in (DEADBAND, LAGGED))],
    ids=["plain", "deadband", "lag"],
)
def test_harmonic_balance_agrees_with_simulation(model):
    """Wanted are 0.1 % and 0.1 degree; found: 8e-5 and 0.001 degree."""
    maps = [
        describing_function(model, AMPLITUDES, FREQUENCIES, method=method)
        for method in ("simulation", "harmonic_balance")
    ]
    gain, phase = compare(*maps)
    assert gain < 5e-4
    assert phase < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("model", [dft.Thruster(), DEADBAND, LAGGED])
def test_methods_agree_over_a_dense_map(model):
    a, w = np.geomspace(0.05, 10.0, 64), np.geomspace(0.1, 30.0, 64)
    maps = [
        describing_function(model, a, w, method=method)
        for method in ("simulation", "harmonic_balance")
    ]
    gain, phase = compare(*maps)
    print(f"{model}: gain {gain:.1e}, phase {phase:.1e} deg")
    assert gain < 1e-3
    assert phase < 0.1


def test_simulation_agrees_with_a_high_order_integrator(plain):
    """Far past the transient, by an eighth-order method with a tolerance of 1e-10."""
    from scipy.integrate import solve_ivp

    for i, j in ((6, 2), (4, 4)):
        a, w = AMPLITUDES[i], FREQUENCIES[j]
        length = 2 * math.pi / w
        last = np.linspace(29 * length, 30 * length, 4097)[:-1]
        found = solve_ivp(
            lambda t, x, a=a, w=w: 42.0 * a * np.sin(w * t) - 0.037 * x * np.abs(x),
            (0, last[-1]), [0.0], method="DOP853", rtol=1e-10, atol=1e-10, t_eval=last,
        ).y[0]  # fmt: skip
        thrust = 0.019 * found * np.abs(found)
        first = 2 * np.mean(thrust * (np.sin(w * last) + 1j * np.cos(w * last))) / a
        assert abs(plain.complex[i, j] / first - 1) < 2e-5


def test_formulas_are_their_closed_forms():
    alpha, beta, ct = 0.03, 50.0, 0.02
    model = dft.Thruster(alpha=alpha, beta=beta, ct=ct)
    gamma = 8 * alpha / (3 * math.pi)
    for method, weight in (("paper", gamma**4), ("consistent", (gamma * alpha) ** 2)):
        found = describing_function(model, AMPLITUDES, FREQUENCIES, method=method)
        a, w = np.meshgrid(AMPLITUDES, FREQUENCIES, indexing="ij")
        force = ct * beta / alpha * a
        square = (-(w**2) + np.sqrt(w**4 + 4 * weight * (force / ct) ** 2)) / 2
        # the form as printed cancels: eight digits are left of sixteen at worst
        np.testing.assert_allclose(found.break_frequency, np.sqrt(square), rtol=1e-5)
        np.testing.assert_allclose(found.phase, np.degrees(-np.arctan(w / np.sqrt(square))))
        static = ct * beta / alpha
        np.testing.assert_allclose(
            found.gain, static / np.sqrt(1 + (w / found.break_frequency) ** 2), rtol=1e-9
        )
        assert found.settled.all()


@pytest.mark.slow
def test_static_nonlinearities_are_those_of_python_control():
    """Dead zone, saturation and backlash to 1e-4; a relay, which jumps, to 1e-3."""
    a = np.array([0.3, 0.6, 0.9, 2.0, 5.0])
    cases = {
        "saturation": (
            Static() + effects.CommandSaturation(limit=0.8),
            control.saturation_nonlinearity(0.8),
        ),
        "relay": (Static() + Relay(), control.relay_hysteresis_nonlinearity(2.0, 0.0)),
        "backlash": (Static() + Backlash(), control.friction_backlash_nonlinearity(1.0)),
    }
    for name, (model, theirs) in cases.items():
        known = np.array([theirs.describing_function(x) for x in a])
        found = describing_function(model, a, [1.0, 3.0], output="reading")
        assert found.settled.all(), name
        tolerance = 1e-3 if name == "relay" else 1e-4
        np.testing.assert_allclose(
            found.complex, np.repeat(known[:, None], 2, axis=1), atol=tolerance * 2, err_msg=name
        )
    # python-control has no dead zone: one minus a saturation
    found = describing_function(
        Static() + effects.CommandDeadband(half_width=0.8), a, 1.0, output="reading"
    )
    known = 1 - np.array([control.saturation_nonlinearity(0.8).describing_function(x) for x in a])
    np.testing.assert_allclose(found.complex[:, 0], known, atol=1e-4)
    assert found.gain[0, 0] == 0
    assert np.isnan(found.phase[0, 0])


@pytest.mark.slow
def test_delay_and_sensor_lag_settle():
    """Effects with memory on the input and on the output, against their frequency responses."""
    w = np.array([0.5, 3.0, 20.0])
    late = dft.Thruster() + effects.CommandDelay(delay=0.15)
    slow = dft.Thruster() + effects.ThrustSensorLag(time_constant=0.4)
    bare = describing_function(dft.Thruster(), [2.0], w, samples=512)
    found = describing_function(late, [2.0], w, samples=512)
    expected = bare.complex * np.exp(-1j * w * 0.15)
    np.testing.assert_allclose(found.complex, expected, rtol=1e-4)
    assert found.phase[0, -1] < -180  # followed, not wrapped
    found = describing_function(slow, [2.0], w, sensors=True, samples=512)
    np.testing.assert_allclose(found.complex, bare.complex / (1 + 0.4j * w), rtol=2e-4)
    left_out = describing_function(slow, [2.0], w, samples=512)
    np.testing.assert_array_equal(left_out.complex, bare.complex)
    assert "sensors=True" in left_out.notes[0]


@pytest.mark.thorough
def test_bandwidth_and_break_frequency_of_a_lag():
    """A linear model: both are its rate, at every amplitude."""
    w = np.geomspace(0.1, 30, 40)
    found = describing_function(FirstOrder(), [0.1, 10.0], w, output="y", bias=1.0)
    np.testing.assert_allclose(found.break_frequency, 2.0, rtol=1e-4)
    np.testing.assert_allclose(found.bandwidth, 2.0, rtol=5e-3)
    np.testing.assert_allclose(found.static_gain, 3.0, rtol=1e-4)
    np.testing.assert_allclose(found.mean, 3.0, rtol=1e-5)
    assert np.all(found.distortion < 1e-4)
    near = int(np.argmin(np.abs(w - 1.0)))
    assert found.complex[0, near] == pytest.approx(3.0 / (1 + 0.5j * w[near]), rel=1e-3)


def test_small_commands_are_followed_more_slowly(plain):
    """Yoerger et al. 1990, figures 6 and 12: bandwidth grows as the root of the amplitude."""
    assert np.all(np.diff(plain.bandwidth) > 0)
    w = plain.bandwidth
    assert w[-1] / w[3] == pytest.approx(math.sqrt(AMPLITUDES[-1] / AMPLITUDES[3]), rel=0.06)
    np.testing.assert_allclose(plain.static_gain[4:], 0.019 * 42 / 0.037, rtol=3e-3)
    # thrust goes with the square of a sinusoidal speed: a third harmonic of one fifth
    assert plain.distortion is not None
    assert plain.distortion[0, -1] == pytest.approx(0.2, abs=0.01)


def test_diverging_points_are_marked_and_the_others_answered(plain):
    found = describing_function(Growing(), AMPLITUDES, FREQUENCIES, samples=512)
    assert 0 < found.settled.sum() < found.settled.size
    np.testing.assert_allclose(found.complex[0], plain.complex[0], rtol=1e-5)
    assert np.all(found.reason[~found.settled] == Reason.DIVERGES)
    assert np.isnan(found.gain[~found.settled]).all()
    assert "diverges" in found.report()
    drawn(found.plot())
    drawn(found.plot_break())
    data = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert data["gain"][-1][0] is None
    assert data["reasons"]["1"] == "the response diverges"


def test_an_unstable_response_is_marked():
    found = describing_function(FirstOrder(rate=-0.3), [1.0, 2.0], [1.0], output="y", samples=128)
    assert np.all(found.reason == Reason.UNSTABLE)


def test_what_changes_with_the_clock_is_marked():
    model = dft.Thruster() + effects.ThrustDegradation()
    found = describing_function(model, [1.0], [0.5, 5.0], samples=128)
    assert np.all(found.reason == Reason.CLOCK)


@pytest.mark.parametrize(
    "method", ["simulation", pytest.param("harmonic_balance", marks=pytest.mark.thorough)]
)
def test_a_drift_spoils_only_what_sees_it(method):
    for output, settles in (("velocity", True), ("position", False)):
        found = describing_function(
            dft.AxisVehicle(), [50.0], [0.2], input="thrust", output=output, bias=10.0,
            method=method, samples=128, harmonics=5,
        )  # fmt: skip
        assert found.settled.all() == settles


def test_states_that_the_output_does_not_feel_are_left_out():
    twin = dft.Vessel(drive="twin")
    signals = {"left_force": 1.0, "right_force": 0.0, "time": 0.0}
    assert states_behind(twin, "yaw_rate", tuple(twin.all_states), signals) == (
        "surge", "sway", "yaw_rate",
    )  # fmt: skip
    assert states_behind(twin, "north", tuple(twin.all_states), signals) == (
        "surge", "sway", "yaw_rate", "north", "heading",
    )  # fmt: skip
    states = tuple(LAGGED.all_states)
    assert states_behind(LAGGED, "thrust", states, {"command": 1.0, "time": 0.0}) == states


def test_beyond_saturation_is_said():
    model = dft.Thruster() + effects.CommandSaturation(limit=2.0)
    found = describing_function(model, [1.0, 4.0], [0.1], samples=256)
    assert "beyond 2 V are cut by 'command_saturation'" in found.report().replace("\n", " ")
    assert found.gain[1, 0] < 0.7 * found.gain[0, 0]


def test_other_inputs_and_a_prescribed_speed():
    model = dft.Thruster() + effects.InflowThrustLoss(loss=0.5)
    with pytest.raises(dft.InputError, match=r"(?s)also reads 'inflow'.*others="):
        describing_function(model, [1.0], [1.0])
    less = describing_function(model, [1.0], [1.0], others={"inflow": 0.2}, samples=128)
    assert less.settled.all()
    found = describing_function(dft.Thruster(), [5.0, 10.0], [1.0], input="speed")
    known = 0.019 * 8 / (3 * math.pi) * np.array([5.0, 10.0])
    np.testing.assert_allclose(found.complex[:, 0], known, rtol=1e-4)
    assert found.gain_unit == "N/(rad/s)"


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"amplitudes": [0.0, 1.0]}, "amplitudes: expected positive numbers, found 0"),
        ({"frequencies": [-1.0]}, "frequencies: expected positive numbers, found -1"),
        ({"amplitudes": [np.nan]}, "expected finite numbers"),
        ({"amplitudes": []}, "expected finite numbers"),
        ({"frequencies": [2.0, 1.0]}, "expected increasing numbers"),
        ({"amplitudes": "big"}, "expected finite numbers"),
        ({"input": "comand"}, "input: expected one of 'command'.*nearest is 'command'"),
        ({"output": "trust"}, "output: expected one of.*nearest is 'thrust'"),
        ({"method": "simulate"}, "method: expected one of.*nearest is 'simulation'"),
        ({"method": "paper", "model": LAGGED}, "does not cover the effects 'actuator_lag'"),
        ({"method": "consistent", "bias": 1.0}, "does not cover a bias of 1"),
        ({"method": "paper", "model": dft.DCMotorThruster()}, "the model 'dc_motor_thruster'"),
        ({"harmonics": 0, "method": "harmonic_balance"}, "harmonics: expected a whole number"),
        ({"samples": 20, "method": "harmonic_balance"}, "15 harmonics need at least 30"),
        ({"samples": 2.5}, "samples: expected a whole number"),
        ({"bias": math.inf}, "bias: expected a finite number"),
        ({"others": {"wind": 1.0}}, "no further input 'wind'"),
        ({"others": 3}, "others: expected a dictionary"),
        ({"model": "thruster"}, "expected a model or a fit"),
    ],
)
def test_bad_input_is_answered_in_words(change, match):
    given = {"model": dft.Thruster(), "amplitudes": [1.0], "frequencies": [1.0], **change}
    with pytest.raises(dft.InputError, match=f"(?s){match}"):
        describing_function(**given)


def test_maps_of_every_size_share_one_compilation():
    model = dft.Thruster() + effects.LinearDamping(rate=0.1)
    describing_function(model, AMPLITUDES, FREQUENCIES, samples=128)
    before = compilations()
    for a in (AMPLITUDES[::2], np.geomspace(0.06, 9.0, 13)):
        describing_function(model.replace(alpha=0.03), a, FREQUENCIES, samples=128)
    assert compilations() == before


def test_given_samples_are_taken():
    found = describing_function(dft.Thruster(), [1.0], [1.0, 2.0], samples=128)
    assert np.all(found.samples == 128)


def drawn(figure) -> None:
    figure.canvas.draw()


def test_figures_and_report(plain):
    drawn(plain.plot())
    drawn(plain.plot_break())
    few = describing_function(
        DEADBAND, [0.1, 1.0], FREQUENCIES, samples=512
    )  # the first moves nothing
    drawn(few.plot())
    drawn(few.plot_break())
    drawn(describing_function(DEADBAND, AMPLITUDES, FREQUENCIES, samples=512).plot())
    drawn(describing_function(DEADBAND, [0.1], [1.0], samples=512).plot())
    text = plain.report()
    assert "64 points, 64 of them settled" in text
    assert "N/V" in text
    assert json.loads(json.dumps(plain.to_json(), allow_nan=False))["gain_unit"] == "N/V"


def test_uncertainty_follows_the_draws(plain):
    """Gain at low frequency is ct beta / alpha, so its interval is that of the ratio."""
    model = dft.Thruster()
    alpha = 0.037 * np.exp(0.05 * np.random.default_rng(0).standard_normal((4, 50)))
    draws = {"alpha": alpha, "beta": np.full_like(alpha, 42.0), "ct": np.full_like(alpha, 0.019)}
    data = xr.Dataset({name: (("chain", "draw"), value) for name, value in draws.items()})
    post = SimpleNamespace(posterior=data, attrs={})
    band = uncertainty(post, model, amplitudes=[2.0, 8.0], frequencies=[0.02, 2.0], draws=200)
    static = np.quantile(0.019 * 42 / alpha, [0.5, 0.025, 0.975])
    np.testing.assert_allclose(band.gain[:, 1, 0], static, rtol=2e-3)
    assert np.all(band.gain[1] <= band.gain[0])
    assert np.all(band.gain[0] <= band.gain[2])
    assert np.all(band.settled == 1)
    drawn(band.plot())
    assert "95 % from" in band.report()
    json.dumps(band.to_json(), allow_nan=False)
    formula = uncertainty(
        post, model, amplitudes=[2.0, 8.0], frequencies=[0.02, 2.0], draws=50, method="consistent"
    )
    np.testing.assert_allclose(formula.gain[0, :, 0], band.gain[0, :, 0], rtol=0.03)


@pytest.mark.slow
def test_the_example_runs(tmp_path):
    assert "1024 points, 1024 of them settled" in run("describing_function", tmp_path)
    assert len(list(tmp_path.glob("figures/*.png"))) == 5


@pytest.mark.thorough
def test_maps_of_a_fit_are_told_and_drawn_in_the_units_of_its_logs():
    fit, grids = written_fits.fit(), {"amplitudes": [0.25, 0.5, 1.0], "frequencies": [0.5, 1, 2]}
    found = describing_function(fit, **grids, bias=0.1)
    assert (found.input_unit, found.output_unit) == ("effort", "N")
    per = written_fits.KGF / 400
    shown = found.shown
    np.testing.assert_allclose(shown.amplitudes, [100.0, 200.0, 400.0])
    np.testing.assert_allclose(shown.gain, per * found.gain, rtol=1e-12)
    np.testing.assert_allclose(shown.mean, written_fits.KGF * found.mean, rtol=1e-12)
    assert shown.bias == pytest.approx(1540.0)  # a width, not a difference
    table = found.report()
    assert "about 1540 us" in table
    assert "[us]" in table
    assert "kgf/us" in table
    assert "effort" not in table
    gain, phase = found.plot().axes[:2]
    assert gain.get_ylabel() == phase.get_ylabel() == "amplitude of the command [us]"
    assert gain.get_title(loc="left") == "gain [kgf/us]"
    data = json.loads(json.dumps(found.to_json()))
    assert (data["input"]["unit"], data["gain_unit"]) == ("effort", "N/effort")
    assert data["written"]["gain_unit"] == "kgf/us"
    np.testing.assert_allclose(data["written"]["gain"], per * found.gain, rtol=1e-12)
    of_a_model = describing_function(fit.model, **grids, bias=0.1)
    np.testing.assert_array_equal(of_a_model.shown.gain, found.gain)


@pytest.mark.thorough
def test_bands_of_a_fit_are_told_and_drawn_in_the_units_of_its_logs():
    grids = {"amplitudes": [0.25, 0.5], "frequencies": [0.5, 1.0]}
    band = uncertainty(written_fits.fit(), **grids, output="speed", draws=20)
    assert band.gain_unit == "(rad/s)/effort"
    np.testing.assert_allclose(band.shown.gain, written_fits.RPM / 400 * band.gain, rtol=1e-12)
    assert "rpm/us" in band.report()
    assert "effort" not in band.report()
    assert band.plot().axes[0].get_ylabel() == "gain [rpm/us]"
    data = json.loads(json.dumps(band.to_json()))
    assert data["written"]["gain"]["unit"] == "rpm/us"
    assert data["written"]["amplitudes"] == [100.0, 200.0]
