"""The further classes of the bench: their sets, and their score."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import diffthrust as dft

from . import bench, further, hull, score, sets

KINDS = tuple(sets.kinds(further.FURTHER))
DRAWN_SLOWLY = ("too_small", "craft")


def told(verdict="adequate", groups=(), held=(), odd=(), detectable=()):
    """A diagnosis with only what the score reads."""
    added = [group[0] for group in groups]
    data = {"verdict": verdict, "added": added, "groups": [list(group) for group in groups],
            "held": dict.fromkeys(held), "odd_logs": [{"log": name} for name in odd]}  # fmt: skip
    return SimpleNamespace(
        verdict=verdict, added=added, groups=groups, detectable=detectable, remaining=None,
        detectable_groups=[(name,) for name in detectable], to_json=lambda: data,
    )  # fmt: skip


@pytest.mark.parametrize("kind", [k for k in KINDS if not k.startswith(DRAWN_SLOWLY)])
def test_a_set_is_the_same_for_the_same_seed(kind):
    first, again = bench.drawn(kind, 2), bench.drawn(kind, 2)
    for a, b in zip((*first.train, first.unseen), (*again.train, again.unseen), strict=True):
        for name, series in a.measured.items():
            np.testing.assert_array_equal(series, b.measured[name])
    assert first.group == kind.partition("/")[0]
    assert first.model.parameters == again.model.parameters


@pytest.mark.thorough
def test_what_is_wrong_in_a_set_is_what_it_asks():
    arm = bench.drawn("constants/lever_arm", 0)
    held = arm.model.parameters["lever_arm"]
    assert held.fixed
    assert abs(np.log(held.value / arm.plant.parameters["lever_arm"])) == pytest.approx(
        np.log(1.25)
    )
    six = bench.drawn("odd_log/ct", 1)
    scale = [
        np.polyfit(np.sign(log.measured["speed"]) * log.measured["speed"] ** 2,
                   log.measured["thrust"], 1)[0]
        for log in six.train
    ]  # fmt: skip
    odd = int(np.argmax(np.abs(scale / np.median(scale) - 1.0)))
    assert six.about == (f"run {odd + 1}",)
    assert len(six.train) == 6
    speed = bench.drawn("held_none", 0).train[0].measured["speed"]
    assert np.mean(np.diff(speed) == 0.0) > 0.45
    for kind, moved in (("command_deadband", "thrust"), ("quadratic_surge_drag", "sway")):
        made = bench.drawn(f"dominated/{kind}", 0)
        assert made.about == (kind,)
        clean = dft.simulate(made.model, made.unseen)[moved]
        assert np.std(made.unseen.measured[moved] - clean) > np.std(clean)
    lost = bench.drawn("gaps_none", 0).train[0].measured["speed"]
    assert 0.0 < np.mean(np.isnan(lost)) <= 0.1


def test_the_hull_with_relief_is_the_plant():
    command = np.repeat([0.0, 1.5, -2.0, 1.0], 50)
    log = dft.Log(hull.STEP * np.arange(200), {"command": command}, {})
    model = hull.ThrusterOnHull(**hull.TRUE) + hull.WayRelief(relief=0.3)
    speed = hull.simulated(hull.TRUE, 0.3, command)[:, 0]
    np.testing.assert_allclose(dft.simulate(model, log)["speed"], speed, atol=0.05)
    plain = dft.simulate(hull.ThrusterOnHull(**hull.TRUE), log)["speed"]
    assert np.max(np.abs(plain - speed)) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", further.ALIKE)
def test_rivals_do_the_same_under_these_commands(name):
    """Either of the two, at its best size, brings the model as near to the logs."""
    made = bench.drawn(f"rivals/{name}", 3)
    fits = [dft.fit(made.model + effect, made.train, starts=2) for effect in made.about]
    plain = dft.fit(made.model, made.train, starts=2)
    one, two = (fit.train.nrmse for fit in fits)
    assert abs(one / two - 1.0) < 0.01
    assert plain.train.nrmse > 1.02 * max(one, two)


def test_the_score_of_what_is_asked():
    arm = bench.drawn("constants/ct", 0)
    for said, label in (
        (told(held=["ct"]), "right"),
        (told("effects_found", [["thrust_sensor_scale"]], held=["ct"]), "right"),
        (told("effects_found", [["cavitation"]], held=["ct"]), "false alarm"),
        (told(held=["ct", "alpha"]), "false alarm"),
        (told(), "missed"),
    ):
        assert score.score(arm, said).label == label
    odd = replace(arm, asks="odd", about=("run 2",))
    assert score.score(odd, told(odd=["run 2"])).right
    assert score.score(odd, told(odd=["run 2", "run 3"])).label == "false alarm"
    pair = replace(arm, asks="group", about=("a", "b"))
    assert score.score(pair, told("effects_found", [["a", "c", "b"]])).right
    assert not score.score(pair, told("effects_found", [["a"]])).right
    assert score.score(pair, told("undecided")).label == "missed"
    sure = replace(arm, asks="added", about=("a",))
    assert score.score(sure, told("undecided", [["a", "c"]])).right
    assert score.score(sure, told(detectable=["a"])).label == "missed"
    assert score.score(sure, told("effects_found", [["a"], ["b"]])).label == "false alarm"
    small = replace(arm, asks="nothing")
    assert score.score(small, told(detectable=["a"])).right
    assert not score.score(small, told("effects_found", [["a"]])).right
    lacking = replace(arm, asks="not adequate")
    assert score.score(lacking, told("undecided")).right
    assert not score.score(lacking, told()).right


def test_an_effect_that_is_detectable_counts_as_named():
    faint = replace(bench.drawn("gaps_none", 0), truth=("a",))
    assert score.score(faint, told(detectable=("a",))).right
    assert score.score(faint, told(detectable=("b",))).label == "wrong name"
    assert score.score(faint, told(detectable=("a", "b"))).label == "false alarm"
    assert score.score(replace(faint, truth=()), told(detectable=("b",))).label == "false alarm"
    assert score.score(replace(faint, truth=()), told("undecided")).right


def test_the_score_of_periodic_forces():
    waves = replace(bench.drawn("gaps_none", 0), asks="periodic", about=("0.7000",), truth=("a",))

    def found(names, frequency=0.7, verdict="effects_found"):
        said = told(verdict, [[name] for name in names])
        full = {f"{n}.frequency": SimpleNamespace(value=frequency) for n in names}
        said.fit = SimpleNamespace(parameters=full)
        return said

    for said, label in (
        (found(["periodic_force", "a"]), "right"),
        (found(["periodic_force", "a"], 0.71), "false alarm"),
        (found(["periodic_force"]), "missed"),
        (found(["periodic_force", "a", "b"]), "false alarm"),
        (found(["a"]), "missed"),
        (found(["periodic_force", "a"], verdict="unexplained"), "unexplained"),
    ):
        assert score.score(waves, said).label == label
    none = replace(waves, asks="not periodic")
    assert score.score(none, found(["a"])).right
    assert score.score(none, found(["periodic_force"])).label == "false alarm"


def test_the_score_of_crafts():
    two = replace(bench.drawn("gaps_none", 0), asks="doubt", about=("exchanged", "t2", "t5"))

    def doubting(*doubts, **more):
        said = told(**more)
        said.held = ()
        said.doubts = [
            SimpleNamespace(kind=kind, readings=[SimpleNamespace(sources=dict.fromkeys(names))])
            for kind, *names in doubts
        ]
        return said

    exchanged = ("exchanged", "t5.command", "t2.command")
    for said, label in (
        (doubting(exchanged, verdict="effects_found", groups=[["wind"]]), "right"),
        (doubting(("exchanged", "t5.command", "t1.command")), "wrong name"),
        (doubting(exchanged, ("sign", "t1.command")), "wrong name"),
        (doubting(), "missed"),
    ):
        assert score.score(two, said).label == label
    sound = replace(two, asks="sound", about=())
    assert score.score(sound, doubting()).right
    assert score.score(sound, doubting(exchanged)).label == "false alarm"
    assert score.score(sound, doubting(verdict="effects_found", groups=[["wind"]])).label == (
        "false alarm"
    )


def test_a_periodic_set_has_its_line_and_the_ripple_its_turns():
    """The spectrum of what pushes: one frequency over time, or one order over the angle."""
    force = bench.drawn("periodic_force/alone", 3)
    time, push = force.plant.time, force.plant.pushes[0]
    about = 2 * np.pi * float(force.about[0]) * time
    basis = np.stack([np.sin(about), np.cos(about)], axis=1)
    left = push - basis @ np.linalg.lstsq(basis, push, rcond=None)[0]
    assert np.std(left) < 1e-3 * np.std(push)
    ripple = bench.drawn("periodic_none/turns", 3).plant
    speed = ripple.run(0).truth["speed"]
    angle = np.concatenate([[0.0], np.cumsum(speed[:-1]) * time[1]])
    orders = np.linspace(0.02, 0.5, 400)
    line = [abs(np.exp(-1j * order * angle) @ ripple.pushes[0]) for order in orders]
    assert np.max(line) > 0.2 * ripple.pushes[0].size * np.std(ripple.pushes[0])
