"""Pooling on simulated fleets: sparse vehicles gain, and intervals cover."""

import numpy as np
import pytest
from simulated_fleets import MEDIAN, drawn_fleet

import diffthrust as dft

FLEETS, SPARSE = 40, ("auv7", "auv8", "auv9")


@pytest.mark.slow
def test_sparse_vehicles_gain_and_intervals_cover(capsys):
    rows = {"separate": [], "quadratic": [], "exact": []}
    inside = {"quadratic": [], "exact": []}
    for seed in range(FLEETS):
        truth, logs = drawn_fleet(seed)
        true = {log.name: values for log, values in zip(logs, truth, strict=True)}
        found = dft.many.fit(dft.Thruster(), logs)
        own = dft.fleet(found)
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
    told, gain = [], {}
    alone = np.array(rows["separate"])
    for route in ("quadratic", "exact"):
        errors, hits = np.array(rows[route]), np.array(inside[route])
        rms = [np.sqrt(np.mean(e**2, axis=0)) for e in (alone, errors)]
        whole = [np.sqrt(np.mean(e**2)) for e in (alone, errors)]
        middle = [np.median(np.abs(e)) for e in (alone, errors)]
        gain[route] = 1 - whole[1] / whole[0], 1 - middle[1] / middle[0]
        told.append(
            f"{route}: rms {whole[0]:.3f} -> {whole[1]:.3f} (-{100 * gain[route][0]:.0f} %), "
            f"median {middle[0]:.3f} -> {middle[1]:.3f} (-{100 * gain[route][1]:.0f} %), "
            f"by parameter {np.round(rms[0], 3)} -> {np.round(rms[1], 3)}; covers "
            f"{100 * hits[:, 1].mean():.1f} % of {len(hits)}, of sparse vehicles "
            f"{100 * hits[hits[:, 0] == 1, 1].mean():.1f} % of {int(hits[:, 0].sum())}"
        )
    with capsys.disabled():
        print("", *told, sep="\n")
    for route in ("quadratic", "exact"):
        hits = np.array(inside[route])
        assert min(gain[route]) >= 0.30
        assert 0.92 <= hits[:, 1].mean() <= 0.98
    sparse = np.array([hit for little, hit in inside["exact"] if little])
    assert 0.92 <= sparse.mean() <= 0.98
