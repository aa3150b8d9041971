"""The parts of the innovations form, one by one, against NumPy."""

from types import SimpleNamespace
from typing import ClassVar

import jax
import numpy as np
import pytest
from observers import (
    CLIP,
    REAL,
    WIDE,
    Correction,
    Limits,
    Observer,
    direction,
    is_memory,
    limited,
    observer_of,
    uncorrected,
)
from problems import nrmse

import diffthrust as dft
from diffthrust import Log
from diffthrust.models import Relaxing

STEP, DURATION = 0.05, 40.0


def named(duration=DURATION, step=STEP, **how):
    observer = Observer(
        ("speed", "thrust"),
        ("speed",),
        (("speed", ("speed",)), ("hidden", ("speed", "other"))),
        ("speed", "hidden"),
        **how,
    )
    return observer.parameters(duration, step)


def plain(p):
    return p.value, p.unit, p.bounds, p.size, p.fixed, p.transform


def test_gains_and_memories_with_their_starts_and_bounds():
    memory = (0.5 * STEP, 10 * DURATION)
    expected = {
        "noise.speed.gain.speed": (0.2, "", (0.0, 1.0), 0.3, False, "linear"),
        "noise.speed.drift.speed": (0.05, "", (0.0, 1.0), 0.3, False, "linear"),
        "noise.speed.memory": (1.0, "s", memory, None, False, "log"),
        "noise.hidden.gain.speed": (0.0, "", (None, 1.0), 0.3, False, "linear"),
        "noise.hidden.drift.speed": (0.0, "", (None, 1.0), 0.3, False, "linear"),
        "noise.hidden.gain.other": (0.0, "", (None, 1.0), 0.3, False, "linear"),
        "noise.hidden.drift.other": (0.0, "", (None, 1.0), 0.3, False, "linear"),
        "noise.hidden.memory": (1.0, "s", memory, None, False, "log"),
        "noise.speed.colour": (0.2, "", (0.0, 1.0), 0.3, False, "linear"),
        "noise.speed.correlation": (5 * STEP, "s", memory, None, False, "log"),
        "noise.thrust.colour": (0.2, "", (0.0, 1.0), 0.3, False, "linear"),
        "noise.thrust.correlation": (5 * STEP, "s", memory, None, False, "log"),
    }
    assert {name: plain(p) for name, p in named().items()} == expected


def test_one_that_is_still_keeps_only_the_errors_of_its_sensors():
    whole = (1.0, "", (0.0, 1.0), 0.3, True, "linear")
    still = named(still=True)
    for name, p in still.items():
        if name.endswith("colour"):
            assert plain(p) == whole
        elif name.endswith("correlation"):
            assert not p.fixed
        else:
            assert p.fixed
            assert is_memory(name) or p.value == 0.0


def test_that_of_a_simulation_estimates_nothing_and_corrects_nothing():
    assert OBSERVER.simulation.parameters(DURATION, STEP) == {}
    assert OBSERVER.simulation.fed == OBSERVER.fed  # so that initial states are estimated alike


@pytest.mark.parametrize(
    ("duration", "step", "memory"), [(1.0, 0.1, 0.5), (40.0, 0.7, 1.4), (40.0, 0.4, 1.0)]
)
def test_memories_are_begun_within_what_a_log_can_tell(duration, step, memory):
    assert named(duration, step)["noise.speed.memory"].value == pytest.approx(memory)


def test_names():
    names = ["noise.a.memory", "noise.a.correlation", "noise.a.colour", "noise.a.gain.memory_of"]
    assert [is_memory(name) for name in names] == [True, True, False, False]
    assert uncorrected(names) == {"noise.a.colour": 0.0, "noise.a.gain.memory_of": 0.0}
    assert (CLIP, WIDE, REAL) == (4.0, 5.0, 10.0)


class Chain(dft.Model):
    """Three states, of which each drives the next; one rate passes a port."""

    name = "chain_of_three"
    inputs: ClassVar = {"u": "V"}
    states: ClassVar = {"first": "m", "second": "m", "third": "m", "aside": "m"}
    outputs: ClassVar = {"second": "m", "third": "m", "sum": "m"}
    ports: ClassVar = {"push": "of the first [m/s]"}
    rate: float = dft.parameter(0.7, "1/s", bounds=(0, None))

    def equations(self, s, port):
        rates = {
            "first": port("push", s.u - s.first),
            "second": self.rate * (s.first - s.second),
            "third": s.second,
            "aside": s.third,
        }
        return rates, {"second": s.second, "third": s.third, "sum": s.second + s.third}


def log(count=6, **measured):
    given = {name: np.ones(count) for name in measured} or {"second": np.ones(count)}
    return Log(0.1 * np.arange(count), {"u": np.ones(count)}, given)


def test_what_is_corrected_by_what():
    found = observer_of(Chain(), log(), ("second", "sum"))
    assert found.fed == ("second",)
    assert found.corrected == (("first", ("second",)), ("second", ("second",)))
    assert found.forced == ("first",)  # its rate alone passes a port
    assert not found.still
    both = observer_of(Chain(), log(), ("second", "third"), still=True)
    assert both.corrected[0] == ("first", ("second", "third"))
    assert both.corrected[1:] == (("second", ("second",)), ("third", ("third",)))
    assert both.still
    deaf = observer_of(Chain(), log(), ("second", "third"), remembering={"second"})
    assert deaf.fed == ("third",)
    assert deaf.corrected == (("second", ("third",)), ("third", ("third",)))
    assert deaf.channels == ("second", "third")


class Bare(Chain):
    """Without ports."""

    name = "chain_without_ports"
    ports: ClassVar = {}

    def equations(self, s, port):
        return super().equations(s, lambda name, value: value)


def test_without_ports_random_forces_act_on_all():
    assert observer_of(Bare(), log(), ("second",)).forced == ("first", "second")


# One correction, by hand.

VALUES = {
    "noise.first.gain.second": 0.3, "noise.first.gain.third": -0.2,
    "noise.first.drift.second": 0.4, "noise.first.drift.third": 0.15, "noise.first.memory": 0.8,
    "noise.second.gain.second": 0.6, "noise.third.gain.third": 0.35,
    "noise.second.drift.second": 0.25, "noise.second.memory": 1.7,
    "noise.second.colour": 0.45, "noise.second.correlation": 0.3,
    "noise.third.colour": 0.55, "noise.third.correlation": 0.9,
}  # fmt: skip
TIME = np.array([0.0, 0.1, 0.35, 0.45, 0.45])
MEASURED = np.array([[1.3, np.nan, -0.4, 2.0, 2.0], [0.2, 0.9, 7.0, -0.6, -0.6]])
STATE = {
    "first": np.array([0.4, -0.3, 1.2, 0.8, 0.8]),
    "second": np.array([0.9, -1.4, 0.6, 0.3, 0.3]),
    "third": np.array([-0.5, 0.7, 1.1, -2.2, -2.2]),
    "aside": np.zeros(5),
    "drift.first": np.array([0.1, 0.2, -0.3, 0.4, 0.4]),
    "drift.second": np.array([-0.6, 0.5, 0.15, 0.25, 0.25]),
    "colour.second": np.array([0.05, -0.15, 0.25, 0.35, 0.35]),
    "colour.third": np.array([-0.45, 0.1, 0.2, 0.3, 0.3]),
}
OBSERVER = Observer(
    ("second", "third"),
    ("second", "third"),
    (("first", ("second", "third")), ("second", ("second",)), ("third", ("third",))),
    ("first", "second"),
)
CLIPS = np.array([1.5, 0.9])


def correction(unsigned=(False, False), reach=2.0):
    return Correction(
        OBSERVER, Chain(), VALUES, TIME, MEASURED, np.array(unsigned), Limits(CLIPS, reach)
    )


def bent(e, limit):
    return e / (1.0 + (e / limit) ** 8) ** 0.125


@pytest.mark.parametrize("unsigned", [(False, False), (True, False)])
def test_one_correction_is_that_written_out(unsigned):
    run = correction(unsigned)
    found = run.correct(STATE, {"u": np.ones(5), "time": TIME}, run.rows)
    step = np.append(np.diff(TIME), 0.0)
    rate = np.divide(1.0, step, out=np.zeros(5), where=step > 0)
    np.testing.assert_allclose(run.rows["1 / step"], rate, rtol=1e-12)
    x, seen, toward = STATE, {}, {}
    for i, c in enumerate(("second", "third")):
        modelled, toward[c] = x[c], 1.0
        if unsigned[i]:  # within half a standard deviation its sign is not told
            toward[c] = np.tanh(x[c] / CLIPS[i])
            modelled = x[c] * np.tanh(x[c] / (0.5 * CLIPS[i] / 4.0))
        rest = MEASURED[i] - modelled - x[f"colour.{c}"]
        seen[c] = bent(np.where(np.isnan(rest), 0.0, rest), 2.0 * CLIPS[i])
    e = {c: toward[c] * seen[c] for c in seen}
    kept = {n: np.exp(-step / VALUES[f"noise.{n}.memory"]) for n in ("first", "second")}
    drift = 0.4 * e["second"] + 0.15 * e["third"]
    expected = {
        "first": x["first"] + rate * (0.3 * e["second"] - 0.2 * e["third"]),
        "second": x["second"] + 0.6 * e["second"],
        "third": x["third"] + 0.35 * e["third"],
        "aside": x["aside"],
        "drift.first": kept["first"] * (x["drift.first"] + rate**2 * drift),
        "drift.second": kept["second"] * (x["drift.second"] + rate * 0.25 * e["second"]),
    }
    for c in seen:
        lasting = np.exp(-step / VALUES[f"noise.{c}.correlation"])
        gain = VALUES[f"noise.{c}.colour"]
        expected[f"colour.{c}"] = lasting * (x[f"colour.{c}"] + gain * seen[c])
    assert set(found) == set(expected)
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-9, atol=1e-12, err_msg=name)


def test_random_accelerations_act_on_the_forced_states_alone():
    run = correction()
    found = {"first": 1.0, "second": Relaxing(2.0, 0.5), "third": 3.0, "aside": 4.0}
    rates = run.rates(found, {"drift.first": 0.3, "drift.second": -0.7})
    assert (rates["first"], rates["third"], rates["aside"]) == (1.3, 3.0, 4.0)
    assert rates["second"] == Relaxing(pytest.approx(1.3), 0.5)
    assert run.start == dict.fromkeys(
        ("drift.first", "drift.second", "colour.second", "colour.third"), 0.0
    )
    assert all(rates[name] == 0.0 for name in run.start)


def test_errors_bend_and_directions_turn_as_they_say():
    e = np.array([-9.0, -1.4, -0.7, 0.0, 0.3, 1.0, 2.5])
    np.testing.assert_allclose(limited(e, 1.3), bent(e, 1.3), rtol=1e-12)
    assert float(limited(0.7, 1.0)) == pytest.approx(0.7 * (1 - 0.007), abs=3e-4)
    assert float(limited(1.0, 1.0)) == pytest.approx(0.92, abs=4e-3)
    np.testing.assert_allclose(direction(e, 0.8), np.tanh(e / 0.8), rtol=1e-12)
    np.testing.assert_array_equal(direction(e, np.inf), np.where(e < 0, -1.0, 1.0))
    far = np.array([-1e12, -20.0, -1.0, 0.0, 1.0, 20.0, 1e12])
    told = [-4.0, -4.0, -1.0, 0.0, 1.0, 4.0, 4.0]
    np.testing.assert_allclose(limited(far, 4.0), told, rtol=2e-5)
    np.testing.assert_allclose(limited(far, np.inf), far, rtol=1e-6)
    assert np.all(np.isfinite(jax.vmap(jax.grad(limited), (0, None))(far, 4.0)))
    assert jax.grad(direction)(0.0, 2.0) == pytest.approx(0.5)  # it passes zero smoothly


def test_a_correction_knows_whole_turns():
    class Turning(Chain):
        name = "turning_chain"
        angles: ClassVar = ("second",)

    run = correction()
    run.model = Turning()
    rest = run.error("second", np.zeros(3), np.array([6.5, -3.0, np.nan]), 0.1)
    np.testing.assert_allclose(rest, [6.4 - 2 * np.pi, -3.1, 0.0], rtol=1e-12)
    plain_run = SimpleNamespace(**vars(run))
    plain_run.model = Chain()
    rest = Correction.error(plain_run, "third", np.zeros(1), np.array([6.5]), 0.1)
    np.testing.assert_allclose(rest, [6.4])


@pytest.mark.parametrize("name", ["rate", "step", "drift", "colour"])
def test_a_reading_is_that_of_its_channel_whatever_its_name(name):
    observer = Observer((name,), (name,), ((name, (name,)),), (name,))
    values = {f"noise.{name}.{of}": 0.5 for of in ("gain", "drift", "memory", "colour")}
    values[f"noise.{name}.correlation"] = 1.0
    readings = np.arange(5.0)[None]
    run = Correction(
        observer, Chain(), values, TIME, readings, np.zeros(1, bool), Limits(np.full(1, 9.0), 1.0)
    )
    np.testing.assert_array_equal(run.rows[name], readings[0])


def test_one_step_errors_of_a_model_that_runs_away_are_infinite_in_silence(monkeypatch):
    """A diagnosis of a Kingfisher printed NumPy's warnings of an overflow."""
    far = SimpleNamespace(errors=np.full((1, 4), 1e200), measured=np.arange(4.0)[None])
    monkeypatch.setattr(f"{nrmse.__module__}.passes", lambda problem: [far])
    assert nrmse(SimpleNamespace(layout=SimpleNamespace(channels=("surge",)))) == np.inf
