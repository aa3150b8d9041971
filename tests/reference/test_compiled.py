"""The compiled judge of measured sets against the evaluator in NumPy, which DOP853 holds."""

import numpy as np
import pytest

from . import compiled, plants
from . import whole_runs as wr

TIME = 0.1 * np.arange(150)


def a_run(seed, *, linear=False, **scales):
    rng = np.random.default_rng(seed)
    inputs = {n: s * np.repeat(rng.uniform(-1, 1, 15), 10) for n, s in scales.items()}
    if "supply_voltage" in inputs:
        inputs["supply_voltage"] += 14.0
    return wr.Run(TIME, inputs, {}, linear=frozenset(inputs if linear else ()))


@pytest.mark.thorough
@pytest.mark.parametrize("linear", [False, True])
def test_a_boat_with_all_that_both_have(linear):
    options = dict.fromkeys(("current", "gain", "crossed", "power", "inflow", "coupling"), True)
    system = wr.twin_boat(drag=("surge", "sway", "yaw"), **options)
    values = {n: r.start for n, r in system.parameters.items()}
    values |= {"to_north": 0.2, "to_east": -0.1, "gain": 0.1, "share": 0.3, "m23": 0.8, "d23": 2.0}
    run = a_run(1, left_force=12.0, right_force=12.0, linear=linear)
    (expected,) = wr.simulate(system, [run], values)
    plant = plants.BOAT
    modelled = compiled.simulate(plant, run, {**plant.null, **values})
    for channel in ("surge", "sway", "yaw_rate", "heading"):
        scale = np.std(expected[channel])
        assert np.abs(modelled[channel] - expected[channel]).max() < 3e-3 * scale, channel


@pytest.mark.thorough
def test_a_thruster_with_all_that_both_have():
    system = wr.yoerger(deadband=True, sag=True, damping=True, offset=True, saturation=True)
    values = {n: r.start for n, r in system.parameters.items()} | {"limit": 1.5, "band": 0.2}
    run = a_run(2, command=2.5, supply_voltage=2.0)
    (expected,) = wr.simulate(system, [run], values)
    plant = plants.THRUSTER
    values["sag"] = values.pop("share")
    modelled = compiled.simulate(plant, run, {**plant.null, **values})
    for channel, series in expected.items():
        assert np.abs(modelled[channel] - series).max() < 5e-3 * np.std(series), channel


def test_a_fit_reaches_the_values_that_made_the_runs():
    plant = plants.BOAT
    truth = {**plant.null, "m11": 25.0, "d11": 12.0, "q_surge": 8.0, "d33": 3.0, "m22": 30.0}
    runs = [a_run(seed, left_force=12.0, right_force=12.0) for seed in (3, 4)]
    rng = np.random.default_rng(5)
    for k, run in enumerate(runs):
        made = compiled.simulate(plant, run, truth)
        measured = {
            c: made[c] + 0.01 * np.std(made[c]) * rng.standard_normal(len(TIME))
            for c in ("surge", "sway", "yaw_rate")
        }
        runs[k] = wr.replace(run, measured=measured, initial=dict.fromkeys(plant.states, 0.0))
    fitted = compiled.fit(plant, runs, [*plants.HULL, "q_surge"], starts=3)
    assert fitted.errors["all"] == pytest.approx(0.01, rel=0.1)
    for name in ("m11", "d11", "q_surge", "d33", "m22"):
        assert fitted.values[name] == pytest.approx(truth[name], rel=0.05), name
