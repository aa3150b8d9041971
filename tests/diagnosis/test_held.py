"""Constants that are held at a wrong value."""

from dataclasses import replace

import made_diagnosis as made
import numpy as np
import pytest
from reference import noise, vessel
from steps import (
    HeldValue,
    bind,
    constants_in,
    constants_of,
    of_effect,
    search_start_module,
    stage_words,
    verdict_words,
    with_candidates,
)

import diffthrust as dft

ARM = 0.40


def boats(seed, logs=3, size=250):
    """Runs of a boat with two thrusters, whose sway and yaw depend on each other."""
    rng = np.random.default_rng(seed)
    parameters = {**vessel.SIRAMDASU, "m11": 4.4, "m22": 6.0, "lever_arm": ARM}
    time = 0.1 * np.arange(size)
    for k in range(logs):
        forces = {
            side: np.repeat(rng.uniform(-0.5, 2.5, size // 25 + 1), 25)[:size]
            for side in ("left_force", "right_force")
        }
        record = vessel.simulate(time, forces, parameters=parameters)
        spread = {
            n: 0.01 * float(np.std(record.measured[n])) for n in ("surge", "sway", "yaw_rate")
        }
        record = noise.measure(record, rng, **{n: noise.Sensor(s) for n, s in spread.items()})
        yield dft.Log(record.time, record.inputs, record.measured, name=f"run {k}")


def diagnosed(arm, seed, candidates=("quadratic_yaw_drag", "lever_arm")):
    *train, unseen = boats(seed)
    model = dft.Vessel(drive="twin").replace(lever_arm=arm)
    return dft.diagnose(model, train, holdout=unseen, candidates=candidates, experiment=False)


@pytest.mark.slow
def test_a_lever_arm_held_at_a_wrong_value_is_named_and_freed():
    diag = diagnosed(0.50, seed=3)
    assert diag.added == ()
    assert diag.verdict == "effects_found"
    (held,) = diag.held.values()
    assert held.value == 0.50
    assert held.wanted == pytest.approx(ARM, abs=4 * held.std_error)
    assert held.std_error < 0.01
    assert "lever_arm is fixed at 0.5 m; these logs suggest 0.4" in diag.details
    assert diag.model.parameters["lever_arm"].fixed  # as it was given
    assert not diag.fit.model.parameters["lever_arm"].fixed
    assert stage_words(diag, 1) == "lever_arm freed"
    data = diag.to_json()
    assert data["held"]["lever_arm"]["value"] == 0.50
    assert [stage["effects"] for stage in data["stages"]] == [[], []]
    copied = diag.report().partition("To copy into a spec file")[2]
    assert "lever_arm = { value = 0.4" in copied
    assert '"lever_arm": {"value": 0.4' in copied
    assert '"fixed": False}' in copied


@pytest.mark.thorough
def test_one_held_at_the_right_value_is_left_alone():
    """A likelihood ratio that would lower the criterion by 4 comes in one set of two thousand."""
    diag = diagnosed(ARM, seed=3)
    assert diag.held == {}
    assert diag.verdict == "adequate"
    assert "lever_arm" not in {*diag.silent, *diag.untestable, *diag.refused}


def test_a_search_tries_the_constants_that_were_asked_for(monkeypatch):
    """Told by what the trials are made of: they are not waited for."""
    (log,) = boats(seed=3, logs=1, size=100)
    fit = dft.fit(dft.Vessel(drive="twin"), log, starts=1, doubts=False)
    records = bind(fit.model, [log])
    monkeypatch.setattr(
        search_start_module, "compiled_fitter", lambda fit, effects, held, *logs: (held, None)
    )
    for wanted, held in (
        (None, constants_of(fit.model)),
        ("wind", ()),
        ("lever_arm", ("lever_arm",)),
    ):
        assert (
            search_start_module.start_search(fit, records, (), wanted, 0, lambda *_: None)[0].fitter
            == held
        )


def test_constants_are_tried_beside_the_catalogue_or_by_their_names():
    model = dft.Thruster().fix("ct")
    assert constants_of(model) == constants_of(model, ["all", "coulomb_friction"]) == ("ct",)
    assert constants_of(model, ["ct", "coulomb_friction"]) == ("ct",)
    assert constants_of(model, "coulomb_friction") == ()
    assert constants_of(model, [dft.effects.CommandDeadband]) == ()


def test_constants_are_parameters_that_are_held_at_a_number_and_no_form():
    model = dft.Thruster().fix("ct") + dft.effects.CommandDeadband()
    assert constants_in(model) == ("ct",)


def test_a_constant_is_a_candidate_by_its_own_name():
    assert of_effect("lever_arm", "lever_arm")
    assert of_effect("wind.coefficient", "wind")
    assert of_effect("wind.height", "wind.height")
    assert not of_effect("wind.height", "wind.coefficient")
    deadband = dft.effects.CommandDeadband()
    candidates = {"command_deadband": deadband}
    model = with_candidates(dft.Thruster().fix("ct"), ["ct", "command_deadband"], candidates)
    assert not model.parameters["ct"].fixed
    assert [effect.name for effect in model.effects] == ["command_deadband"]


def test_the_summary_tells_a_constant_beside_an_effect_and_alone():
    held = {"lever_arm": HeldValue(0.5, 0.4, 0.01, "m")}
    words = "lever_arm is fixed at 0.5 m; these logs suggest 0.400 ± 0.010 m."
    beside = replace(made.found(), held=held)
    assert "lacks a command dead band" in beside.details
    assert words in beside.details
    alone = replace(made.adequate(), verdict="effects_found", held=held)
    assert alone.details.startswith(words)
    assert verdict_words(alone) == "a fixed constant disagrees with these logs"
