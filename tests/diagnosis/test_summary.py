"""The summary of a diagnosis: the answer in few words, whatever was found."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import claims
import hypothesis.strategies as st
import made_diagnosis as made
import numpy as np
import pytest
from hypothesis import given, settings
from steps import (
    HeldValue,
    LearnedLaw,
    MeasuredMend,
    OddLog,
    SignalForm,
    Stage,
    Wording,
    Worth,
    after_effects,
    channel_that_counts,
    effect_words,
    figures_in,
    raised_channel,
    within_budget,
    words_in,
)

import diffthrust as dft

F = "The thrust error on logs kept out of the fit falls from 3.4 to 0.41 N."
MADE_UP = [made.found, made.diagnosis, made.adequate, made.unexplained, made.undecided]
SURE = Worth(0.5, 0.4, 0.6)


@pytest.mark.parametrize("made_up", MADE_UP)
def test_it_is_short_and_every_line_is_so(made_up):
    diag = made_up()
    assert words_in(diag.summary) <= 60
    assert figures_in(diag.summary) <= 4
    assert claims.contradictions(diag, text=diag.summary) == []


@pytest.mark.parametrize(
    ("made_up", "lines"),
    [
        (made.found, ["The logs look sound.",
                      "Found: commands within ±0.398 V do nothing.",
                      F,
                      'Copy: effects = ["command_deadband"]']),
        (made.unexplained, ["The logs look sound.",
                            "Missing: something unknown in the drive that depends on command.",
                            "Error on logs kept out of the fit: thrust 3.4 N, speed 5.6 rad/s."]),
        (made.undecided, ["The logs look sound.",
                          "These logs cannot tell a disturbance from missing physics.",
                          "Error on logs kept out of the fit: thrust 3.4 N, speed 5.6 rad/s.",
                          "Possibly also: command dead band.",
                          "Next: repeat one run with the same inputs; what recurs is physics."]),
        (made.adequate, ["The logs look sound.",
                         "The model is good enough for these logs: no effect helps.",
                         "Error on the training logs: thrust 0.42 N, speed 0.29 rad/s."]),
    ],
)  # fmt: skip
def test_it_reads_as_an_answer(made_up, lines):
    assert made_up().summary.splitlines() == lines


@pytest.mark.parametrize(
    ("made_up", "old", "new", "why"),
    [
        (made.found, "±0.", "±1.", "no parameter of command_deadband is 1."),
        (made.found, "commands within", "clocks within", "added:"),
        (made.found, "to 0.41", "to 0.21", "0.21 is 0.4"),
        (made.found, "falls from", "rises from", "thrust: from 3."),
        (made.found, "logs kept out of the fit", "the training logs", "unseen logs: True"),
        (made.found, F, F.replace("thrust", "speed").replace("3.4 to 0.41 N", "5.6 to 0.30 rad/s"),
         "falls more"),
        (made.found, "0.41 N.", "0.41 kN.", "it is in N"),
        (made.found, '["command_deadband"]', '["actuator_lag"]', "the model has"),
        (made.found, "Found", "Perhaps", "is worth"),
        (made.diagnosis, "a thrust sensor lag", "an inflow", "groups:"),
        (made.unexplained, "depends on command", "depends on speed", "it depends on command"),
        (made.undecided, "Possibly also: command dead band", "Possibly also: wind", "possible:"),
        (made.adequate, "speed 0.29", "speed 0.39", "0.39 is"),
        (made.found, "Found: ", "Alas. Found: ", "nobody checks"),
    ],
)  # fmt: skip
def test_what_is_not_so_is_seen(made_up, old, new, why):
    diag = made_up()
    text = diag.summary.replace(old, new, 1)
    assert text != diag.summary
    assert any(why in words for words in claims.contradictions(diag, text=text))


# -- whatever was found ----------------------------------------------------------------------------


UNSURE, HARMFUL = Worth(0.37, -0.97, 0.93), Worth(-0.4, -0.6, -0.2)


def doubted(diag, doubt):
    return made.with_fit(diag, 0, doubts=(doubt,))


def with_law(diag, **changes):
    """A diagnosis that has learned a curve of speed in the drive."""
    curve = dft.effects.Curve("drive", "speed", -60.0, 60.0, unit="rad/s^2", shape=(3.0,))
    law = LearnedLaw(
        curve, made.found().fit, SURE, 9.0, samples=np.linspace(-50.0, 50.0, 101),
        signal_unit="rad/s", port_unit="rad/s^2",
    )  # fmt: skip
    return replace(diag, laws=(replace(law, **changes),))


def with_a_mend(diag):
    reading = dft.soundness.Reading(
        "thrust and speed exchanged", '[channels.thrust] column = "speed", or ...'
    )
    return mended(diag, (reading,))


def mended(diag, readings):
    """A doubt with these readings, of which the first was measured, and helps."""
    doubt = dft.soundness.Doubt("thrust", "exchanged", "It is odd.", "look", readings)
    before = diag.stages[0].holdout or diag.stages[0].train
    after = replace(before, nrmse=0.4 * before.nrmse)
    mend = MeasuredMend(doubt, readings[0], before, after, SURE, True)
    return replace(doubted(diag, doubt), mends=(mend,))


def with_odd_logs(diag):
    odd = (OddLog(f"a log of run {k}", "thrust", "errs 5 times as much", 0.5) for k in range(3))
    return replace(diag, odd_logs=tuple(odd))


def with_held_values(diag):
    return replace(diag, held={n: HeldValue(0.5, 0.4, 0.01, "1/rad") for n in ("alpha", "ct")})


def with_possible_effects(diag):
    names = ("command_delay", "coulomb_friction", "thrust_sensor_offset", "inflow_thrust_loss")
    return replace(diag, possible=dict.fromkeys(names, SURE))


def not_converged(diag):
    return made.with_fit(diag, status=dft.estimation.Status.NOT_CONVERGED)


def with_grown_errors(diag):
    return replace(diag, one_step={"speed": 1e-3, "thrust": 1e-3})


CHANGES = (
    *(with_a_mend, with_odd_logs, with_held_values, with_possible_effects, not_converged),
    with_grown_errors,
)


@pytest.mark.thorough
@pytest.mark.parametrize("made_up", MADE_UP)
def test_any_combination_of_findings_is_told_within_the_budget(made_up):
    for count in range(1, len(CHANGES) + 1):
        for changes in itertools.combinations(CHANGES, count):
            diag = made_up()
            for change in changes:
                diag = change(diag)
            names = [change.__name__ for change in changes]
            assert words_in(diag.summary) <= 60, names
            assert figures_in(diag.summary) <= 4, names
            assert claims.contradictions(diag, text=diag.summary) == [], names


def test_the_mend_of_a_log_leads_and_is_what_is_copied():
    lines = with_a_mend(made.found()).summary.splitlines()
    assert lines[0] == (
        "First mend the logs, then diagnose again: with thrust and speed exchanged the unseen "
        "error falls by 60 %."
    )
    assert lines[1] == "What is told below may come from this mistake."
    assert lines[2:] == ['Copy under [channels.thrust]: column = "speed"']


@pytest.mark.parametrize(
    ("worth", "error", "said"),
    [
        (None, 1.0, "was not tried"),
        (UNSURE, 0.7, "falls by 30 %"),
        (UNSURE, 1.2, "does not fall"),
        (HARMFUL, 1.2, ""),
    ],
)
def test_another_mistake_that_a_doubt_may_come_from_is_told(worth, error, said):
    """A boat with exchanged sides was told to turn its gyroscope, which errs least."""
    if said:
        said = f", with thrust and speed exchanged it {said}: look which of them is true"
    words = ("the sign of thrust reversed", "thrust and speed exchanged")
    diag = mended(made.found(), tuple(dft.soundness.Reading(w, "[channels.a] b") for w in words))
    if worth:
        (mend,) = diag.mends
        after = replace(mend.before, nrmse=error * mend.before.nrmse)
        other = replace(mend, reading=mend.doubt.readings[1], worth=worth, after=after)
        diag = replace(diag, mends=(mend, other))
    line = (
        "First mend the logs, then diagnose again: with the sign of thrust reversed the unseen "
        f"error falls by 60 %{said}."
    )
    assert diag.summary.splitlines()[0] == line
    copied = "How to mend either stands below."
    assert (copied in diag.summary.splitlines()) is bool(said)
    either = "; or ".join(f"{each}, [channels.a] b" for each in words)
    told = f"Look which of these is true, and mend that alone: {either}"
    assert (told in diag.details) is bool(said)
    assert claims.contradictions(diag, text=diag.summary) == []
    assert claims.contradictions(diag, text=line.replace("60 %", "50 %")) != []
    if said:
        assert claims.contradictions(diag, text=line.replace(said, "")) != []


def test_of_many_mistakes_the_first_keeps_its_figure():
    words = ("the sign of thrust reversed", "thrust and speed exchanged", "the unit of thrust mN")
    readings = tuple(dft.soundness.Reading(w, "[channels.a] b") for w in words)
    diag = mended(made.found(), readings)
    (mend,) = diag.mends
    others = [replace(mend, reading=r, worth=UNSURE) for r in readings[1:]]
    diag = replace(diag, mends=(mend, *others))
    first = diag.summary.splitlines()[0]
    assert "reversed the unseen error falls by 60 %" in first
    assert first.endswith("look which of them is true.")
    assert words_in(diag.summary) <= 60
    assert claims.contradictions(diag, text=diag.summary) == []


def test_a_rate_is_told_in_words():
    rate = SignalForm("speed", rate=True)
    diag = made.unexplained()
    told = replace(diag, remaining=replace(diag.remaining, signal=rate))
    assert "that depends on how fast speed changes." in told.summary
    assert claims.contradictions(told, text=told.summary) == []


def test_an_input_is_named_with_the_effects_that_it_has_gone_through():
    """With a BlueBoat's thrusters exchanged "left_force" was held against the wrong column."""
    boat, swapped = dft.Vessel(drive="twin"), [dft.effects.SwappedThrusters()]
    assert after_effects(boat, swapped, ["left_force"]) == " (after swapped thrusters)"
    assert after_effects(boat, swapped, ["surge"]) == ""
    offset = [dft.effects.SpeedSensorOffset()]  # moves the reading, not the speed
    assert after_effects(dft.Thruster(), offset, ["speed"]) == ""
    signal = SignalForm("speed", after=" (after swapped thrusters)")
    assert signal == SignalForm("speed")
    diag = made.unexplained()
    told = replace(diag, remaining=replace(diag.remaining, signal=signal))
    assert "that depends on speed (after swapped thrusters)." in told.summary
    assert claims.contradictions(told, text=told.summary) == []


@pytest.mark.parametrize(("mend", "leads"), [("none is needed: it is held.", False), ("x", True)])
def test_a_doubt_leads_unless_nothing_is_to_be_mended(mend, leads):
    told = doubted(made.found(), dft.soundness.Doubt("speed", "stuck", "It changes seldom.", mend))
    assert told.summary.startswith("Check the logs: readings of speed are repeated.") is leads
    assert claims.contradictions(told, text=told.summary) == []


def test_a_sign_that_looks_wrong_may_be_an_exchange_and_nothing_is_undecided_before_it_is_mended():
    """Of a Kingfisher the heading alone was named, and random forces held possible."""
    words = ("the sign of speed reversed", "thrust and speed exchanged")
    readings = tuple(dft.soundness.Reading(w, "[channels.a] b") for w in words)
    doubt = dft.soundness.Doubt("speed", "sign", "It is odd.", "look", readings)
    told = doubted(made.undecided(), doubt)
    line = "Check the logs: the sign of speed looks wrong, or thrust and speed exchanged."
    assert told.summary.splitlines()[0] == line
    assert "Undecided as long as the doubts on the logs stand: mend them first." in told.details
    assert "disturbance" not in told.details
    assert claims.contradictions(told) == []
    assert "disturbance" in made.undecided().details


def test_of_many_effects_those_without_a_size_are_named():
    names = ["linear_damping", "command_delay", "thrust_sensor_lag", "coulomb_friction"]
    diag = made.found()
    model = diag.fit.model
    for name in names:
        model = model + name
    width = diag.fit.parameters["command_deadband.half_width"]
    estimates = {n: replace(width, value=p.value) for n, p in model.parameters.items()}
    many = replace(diag, best=model.effects, groups=tuple((e.name,) for e in model.effects))
    many = made.with_fit(many, model=model, parameters={**estimates, **diag.fit.parameters})
    assert "Also: command delay, thrust sensor lag and Coulomb friction." in many.summary
    assert words_in(many.summary) <= 60
    assert figures_in(many.summary) <= 4
    assert claims.contradictions(many, text=many.summary) == []


WEAK = Worth(
    0.03, 0.01, 0.05, {"speed": Worth(0.04, 0.02, 0.06), "thrust": Worth(0.02, 0.0, 0.04)},
    everywhere=Worth(0.05, 0.02, 0.09),
)  # fmt: skip


def test_what_adds_little_is_told_behind_the_error_that_another_effect_removes():
    """A sway drag that added 0.4 of 19 mm/s stood beside the wind, above the error of both."""
    diag = made.diagnosis()
    told = replace(diag, worth={"command_deadband": SURE, "actuator_lag": WEAK}, remaining=None)
    lines = told.summary.splitlines()
    assert lines[:4] == [
        "The logs look sound.",
        "Found: commands within ±0.399 V do nothing.",
        F,
        "Adds little: the motor's torque lags by 0.00050 s.",
    ]
    assert claims.contradictions(told, text=told.summary) == []
    much = replace(WEAK, channels={**WEAK.channels, "speed": Worth(0.2, 0.1, 0.3)})
    both = replace(told, worth={"command_deadband": SURE, "actuator_lag": much})
    assert "Found: the motor's torque lags by 0.00050 s" in both.summary
    wrong = told.summary.replace("Found: commands", "Adds little: commands")
    assert claims.contradictions(told, text=wrong) != []


def test_what_adds_little_is_told_behind_the_error_that_a_law_removes():
    """An EMPS had a thrust "reported 0.0056 s late" above a friction that removes 98 %."""
    told = with_law(replace(made.found(), worth={"command_deadband": WEAK}))
    lines = told.summary.splitlines()
    small = "Adds little: commands within ±0.398 V do nothing."
    assert not any(line.startswith("Found: ") for line in lines)
    at = [k for k, line in enumerate(lines) if line.startswith(("Found in the drive: ", small))]
    assert len(at) == 2
    assert lines[at[1]] == small
    assert small not in replace(told, laws=()).summary


def test_the_number_of_an_effect_beside_a_law_is_told_where_it_is_another():
    """An EMPS's delay of 0.0056 s stood in for its friction: 0.0030 s beside the curve of it."""
    first = made.found()
    width = "command_deadband.half_width"
    estimate = replace(first.fit.parameters[width], value=0.2)
    beside = replace(first.fit, parameters={**first.fit.parameters, width: estimate})
    open_ = replace(first, verdict="unexplained", remaining=made.unexplained().remaining,
                    worth={"command_deadband": SURE})  # fmt: skip
    diag = with_law(open_, fit=beside)
    assert "Estimated anew beside what was learned: a command dead band of ±0.20 V." in diag.details
    said = "Estimated anew beside what was learned: "
    assert claims.contradictions(diag, text=f"{said}a command dead band of ±0.30 V.") != []
    assert claims.contradictions(diag, text=f"{said}an actuator lag of 0.20 s.") != []
    assert said not in with_law(open_).details


def test_what_looks_alike_stands_in_the_brackets_of_an_effect():
    group = ("command_deadband", "static_friction")
    assert (
        "lacks a command dead band of ±0.398 V (these logs cannot tell it from static friction): "
    ) in replace(made.found(), groups=(group,)).details
    fit, effect = made.found().fit, dft.effects.AxialFlow(loss=0.1)
    estimate = replace(fit.parameters["command_deadband.half_width"], value=0.1)
    model = dft.Thruster() + effect
    flow = replace(fit, model=model, parameters=dict.fromkeys(model.parameters, estimate))
    stages = made.found().stages[0], Stage(("axial_flow",), flow)
    groups = (("axial_flow", "static_friction"),)
    lacking = replace(made.found(), best=(effect,), groups=groups, stages=stages)
    assert "; these logs cannot tell it from static friction): " in lacking.details
    # the brackets of a unit are not those of an effect
    loss = dft.effects.InflowThrustLoss(loss=0.1)
    unit = replace(estimate, unit="N s^2/(m rad)", shown_unit="N s^2/(m rad)")
    model = dft.Thruster() + loss
    flow = replace(fit, model=model, parameters=dict.fromkeys(model.parameters, unit))
    stages = made.found().stages[0], Stage((loss.name,), flow)
    lacking = replace(lacking, best=(loss,), groups=((loss.name, "static_friction"),),
                      stages=stages)  # fmt: skip
    assert "N s^2/(m rad) (these logs cannot tell it from static friction): " in lacking.details


@pytest.mark.parametrize(("share", "told"), [(0.03, False), (0.6, True)])
def test_a_signal_that_explains_next_to_nothing_is_not_told_as_the_cause(share, told):
    diag = made.unexplained()
    (missing, *_) = diag.missing
    diag = replace(
        diag,
        remaining=replace(diag.remaining, share=0.02),
        missing=(replace(missing, share=share),),
    )
    assert ("that depends on command" in diag.summary) is told
    assert "something unknown in the drive" in diag.summary


def test_logs_that_nobody_looked_at_are_not_called_sound():
    diag = made.found()
    unseen = made.with_fit(diag, 0, doubts_sought=False)
    assert "sound" not in unseen.summary
    assert claims.contradictions(unseen, text=diag.summary) != []
    train, _ = made.logs()
    assert not dft.fit(dft.Thruster(), train, starts=1, doubts=False).doubts_sought
    for change in (with_a_mend, with_odd_logs):
        assert "sound" not in change(diag).summary


def errors(**sizes):
    return SimpleNamespace(channels={n: SimpleNamespace(nrmse=s) for n, s in sizes.items()})


def test_a_channel_that_nothing_explains_is_not_the_one_that_is_told():
    """Of a BlueBoat the sway was, which a constant follows better."""
    before, after = errors(sway=1.8, yaw_rate=0.64), errors(sway=1.2, yaw_rate=0.42)
    assert channel_that_counts(before, after) == "yaw_rate"
    assert channel_that_counts(errors(sway=1.8), errors(sway=1.2)) == "sway"
    assert channel_that_counts(before, errors(sway=0.9, yaw_rate=0.42)) == "sway"


@pytest.mark.parametrize(
    ("after", "rises"),
    [
        ({"surge": 0.87, "yaw_rate": 0.73, "heading": 1.7}, "heading"),
        ({"surge": 0.87, "yaw_rate": 1.3, "heading": 1.7}, "heading"),  # that rises most
        ({"surge": 0.30, "yaw_rate": 0.84, "heading": 1.1}, ""),  # by 0.11, where 1.3 fell
        ({"surge": 0.87, "yaw_rate": 0.73, "heading": 1.14}, ""),  # by 7 % of what it was
        ({"surge": 1.5, "yaw_rate": 0.9, "heading": 1.2}, "surge"),
        ({"surge": np.inf, "yaw_rate": 0.5, "heading": np.nan}, ""),
        ({"surge": 1.5}, ""),
    ],
)
def test_a_rise_counts_beside_what_falls(after, rises):
    """An Otter's surge, yaw rate and heading err by these of their spreads."""
    before = {"surge": 1.16, "yaw_rate": 0.77, "heading": 1.1}
    before = {name: before[name] for name in after}
    assert raised_channel(errors(**before), errors(**after)) == rises


def test_what_is_left_of_an_error_that_is_told_has_its_size_there():
    """ "Unexplained: position; repeat one run" did not say how much was unexplained."""
    found = made.found()
    left = replace(found, one_step={"thrust": 1e-3}).summary.splitlines()
    assert left[2:4] == [
        F,
        "Unexplained: what is left of the thrust error; repeat one run: what recurs is physics.",
    ]
    other = replace(found, one_step={"speed": 1e-3}).summary.splitlines()
    assert "Unexplained: speed off by 0.30 rad/s; repeat one run." in other


@pytest.mark.parametrize(
    ("speed", "said"),
    [
        (3.0, ["But the speed error rises to 17 rad/s."]),
        (1.04, []),  # by 8 % of its square
        (0.5, []),
    ],
)
def test_a_channel_that_errs_more_with_what_was_found_is_told(speed, said):
    """Of an Otter the answer told a surge error that fell, and no heading error that rose."""
    found = made.found()
    errors, first = found.fit.holdout, found.stages[0].fit.holdout.channels["speed"]
    rising = replace(first, rmse=speed * first.rmse, nrmse=speed * first.nrmse)
    changed = replace(errors, channels={**errors.channels, "speed": rising})
    diag = made.with_fit(found, holdout=changed)
    lines = diag.summary.splitlines()
    assert [line for line in lines if "rises" in line] == said
    assert F in lines
    contradictions = claims.contradictions(diag, text="\n".join([F, *said]))
    assert contradictions == []


TEXTS = st.lists(
    st.sampled_from(["thrust", "falls", "0.30", "14V", "-2", "m/s^2", "±5"]),
    min_size=1,
    max_size=90,
).map(" ".join)
PARTS = st.lists(st.lists(st.builds(Wording, TEXTS, st.integers(1, 9)), max_size=4), max_size=9)


@settings(deadline=None, derandomize=True)
@given(PARTS)
def test_no_text_is_over_the_budget(parts):
    text = within_budget(parts)
    assert words_in(text) <= 60
    assert figures_in(text) <= 4
    if all(len(part) < 2 for part in parts) and text.count("below.") == 0:
        assert text.split("\n") == [part[0].text for part in parts if part] or not any(parts)


def test_what_matters_least_is_left_out_first():
    parts = [[Wording("word " * 20 + name, size)] for name, size in (("a", 2), ("b", 9), ("c", 5))]
    assert within_budget(parts).split("\n")[-1] == "More below."
    assert [line.split()[-1] for line in within_budget(parts).split("\n")[:-1]] == ["b", "c"]


def test_a_part_is_left_out_by_what_its_shortest_wording_matters():
    error = [Wording("It falls from 2 to 1 m.", 2), Wording("2 to 1 m.", 9)]
    parts = [error, *([Wording(f"Found: {k} m.", 5)] for k in (7, 8, 9))]
    lines = within_budget(parts).split("\n")
    assert lines[0] == "It falls from 2 to 1 m."
    assert lines[-1] == "More below."


def test_a_channel_that_nobody_measured_is_named_beside_what_it_could_look_like():
    """Under an unmeasured inflow a thruster seemed to push less in reverse."""
    diag = made.found()
    model = diag.fit.model + "reverse_thrust_asymmetry"
    change = replace(diag.fit.parameters["command_deadband.half_width"], value=-0.2)
    estimates = {**diag.fit.parameters, "reverse_thrust_asymmetry.change": change}
    reason = "needs the channel 'inflow', which no log has"
    told = replace(
        made.with_fit(diag, model=model, parameters=estimates),
        best=model.effects,
        groups=tuple((e.name,) for e in model.effects),
        untestable={"inflow_thrust_loss": reason, "inflow_load_relief": reason},
    )
    words = "The inflow was not measured: it could look like a reverse thrust asymmetry."
    assert words in told.summary.splitlines()[2:4]  # beside what was found
    still = replace(told, one_step={n: e.rmse for n, e in told.after.errors.channels.items()})
    assert words not in still.summary  # nothing is left that an inflow would leave
    assert "Inflow, which no log has, could look like a reverse thrust asymmetry." in told.report()
    assert claims.contradictions(told, text=told.summary) == []
    assert words not in replace(told, untestable={}).summary
    little = {"command_deadband": SURE, "reverse_thrust_asymmetry": WEAK}
    assert words not in replace(told, worth=little).summary


def test_what_is_left_is_named_rather_than_said_of_the_inflow_at_length():
    """Of the answer for a thruster of a glider nobody could retell what was left."""
    remaining = made.unexplained().remaining
    effects = ("coulomb_friction", "load_exponent", "axial_flow", "command_offset")
    diag = made.found()
    model = diag.stages[0].fit.model
    for name in effects:
        model += name
    sizes = {n: diag.fit.parameters["command_deadband.half_width"] for n in model.parameters}
    told = replace(
        made.with_fit(diag, model=model, parameters=sizes, free=()), verdict="unexplained",
        best=model.effects, groups=tuple((n,) for n in effects), remaining=remaining,
        untestable={"inflow_load_relief": "needs the channel 'inflow', which no log has"},
    )  # fmt: skip
    assert "Unmeasured inflow could look like a load exponent." in told.summary
    assert "Unexplained: something in the drive." in told.summary
    assert claims.contradictions(told, text=told.summary) == []


# -- effects in words ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(dft.effects.EFFECTS))
def test_every_effect_says_what_it_does(name):
    effect = dft.effects.EFFECTS[name]
    if not effect.in_words:
        assert name in ("curve", "formula", "periodic_force", "differential_gain",
                        "water_current")  # fmt: skip
        return
    fit = made.found().fit
    width = fit.parameters["command_deadband.half_width"]
    estimates = {f"{name}.{n}": replace(width, value=0.25) for n in effect.declared}
    model = type("Stub", (), {"effects": (effect(),)})()
    words = effect_words(name, replace(fit, model=model, parameters=estimates))
    assert "{" not in words
    assert figures_in(words) <= 2
    assert words_in(words) <= 14


def test_a_change_is_more_or_less():
    fit, model = made.found().fit, dft.Thruster() + "reverse_thrust_asymmetry"
    change = fit.parameters["command_deadband.half_width"]
    for value, words in ((-0.2, "20 % less thrust"), (0.1, "10 % more thrust")):
        estimates = {"reverse_thrust_asymmetry.change": replace(change, value=value)}
        told = effect_words(
            "reverse_thrust_asymmetry", replace(fit, model=model, parameters=estimates)
        )
        assert told == f"{words} in reverse"


def test_a_law_is_told_in_one_form_and_by_what_it_does():
    diag = with_law(made.unexplained())
    _, first, second, *_ = diag.summary.splitlines()
    assert first.startswith("Found in the drive: a term that is a curve of speed, up to 3.0")
    assert second == F
    assert claims.contradictions(diag, text=diag.summary) == []


@pytest.mark.parametrize(("error", "told"), [(1.0, True), (2.0, False)])
def test_a_curve_has_a_size_where_no_parameter_of_the_model_takes_it_up(monkeypatch, error, told):
    """The EMPS: "up to 26 N" beside one viscous friction, 68 N beside another, errors alike."""
    place = np.linspace(-60.0, 60.0, 121)
    drawn = place, 3.0 * np.sign(place), np.full(121, error)
    monkeypatch.setattr(LearnedLaw, "drawn", lambda law: drawn)
    summary = with_law(made.unexplained(), samples=place).summary
    assert ("up to 3.0 rad/s^2" in summary) is told


@pytest.mark.parametrize(
    ("status", "unseen", "label"),
    [
        (dft.estimation.Status.CONVERGED, 0.3, "Found"),
        (dft.estimation.Status.NOT_CONVERGED, 0.3, "Perhaps"),
        (dft.estimation.Status.CONVERGED, 1.1, "Perhaps"),
    ],
)
def test_a_law_is_found_by_a_fit_that_ended_and_follows_a_channel(status, unseen, label):
    """Whatever the model as given did: it may lack what makes it follow."""
    diag = with_law(made.unexplained())
    last = diag.stages[-1].fit.holdout
    blind = {name: replace(e, nrmse=1.4) for name, e in last.channels.items()}
    diag = made.with_fit(diag, holdout=replace(last, channels=blind))
    fit = diag.laws[0].fit
    channels = {n: replace(e, nrmse=unseen) for n, e in fit.holdout.channels.items()}
    fit = replace(fit, status=status, holdout=replace(fit.holdout, channels=channels))
    diag = replace(diag, laws=(replace(diag.laws[0], fit=fit),))
    line = next(line for line in diag.summary.splitlines() if " in the drive: a term" in line)
    assert line.startswith(label)
    assert claims.contradictions(diag, text=line) == []
    other = {"Found": "Perhaps", "Perhaps": "Found"}[label]
    assert claims.contradictions(diag, text=line.replace(label, other)) != []


def test_a_notebook_shows_the_answer_and_folds_the_rest():
    shown, _, folded = made.found()._repr_html_().partition("<details>")
    assert "The thrust error on logs kept out of the fit falls" in shown
    assert "Stages" not in shown
    assert "Stages" in folded
    assert folded.endswith("</details></div>")


def test_a_fit_that_ran_away_is_told_first_and_nothing_is_found_by_it():
    """With an inertia of 6e5 kg m^2 a Kingfisher's thrusters did nothing, and "the water moves"."""
    diag = made.found()
    first, last = diag.stages
    far = replace(last.fit.parameters["beta"], value=2e5 * first.fit.guess["beta"])
    away = made.with_fit(diag, parameters={**last.fit.parameters, "beta": far})
    lines = away.summary.splitlines()
    assert lines[0].startswith("No fit is to be believed: beta ran away to ")
    assert lines[1:] == [
        "What is told below may come from this mistake.",
        "Next: check signs, units and the sense of angles, or hold a mass that you know.",
    ]
    assert claims.contradictions(away, text=away.summary) == []
    ends = last.fit.parameters["command_deadband.half_width"]
    wide = {**last.fit.parameters, "command_deadband.half_width": replace(ends, value=1e9)}
    assert "ran away" not in made.with_fit(diag, parameters=wide).summary
    assert claims.contradictions(diag, text=lines[0])  # not said of values that are near


def test_a_thrust_from_the_log_is_not_reported_late_but_acts_late():
    """Of the axis of EMPS "the thrust is reported 0.0056 s late" had the direction reversed."""
    delay, lag = dft.effects.ThrustSensorDelay(delay=0.0056), dft.effects.ThrustSensorLag()
    axis = dft.AxisVehicle()
    assert delay.consequence(axis) == "the thrust acts 0.0056 s after what is logged"
    assert lag.consequence(axis) == "the thrust lags by 0.10 s behind what is logged"
    assert delay.consequence(dft.Thruster()) == lag.consequence(dft.Thruster()) == ""
    time = 0.01 * np.arange(300)
    step = dft.Log(time, {"thrust": np.where(time > 1.0, 50.0, 0.0)}, units={"thrust": "N"})
    late = dft.simulate(axis + dft.effects.ThrustSensorDelay(delay=0.1), step)["velocity"]
    moves = [float(time[np.argmax(v > 1e-9)]) for v in (dft.simulate(axis, step)["velocity"], late)]
    assert moves[1] - moves[0] == pytest.approx(0.1, abs=0.011)
