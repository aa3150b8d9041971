"""Numbers that differ by log, against mixed models that are solved by other means."""

from dataclasses import replace

import numpy as np
import pytest
from compilations import compilations
from offsets_by_log import NOISE, fitted, readings
from reference import inputs, thruster, vessel
from scipy.optimize import least_squares, minimize_scalar

import diffthrust as dft
from diffthrust import InputError, Log


class MixedModel:
    """y = slope * depth + b_k + e, b_k of a Gaussian about a mean: by dense matrices."""

    def __init__(self, logs, noise=NOISE):
        depth = np.concatenate([log.inputs["depth"] for log in logs])
        self.y = np.concatenate([log.measured["reading"] for log in logs])
        log_of = np.repeat(np.arange(len(logs)), [len(log) for log in logs])
        self.shared = np.stack([depth, np.ones(depth.size)], axis=1)
        self.own = (log_of[:, None] == np.arange(len(logs))).astype(float)
        self.noise = noise

    def restricted(self, width):
        """Twice the restricted log-likelihood, without constants (Patterson & Thompson 1971)."""
        v = self.noise**2 * np.eye(self.y.size) + width**2 * self.own @ self.own.T
        weighed = np.linalg.solve(v, self.shared)
        inner = self.shared.T @ weighed
        beta = np.linalg.solve(inner, weighed.T @ self.y)
        residual = self.y - self.shared @ beta
        logs = np.linalg.slogdet(v)[1] + np.linalg.slogdet(inner)[1]
        return -logs - residual @ np.linalg.solve(v, residual)

    def width(self, kept=True):
        """Where that is largest, kept from zero or not."""
        projected = self.own - self.shared @ np.linalg.lstsq(self.shared, self.own, rcond=None)[0]
        informed = np.sum(projected**2) / self.noise**2
        error = np.sqrt((self.own.shape[1] - 1) / informed)

        def loss(logarithm):
            width = np.exp(logarithm)
            return -self.restricted(width) + kept * np.log1p((error / width) ** 2)

        return float(np.exp(minimize_scalar(loss, bounds=(-9.0, 3.0), method="bounded").x))

    def estimates(self, width):
        """Values and standard errors of slope, mean and offsets, by Henderson's equations."""
        columns = np.hstack([self.shared, self.own])
        prior = np.zeros(columns.shape[1])
        prior[2:] = 1.0 / width**2
        matrix = columns.T @ columns / self.noise**2 + np.diag(prior)
        covariance = np.linalg.inv(matrix)
        solved = covariance @ columns.T @ self.y / self.noise**2
        turn = np.eye(solved.size)
        turn[2:, 1] = 1.0  # an offset is the mean and what is its own
        return turn @ solved, np.sqrt(np.diagonal(turn @ covariance @ turn.T))


@pytest.mark.parametrize(("spread", "count"), [(0.5, 5), (0.03, 4), (0.0, 6), (0.5, 2)])
def test_a_linear_fit_is_the_mixed_model(spread, count):
    rng = np.random.default_rng([7, count, int(100 * spread)])
    logs = readings(rng, rng.normal(1.0, spread, count))
    fit, exact = fitted(logs), MixedModel(logs)
    offset = fit.per_log["offset"]
    assert fit.status is dft.estimation.Status.CONVERGED
    assert offset.width == pytest.approx(exact.width(), rel=2e-3)
    values, errors = exact.estimates(offset.width)
    found = [fit.parameters["slope"], fit.parameters["offset"], *offset.values.values()]
    assert np.all(np.abs(np.array([e.value for e in found]) - values) < 1e-3 * errors)
    np.testing.assert_allclose([e.std_error for e in found], errors, rtol=1e-5)
    assert [*offset.values] == [log.name for log in logs]
    ratio = exact.restricted(offset.width) - exact.restricted(1e-9)
    assert offset.ratio == pytest.approx(ratio, abs=1e-4 * max(1.0, ratio))


def test_a_width_that_logs_tell_is_that_of_the_plain_restricted_likelihood():
    rng = np.random.default_rng(11)
    logs = readings(rng, rng.normal(1.0, 0.5, 6))
    fit, plain = fitted(logs), MixedModel(logs).width(kept=False)
    assert fit.per_log["offset"].width == pytest.approx(plain, rel=2e-3)
    low, high = fit.per_log["offset"].width_range
    assert low < plain < high
    assert not any("do not tell" in note for note in fit.notes)


def test_a_width_is_no_zero_and_it_is_said_where_logs_tell_of_none():
    logs = readings(np.random.default_rng(3), [1.0] * 4)
    assert MixedModel(logs).width(kept=False) < 1e-3  # the likelihood alone is largest at zero
    fit = fitted(logs)
    offset = fit.per_log["offset"]
    assert offset.width > 0.005
    assert offset.width_range[0] == 0.0
    assert not offset.tells
    (note,) = (note for note in fit.notes if "do not tell" in note)
    assert "offset" in note
    assert "without per_log" in note


def test_differences_that_are_none_are_told_as_often_as_is_said():
    told = [
        fitted(readings(np.random.default_rng([5, seed]), [1.0] * 4), doubts=False)
        .per_log["offset"]
        .tells
        for seed in range(60)
    ]
    # 5 % are expected of 60 sets; more than nine come by chance in one of 1000 such tests
    assert sum(told) <= 9


@pytest.mark.parametrize("spread", [0.05, 0.5])
def test_intervals_of_values_by_log_hold_what_they_say(spread):
    inside, count = 0, 0
    for seed in range(40):
        rng = np.random.default_rng([13, seed])
        true = rng.normal(1.0, spread, 5)
        found = fitted(readings(rng, true, samples=20), doubts=False).per_log["offset"]
        for value, offset in zip(found.values.values(), true, strict=True):
            inside += abs(value.value - offset) < 1.645 * value.std_error
            count += 1
    # 90 % of 200, which scatter by 2.1 %: more than three deviations to either side
    assert abs(inside / count - 0.9) < 0.07


def test_a_mean_that_is_held_and_a_noise_that_is_not_known():
    rng = np.random.default_rng(17)
    logs = readings(rng, rng.normal(0.0, 0.5, 5), samples=400, known=False)
    fit = fitted(logs, dft.LinearSensor(offset=0.0).fix("offset"))
    offset = fit.per_log["offset"]
    assert offset.mean.value == 0.0
    assert offset.mean.fixed
    mean_square = np.sqrt(np.mean([e.value**2 for e in offset.values.values()]))
    assert offset.width == pytest.approx(mean_square, rel=1e-3)  # of known mean, and no error
    assert fit.noise["reading"] == pytest.approx(NOISE, rel=0.05)
    assert all(e.std_error < 0.02 and not e.fixed for e in offset.values.values())


def test_a_value_at_a_bound_is_the_optimum_within_bounds_by_scipy():
    logs = readings(np.random.default_rng(0), [0.8, 1.0, 1.1, 1.3])
    bounded = dft.LinearSensor().replace(offset={"value": 1.0, "bounds": (None, 1.2)})
    fit = dft.fit(bounded, logs, per_log=["offset"], starts=3)
    assert fit.status is dft.estimation.Status.CONVERGED
    offset = fit.per_log["offset"]
    *others, last = offset.values.values()
    assert last.at_bound
    assert last.value == 1.2
    assert last.std_error is None
    assert not any(e.at_bound or e.std_error is None for e in others)

    def rows(x):
        apart = [(x[2:] - x[1]) / offset.width]
        pairs = zip(logs, x[2:], strict=True)
        errors = [g.measured["reading"] - x[0] * g.inputs["depth"] - own for g, own in pairs]
        return np.concatenate([*apart, *(e / NOISE for e in errors)])

    ends = ([-9.0] * 6, [9.0, *[1.2] * 5])
    solved = least_squares(rows, [0.2, 1, 1, 1, 1, 1], bounds=ends, xtol=1e-14, ftol=1e-14)
    found = [fit.parameters[n].value for n in ("slope", "offset")]
    found += [e.value for e in offset.values.values()]
    np.testing.assert_allclose(found, solved.x, rtol=1e-4)
    # the logs within the bounds tell of the difference by themselves
    assert offset.tells


def test_a_width_of_a_logarithm_is_a_share_in_reports_and_json():
    logs = readings(np.random.default_rng(19), [0.8, 1.0, 1.1, 1.3])
    model = dft.LinearSensor(offset=1.0).replace(offset={"bounds": (0, None), "transform": "log"})
    relative = fitted(logs, model)
    width = relative.per_log["offset"].width
    assert 0.1 < width < 0.5
    shown = [line for line in relative.report().splitlines() if " width " in line]
    assert f"{100 * width:.2g}" in shown[0]
    assert "%" in shown[0]
    assert relative.to_json()["per_log"]["offset"]["width_unit"] == ""
    linear = fitted(logs)
    shown, *_ = [line for line in linear.report().splitlines() if " width " in line]
    assert "%" not in shown
    offset = linear.per_log["offset"]
    assert offset.to_json()["width_unit"] == offset.mean.unit
    # in the unit of the logs, if that is another: the width goes with the mean, a share does not
    for found, per in ((offset, 1000.0), (relative.per_log["offset"], 100.0)):
        other = replace(found, mean=replace(found.mean, per=1000.0, shown_unit="mm"))
        assert other.shown_width[0] == pytest.approx(per * found.width)


def test_logs_of_one_name_are_counted_until_the_name_is_free():
    logs = readings(np.random.default_rng(23), [0.8, 1.0, 1.1, 1.3])
    pairs = zip(logs, ("a", "a (2)", "a", "b"), strict=True)
    fit = fitted([log.replaced(name=name) for log, name in pairs])
    assert [*fit.per_log["offset"].values] == ["a", "a (2)", "a (3)", "b"]
    begun = [own["offset"] for own in fit.initial]
    assert [e.value for e in fit.per_log["offset"].values.values()] == begun


def test_values_by_log_are_found_where_every_parameter_is_fixed():
    rng = np.random.default_rng(29)
    true = rng.normal(1.0, 0.4, 5)
    logs = readings(rng, true, samples=200)
    fit = fitted(logs, dft.LinearSensor(slope=0.2, offset=1.0).fix("slope", "offset"))
    assert fit.status is dft.estimation.Status.CONVERGED
    assert fit.free == ()
    offset = fit.per_log["offset"]
    assert (offset.mean.value, offset.mean.std_error) == (1.0, None)
    for log, value in zip(logs, offset.values.values(), strict=True):
        apart = log.measured["reading"] - 0.2 * log.inputs["depth"] - 1.0
        weight, tight = apart.size / NOISE**2, offset.width**-2
        exact = 1.0 + weight * apart.mean() / (weight + tight)
        assert value.value == pytest.approx(exact, rel=1e-6)
        assert value.std_error == pytest.approx((weight + tight) ** -0.5, rel=1e-6)
    assert "offset" in fit.report()
    assert dft.compare(fit, logs).errors.nrmse == pytest.approx(fit.train.nrmse, rel=1e-12)


# A model that is not linear.

TRUE = {"alpha": 0.037, "beta": 42.0}
LEVELS = {"speed": 0.3, "thrust": 0.2}


def runs_of_thrusters(coefficients, seed=0, duration=15.0):
    logs = []
    for k, ct in enumerate(coefficients):
        rng = np.random.default_rng([seed, k])
        time = inputs.grid(duration, 0.05)
        command = inputs.low_passed_random(time, 1.5, rng)
        made = thruster.simulate(time, command, **TRUE, ct=ct, method="rk4")
        measured = {n: made.truth[n] + rng.normal(0.0, s, time.size) for n, s in LEVELS.items()}
        logs.append(Log(time, {"command": command}, measured, name=f"run{k}", noise=LEVELS))
    return logs


def test_all_unknowns_are_those_of_least_squares_by_scipy():
    # a coefficient that is positive differs by factors: its logarithm is what is Gaussian
    true = [0.02, 0.024, 0.017]
    logs = runs_of_thrusters(true)
    fit = dft.fit(
        dft.Thruster(), logs, per_log=["ct"], starts=2, initial="measured", horizon=None, substeps=1
    )
    found, begun = fit.per_log["ct"], [log.measured["speed"][0] for log in logs]

    def rows(x):
        alpha, beta, mean, *apart = np.exp(x[:3]).tolist() + x[3:].tolist()
        out = [np.array(apart) / found.width]
        for log, away, speed in zip(logs, apart, begun, strict=True):
            made = thruster.simulate(
                log.time, log.inputs["command"], alpha=alpha, beta=beta,
                ct=mean * np.exp(away), method="rk4", initial_speed=speed, substeps=1,
            )  # fmt: skip
            out += [(log.measured[n] - made.truth[n]) / s for n, s in LEVELS.items()]
        return np.concatenate(out)

    solved = least_squares(rows, [*np.log([0.05, 30.0, 0.01]), 0.0, 0.0, 0.0], x_scale="jac")
    mean, apart = np.exp(solved.x[2]), solved.x[3:]
    values = [e.value for e in found.values.values()]
    np.testing.assert_allclose(values, mean * np.exp(apart), rtol=1e-5)
    covariance = np.linalg.inv(solved.jac.T @ solved.jac)
    errors = [
        value * np.sqrt(covariance[np.ix_([2, 3 + k], [2, 3 + k])].sum())
        for k, value in enumerate(values)
    ]
    np.testing.assert_allclose([e.std_error for e in found.values.values()], errors, rtol=1e-3)
    for value, ct in zip(found.values.values(), true, strict=True):
        assert abs(value.value - ct) < 4.0 * value.std_error
    assert fit.parameters["alpha"].value == pytest.approx(np.exp(solved.x[0]), rel=1e-5)


def test_one_program_serves_any_widths_and_starts():
    logs = runs_of_thrusters([0.02, 0.024, 0.017, 0.021], seed=2, duration=10.0)
    dft.fit(dft.Thruster(), logs, per_log=["ct"], starts=2)
    before = compilations()
    dft.fit(dft.Thruster(alpha=0.03), logs[::-1], per_log=["ct"], starts=3)
    assert compilations() == before
    first = compilations("solved_by_passes")
    dft.fit(dft.Thruster(), logs[:2], per_log=["ct", "alpha"], starts=2)
    assert compilations("solved_by_passes") == first + 1  # and no step by log


def test_values_are_where_simulations_begin():
    logs = runs_of_thrusters([0.02, 0.026], seed=4, duration=10.0)
    fit = dft.fit(dft.Thruster(), logs, per_log=["ct"], starts=2)
    for log, states, value in zip(
        logs, fit.initial, fit.per_log["ct"].values.values(), strict=True
    ):
        assert states["ct"] == value.value
        made = dft.simulate(fit.model, log, initial=states, substeps=fit.substeps)
        again = dft.simulate(
            fit.model.replace(ct=value.value), log, initial={"speed": states["speed"]},
            substeps=fit.substeps,
        )  # fmt: skip
        np.testing.assert_array_equal(made["thrust"], again["thrust"])


# Refusals.


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("ct", "expected a list of names"),
        (["cf"], "'thruster' has no parameter 'cf'"),
        ([3], "no parameter 3"),
    ],
)
def test_names_that_are_none_are_refused(names, words):
    with pytest.raises(InputError, match=words):
        dft.fit(dft.Thruster(), runs_of_thrusters([0.02, 0.02], duration=5.0), per_log=names)


def test_one_log_tells_no_width():
    with pytest.raises(InputError, match="there is one log") as caught:
        dft.fit(dft.Thruster(), runs_of_thrusters([0.02], duration=5.0), per_log=["ct"])
    assert "leave per_log out" in str(caught.value)


def test_a_marked_model_on_one_log_says_how_the_mark_is_taken_away():
    logs = readings(np.random.default_rng(37), [0.8, 1.0, 1.2])
    fit = fitted(logs)
    with pytest.raises(InputError, match="there is one log") as caught:
        dft.fit(fit.model, logs[0], starts=1, per_log=None)
    assert "model.replace({'offset': {'per_log': False}})" in str(caught.value)
    assert "leave per_log out" not in str(caught.value)
    again = dft.fit(fit.model.replace({"offset": {"per_log": False}}), logs[0], starts=1)
    assert again.per_log == {}


def test_a_value_of_what_does_not_differ_is_no_start():
    (log,) = runs_of_thrusters([0.02], duration=5.0)
    with pytest.raises(InputError, match="one number for all logs"):
        dft.simulate(dft.Thruster(), log, initial={"ct": 0.03})


# A boat in water that moves otherwise in each log, by the reference that is written without us.


def run_of_a_boat(number, current):
    rng = np.random.default_rng([41, number])
    time = inputs.grid(40.0, 0.1)
    forces = {n: np.repeat(rng.uniform(-0.2, 1.0, 20), 21)[: time.size] for n in vessel.TWIN}
    hidden = {"water_current": dict(zip(("to_north", "to_east"), current, strict=True))}
    made = vessel.simulate(time, forces, method="rk4", **hidden)
    names = ("surge", "sway", "yaw_rate", "heading")
    measured = {n: made.truth[n] + rng.normal(0.0, 0.01, time.size) for n in names}
    return Log(time, forces, measured, name=f"run{number}")


@pytest.mark.thorough
def test_a_current_by_log_is_found_beside_one_hull():
    currents = np.random.default_rng(43).normal([0.15, -0.1], 0.1, (5, 2))
    *logs, unseen = [run_of_a_boat(k, current) for k, current in enumerate(currents)]
    names = ["water_current.to_north", "water_current.to_east"]
    hull = dft.Vessel(drive="twin", **vessel.SIRAMDASU).fix("m22", "d22", "i33", "d33", "exponent")
    fit = dft.fit(
        hull.replace(m11=6.0, d11=3.0) + "water_current", logs, per_log=names, starts=1,
        holdout=unseen, horizon=None, substeps=2,
    )  # fmt: skip
    for name in ("m11", "d11"):
        estimate = fit.parameters[name]
        assert abs(estimate.value - vessel.SIRAMDASU[name]) < 4.0 * estimate.std_error
        assert estimate.std_error < 0.02 * estimate.value
    (run,) = dft.compare(fit, unseen, substeps=2).runs
    for name, true in zip(names, currents.T, strict=True):
        for value, component in zip(fit.per_log[name].values.values(), true, strict=False):
            assert abs(value.value - component) < 4.0 * value.std_error
            assert value.std_error < 0.01
        assert fit.per_log[name].tells
        assert run.start[name] == pytest.approx(true[-1], abs=0.02)
    for channel in fit.holdout.channels.values():
        assert channel.rmse < 0.012
