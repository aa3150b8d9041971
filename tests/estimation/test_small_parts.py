"""Small parts of an estimate, each alone: noise that lasts, what vanished, what is silent."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from problems import (
    AR1,
    RANGE,
    Gaps,
    alive,
    bind,
    insensitive_module,
    noise_levels,
    nrmse,
    status_module,
    unstable_advice,
    vanished,
    vanished_notes,
)
from trajectories import runs_over

import diffthrust as dft

CHANNELS = ("speed", "thrust")
NAMES = tuple(f"noise.{c}.lag_one" for c in CHANNELS)
GAPS = Gaps(
    steps=np.array([[1.0, 2.5, 1e15], [1.0, 3.0, 7.0]]),
    counts=np.array([[30.0, 4.0, 0.0], [12.0, 5.0, 2.0]]),
)
COUNTS = np.array([36.0, 20.0])
NUMBERS = SimpleNamespace(gaps=GAPS, counts=COUNTS)
VALUES = {NAMES[0]: 0.7, NAMES[1]: 0.35}


def test_the_parameters_of_noise_that_lasts():
    p = AR1().parameters(CHANNELS)
    assert tuple(p) == NAMES
    for one in p.values():
        assert (one.value, one.unit, one.bounds, one.size) == (0.5, "", (1e-3, 0.9999), 0.3)
        assert not one.fixed
    assert RANGE == (1e-3, 0.9999)
    nearly = dict.fromkeys(NAMES, 0.02)
    assert AR1().guesses(NAMES) == ({}, nearly, nearly)
    assert AR1().whiteness(False).limit == 0.1


def test_the_level_of_what_is_new():
    found = AR1().levels(CHANNELS, NUMBERS, VALUES)
    for c, kept in enumerate(VALUES.values()):
        sized = GAPS.counts[c] > 0
        logs = GAPS.counts[c][sized] * np.log1p(-(kept ** (2.0 * GAPS.steps[c][sized])))
        expected = np.exp(0.5 * logs.sum() / COUNTS[c])
        assert float(found[c]) == pytest.approx(expected, rel=1e-12)
    problem = SimpleNamespace(
        layout=SimpleNamespace(channels=CHANNELS, likelihood=SimpleNamespace(noise=AR1())),
        numbers=NUMBERS,
        values=lambda z: VALUES,
    )
    levels = noise_levels(problem, np.zeros(2), np.array([0.6, 1.4]))
    assert levels == pytest.approx(dict(zip(CHANNELS, [0.6, 1.4] / np.asarray(found), strict=True)))


def test_how_many_samples_are_independent():
    total = 0.0
    for c, kept in enumerate(VALUES.values()):
        apart = np.sum(GAPS.counts[c] * np.minimum(GAPS.steps[c], 1e14)) / GAPS.counts[c].sum()
        a = kept**apart
        total += COUNTS[c] * (1 - a) / (1 + a)
    assert AR1().independent(CHANNELS, NUMBERS, VALUES) == pytest.approx(total, rel=1e-9)
    none = SimpleNamespace(gaps=Gaps(GAPS.steps, 0.0 * GAPS.counts), counts=COUNTS)
    assert AR1().independent(CHANNELS, none, VALUES) == 2.0  # as few as there can be


def test_what_is_new_in_each_residual():
    rest = np.array([0.4, -1.2, 0.0, 2.2, -0.3])
    seen = np.array([True, True, False, True, True])
    links = SimpleNamespace(
        past=np.array([[0, 0, 0, 1, 3]]), gap=np.array([[1e15, 1.0, 1e15, 2.0, 1.5]])
    )
    log = SimpleNamespace(measured=np.where(seen, 1.0, np.nan)[None], links=links)
    numbers = SimpleNamespace(gaps=Gaps(GAPS.steps[:1], GAPS.counts[:1]), counts=COUNTS[:1])
    (found,) = AR1().new(CHANNELS[:1], [rest], log, numbers, VALUES)
    scale = float(AR1().levels(CHANNELS[:1], numbers, VALUES)[0])
    expected = [rest[0]]
    for i, past, gap in ((1, 0, 1.0), (3, 1, 2.0), (4, 3, 1.5)):
        kept = 0.7**gap
        expected.append((rest[i] - kept * rest[past]) / np.sqrt(1 - kept**2))
    np.testing.assert_allclose(found, scale * np.insert(expected, 2, 0.0), rtol=1e-12)


# What vanished.


def problem_of(model, free, own=None):
    return SimpleNamespace(
        model=model, free=free, own=own or free, named=model.parameters, layout=None
    )


def test_a_logarithm_ten_decades_below_its_start_is_zero():
    model = dft.Thruster(alpha=0.02).replace(ct={"bounds": (1e-30, 1.0)})
    problem = problem_of(model, ("alpha", "beta", "ct"), ("alpha", "beta", "ct"))
    z = np.log([0.02, 42.0, 0.019]) - [23.01, 22.99, 30.0]
    assert vanished(problem, z).tolist() == [True, False, False]  # ct may not be zero
    assert vanished(problem, np.append(z, -99.0)).tolist() == [True, False, False, False]
    (note,) = vanished_notes(problem, z)
    assert note.startswith(
        "alpha vanished: these logs push it to zero, where the term of alpha (pro"
    )
    bare = problem_of(model, ("alpha",))
    bare.named["alpha"] = replace(bare.named["alpha"], doc="")
    assert "where the term of alpha is absent" in vanished_notes(bare, z[:1])[0]
    linear = problem_of(dft.LinearSensor(), ("slope",))
    assert not vanished(linear, np.array([-99.0])).any()
    fixed = problem_of(model.fix("alpha"), ("alpha",))
    assert not vanished(fixed, z[:1]).any()


def test_what_vanished_in_an_earlier_fit_begins_where_logs_can_move_it():
    model = dft.Thruster(alpha=0.9e-12 * 0.037, beta=1.1e-12 * 42.0)
    again = alive(model)
    assert again.alpha == pytest.approx(0.01 * 0.037)
    assert again.beta == model.beta
    assert alive(dft.Thruster().fix("alpha")).alpha == 0.037
    held = dft.Thruster(alpha=1e-20).fix("alpha")
    assert alive(held) is held
    lost = dft.Thruster() + dft.effects.Cavitation(onset=1e-15)
    assert alive(lost).effects[0].onset == pytest.approx(0.4)


# What the logs say nothing of.


def silent(monkeypatch, information, costs, begin=False):
    """`without_silent` of three parameters, of which a solver tells this."""
    model = dft.Thruster()
    points = np.array([[0.0, 1.0, 2.0], [0.3, 1.3, 2.3], [0.6, 1.6, 2.6]])
    asked = []

    def solve(problem, z, budget=None):
        asked.append((tuple(z), budget))
        q = SimpleNamespace(information=information(z), cost=costs(z))
        return SimpleNamespace(quadratic=q)

    monkeypatch.setattr(insensitive_module, "solve", solve)
    monkeypatch.setattr(insensitive_module, "draw", lambda problem, count, rng: points[:count])
    problem = SimpleNamespace(
        own=("alpha", "beta", "ct"), model=model, limits=lambda: (np.full(3, -9.0), np.full(3, 9.0))
    )
    rng = np.random.default_rng(0)
    told = insensitive_module.without_silent(problem, lambda m: m, rng, begin)
    return told, asked, problem


def test_all_that_is_felt_is_left_free(monkeypatch):
    told, asked, problem = silent(monkeypatch, lambda z: np.eye(3), lambda z: 1.0, begin=True)
    assert told[0] is problem
    assert told[1] == ()
    assert asked == [((0.0, 1.0, 2.0), insensitive_module.FIRST_BUDGET)]
    assert told[2] is not None
    told, asked, _ = silent(monkeypatch, lambda z: np.eye(3), lambda z: 1.0)
    assert told[2] is None
    assert asked == [((0.0, 1.0, 2.0), 1)]


def test_what_nothing_depends_on_is_held(monkeypatch):
    def information(z):
        return np.diag([1.0, 0.0, 2.0 * (z[2] > 2.5)])

    told, _, _ = silent(monkeypatch, information, lambda z: z[0])
    assert told[1] == ("beta",)
    assert [n for n, p in told[0].parameters.items() if p.fixed] == ["beta"]
    # a slope of zero may be that of a step: moving it changes something
    told, _, problem = silent(monkeypatch, information, lambda z: z[0] + (z[1] > 2.0))
    assert told[:2] == (problem, ())
    # where none of them is felt, none is held
    told, _, problem = silent(monkeypatch, lambda z: np.zeros((3, 3)), lambda z: 1.0)
    assert told[:2] == (problem, ())
    # a simulation that fails says nothing against it
    told, _, _ = silent(monkeypatch, information, lambda z: np.nan if z[0] > 0.1 else 1.0)
    assert told[1] == ("beta",)
    told, _, problem = silent(monkeypatch, lambda z: np.diag([1.0, np.nan, np.inf]), lambda z: 1.0)
    assert told[:2] == (problem, ())


# What an unstable model is told of.


@pytest.mark.parametrize(("times", "told"), [(0.99995e4, False), (1.00005e4, True)])
def test_runs_that_part_by_ten_thousand(monkeypatch, times, told):
    speed = np.linspace(3.0, 5.0, 9)
    run = SimpleNamespace(
        channels={"speed": None}, signals={"speed": speed}, failure="", name="run", record=None,
        substeps=3,
    )  # fmt: skip
    asked, apart = {}, np.append(np.zeros(8), times * 1e-8 * 2.0)

    def simulate_fixed(model, record, initial, substeps):
        asked.update(initial, substeps=substeps)
        return {"speed": speed + apart}

    monkeypatch.setattr(status_module, "simulate_fixed", simulate_fixed)
    status = dft.estimation.Status.NOT_CONVERGED
    advice = unstable_advice(status, dft.Thruster(), [run], False)
    assert ("grows 1e+04 times as large" in advice) == told
    assert asked == {"speed": 3.0 + 1e-8 * 2.0, "substeps": 3}
    failed = SimpleNamespace(**{**vars(run), "failure": "It failed."})
    assert unstable_advice(status, dft.Thruster(), [failed], False) == ""
    blind = SimpleNamespace(**{**vars(run), "channels": {"thrust": None}})
    assert unstable_advice(status, dft.Thruster(), [blind], False) == ""


def test_one_step_errors_over_the_spread_of_what_was_measured(monkeypatch):
    rng = np.random.default_rng(4)
    logs = []
    for count in (30, 20):
        measured = rng.normal([[1.0], [5.0], [0.0]], [[1.0], [3.0], [1.0]], (3, count))
        errors = rng.normal(size=(3, count))
        errors[1, :4] = errors[2] = np.nan
        logs.append(SimpleNamespace(errors=errors, measured=measured))
    monkeypatch.setattr("diffthrust.estimation._one_step.passes", lambda problem: logs)
    problem = SimpleNamespace(layout=SimpleNamespace(channels=("a", "b", "c")))
    e, y = (np.concatenate([getattr(one, k) for one in logs], 1) for k in ("errors", "measured"))
    seen = np.isfinite(e)
    ratios = [np.mean(e[i][seen[i]] ** 2) / np.var(y[i][seen[i]]) for i in (0, 1)]
    assert nrmse(problem) == pytest.approx(np.sqrt(np.mean(ratios)), rel=1e-12)


GROWTH, GAIN, STEP, COUNT = 1.0, 2.0, 0.05, 400


class Yawing(dft.Model):
    """The yaw rate of a hull that keeps no course: Nomoto with a negative time constant."""

    name = "yawing"
    inputs = {"rudder_angle": "rad"}
    states = {"yaw_rate": "rad/s"}
    outputs = {"yaw_rate": "rad/s"}
    ports = {}

    growth: float = dft.parameter(GROWTH, "1/s", bounds=(None, None), size=1.0)
    gain: float = dft.parameter(GAIN, "1/s^2", bounds=(None, None), size=1.0)

    def equations(self, s, port):
        return {"yaw_rate": self.growth * s.yaw_rate + self.gain * s.rudder_angle}, {
            "yaw_rate": s.yaw_rate
        }


def steered(seed=0, count=COUNT):
    """Steered by what is measured, with small gusts: solved exactly from sample to sample."""
    rng = np.random.default_rng(seed)
    kept = math.exp(GROWTH * STEP)
    rate, true, angle, read = 0.0, [], [], []
    for _ in range(count):
        true.append(rate)
        read.append(rate + 0.01 * rng.standard_normal())
        angle.append(-1.5 * read[-1] + 0.5 * rng.standard_normal())
        rate = kept * rate + (kept - 1.0) / GROWTH * GAIN * angle[-1]
        rate += 0.005 * rng.standard_normal()
    time = STEP * np.arange(count)
    units = {"rudder_angle": "rad", "yaw_rate": "rad/s"}
    return dft.Log(time, {"rudder_angle": np.array(angle)}, {"yaw_rate": np.array(read)}, units)


@pytest.mark.thorough
@pytest.mark.filterwarnings(
    "ignore::diffthrust.simulation.CoarseStepWarning"
)  # of the one that fails
def test_a_fit_of_whole_runs_that_fails_says_why_and_innovations_find_it():
    log = steered()
    whole = dft.fit(Yawing(), log, substeps=2)  # from the truth
    assert not whole.status.ok
    assert "likelihood='innovations'" in whole.message
    assert abs(whole.parameters["gain"].value - GAIN) > 0.1  # and it is wrong
    found = dft.fit(Yawing(), log, likelihood="innovations", substeps=2)
    assert found.status.ok, found.message
    assert "unstable" not in found.message
    for name, value in (("growth", GROWTH), ("gain", GAIN)):
        p = found.parameters[name]
        assert abs(p.value - value) < 4.0 * p.std_error
        assert p.std_error < 0.1 * value


@pytest.mark.thorough
def test_a_small_difference_grows_as_the_closed_form_has_it():
    log = steered(count=250)
    (run,) = runs_over(Yawing(), bind(Yawing(), [log]), initial=[{"yaw_rate": 0.0}])
    told = unstable_advice(dft.estimation.Status.NOT_CONVERGED, Yawing(), [run], False)
    grown = math.exp(GROWTH * STEP * 249)
    assert f"grows {grown:.0e} times as large" in told
    assert unstable_advice(dft.estimation.Status.CONVERGED, Yawing(), [run], False) == ""
    assert unstable_advice(dft.estimation.Status.NOT_CONVERGED, Yawing(), [run], True) == ""


def test_a_stable_model_is_not_blamed():
    stable = Yawing(growth=-1.0)
    runs = runs_over(stable, bind(stable, [steered()]))
    assert unstable_advice(dft.estimation.Status.NOT_CONVERGED, stable, runs, False) == ""
