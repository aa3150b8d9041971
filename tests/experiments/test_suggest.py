"""Suggested experiments: what they separate, whether they keep their promise, limits, errors."""

from __future__ import annotations

from io import BytesIO

import jax.numpy as jnp
import numpy as np
import pytest
import written_fits
from reference import inputs, thruster

import diffthrust as dft
from diffthrust.experiments._designs import (  # private: every family within every limit
    KINDS,
    Design,
    Space,
    design_key,
    grid,
    sequence,
)

LIMITS = {"command": (-5.0, 5.0)}
NOISE = {"speed": 0.5}
SHORT = {"limits": LIMITS, "duration": 10.0, "step": 0.05, "noise": NOISE}


class Delay(dft.Effect):
    """The command arrives late."""

    name = "delay"
    port = "command"
    memory = True
    time: float = dft.parameter(0.05, "s", bounds=(0, 1), null=0.0, size=0.1)

    def __call__(self, value, s):
        return jnp.interp(s.time - self.time, s.time, value)


class Viscous(dft.Effect):
    """Friction in proportion to speed."""

    name = "viscous"
    port = "shaft"
    rate: float = dft.parameter(0.3, "1/s", bounds=(0, None), null=0.0, size=0.5)

    def __call__(self, value, s):
        return value - self.rate * s.speed


class Dry(dft.Effect):
    """Friction of constant size."""

    name = "dry"
    port = "shaft"
    level: float = dft.parameter(6.0, "rad/s^2", bounds=(0, None), null=0.0, size=5.0)

    def __call__(self, value, s):
        return value - self.level * jnp.tanh(s.speed / 0.5)


RIVALS = [dft.Thruster() + Viscous(), dft.Thruster() + Dry()]


class Inflow(dft.Effect):
    """Thrust falls with the speed of the water."""

    name = "inflow"
    port = "propeller"
    needs = ("inflow",)
    loss: float = dft.parameter(0.01, "N s^2/(m rad)", null=0.0, size=0.05)

    def __call__(self, value, s):
        return value - self.loss * jnp.abs(s.speed) * s.inflow


def noisy(time, series, speed, seed, noise=1.0):
    error = np.random.default_rng(seed).normal(0.0, noise, time.size)
    return dft.Log(
        time=time,
        inputs=series,
        measured={"speed": speed + error},
        noise={"speed": noise},
        name=f"log {seed}",
    )


def slow_log(seed, noise=1.0, **hidden):
    """The thruster under a slow random command, by the reference simulator."""
    time = inputs.grid(20.0, 0.05)
    command = inputs.low_passed_random(time, 1.0, np.random.default_rng(seed), 0.2)
    made = thruster.simulate(time, command, method="rk4", **hidden)
    return noisy(time, made.inputs, made.truth["speed"], seed + 100, noise)


@pytest.fixture(scope="module")
def logs():
    return [slow_log(1, actuator_lag=0.05), slow_log(2, actuator_lag=0.05)]


@pytest.fixture(scope="module")
def fits(logs):
    thrustless = dft.Thruster().fix("ct")
    lag = dft.fit(thrustless + dft.effects.ActuatorLag(), logs, starts=2)
    delay = dft.fit(thrustless + Delay(), logs, starts=2)
    assert lag.status is delay.status is dft.estimation.Status.CONVERGED
    return lag, delay


@pytest.fixture(scope="module")
def friction():
    return dft.suggest_experiment(RIVALS, **SHORT | {"duration": 40.0})


def slow_ramp(test):
    """Separation of the slowest ramp over the whole range, which is always among those tried."""
    ramps = [
        t
        for t in test.ranking
        if t.kind == "ramps" and t.parameters["command"] == (LIMITS["command"])
    ]
    return max(ramps, key=lambda t: t.parameters["hold"])


# -- what is separated -----------------------------------------------------------------------------


@pytest.mark.slow
def test_a_lag_is_told_from_a_delay_far_better_than_by_a_slow_ramp(fits):
    test = dft.suggest_experiment(fits, limits=LIMITS, duration=20.0, step=0.05)
    ramp = slow_ramp(test)
    assert ramp.parameters["hold"] >= 18.0 / 4 - 0.05  # one turn in all of the time between rests
    assert test.separation > 5 * ramp.separation
    assert test.decisive
    assert test.sentence.startswith(test.ranking[0].words)
    assert "speed differs by up to" in test.sentence
    worths = [trial.separation for trial in test.ranking]
    assert worths == sorted(worths, reverse=True)
    assert test.separation == min(test.separations.values())
    assert test.separation == pytest.approx(worths[0], rel=1e-5)
    assert set(test.separations) == {test.rivals, test.rivals[::-1]}


@pytest.mark.slow
def test_friction_in_proportion_to_speed_is_told_from_constant_friction(friction):
    """A slow ramp shows the friction at every speed: a good test here, but not the best."""
    assert friction.separation > 2 * slow_ramp(friction).separation
    assert friction.decisive


def test_the_same_rival_twice_cannot_be_told_apart():
    model = dft.Thruster() + Viscous()
    test = dft.suggest_experiment([model, model], **SHORT)
    assert test.separation == 0.0
    assert not test.decisive
    assert test.sentence.startswith("No test within the limits tells 'thruster + viscous (1)' and")
    assert all(trial.separation == 0.0 for trial in test.ranking)


@pytest.mark.thorough
def test_rivals_that_imitate_each_other_cannot_be_told_apart():
    """Alpha and beta are free: the imitator moves them to those of the truth."""
    rivals = [dft.Thruster(), dft.Thruster(alpha=0.03, beta=36.0)]
    test = dft.suggest_experiment(rivals, **SHORT)
    assert test.separation < 0.01
    assert not test.decisive
    held = [rival.fix("alpha", "beta", "ct") for rival in rivals]
    apart = dft.suggest_experiment(held, **SHORT)
    assert apart.separation > 100


def test_a_model_and_its_extension_are_judged_with_the_extension_as_the_truth():
    rivals = [dft.Thruster(), dft.Thruster() + Viscous()]
    test = dft.suggest_experiment(rivals, **SHORT)
    assert list(test.separations) == [("thruster + viscous", "thruster")]
    assert test.decisive


@pytest.mark.thorough
def test_correlated_noise_counts_a_lasting_difference_for_less(friction):
    change = {"duration": 40.0, "correlation_time": 1.0}
    test = dft.suggest_experiment(RIVALS, **SHORT | change)
    assert 0 < test.separation < 0.5 * friction.separation


# -- the promise -----------------------------------------------------------------------------------


def gained(fits, logs):
    """What other logs add to the log-likelihood of the first model over that of the second."""
    after = [dft.fit(fit.model, logs, starts=1).log_likelihood - fit.log_likelihood for fit in fits]
    return after[0] - after[1]


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
def test_the_promised_likelihood_ratio_is_what_new_data_give(fits, logs, seed):
    """Data of the lag on the suggested inputs; both rivals refitted to old and new logs.

    Of the gain in log-likelihood ratio the mean is half the separation S, and the variance S from
    the noise along the difference, plus half the number of refitted parameters (three each) from
    the quadratic terms: four standard deviations are allowed.
    """
    lag, _ = fits
    test = dft.suggest_experiment(fits, limits={"command": (-1, 1)}, duration=20.0, step=0.05)
    promised = test.separations[test.rivals]
    assert promised > 50  # so that four standard deviations are less than the promise
    blank = noisy(test.time, test.log_inputs, np.zeros(test.time.size), 0)
    new = noisy(test.time, test.log_inputs, dft.simulate(lag.model, blank)["speed"], 1000 + seed)
    gain = gained(fits, [*logs, new])
    assert abs(gain - 0.5 * promised) < 4 * np.sqrt(promised + 3)


@pytest.mark.slow
def test_the_reference_simulator_keeps_the_promise_too(fits, logs):
    """As above; the truth is now not the fit but within its errors, which shifts the mean a little.

    The lag is known to some 15 %; a difference in proportion to it shifts S by twice as much.
    """
    lag, _ = fits
    test = dft.suggest_experiment(fits, limits={"command": (-1, 1)}, duration=20.0, step=0.05)
    promised = test.separations[test.rivals]
    name = "actuator_lag.time_constant"
    doubt = lag.parameters[name].std_error / lag.parameters[name].value
    made = thruster.simulate(test.time, test.inputs["command"], method="rk4", actuator_lag=0.05)
    new = noisy(test.time, test.log_inputs, made.truth["speed"], 2000)
    gain = gained(fits, [*logs, new])
    assert abs(gain - 0.5 * promised) < 4 * np.hypot(np.sqrt(promised + 3), promised * doubt)


@pytest.mark.slow
def test_what_is_known_of_the_imitator_is_held_against_it(logs):
    """A prior on the parameters leaves less room to imitate; logs do the same."""
    free = dft.suggest_experiment(RIVALS, **SHORT)
    prior = {"prior": dft.models.Normal(0.037, 0.0005)}
    known = dft.suggest_experiment([m.replace(alpha=prior) for m in RIVALS], **SHORT)
    logged = dft.suggest_experiment(RIVALS, logs=logs, **SHORT)
    assert known.separation > 1.02 * free.separation
    assert logged.separation > 1.02 * free.separation


# -- the sequences ---------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [np.inf, 3.0])
@pytest.mark.parametrize("names", [("command",), ("left", "right")])
@pytest.mark.parametrize("limits", [(-5.0, 2.0), (0.0, 4.0), (1.0, 3.0)])
def test_every_design_keeps_limits_rates_and_rests(limits, names, rate):
    rates = {name: rate for name in names if np.isfinite(rate)}
    time = np.round(np.arange(401) * 0.05, 9)
    space = Space(time, dict.fromkeys(names, limits), rates, 1.0, seed=0)
    designs = grid(space)
    assert 40 <= len(designs) <= 80
    assert {d.kind for d in designs} <= set(KINDS)
    low, high = limits
    moving = 0
    for design in designs:
        for values in sequence(design, space).values():
            assert np.all((low <= values) & (values <= high))
            assert np.all(np.abs(np.diff(values)) <= rate * 0.05)
            rest = min(max(0.0, low), high)
            assert values[0] == values[-1] == rest
            if np.isinf(rate):
                assert np.all(values[(time < 1.0) | (time > 19.0)] == rest)
            moving += np.ptp(values) > 0
    assert moving > 0.5 * len(designs)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_uses_its_range(kind):
    space = Space(np.arange(2001) * 0.05, {"command": (-4.0, 6.0)}, {}, 1.0, seed=0)
    design = Design(kind, {"command": 1}, 0.5, 2.0)
    (values,) = sequence(design, space).values()
    bottom, top = design.levels("command", space)
    assert (bottom, top) == {"step up": (0.0, 3.0), "step down": (-2.0, 0.0)}.get(kind, (-2, 3))
    span = top - bottom
    assert bottom - 1e-12 <= values.min() < bottom + 0.15 * span
    assert top - 0.15 * span < values.max() <= top + 1e-12


@pytest.mark.thorough
def test_the_suggestion_is_the_same_each_time_and_keeps_the_rate_limit():
    change = {"limits": {"command": (-3, 5)}, "rate_limits": {"command": 2.0}}
    one, two = (dft.suggest_experiment(RIVALS, **SHORT | change) for _ in range(2))
    assert one.sentence == two.sentence
    assert one.ranking == two.ranking
    np.testing.assert_array_equal(one.inputs["command"], two.inputs["command"])
    command = one.inputs["command"]
    assert np.ptp(command) > 1.0
    assert command.min() >= -3
    assert command.max() <= 5
    assert np.all(np.abs(np.diff(command)) <= 2.0 * 0.05)
    assert command[0] == command[-1] == 0.0


def test_no_design_is_tried_twice():
    space = Space(np.arange(101) * 0.05, {"command": (-1.0, 1.0)}, {}, 0.0, seed=0)
    keys = [design_key(design) for design in grid(space)]
    assert len(set(keys)) == len(keys)


@pytest.mark.slow
def test_a_vessel_is_moved_by_both_inputs():
    class YawDrag(dft.Effect):
        name = "yaw_drag"
        port = "yaw_moment"
        level: float = dft.parameter(1.0, bounds=(0, None), null=0.0, size=1.0)

        def __call__(self, value, s):
            return value - self.level * s.yaw_rate * jnp.abs(s.yaw_rate)

    vessel = dft.Vessel().fix("m11", "m22", "i33", "d11", "d22", "exponent")
    test = dft.suggest_experiment(
        [vessel, vessel + YawDrag()],
        limits={"propeller_speed": (0, 100), "rudder_angle": (-0.5, 0.5)},
        duration=60.0,
        step=0.2,
        noise={"surge": 0.05, "yaw_rate": 0.02},
    )
    assert test.decisive
    assert set(test.inputs) == {"propeller_speed", "rudder_angle"}
    assert np.ptp(test.inputs["rudder_angle"]) > 0.1
    assert np.ptp(test.inputs["propeller_speed"]) > 10
    still = [t for t in test.ranking if t.parameters["propeller_speed"] == (0.0, 0.0)]
    assert still  # a rudder without a propeller's jet moves nothing
    assert all(trial.separation == 0.0 for trial in still)


# -- what is taken from logs -----------------------------------------------------------------------


@pytest.mark.thorough
def test_limits_and_constant_inputs_come_from_the_logs():
    time = inputs.grid(20.0, 0.05)
    rng = np.random.default_rng(0)
    command = np.clip(inputs.low_passed_random(time, 1.0, rng), -1.5, 2.5)
    inflow = 0.4 + 0.1 * np.sin(time)
    made = thruster.simulate(time, command, method="rk4")
    log = dft.Log(
        time=time,
        inputs={"command": command, "inflow": inflow},
        measured={"speed": made.truth["speed"] + rng.normal(0, 0.3, time.size)},
    )
    rivals = [dft.Thruster() + Inflow(), dft.Thruster() + Inflow() + Viscous()]
    given = {"logs": log, "duration": 10.0, "step": 0.05, "noise": {"speed": 0.3}}
    test = dft.suggest_experiment(rivals, **given)
    assert set(test.inputs) == {"command"}
    assert set(test.log_inputs) == {"command", "inflow"}
    np.testing.assert_array_equal(test.log_inputs["inflow"], np.median(inflow))
    reached = [trial.parameters["command"] for trial in test.ranking]
    assert min(low for low, _ in reached) == command.min()
    assert max(high for _, high in reached) == command.max()
    other = dft.suggest_experiment(rivals, held={"inflow": 0.0}, **given)
    assert not other.log_inputs["inflow"].any()


def test_the_table_for_the_controller_is_read_back_exactly(friction, tmp_path):
    friction.to_csv(tmp_path / "test.csv")
    text = (tmp_path / "test.csv").read_text()
    assert text.splitlines()[0] == "time,command"
    table = np.loadtxt(tmp_path / "test.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 0], friction.time)
    np.testing.assert_array_equal(table[:, 1], friction.inputs["command"])
    assert [path.name for path in tmp_path.iterdir()] == ["test.csv"]
    with pytest.raises(dft.InputError, match="cannot be written"):
        friction.to_csv(tmp_path / "nowhere" / "test.csv")


def test_the_figure_shows_inputs_predictions_and_differences(friction):
    figure = friction.plot()
    assert len(figure.axes) == 2 * 3  # the whole and a detail of command, speed and difference
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["command\n[V]", "", "speed\n[rad/s]", "", "difference\n[rad/s]", ""]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        f"if {friction.truth} holds",
        f"imitated by {next(name for name in friction.rivals if name != friction.truth)}",
        "noise (±2 standard deviations)",
    ]
    assert "expected log-likelihood ratio" in " ".join(figure.get_suptitle().split())
    out = BytesIO()
    figure.savefig(out, dpi=40)
    assert out.getvalue().startswith(b"\x89PNG")


# -- errors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rivals": [dft.Thruster()]}, "two models or fits at least, found 1"),
        ({"rivals": dft.Thruster()}, "two models or fits at least"),
        ({"rivals": [dft.Thruster(), "lag"]}, "expected models or fits, found 'lag'"),
        ({"limits": None}, r"'command', for which there are neither limits.*\n.*limits={'command'"),
        ({"limits": {"comand": (0, 1)}}, "the nearest is 'command'"),
        ({"limits": {"command": (5, -5)}}, r"lower and a higher number for 'command'"),
        ({"limits": {"command": 5}}, "lower and a higher number for 'command', found 5"),
        ({"held": {"command": 1.0}}, "'command' has limits and is held"),
        ({"limits": None, "held": {"command": 1.0}}, "nothing to move"),
        ({"held": {"inflow": "high"}}, "expected a number for 'inflow'"),
        ({"rivals": [dft.Thruster(), dft.Thruster() + Inflow()]}, "'inflow'.*neither limits"),
        ({"noise": None}, r"No noise level is known.*\n.*noise={'speed'"),
        ({"noise": {"sped": 1.0}}, "the nearest is 'speed'"),
        ({"noise": {"speed": 0.0}}, "positive standard deviation for 'speed'"),
        ({"rate_limits": {"command": 0}}, "positive change per second for 'command'"),
        ({"rate_limits": {"speed": 1.0}}, "'speed': this input is not moved"),
        ({"duration": -1.0}, "duration: expected a positive number"),
        ({"step": "fast"}, "step: expected a positive number"),
        ({"rest": 10.0}, "fewer than 20 samples to move in"),
        ({"correlation_time": 0.0}, "correlation_time"),
        ({"seed": 0.5}, "seed: expected a whole number"),
        ({"step": 5.0, "duration": 500.0}, "time base"),
    ],
)
def test_errors_name_what_is_missing(change, message):
    given = {"rivals": RIVALS, **SHORT, **change}
    rivals = given.pop("rivals")
    with pytest.raises(dft.InputError, match=f"(?s){message}"):
        dft.suggest_experiment(rivals, **given)


@pytest.mark.thorough
def test_a_test_is_told_and_drawn_in_the_units_of_the_fits_logs():
    fits = [written_fits.fit(), written_fits.fit(deadband=False)]
    test = dft.suggest_experiment(
        fits, limits={"command": (-0.2, 0.2)}, duration=4.0, step=0.05, noise={"thrust": 0.5}
    )
    assert np.max(np.abs(test.inputs["command"])) <= 0.2
    low, high = (1500 + 400 * level for level in test.ranking[0].parameters["command"])
    assert f"{low:.0f} us" in test.sentence or f"{high:.0f} us" in test.sentence
    assert " kgf (" in test.sentence
    assert " N (" not in test.sentence
    assert "effort" not in test.report()
    figure = test.plot()
    assert [axes.get_ylabel() for axes in figure.axes[::2]] == [
        *("command\n[us]", "thrust\n[kgf]", "difference\n[kgf]")
    ]
    (drawn,) = figure.axes[0].get_lines()
    np.testing.assert_allclose(drawn.get_ydata(), 1500 + 400 * test.inputs["command"], rtol=1e-12)
    (line,) = figure.axes[4].get_lines()[1:]
    apart = written_fits.KGF * test.difference("thrust", *_ordered(test))
    np.testing.assert_allclose(line.get_ydata(), apart, atol=1e-9)


def _ordered(test: dft.experiments.Experiment) -> tuple[str, str]:
    """The truth, and what imitates it."""
    (other,) = (name for name in test.rivals if name != test.truth)
    return test.truth, other
