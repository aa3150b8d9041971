"""Laws of unknown form: splines, priors, memory, and their way through fits and files."""

import numpy as np
import pytest
from hidden.outside import THRUSTER_TABLE
from lines_to_copy import effects_line
from reference import inputs, noise, thruster
from scipy.interpolate import BSpline

import diffthrust as dft
from diffthrust.effects import Curve


def as_spline(curve: Curve) -> BSpline:
    """The same curve by SciPy: coefficients found from its values, on its own knots."""
    step = (curve.high - curve.low) / curve.pieces
    knots = curve.low + step * np.arange(-3.0, curve.pieces + 4.0)
    at = np.linspace(curve.low, curve.high, 400)
    rows = BSpline.design_matrix(at, knots, 3).toarray()
    values = np.asarray(curve.at_signal(at))
    weights = np.linalg.lstsq(rows, values, rcond=None)[0]
    assert np.allclose(rows @ weights, values, atol=1e-9)  # it is a cubic spline on these knots
    return BSpline(knots, weights, 3)


def test_a_curve_is_a_cubic_spline_on_an_even_grid_that_ends_within_three_pieces():
    rng = np.random.default_rng(3)
    curve = Curve("load", "speed", -30.0, 50.0, shape=rng.standard_normal(11))
    as_spline(curve)
    x = np.linspace(-80.0, 100.0, 301)
    seen = np.asarray(curve.at_signal(x))
    assert np.allclose(curve.shape @ curve.basis(x), seen, atol=1e-12)
    assert np.abs(seen[(x < -60.0) | (x > 80.0)]).max() < 1e-10
    assert np.abs(np.diff(seen)).max() < 0.1 * np.ptp(seen)  # no jump anywhere


def test_level_slope_and_bends_mean_what_they_say():
    at = np.linspace(-1.0, 3.0, 50)
    flat = Curve("load", "speed", -1.0, 3.0, shape=(2.0, 8.0))
    assert np.allclose(flat.at_signal(at), 2.0 + 8.0 * (at - 1.0) / 4.0)
    # bends of unit prior are those of the second-difference penalty: its value is their square sum
    rng = np.random.default_rng(1)
    curve = Curve("load", "speed", -1.0, 3.0, shape=(0.0, 0.0, *rng.standard_normal(9)))
    weights = as_spline(curve).c
    penalty = np.sum(np.diff(weights, 2) ** 2) * curve.pieces**3
    assert np.isclose(penalty, np.sum(np.square(curve.shape)), rtol=1e-6)


@pytest.mark.parametrize("times", ["", "value", "abs(speed)"])
def test_at_zero_it_changes_nothing_and_is_multiplied_by_what_is_asked(times):
    time = np.arange(200) * 0.05
    log = dft.Log(time=time, inputs={"command": 8.0 * np.sin(time)}, units={"command": "V"})
    plain = dft.simulate(dft.Thruster(), log)["speed"]
    curve = Curve("load", "speed", -60.0, 60.0, times=times)
    at_null = dft.simulate(dft.Thruster() + curve, log)["speed"]
    assert np.allclose(at_null, plain, rtol=1e-12, atol=1e-12)
    constant = Curve("load", "speed", -1e3, 1e3, times=times, shape=(0.1,))
    seen = dft.simulate(dft.Thruster() + constant, log, substeps=16)["speed"]
    expected = _by_hand(time, 8.0 * np.sin(time), times)
    assert np.allclose(seen, expected, atol=1e-5)


def _by_hand(time: np.ndarray, command: np.ndarray, times: str) -> np.ndarray:
    """The thruster with a constant in its load, by SciPy."""
    from scipy.integrate import solve_ivp

    model = dft.Thruster()

    def rate(t: float, w: np.ndarray) -> np.ndarray:
        load = model.alpha * w * np.abs(w)
        more = {"": 0.1, "value": 0.1 * load, "abs(speed)": 0.1 * np.abs(w)}[times]
        return model.beta * held - load - more

    speeds, w = [0.0], np.zeros(1)
    for k in range(len(time) - 1):
        held = command[k]
        w = solve_ivp(rate, time[k : k + 2], w, method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
        speeds.append(float(w[0]))
    return np.array(speeds)


@pytest.mark.thorough
def test_a_fit_finds_a_hump_that_the_reference_simulator_has_hidden():
    rng = np.random.default_rng(5)
    time = inputs.grid(60.0, 0.05)
    command = inputs.staircase(time, list(rng.uniform(-9.0, 9.0, 30)), 2.0)

    size = {"height": 120.0, "middle": 50.0, "width": 12.0}
    record = thruster.simulate(time, command, catalogue=THRUSTER_TABLE, load_hump=size)
    record = noise.measure(record, rng, speed=noise.Sensor(0.1))
    log = dft.Log(time=time, inputs={"command": command},
                  measured={"speed": record.measured["speed"]},
                  units={"command": "V", "speed": "rad/s"}, noise={"speed": 0.1})  # fmt: skip
    curve = Curve("shaft", "speed", -105.0, 105.0, pieces=16, size=80.0, bend=5.0)
    # steps tell alpha and beta from a curve only while they settle: here these are known
    known = dft.Thruster(alpha=0.037, beta=42.0).fix("alpha", "beta")
    learned = dft.fit(known + curve, log, starts=1, horizon=None, substeps=2)
    assert dft.compare(known, log).errors.nrmse > 10 * learned.train.nrmse
    at = np.quantile(record.measured["speed"], np.linspace(0.02, 0.98, 97))
    found = np.array(learned.model.effects[0].at_signal(at))
    hump = -120.0 * (np.exp(-(((at - 50) / 12) ** 2)) - np.exp(-(((at + 50) / 12) ** 2)))
    assert np.sqrt(np.mean((found - hump) ** 2)) < 0.1 * np.sqrt(np.mean(hump**2))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"high": -50.0}, "low < high"),
        ({"pieces": 2}, "3 to 200 pieces, found 2"),
        ({"pieces": 10**7}, "3 to 200 pieces"),
        ({"pieces": 4.0}, "expected a whole number of 3 to 200 pieces, found 4.0"),
        ({"pieces": np.nan}, "expected a whole number of 3 to 200 pieces, found nan"),
        ({"high": np.inf}, "both finite"),
        ({"low": "a"}, "expected a number as low, found 'a'"),
        ({"times": 2}, "expected text as times, found 2"),
        (
            {"held": ["slop"]},
            "expected names of coefficients to hold, found 'slop'; the nearest is 'slope'",
        ),
        ({"signal": "lag(speed, level)", "level": {"unit": "s", "value": 1.0}}, "as a coefficient"),
        ({"signal": "speed * size", "pieces": 8, "coefficients": "1"}, "does not occur"),
        ({"size": 0.0}, "a positive size"),
        ({"shape": (0.0,) * 12}, "a shape of at most 11 numbers"),
        ({"signal": "speed.__class__"}, "not allowed"),
        ({"signal": "speed +"}, "cannot be read"),
        ({"times": "lag(speed, 1.0)"}, "times of what does not remember"),
        ({"signal": "lag(speed, T)", "T": "s"}, "nothing says where it begins"),
        ({"T": {"unit": "s", "value": 1.0}}, "'T' does not occur in 'speed'"),
    ],
)
def test_what_makes_no_curve_is_told(wrong, told):
    given = {"port": "load", "signal": "speed", "low": -40.0, "high": 40.0, **wrong}
    with pytest.raises(dft.InputError, match=told):
        Curve(**given)


def test_a_signal_that_is_called_like_a_coefficient_is_the_signal():
    curve = Curve("drive", "level", 0.0, 10.0, shape=(1.0, 2.0))
    s = dft.models.Signals({"level": np.array([0.0, 10.0])})
    np.testing.assert_allclose(curve(np.zeros(2), s), [0.0, 2.0], atol=1e-12)


def test_a_signal_that_the_model_does_not_have_is_told_with_the_nearest():
    with pytest.raises(dft.InputError, match="speed"):
        dft.Thruster() + Curve("load", "sped", -1.0, 1.0)


def test_a_learned_curve_goes_into_a_spec_file_and_comes_back(tmp_path):
    curve = Curve("load", "speed", -40.0, 40.0, times="value", shape=(0.1, 0.2, 0.05), name="stall")
    text = f'model = "thruster"\n{effects_line([curve])}\n[logs]\n'
    (tmp_path / "run.csv").write_text(
        "t,u,w\n" + "".join(f"{k / 10},{k % 7},{k}\n" for k in range(50))
    )
    text += (
        'train = ["run.csv"]\ntime = { column = "t", unit = "s" }\n'
        '[channels.command]\ncolumn = "u"\nunit = "V"\n'
        '[channels.speed]\ncolumn = "w"\nunit = "rad/s"\n'
    )
    (tmp_path / "fit.toml").write_text(text)
    back = dft.specs.load_spec(tmp_path / "fit.toml").model.effects[0]
    assert back.shape == curve.shape
    assert back.arguments == curve.arguments
