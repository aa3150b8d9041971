"""Fleets of fits: spread, drift, effects and outliers, against closed forms and simulation."""

import re

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.optimize import curve_fit
from scipy.stats import kstest
from short_logs import MODEL, made_log

import diffthrust as dft
from diffthrust import InputError
from diffthrust.many._fleet.statistics import (  # private: numbers by hand
    between,
    holm,
    weighted_mean,
)

VEHICLES = [f"auv{i}" for i in range(8)]


def table(values, errors, vehicles=VEHICLES, **columns):
    """A table of fits of a thruster's alpha."""
    frame = {"name": [f"{v}/{i}" for i, v in enumerate(vehicles)], "model": "thruster"}
    frame |= {"alpha": values, "alpha_std_error": errors, **columns}
    return pd.DataFrame(frame)


def drawn(rng, count=8, spread=0.1, error=0.05):
    """Estimates of alpha with relative errors, of vehicles that differ by a factor."""
    errors = error * rng.uniform(0.5, 2.0, count)
    logs = np.log(0.037) + spread * rng.standard_normal(count) + errors * rng.standard_normal(count)
    return np.exp(logs), errors * np.exp(logs)


def over_time(rng, scatter=1.0, slope=0.0, vehicles=5, fits=5):
    """Estimates at several times; those of the first vehicle drift."""
    names = np.repeat(VEHICLES[:vehicles], fits)
    times = np.tile(np.arange(fits, dtype=float), vehicles)
    logs = np.log(0.037) + slope * times * (names == "auv0")
    values = np.exp(logs + 0.02 * scatter * rng.standard_normal(logs.size))
    return table(values, 0.02 * values, names, time=times)


def test_the_spread_of_equal_errors_has_a_closed_form():
    rng = np.random.default_rng(1)
    values = rng.normal(5.0, 2.0, 12)
    assert between(values, np.full(12, 0.7)) == pytest.approx(
        np.sqrt(np.var(values, ddof=1) - 0.7**2), rel=1e-9
    )
    assert between(values, np.full(12, 10.0)) == 0.0
    mean = weighted_mean(values, np.full(12, 0.7))
    assert mean.q == pytest.approx(np.sum((values - values.mean()) ** 2) / 0.7**2)
    assert mean.error == pytest.approx(0.7 / np.sqrt(12))


def test_the_table_of_spread():
    values, errors = drawn(np.random.default_rng(2))
    row = dft.many.fleet(table(values, errors)).spread().iloc[0]
    relative = errors / values
    mean = np.average(np.log(values), weights=relative**-2)
    q = np.sum(((np.log(values) - mean) / relative) ** 2)
    assert (row["parameter"], row["unit"], row["vehicles"]) == ("alpha", "1/rad", 8)
    assert row["median"] == np.median(values)
    assert row["q"] == pytest.approx(q)
    assert row["share"] == pytest.approx(1 - 7 / q)
    mad = np.median(np.abs(values - np.median(values)))
    assert row["robust_sd"] == pytest.approx(1.4826 * mad)


def test_alike_vehicles_give_uniform_p_values():
    rng = np.random.default_rng(3)
    found = [
        dft.many.fleet(table(*drawn(rng, spread=0.0, error=0.01))).spread()["p_value"].iloc[0]
        for _ in range(100)
    ]
    assert kstest(found, "uniform").pvalue > 0.01


def test_a_drift_is_the_weighted_line():
    rng = np.random.default_rng(4)
    times = np.array([0.0, 1.0, 4.0, 9.0, 11.0])
    values = np.exp(-3.3 + 0.03 * times + 0.05 * rng.standard_normal(5))
    errors = values * rng.uniform(0.01, 0.02, 5)
    row = dft.many.fleet(table(values, errors, ["auv0"] * 5, time=times)).drift().iloc[0]
    best, cov = curve_fit(  # scales the errors to the scatter
        lambda t, a, b: a + b * t, times, np.log(values), sigma=errors / values
    )
    assert row["dispersion"] > 1.0
    assert row["relative"] == pytest.approx(best[1], rel=1e-6)
    assert row["slope_std_error"] / row["slope"] == pytest.approx(
        np.sqrt(cov[1, 1]) / best[1], rel=1e-5
    )


@pytest.mark.parametrize("scatter", [1.0, 4.0])
def test_drifts_are_told_falsely_as_rarely_as_promised(scatter):
    rng = np.random.default_rng(5)
    runs = 100
    alarms = sum(
        dft.many.fleet(over_time(rng, scatter)).drift()["drifts"].any() for _ in range(runs)
    )
    assert alarms <= 0.05 * runs + 3 * np.sqrt(0.05 * 0.95 * runs)


def test_a_vehicle_that_drifts_is_found():
    found = dft.many.fleet(over_time(np.random.default_rng(6), slope=0.05, fits=8)).drift()
    assert list(found[found["drifts"]]["vehicle"]) == ["auv0"]
    row = found.iloc[0]
    assert row["relative"] == pytest.approx(0.05, abs=0.02)
    assert row["unit"] == "1/rad per unit of time"


def test_outliers_are_told_falsely_as_rarely_as_promised():
    rng = np.random.default_rng(7)
    alarms = [
        sum(
            dft.many.fleet(table(*drawn(rng, spread=spread))).outliers()["outlier"].any()
            for _ in range(60)
        )
        for spread in (0.0, 0.05, 0.3)
    ]
    assert sum(alarms) <= 0.05 * 180 + 3 * np.sqrt(0.05 * 0.95 * 180)


def test_a_fouled_vehicle_is_an_outlier():
    values, errors = drawn(np.random.default_rng(8), spread=0.05)
    values[3] *= 2.0
    found = dft.many.fleet(table(values, errors)).outliers()
    assert list(found[found["outlier"]]["vehicle"]) == ["auv3"]
    first = found.iloc[0]
    rest = np.delete(values, 3)
    assert first["others"] == pytest.approx(np.exp(np.mean(np.log(rest))), rel=0.05)


def test_the_chance_of_a_false_alarm_is_any_kind_of_number():
    made = dft.many.fleet(over_time(np.random.default_rng(6), slope=0.05, fits=8))
    for told in (made.drift, made.outliers):
        pd.testing.assert_frame_equal(
            told(false_alarms=xr.DataArray(0.05)), told(false_alarms=0.05)
        )


def test_units_do_not_change_what_is_told():
    values, errors = drawn(np.random.default_rng(9))
    one, other = (dft.many.fleet(table(k * values, k * errors)) for k in (1.0, 1000.0))
    for name in ("q", "share", "p_value"):
        assert one.spread()[name].iloc[0] == pytest.approx(other.spread()[name].iloc[0])
    assert one.outliers()["distance"].to_numpy() == pytest.approx(other.outliers()["distance"])
    assert other.spread()["between_sd"].iloc[0] == pytest.approx(
        1000 * one.spread()["between_sd"].iloc[0]
    )


def test_many_tests_are_corrected_for():
    p = np.array([0.03, 0.001, np.nan, 0.04, 0.012])
    assert list(holm(p, 0.05)) == [False, True, False, False, True]  # 0.05/4, 0.05/3, stop


def test_effects_by_vehicle():
    values, errors = drawn(np.random.default_rng(10), 4)
    effects = ["", "actuator_lag", "actuator_lag, coulomb_friction", None]
    frame = table(values, errors, ["a", "a", "b", "b"], effects=effects)
    found = dft.many.fleet(frame).effects()
    assert list(found.columns) == ["fits", "actuator_lag", "coulomb_friction"]
    assert found.loc["a"].tolist() == [2, 0.5, 0.0]
    assert found.loc["b"].tolist() == [2, 0.5, 0.5]


@pytest.fixture(scope="module")
def fits():
    logs = [made_log(seed, name=f"{'ab'[seed % 2]}/dive{seed}") for seed in range(4)]
    return dft.many.fit(MODEL, logs, starts=1)


@pytest.mark.thorough
def test_fits_come_from_many_lists_dictionaries_and_tables(fits, tmp_path):
    def owner(name):
        return name.split("/")[0]

    listed = list(fits)
    dates = ["2026-05-01", "2026-05-02", "2026-05-11T12:00", "2026-05-21"]
    fleets = [
        dft.many.fleet(fits, vehicle=owner, time=dates),
        dft.many.fleet(listed, vehicle=["a", "b", "a", "b"], time=dates),
        dft.many.fleet({"a": listed[::2], "b": listed[1::2]}, time=[*dates[::2], *dates[1::2]]),
        dft.many.fleet(fits.table().assign(vehicle=["a", "b", "a", "b"], time=dates)),
    ]
    path = tmp_path / "campaign.parquet"
    fits.table().assign(time=dates).to_parquet(path)
    fleets += [dft.many.fleet(path), dft.many.fleet(tmp_path)]
    for one in fleets:
        assert one.vehicles == ("a", "b")
        assert one.axes["alpha"].log
        assert one.axes["alpha"].unit == "1/rad"
        times, values, errors = one.series("a", "alpha")
        assert times == pytest.approx([0.0, 10.5])
        assert values == pytest.approx(np.log([fits[i].parameters["alpha"].value for i in (0, 2)]))
        estimate = fits[0].parameters["alpha"]
        assert errors[0] == pytest.approx(estimate.std_error / estimate.value)
        assert one.drift()["unit"].iloc[0] == "1/rad per day"
        assert len(one.table) == 4
    report = fleets[0].report()
    assert "Nothing drifts" in report
    assert re.search(r"errors +Q +Dof +Alike\?", report)


def test_failed_and_doubtful_fits_are_left_out_and_told():
    values, errors = drawn(np.random.default_rng(11))
    frame = table(values, errors, fit_status=["converged"] * 6 + ["not_converged"] * 2)
    frame = frame.assign(status=["failed"] + ["ok"] * 7)
    found = dft.many.fleet(frame)
    assert len(found.table) == 7
    assert found.spread()["vehicles"].iloc[0] == 5
    assert found.notes[0] == "1 row has no result and is left out."
    assert found.notes[1].endswith("all but the table: auv6/6, auv7/7.")


def test_figures_show_each_parameter_with_its_unit():
    rng = np.random.default_rng(12)
    frame = over_time(rng, slope=0.1).assign(effects="actuator_lag")
    made = dft.many.fleet(frame)
    for figure in (made.plot_spread(), made.plot_drift()):
        axes = figure.axes[0]
        assert axes.get_title(loc="left") == "alpha"
        assert "alpha [1/rad]" in (axes.get_xlabel(), axes.get_ylabel())
    labels = [t.get_text() for t in made.plot_drift().legends[0].get_texts()]
    assert labels == ["auv0 drifts", "other vehicles"]
    assert [t.get_text() for t in made.plot_effects().axes[0].texts] == ["5 of 5"] * 5


@pytest.mark.parametrize(
    ("source", "options", "told"),
    [
        (3, {}, "Expected fits, a table of them or a campaign, found int"),
        ([], {"vehicle": []}, "Expected the fits of a fleet, found none"),
        ({"a": 3.0}, {}, "a: expected a fit, found float"),
        ("nowhere.parquet", {}, "nowhere.parquet: the table of a campaign cannot be read"),
        (pd.DataFrame({"name": ["a"]}), {}, "no pair of columns such as 'alpha'"),
        (table([1.0], [0.1], ["a"]), {"vehicle": ["a", "b"]}, "one for each of 1 fits, found 2"),
        (table([1.0], [0.1], ["a"]), {"vehicle": {"b": "c"}}, "nothing is given for 'a/0'"),
        (table([1.0], [0.1], ["a"]), {"time": ["yesterday?"]}, "expected numbers or dates"),
        (table([1.0], [0.1], ["a"]).assign(vehicle=None), {}, "'vehicle': 'a/0' has none"),
        (table(["x"], [0.1], ["a"]), {}, "Column 'alpha': expected numbers"),
        (table([1.0, 2.0], [0.1, 0.1], ["a", "b"]).assign(model=["thruster", "vessel"]), {},
         "A fleet has one model"),
    ],
)  # fmt: skip
def test_what_is_no_fleet_is_told(source, options, told):
    with pytest.raises(InputError, match=told):
        dft.many.fleet(source, **options)


def test_a_list_of_fits_does_not_tell_whose_they_are(fits):
    with pytest.raises(InputError, match="expected the vehicle of each fit"):
        dft.many.fleet(list(fits))


def test_without_times_nothing_drifts():
    made = dft.many.fleet(table(*drawn(np.random.default_rng(13))))
    with pytest.raises(InputError, match="no times"):
        made.drift()
    with pytest.raises(InputError, match="false_alarms: expected a number in"):
        made.outliers(false_alarms=5)
    with pytest.raises(InputError, match="No fit of the fleet has an effect"):
        made.plot_effects()
