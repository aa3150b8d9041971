"""Pooling on simulated fleets: sparse vehicles gain, and intervals cover."""

import re

import numpy as np
import pytest
from simulated_fleets import MEDIAN, drawn_fleet
from test_examples import figure, run

import diffthrust as dft

FLEETS, SPARSE = 40, ("auv7", "auv8", "auv9")


def study():
    """Many fleets pooled both ways.

    Returns:
        By route, what the sparse vehicles gain (of the RMS and of the median error, as shares); and
        for each interval whether its vehicle is sparse and whether it holds the truth, ``(n, 2)``.
    """
    rows = {"separate": [], "quadratic": [], "exact": []}
    inside = {"quadratic": [], "exact": []}
    for seed in range(FLEETS):
        truth, logs = drawn_fleet(seed)
        true = {log.name: values for log, values in zip(logs, truth, strict=True)}
        found = dft.many.fit(dft.Thruster(), logs)
        own = dft.many.fleet(found)
        little = {log.name: log for log in logs if log.name in SPARSE}
        for vehicle in SPARSE:
            values = found[vehicle].parameters
            rows["separate"].append([values[n].value / true[vehicle][n] - 1 for n in MEDIAN])
        for route, given in (("quadratic", None), ("exact", little)):
            pooled = own.pool(logs=given, seed=seed)
            assert pooled.convergence.status.ok, pooled.convergence.message
            table = pooled.table.set_index(["vehicle", "parameter"])
            for vehicle in SPARSE:
                told = [table.loc[(vehicle, n), "median"] / true[vehicle][n] - 1 for n in MEDIAN]
                rows[route].append(told)
            for (vehicle, name), row in table.iterrows():
                hit = row["low"] <= true[vehicle][name] <= row["high"]
                inside[route].append((vehicle in SPARSE, hit))
    errors = {route: np.array(each) for route, each in rows.items()}

    def left(route):
        e = errors[route]
        return np.array([np.sqrt(np.mean(e**2)), np.median(np.abs(e))])

    gain = {route: 1 - left(route) / left("separate") for route in inside}
    return gain, {route: np.array(each) for route, each in inside.items()}


@pytest.mark.slow
def test_sparse_vehicles_gain_and_intervals_cover(capsys):
    gain, hits = study()
    with capsys.disabled():
        for route, (rms, median) in gain.items():
            of, sparse = hits[route][:, 1], hits[route][hits[route][:, 0] == 1, 1]
            print(
                f"\n{route}: rms -{100 * rms:.0f} %, median -{100 * median:.0f} %; covers "
                f"{100 * of.mean():.1f} % of {len(of)}, of sparse vehicles "
                f"{100 * sparse.mean():.1f} % of {len(sparse)}"
            )
    for route in gain:
        assert min(gain[route]) >= 0.30
        assert 0.92 <= hits[route][:, 1].mean() <= 0.98
    sparse = hits["exact"][hits["exact"][:, 0] == 1, 1]
    assert 0.92 <= sparse.mean() <= 0.98


@pytest.mark.slow
def test_a_vehicle_without_a_speed_sensor_borrows_its_scale():
    """From thrust alone, alpha * beta and ct / alpha^2 are known, and nothing of their scale."""
    truth, logs = drawn_fleet(1, vehicles=6, sparse=0)
    given = logs[5]
    thrust = {"thrust": given.values("thrust", "N")}
    command = {"command": given.values("command", "V")}
    logs[5] = dft.Log(given.time, command, thrust, name="auv5")
    found = dft.many.fit(dft.Thruster(), logs)
    assert found["auv5"].status is dft.estimation.Status.NOT_IDENTIFIABLE
    pooled = dft.many.fleet(found).pool(logs={"auv5": logs[5]})
    assert pooled.convergence.status.ok, pooled.convergence.message
    own = {n: np.log(pooled.post.posterior[n].sel(vehicle="auv5").values.ravel()) for n in MEDIAN}
    true = {n: np.log(truth[5][n]) for n in MEDIAN}
    law = {n: np.log(values).std() for n, values in pooled.new_vehicle().items()}
    for combination in ({"alpha": 1, "beta": 1}, {"ct": 1, "alpha": -2}):
        drawn = sum(k * own[n] for n, k in combination.items())
        wanted = sum(k * true[n] for n, k in combination.items())
        assert drawn.std() < 0.02
        assert drawn.mean() == pytest.approx(wanted, abs=4 * drawn.std())
    assert 0.2 * law["alpha"] < own["alpha"].std() < law["alpha"]
    plain = dft.many.fleet(found).pool()
    assert "auv5" in plain.notes[-1]
    free = np.log(plain.post.posterior["alpha"].sel(vehicle="auv5").values.ravel())
    assert free.std() == pytest.approx(np.log(plain.new_vehicle()["alpha"]).std(), rel=0.2)


@pytest.mark.slow
def test_the_example_finds_what_it_hid(tmp_path):
    text = run("fleet", tmp_path)
    assert len(re.findall(r"^Outlier: auv3, ", text, re.MULTILINE)) == 2
    assert "Outlier: auv3, alpha" in text
    assert re.findall(r"^Drift: (\w+), (\w+) ", text, re.MULTILINE) == [("auv5", "alpha")]
    assert "Effect: command dead band in auv2 (4 of 4)." in text
    rows = re.findall(r"^auv[67] \w+ +(\S+) +(\S+) +(\S+)$", text, re.MULTILINE)
    true, alone, pooled = np.array(rows, float).T
    assert np.mean((pooled / true - 1) ** 2) < np.mean((alone / true - 1) ** 2)
    for name in ("spread", "drift", "effects", "pooled"):
        assert figure(tmp_path, f"fleet_{name}.png")
