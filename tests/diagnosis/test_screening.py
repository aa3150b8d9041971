"""The screen of a diagnosis, on made-up trials and on one small set of logs."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from compilations import compilations
from observers import WIDE
from reference import inputs, noise, thruster
from steps import (
    CandidateFitter,
    Programs,
    bind,
    continued_beside,
    edge_of,
    fitted_from_fallback,
    is_at_null,
    levels_of,
    predicted_gains,
    probes,
    promising_constants,
    scores_at_port,
    screened,
    screening_module,
    trial_programs_module,
)

import diffthrust as dft

TIME = np.arange(500) * 0.05


@dataclass(frozen=True)
class Made:
    """A trial with as much of `TrialFit` as a probe reads."""

    cost: float
    values: dict = field(default_factory=dict)
    effects: tuple = ("effect",)
    initial_states: None = None
    clip: None = None


@pytest.fixture(scope="module")
def trials():
    """A shaft with Coulomb friction, and three candidates."""
    rng = np.random.default_rng(2)
    logs = []
    for _ in range(2):
        command = inputs.low_passed_random(TIME, 2.0, rng)
        record = thruster.simulate(TIME, command, method="rk4", coulomb_friction=20.0)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        logs.append(dft.Log(record.time, record.inputs, record.measured))
    fit = dft.fit(dft.Thruster(), logs, starts=2)
    known = dft.effects.EFFECTS
    names = ("coulomb_friction", "thrust_sensor_offset", "command_saturation")
    made = CandidateFitter(fit.model, [known[n]() for n in names], bind(fit.model, logs), [])
    return made, made.base()


@pytest.mark.thorough
@pytest.mark.parametrize(("longest", "programs"), [(5000, [3, 3, 3]), (0, [0, 2, 3])])
def test_over_short_logs_one_program_has_all_candidates(trials, monkeypatch, longest, programs):
    monkeypatch.setattr(trial_programs_module, "_SHORT", longest)
    made, _ = trials
    everything = Programs(made.model, list(made.candidates.values()), made.records, [])
    asked = [((), ()), (("coulomb_friction",), ["thrust_sensor_offset"]), ((), [*made.candidates])]
    ready = [everything.ready(present, tried) for present, tried in asked]
    assert [len(program.effects) for program in ready] == programs
    assert len({id(program) for program in ready}) == len({*programs})


def test_effects_that_were_tried_together_are_admitted_by_one_program(monkeypatch):
    """Each effect of the bench's logs had its own program of whole runs."""
    monkeypatch.setattr(trial_programs_module, "_SHORT", 0)
    model, time = dft.Thruster(), 0.05 * np.arange(200)
    log = dft.Log(time, {"command": np.sin(time)}, {"speed": np.sin(time), "thrust": np.sin(time)})
    names = ("coulomb_friction", "thrust_sensor_offset")
    candidates = [dft.effects.EFFECTS[n]() for n in (*names, "command_saturation")]
    programs = Programs(model, candidates, bind(model, [log]), [])
    programs.ready((), names)
    simulating = programs.simulating()
    first, second = (simulating.ready((name,)) for name in names)
    assert first is second is simulating.ready(())
    assert first.effects == {*names}


@pytest.mark.thorough
def test_an_effect_whose_null_is_infinite_begins_at_the_value_that_is_given(trials):
    made, base = trials
    given = {"command_saturation.limit": 0.9 * np.abs(made.records[0].inputs["command"]).max()}
    there = made.base(("command_saturation",), {**base.values, **given})
    assert np.isfinite(there.cost)
    assert there.cost < base.cost + 1.0  # it ends at least as well as without it


@pytest.mark.slow
def test_next_to_a_null_is_promised_what_a_step_of_a_fit_from_there_promises(trials):
    made, base = trials
    levels, gain = levels_of(made, base), {}
    for name in ("coulomb_friction", "thrust_sensor_offset"):
        effect = made.candidates[name]
        point, *_ = near = probes(effect, levels)[0]
        promised, *_ = predicted_gains(base.response, effect, near, [])
        step = made.solve(
            (name,), {**base.values, **point}, base.initial_states, base.clip, budget=1
        )
        assert promised.gain == pytest.approx(base.cost - step.expected, abs=0.05)
        gain[name] = 2 * promised.gain
    assert gain["coulomb_friction"] > 50 > 15 > gain["thrust_sensor_offset"]


def test_the_screen_leaves_out_what_is_hopeless_and_keeps_what_is_there(trials):
    made, base = trials
    found = screened(made, list(made.candidates), base, levels_of(made, base))
    assert "coulomb_friction" in found
    best = found["coulomb_friction"]
    assert 2 * (base.cost - best.cost) > 50
    assert best.values["coulomb_friction.level"] == pytest.approx(20.0, rel=0.1)


def test_what_was_fitted_before_goes_on_from_its_size_there(trials):
    made, base = trials
    sizes = {
        "coulomb_friction": {"coulomb_friction.level": 12.0},
        "thrust_sensor_offset": {"thrust_sensor_offset.offset": 0.1},
    }
    found = continued_beside(made, base, sizes)
    assert list(found) == ["coulomb_friction"]
    assert found["coulomb_friction"].values["coulomb_friction.level"] == pytest.approx(20, rel=0.1)
    assert continued_beside(made, base, {}) == {}


def test_what_promises_less_than_is_asked_is_not_fitted(trials):
    made, base = trials
    found = screened(made, list(made.candidates), base, levels_of(made, base))
    gain = 2 * (base.cost - found["coulomb_friction"].cost)
    some = screened(made, list(made.candidates), base, levels_of(made, base), least=0.1 * gain)
    assert list(some) == ["coulomb_friction"]
    assert not screened(made, list(made.candidates), base, levels_of(made, base), least=10 * gain)


def test_of_constants_those_that_promise_most_are_fitted(monkeypatch):
    """A craft of eight thrusters holds 30."""
    gains = {f"c{k}": 100.0 - k for k in range(20)} | {"faint": 0.4}
    monkeypatch.setattr(screening_module, "_gain_of_constant", lambda f, r, name: gains[name])
    fitter, present = SimpleNamespace(samples=1000), SimpleNamespace(response=None)
    assert promising_constants(fitter, present, list(gains)) == [f"c{k}" for k in range(8)]
    assert promising_constants(fitter, present, ["c3", "faint"]) == ["c3"]
    assert promising_constants(fitter, present, ["c3", "c9"], least=190.0) == ["c3"]


def test_series_that_go_through_the_logs_together_are_tested_as_each_alone():
    rng, model, logs = np.random.default_rng(8), dft.Thruster(), []
    for count in (300, 420):
        time = 0.05 * np.arange(count)
        command = inputs.low_passed_random(time, 2.0, rng)
        record = thruster.simulate(time, command, method="rk4", coulomb_friction=20.0)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        record.measured["thrust"][rng.random(count) < 0.1] = np.nan
        logs.append(dft.Log(record.time, record.inputs, record.measured))
    made = CandidateFitter(model, [], bind(model, logs), [])
    base = made.base()
    lengths = [record.log.time.size for record in made.records]
    sets = [[rng.standard_normal((knots, n)) for n in lengths] for knots in (6, 2, 30)]
    together = scores_at_port("drive", base, sets)
    for series, (p, estimated, covariance) in zip(sets, together, strict=True):
        ((p_alone, alone, covariance_alone),) = scores_at_port("drive", base, [series])
        assert p == pytest.approx(p_alone, rel=1e-6)
        np.testing.assert_allclose(estimated, alone, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(covariance, covariance_alone, rtol=1e-8, atol=1e-15)
    nothing = [np.full((3, n), np.nan) for n in lengths]
    beside = scores_at_port("drive", base, [sets[0], nothing])
    assert beside[0][0] == pytest.approx(together[0][0], rel=1e-6)


def test_an_effect_at_its_null_is_idle(trials):
    made, base = trials
    values = {**base.values, "coulomb_friction.level": 20.0}
    there = made.solve(("coulomb_friction",), values, None, base.clip)
    assert not is_at_null(made, there)
    assert is_at_null(made, replace(there, values=made.absent(["coulomb_friction"], there.values)))


@pytest.mark.slow
def test_an_instant_is_found_wherever_it_lies():
    rng = np.random.default_rng(5)
    command = inputs.low_passed_random(TIME, 2.0, rng)
    record = thruster.simulate(TIME, command, method="rk4")
    lost = np.where(TIME > 9.0, 0.9, 1.0)
    record.measured["thrust"] = record.measured["thrust"] * lost
    record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
    log = dft.Log(record.time, record.inputs, record.measured)
    made = CandidateFitter(
        dft.Thruster(), [dft.effects.ThrustDegradation()], bind(dft.Thruster(), [log]), []
    )
    base = made.base()
    found = screened(made, ["thrust_degradation"], base, levels_of(made, base))
    values = found["thrust_degradation"].values
    assert values["thrust_degradation.instant"] == pytest.approx(9.0, abs=0.5)
    assert values["thrust_degradation.fraction"] == pytest.approx(0.1, rel=0.2)


def test_the_edge_of_a_limit_is_found_from_inside():
    edge = edge_of(1.0, 1.2, lambda value: value < 1.137)
    assert 1.137 > edge > 1.137 * (1 - 2e-4)


@pytest.mark.slow
def test_a_limit_that_cuts_only_the_highest_commands_is_found():
    rng = np.random.default_rng(8)
    command = inputs.low_passed_random(TIME, 2.0, rng)
    limit = 0.985 * np.abs(command).max()
    record = thruster.simulate(TIME, np.clip(command, -limit, limit), method="rk4")
    record = noise.measure(record, rng, speed=noise.Sensor(0.05), thrust=noise.Sensor(0.05))
    log = dft.Log(record.time, {"command": command}, record.measured)
    made = CandidateFitter(
        dft.Thruster(), [dft.effects.CommandSaturation()], bind(dft.Thruster(), [log]), []
    )
    base = made.base()
    found = screened(made, ["command_saturation"], base, levels_of(made, base))
    assert found["command_saturation"].values["command_saturation.limit"] == pytest.approx(
        limit, rel=5e-3
    )


@pytest.mark.thorough
def test_trials_of_a_few_effects_share_one_compilation(trials):
    made, base = trials
    screened(made, list(made.candidates), base, levels_of(made, base))
    before = compilations("solved")
    screened(made, list(made.candidates), base, levels_of(made, base))
    made.settled(("coulomb_friction",), base.values, base.initial_states, base.clip)
    assert compilations("solved") == before
    fresh = CandidateFitter(
        made.model, list(made.candidates.values()), made.records[:1], [], substeps=3
    )
    fresh.base()
    assert compilations("solved") == before + 1  # from the first guess to the last limit of errors


@pytest.mark.thorough
def test_what_promises_nothing_is_neither_compiled_nor_fitted():
    rng = np.random.default_rng(12)
    command = inputs.low_passed_random(TIME, 2.0, rng)
    record = thruster.simulate(TIME, command, method="rk4")
    record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
    log = dft.Log(record.time, record.inputs, record.measured)
    known = dft.effects.EFFECTS
    names = ("coulomb_friction", "linear_damping", "actuator_lag", "command_offset")
    made = CandidateFitter(
        dft.Thruster(), [known[n]() for n in names], bind(dft.Thruster(), [log]), []
    )
    base = made.base()
    before = compilations("solved")
    assert not screened(made, names, base, levels_of(made, base))
    assert compilations("solved") == before


@pytest.mark.slow
@pytest.mark.parametrize(("what", "reach"), [("spikes of the sensor", 1.0), ("jolts", WIDE)])
def test_large_errors_are_limited_only_where_they_are_spikes(what, reach):
    rng = np.random.default_rng(4)
    command = inputs.low_passed_random(TIME, 2.0, rng)
    jolts = np.where(rng.random(TIME.size) < 0.03, rng.choice([-1.0, 1.0], TIME.size), 0.0)
    if what == "jolts":  # of the shaft, which keeps the speed that they leave
        record = thruster.simulate(TIME, command + 4.0 * jolts, method="rk4")
    else:
        record = thruster.simulate(TIME, command, method="rk4")
    record = noise.measure(record, rng, speed=noise.Sensor(0.05), thrust=noise.Sensor(0.05))
    if what != "jolts":
        record.measured["speed"] = record.measured["speed"] + 10.0 * jolts
    log = dft.Log(record.time, {"command": command}, record.measured)
    made = CandidateFitter(dft.Thruster(), [], bind(dft.Thruster(), [log]), [])
    assert made.base().clip.reach == reach


class Astray:
    """Trials in which an effect shows only with the parameters as they were given."""

    def __init__(self, costs):
        self.costs = costs

    def cost(self, effects, values, initial_states, limit):
        return self.costs[values["alpha"], values["effect.size"]]

    def solve(self, effects, values, initial_states, limit, budget):
        return dict(values)


@pytest.mark.parametrize(("low", "followed"), [(60.0, [0.5]), (99.5, [])])
def test_far_points_are_tried_with_the_values_as_they_were_given(low, followed):
    costs = {(1.0, 0.0): 100.0, (1.0, 0.2): np.nan, (1.0, 0.5): low, (1.0, 0.9): 80.0 + low}
    present = Made(90.0, {"alpha": 7.0, "effect.size": 0.0}, effects=())
    points = [{"effect.size": size} for size in (0.2, 0.5, 0.9)]
    found = fitted_from_fallback(Astray(costs), "effect", present, points, {"alpha": 1.0})
    assert [values["effect.size"] for values in found] == followed
