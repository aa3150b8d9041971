"""The whole-run evaluator against DOP853, and its least squares where the answer is known."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from . import whole_runs as wr

TIME = 0.1 * np.arange(120)
EXACT = 3e-3
"""Of a channel's standard deviation, at the worst sample, just after a step of the fastest one."""

SYSTEMS = {
    "boat": (
        wr.twin_boat(drag=("surge", "sway", "yaw"), current=True, gain=True, exchanged=True),
        {"to_north": 0.2, "to_east": -0.1, "gain": 0.1},
    ),
    "boat without a path": (wr.twin_boat(drag=("surge",)), {}),
    "effort": (wr.twin_boat(effort=True, positions=True), {"exponent": 1.7, "m11": 1.0}),
    "thruster": (wr.yoerger(deadband=True, sag=True, damping=True, reverse=True), {}),
    "late thruster": (wr.yoerger(delay=True, saturation=True, offset=True), {"delay": 0.2}),
    "speed loop": (wr.speed_loop(deadband=True), {}),
    "tanks": (wr.two_tanks(overflow=True, linear=True), {"rim": 0.5, "upper_linear": 0.01}),
    "axis": (wr.rail_axis(quadratic=True, dry=True, offset=True), {"width": 0.05}),
}
SCALES = {
    "left_force": 12.0,
    "right_force": 12.0,
    "command": 3.0,
    "supply_voltage": 1.0,
    "voltage": 3.0,
    "force": 60.0,
}


def a_run(system, seed):
    """A run under held random inputs; a delayed one moves by whole samples."""
    rng = np.random.default_rng(seed)
    names = {n for n in SCALES if n in _read_by(system)}
    inputs = {n: SCALES[n] * np.repeat(rng.uniform(-1, 1, 12), 10) for n in sorted(names)}
    if "supply_voltage" in inputs:
        inputs["supply_voltage"] += 15.0
    if "voltage" in inputs:
        inputs["voltage"] = np.abs(inputs["voltage"]) + 5.0
    initial = dict.fromkeys(system.states, 0.3)
    return wr.Run(TIME, inputs, {}, initial)


def _read_by(system):
    """The inputs that the rates or the outputs read."""
    read = set()

    class Asked(dict):
        def __missing__(self, name):
            read.add(name)
            return np.zeros(1)

    p = {n: np.full(1, r.start) for n, r in system.parameters.items()}
    x = {s: np.full(1, 0.3) for s in system.states}
    for part in (system.rates, system.outputs):
        part(x, Asked(), p)
    return read


def exactly(system, run, values):
    """Channels by DOP853, begun anew at each sample of the inputs."""
    p = {n: np.full(1, v) for n, v in values.items()}
    x = np.array([run.initial[s] for s in system.states])
    inputs = dict(run.inputs)
    for name, delay in system.delays.items():
        shift = round(values[delay] / (run.time[1] - run.time[0]))
        series = inputs[name]
        inputs[name] = np.concatenate([np.full(shift, series[0]), series[: len(series) - shift]])
    kept = []
    for k, t in enumerate(run.time):
        u = {n: np.full(1, series[k]) for n, series in inputs.items()}
        now = {s: np.full(1, v) for s, v in zip(system.states, x, strict=True)}
        kept.append({c: float(np.squeeze(v)) for c, v in system.outputs(now, u, p).items()})
        if k == len(run.time) - 1:
            break

        def rates(s, x, k=k, u=u, t=t):
            between = (s - t) / (run.time[k + 1] - t)
            straight = {
                n: np.full(1, inputs[n][k] + between * (inputs[n][k + 1] - inputs[n][k]))
                for n in system.linear
            }
            now = {s: np.full(1, v) for s, v in zip(system.states, x, strict=True)}
            dx = system.rates(now, {**u, **straight}, p)
            return [float(np.squeeze(dx[s])) for s in system.states]

        x = solve_ivp(rates, (t, run.time[k + 1]), x, "DOP853", rtol=1e-8, atol=1e-9).y[:, -1]
    return {c: np.array([row[c] for row in kept]) for c in kept[0]}


@pytest.mark.parametrize("name", SYSTEMS)
def test_simulations_agree_with_dop853(name):
    system, given = SYSTEMS[name]
    values = {**{n: r.start for n, r in system.parameters.items()}, **given}
    run = a_run(system, 3)
    assert run.inputs
    (modelled,) = wr.simulate(system, [run], values)
    exact = exactly(system, run, values)
    for channel, series in exact.items():
        assert np.std(series) > 0
        worst = np.max(np.abs(modelled[channel] - series))
        assert worst <= EXACT * np.std(series), channel


def test_runs_and_parameter_sets_do_not_mix():
    system, given = SYSTEMS["boat"]
    values = {**{n: r.start for n, r in system.parameters.items()}, **given}
    runs = [a_run(system, seed) for seed in (1, 2)]
    runs[0] = wr.Run(
        runs[0].time[:70], {n: x[:70] for n, x in runs[0].inputs.items()}, {}, runs[0].initial
    )
    alone = [wr.simulate(system, [run], values)[0]["surge"] for run in runs]
    together = wr.simulate(system, runs, {**values, "m11": np.array([values["m11"], 25.0])})
    for series, both in zip(alone, together, strict=True):
        np.testing.assert_allclose(both["surge"][:, 0], series, rtol=1e-9, atol=1e-12)
    assert np.abs(together[0]["surge"][:, 1] - alone[0]).max() > 1e-3


def test_a_fit_finds_the_values_that_made_the_runs():
    system = wr.yoerger(deadband=True).fixed(nominal=16.0)
    truth = {"alpha": 0.03, "beta": 50.0, "ct": 0.015, "nominal": 16.0, "band": 0.4}
    rng = np.random.default_rng(8)
    runs = []
    for seed in (4, 5):
        run = a_run(system, seed)
        (made,) = wr.simulate(system, [run], truth)
        measured = {c: x + 0.02 * np.std(x) * rng.standard_normal(len(x)) for c, x in made.items()}
        runs.append(wr.Run(run.time, run.inputs, measured, run.initial))
    found = wr.fit(system, runs[:1], starts=3)
    for name, value in truth.items():
        assert found.values[name] == pytest.approx(value, rel=0.03), name
    assert wr.errors(system, runs[1:], found.values)["all"] == pytest.approx(0.02, rel=0.1)
    assert sorted(found.costs)[1] == pytest.approx(min(found.costs), rel=1e-3)


def test_errors_are_pooled_and_angles_go_round():
    time = np.arange(5.0)
    system = wr.System(
        ("x",),
        lambda x, u, p: {"x": 0.0 * x["x"]},
        lambda x, u, p: {"x": x["x"], "turn": x["x"]},
        {"a": wr.Range(1.0)},
        angles=frozenset(["turn"]),
    )
    measured = {"x": np.array([1.0, 2.0, np.nan, 4.0, 5.0]), "turn": 2 * np.pi + time / 10}
    run = wr.Run(time, {}, measured, {"x": 0.0})
    errors = wr.errors(system, [run], {"a": 1.0})
    seen = np.array([1.0, 2.0, 4.0, 5.0])
    assert errors["x"] == pytest.approx(np.sqrt(np.mean(seen**2)) / np.std(seen))
    assert errors["turn"] == pytest.approx(np.sqrt(np.mean(time**2)) / np.std(time))
    assert errors["all"] == pytest.approx(np.hypot(errors["x"], errors["turn"]) / np.sqrt(2))
