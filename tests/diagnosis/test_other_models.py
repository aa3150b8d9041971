"""Other models of the same logs, and channels for which a model has no use."""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import claims
import made_diagnosis as made
import numpy as np
import pytest
from one_truth import contradictions
from steps import (
    OtherModel,
    Worth,
    adopted,
    bind,
    models_fed_by,
    rival_models_module,
    unused_channels,
    unused_notes,
)
from test_public_docs import schema

import diffthrust as dft

TIME = 0.1 * np.arange(40)
SURE = Worth(0.4, 0.3, 0.5)


def log(inputs=("command",), measured=("speed",), **units):
    series = {name: 1.0 + np.sin(TIME + k) for k, name in enumerate((*inputs, *measured))}
    return dft.Log(
        TIME, {n: series[n] for n in inputs}, {n: series[n] for n in measured}, units=units
    )


@pytest.mark.parametrize(
    ("channels", "models"),
    [
        ({"command": "effort", "speed": "rad/s"}, ["thruster", "speed_loop_thruster"]),
        (
            {"command": "V", "speed": "rad/s"},
            ["thruster", "speed_loop_thruster", "dc_motor_thruster"],
        ),
        ({"command": "N m", "speed": "rad/s"}, ["thruster", "ducted_thruster"]),
    ],
)
def test_models_that_some_channels_feed(channels, models):
    assert [model.name for model in models_fed_by([log(**channels)])] == models


@pytest.mark.parametrize(
    ("unit", "rivals"),
    [
        ("V", {"speed_loop_thruster": "V"}),
        ("effort", {"speed_loop_thruster": "effort"}),
        ("N m", {"ducted_thruster": "N m"}),
        ("", {"speed_loop_thruster": "V"}),
    ],
)
def test_rivals_of_a_thruster_have_its_command(unit, rivals):
    """A log without units is in those of the diagnosed model: volts are no torque.

    A motor's current, which nobody measures here, makes it no rival.
    """
    logs = [log(**({"command": unit} if unit else {}))]
    given = adopted(dft.Thruster(), logs)
    fitter = SimpleNamespace(channels=("speed",))
    context = SimpleNamespace(given=given, fitter=fitter, records=bind(given, logs), unseen=())
    models = rival_models_module._rivals_of(context)
    assert {model.name: model.inputs["command"] for model in models} == rivals


def test_channels_of_another_machine_feed_no_model():
    assert models_fed_by([log(("heater",), ("temperature",))]) == ()
    boat = log(("left_force", "right_force"), ("surge",))
    assert [model.name for model in models_fed_by([boat])] == ["vessel"]


def test_a_channel_that_only_another_model_reads_is_named():
    model = dft.SpeedLoopThruster(command="V")
    logs = [log(("command", "supply_voltage"), ("speed", "current"), command="V")]
    unused = unused_channels(model, bind(model, logs))
    assert list(unused) == ["supply_voltage", "current"]
    assert (
        "supply_voltage_sag reads it, which acts at 'drive' of thruster" in unused["supply_voltage"]
    )
    assert "a channel of dc_motor_thruster" in unused["current"]
    assert unused_channels(dft.Thruster(), bind(dft.Thruster(), logs)).keys() == {"current"}
    motor = dft.DCMotorThruster()
    assert unused_channels(motor, bind(motor, logs)).keys() == {"supply_voltage"}
    assert "dc_motor" not in unused["supply_voltage"]
    (note, _) = unused_notes(model, unused)
    assert note.startswith("The logs have 'supply_voltage', and neither the speed loop thruster")


def test_what_an_effect_reads_without_declaring_it_is_no_unused_channel():
    """The wind on a vessel reads a vane where the logs have one."""
    forces = ("left_force", "right_force")
    logs = [log((*forces, "wind_speed", "wind_direction", "moon"), ("surge",))]
    vessel = dft.Vessel(drive="twin")
    assert unused_channels(vessel, bind(vessel, logs)) == {
        "moon": "no model or effect of the library knows it"
    }


@cache
def other():
    train, unseen = made.logs()
    return dft.fit(dft.SpeedLoopThruster(command="V"), train, holdout=unseen, starts=1)


def test_a_model_that_errs_less_is_told_with_both_errors():
    """Here the thruster as it is, in the place of a better one: its numbers must be told."""
    diag, better = made.unexplained(), made.found().fit
    told = replace(diag, other_models=(OtherModel(better, None, SURE),))
    text = told.details
    assert "A thruster with command dead band errs less over whole runs of the same unseen" in text
    assert "Diagnose that model, too." in text
    assert claims.contradictions(told) == []
    errs = "errs less over whole runs of the same unseen logs: NRMSE 0."
    wrong = text.replace(f"{errs}0", f"{errs}1")
    assert wrong != text
    assert any("NRMSE 0.1" in words for words in claims.contradictions(told, text=wrong))


def test_a_model_that_errs_more_stands_in_the_table_alone():
    worse = OtherModel(other(), None, Worth(-0.8, -0.9, -0.6))
    told = replace(made.found(), other_models=(worse,))
    assert told.details == made.found().details
    assert "Other models of these logs" in told.report()
    assert "-80 %" in told.report()
    assert contradictions(told) == []


def test_what_is_better_must_be_sure_and_clear():
    unsure, small = Worth(0.4, -0.1, 0.6), Worth(0.05, 0.03, 0.07)
    sizes = [OtherModel(other(), None, worth).better for worth in (SURE, unsure, small)]
    assert sizes == [True, False, False]


def test_the_data_of_other_models_and_unused_channels_keep_to_the_schema():
    rival = OtherModel(other(), made.found().fit, SURE)
    told = replace(made.found(), other_models=(rival,), unused={"roll": "nobody reads it"})
    plain = told.to_json()
    schema("diagnose").validate(plain)
    (data,) = plain["other_models"]
    assert data["extended"]["effects"] == ["command_deadband"]
    assert data["better"]
    assert plain["unused"] == {"roll": "nobody reads it"}


@pytest.mark.parametrize("law", [False, True])
def test_no_other_model_is_fitted_where_what_was_learned_reaches_the_noise(monkeypatch, law):
    asked = []

    def simulation_is_poor(context, state, judged):
        asked.append(judged)
        return False

    monkeypatch.setattr(rival_models_module, "simulation_is_poor", simulation_is_poor)
    learned = SimpleNamespace(reported="with the law") if law else None
    state = SimpleNamespace(stages=("given", "last"))
    assert rival_models_module.other_models(None, state, learned, catalogue=True) == ()
    assert asked == ["with the law" if law else "last"]


def test_a_rival_that_the_logs_leave_open_is_fitted_and_not_searched(monkeypatch):
    fits = {
        "open": replace(other(), status=dft.estimation.Status.NOT_IDENTIFIABLE),
        "fixed": replace(other(), status=dft.estimation.Status.CONVERGED),
    }
    searched = []
    stage = SimpleNamespace(fit=other(), holdout=None, train=other().train)

    def rivals_of(context):
        return [context.given]

    def as_it_is(context, model):
        fitted = SimpleNamespace(fit=fits[context.kind], unseen_runs=(), runs=())
        return SimpleNamespace(model=model, stage=fitted)

    def search(context, state, rival, catalogue):
        searched.append(context.kind)

    for name, stand_in in (
        ("simulation_is_poor", lambda *a: True),
        ("_rivals_of", rivals_of),
        ("_as_it_is", as_it_is),
        ("_searched", search),
        ("_runs_of", lambda *a: ()),
        ("errors_between", lambda *a: []),
        ("explained_share", lambda pairs: SURE),
    ):
        monkeypatch.setattr(rival_models_module, name, stand_in)
    for kind in fits:
        context = SimpleNamespace(kind=kind, given="given", clock=lambda step: nullcontext())
        told = rival_models_module.other_models(
            context, SimpleNamespace(stages=(stage,)), None, catalogue=True
        )
        assert [model.plain for model in told] == [fits[kind]]
    assert searched == ["fixed"]


@pytest.mark.parametrize(
    ("rival", "effects", "behind"),
    [
        (0.9, "", False),
        (0.9, "a", False),  # with two effects the diagnosed model errs by 0.2
        (0.21, "ab", False),
        (0.23, "ab", True),
        (0.23, "abc", True),
        (0.1, "abcd", False),
        (0.12, "abcde", True),
    ],
)
def test_a_rival_falls_behind_where_it_errs_a_tenth_more_with_as_many_effects(
    rival, effects, behind
):
    """The diagnosed model was given two effects at once, then two more."""

    def stage(error, effects):
        fit = SimpleNamespace(holdout=SimpleNamespace(nrmse=error), train=None)
        return SimpleNamespace(fit=fit, effects=tuple(effects))

    state = SimpleNamespace(stages=[stage(0.25, ""), stage(0.2, "ab"), stage(0.1, "abcd")])
    found = SimpleNamespace(stages=[stage(rival, effects)])
    assert rival_models_module._is_behind(found, state) is behind


@pytest.mark.slow
def test_a_thruster_behind_a_speed_loop_is_told_to_be_one():
    rng = np.random.default_rng(5)
    plant = dft.SpeedLoopThruster(command="effort", gain=300.0, time_constant=0.4, exponent=0.6)
    logs = []
    for k in range(3):
        time = 0.05 * np.arange(500)
        command = np.repeat(rng.uniform(-0.9, 0.9, 25), 20)
        units = {"command": "effort", "speed": "rad/s", "thrust": "N"}
        driven = dft.simulate(
            plant, dft.Log(time, {"command": command}, {}, units={"command": "effort"})
        )
        measured = {
            "speed": driven["speed"] + rng.normal(0.0, 1.0, 500),
            "thrust": driven["thrust"] + rng.normal(0.0, 0.5, 500),
        }
        logs.append(dft.Log(time, {"command": command}, measured, units=units, name=f"log {k}"))
    diag = dft.diagnose(
        dft.Thruster(command="effort"), logs[:2], holdout=logs[2], candidates="actuator_lag",
        experiment=False,
    )  # fmt: skip
    assert [model.name for model in diag.other_models] == ["speed_loop_thruster"]
    assert diag.other_models[0].better
    assert "basic speed loop thruster errs less over whole runs" in diag.details
    assert claims.contradictions(diag) == []
