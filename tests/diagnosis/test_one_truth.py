"""One truth a page: fields, verdict and words of a diagnosis agree."""

import re
from dataclasses import replace
from types import SimpleNamespace

import claims
import made_diagnosis as made
import numpy as np
import pytest
from claims.about_errors import (
    BLOWING,
    MOVING,
    SAGGING,
    UNEVEN,
    blowing_wind,
    moving_water,
    sagging_drive,
    uneven_thrusters,
)
from one_truth import contradictions
from reference import whole_runs as wr
from steps import (
    Stage,
    Worth,
    added_bound_words,
    an_effect,
    beginnings,
    growth_words,
    headroom_between,
    missing_words,
    parameter_words,
    sized_words,
    verdict_evidence,
    verdict_of,
    worth_rows,
)

import diffthrust as dft

SMALL = Worth(0.01, 0.005, 0.02)
MADE_UP = [made.found, made.diagnosis, made.adequate, made.unexplained, made.undecided]


@pytest.mark.parametrize("made_up", MADE_UP)
def test_every_sentence_has_a_check_and_passes_it(made_up):
    assert claims.contradictions(made_up()) == []


def page_of_a_dead_band() -> claims.Page:
    """What is known of the logs of `made.found`."""
    train, unseen = made.logs()
    return claims.Page(
        [wr.Run.of(train)],
        [wr.Run.of(unseen)],
        hidden=frozenset({"command_deadband"}),
        true=wr.yoerger(deadband=True),
        truth={"alpha": 0.037, "beta": 42.0, "ct": 0.02, "nominal": 16.0, "band": made.BAND},
        noise={"speed": 0.3, "thrust": 0.4},
    )


@pytest.mark.thorough
def test_a_found_dead_band_is_held_against_a_plain_least_squares():
    page = page_of_a_dead_band()
    assert page.quiet
    assert claims.contradictions(made.found(), page) == []


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("falls from", "rises from", "it rises"),
        ("dead band of ±0.", "dead band of ±1.", "no added parameter"),
        ("lacks a command dead band", "lacks an actuator lag", "was added"),
        ("(NRMSE 0.", "(NRMSE 1.", "NRMSE 1."),
        (" to 0.", " to 2.", "is 0."),
        ("The basic", "Thrusters are noble. The basic", "nobody checks"),
    ],
)
def test_what_is_not_so_is_seen(old, new, why):
    diag = made.found()
    text = diag.details.replace(old, new, 1)
    assert text != diag.details
    assert any(why in words for words in claims.contradictions(diag, text=text))


@pytest.mark.thorough
def test_a_fit_that_ended_early_and_a_false_name_are_seen():
    diag, page = made.found(), page_of_a_dead_band()
    other = {**diag.fit.parameters, "beta": replace(diag.fit.parameters["beta"], value=60.0)}
    wrong = claims.contradictions(made.with_fit(diag, parameters=other), page)
    assert any("by an independent simulation" in words for words in wrong)
    early = replace(diag.stages[0].train, nrmse=1.2 * diag.stages[0].train.nrmse)
    wrong = claims.contradictions(made.with_fit(diag, 0, train=early), page)
    assert any("a plain least squares reaches" in words for words in wrong)
    wrong = claims.contradictions(diag, replace(page, hidden=frozenset({"actuator_lag"})))
    assert any("nothing of command_deadband is hidden" in words for words in wrong)


def test_random_forces_are_not_said_of_a_plant_without():
    chance = replace(made.undecided(), recurring={"thrust": Worth(0.05, -0.1, 0.2)})
    assert (
        "5 % (-10 % to 20 %) of its square recurs: most of it comes from random" in chance.details
    )
    assert claims.contradictions(chance) == []
    wrong = claims.contradictions(chance, page_of_a_dead_band())
    assert any("no random force is at work" in words for words in wrong)


@pytest.mark.parametrize(
    "made_up", [made.found, made.diagnosis, made.adequate, made.unexplained, made.undecided]
)
def test_what_is_told_agrees(made_up):
    diag = made_up()
    assert contradictions(diag) == []
    assert verdict_of(verdict_evidence(diag, diag)) == diag.verdict


@pytest.mark.parametrize(
    ("wrong", "where"),
    [
        (lambda: replace(made.found(), untestable={"command_deadband": "x"}), "untestable"),
        (lambda: replace(made.found(), detectable=("command_deadband",)), "detectable"),
        (lambda: replace(made.found(), silent=("command_deadband",)), "silent"),
        (lambda: replace(made.found(), stages=made.found().stages[:1]), "last model"),
        (lambda: replace(made.found(), worth={"actuator_lag": SMALL}), "not in the model"),
        (lambda: replace(made.found(), verdict="adequate"), "verdict adequate"),
        (lambda: replace(made.unexplained(), verdict="undecided"), "verdict undecided"),
        (lambda: replace(made.adequate(), verdict="undecided"), "whole runs are good"),
        (lambda: replace(made.undecided(), verdict="adequate"), "far off"),
    ],
)
def test_contradictions_are_seen(wrong, where):
    assert any(where in words for words in contradictions(wrong()))


def test_errors_that_repeat_are_not_left_to_chance():
    """A flexible model explains most of what the model as given leaves: structure remains."""
    train, unseen = made.logs()
    diag = made.found()
    first = diag.stages[0].fit
    held = dft.compare(first, train, initial=first.initial), dft.compare(first, unseen)
    diag = replace(
        diag, best=(), groups=(), stages=diag.stages[:1], before=held[1], after=held[1],
        trained=(held[0], held[0]), one_step={"speed": 0.01, "thrust": 0.01},
        room=headroom_between(*held),
    )  # fmt: skip
    assert diag.repeating
    diag = replace(diag, verdict=verdict_of(verdict_evidence(diag, diag)))
    assert diag.verdict == "unexplained"
    assert "so it is repeatable" in diag.details
    assert "cannot tell a disturbance" not in diag.details
    assert contradictions(diag) == []
    recurs = {"speed": Worth(0.8, 0.6, 0.9)}
    for room, explains in ((diag.room, " and where logs repeat"), (None, "where logs repeat")):
        again = replace(diag, room=room, recurring=recurs)
        assert again.repeating
        assert f"{explains} their inputs 80 % (60 % to 90 %) of the squared" in again.details
        assert claims.contradictions(again) == []


def test_what_matters_leads_and_what_does_not_is_told_as_such():
    diag = replace(
        made.diagnosis(),
        worth={"command_deadband": Worth(0.2, 0.1, 0.3), "actuator_lag": Worth(0.7, 0.6, 0.8),
               "thrust_sensor_lag": SMALL},
        detectable=("thrust_sensor_lag",),
    )  # fmt: skip
    text = diag.details
    assert text.index("an actuator lag") < text.index("a command dead band of")
    assert (
        "each removes, added in this order: command dead band 20 % (10 % to 30 %) and actuator lag "
        "70 % (60 % to 80 %)"
    ) in text
    assert "Left out: a thrust sensor lag (it would remove 1 % (0.5 % to 2 %) of" in text
    assert contradictions(diag) == []
    alike = replace(diag, detectable_groups=(("thrust_sensor_lag", "thrust_sensor_delay"),))
    words = "that is left; the next sample cannot tell it from a thrust sensor delay). With it"
    assert words in alike.details
    assert alike.to_json()["detectable_groups"] == [["thrust_sensor_lag", "thrust_sensor_delay"]]


def test_a_share_is_told_of_its_channel_and_none_whose_interval_holds_zero():
    """A dead band took the speed error from 46 to 19 rpm and was told as 10 % (-5 % to 22 %)."""
    speed = {"speed": Worth(0.83, 0.7, 0.9), "thrust": Worth(0.0, -0.1, 0.1)}
    diag = made.found()
    text = replace(diag, worth={"command_deadband": Worth(0.1, -0.05, 0.22, speed)}).details
    assert (
        "Of the squared speed error as given over whole runs of unseen logs command dead band "
        in text
    )
    assert "dead band removes 83 % (70 % to 90 %)." in text
    assert "each removes" not in text
    unsure = Worth(0.02, -0.01, 0.03)
    none = replace(diag, worth={"command_deadband": unsure})
    assert "Command dead band has no sure effect on whole runs." in none.details
    joint = replace(unsure, everywhere=Worth(0.05, 0.01, 0.08))
    both = replace(diag, worth={"command_deadband": joint})
    assert "whole runs of training and unseen logs command dead band removes 5 %" in both.details
    minor = replace(diag, detectable=("actuator_lag",), worth={"actuator_lag": unsure})
    assert "Left out: an actuator lag (no sure gain over whole runs). With it" in minor.details
    harmful = {"speed": Worth(0.9, 0.8, 0.95), "thrust": Worth(-1.1, -4.0, -0.05)}
    harms = replace(minor, worth={"actuator_lag": replace(unsure, channels=harmful)})
    words = "that is left, and raise the squared thrust error that is left by 110 %). With it"
    assert words in harms.details
    assert contradictions(harms) == []
    fit = replace(diag.fit, status=dft.estimation.Status.NOT_CONVERGED)
    vague = replace(harms, stages=(*harms.stages[:-1], replace(harms.stages[-1], fit=fit)))
    assert (
        "Left out: an actuator lag. With it the next sample is predicted better, and what it does "
        "to whole runs this fit does not tell."
    ) in vague.details
    assert contradictions(vague) == []
    pair = {"actuator_lag": replace(unsure, low=0.01, share=0.05, high=0.06),
            "command_delay": replace(unsure, channels=harmful)}  # fmt: skip
    two = replace(minor, detectable=("actuator_lag", "command_delay"), worth=pair)
    assert contradictions(two) == []
    assert two.details.count("and raise") == 1
    alike = replace(minor, detectable_groups=(("actuator_lag", "command_delay"),))
    words = (
        "an actuator lag (no sure gain over whole runs; the next sample cannot tell it from a "
        "command delay). With"
    )
    assert words in alike.details
    # of a Kingfisher -706 to -202 % was "no sure effect"
    worse = replace(minor, worth={"actuator_lag": Worth(-4.0, -7.06, -2.02)})
    assert "an actuator lag (no sure gain over whole runs). With it" in worse.details
    gains = replace(minor, worth={"actuator_lag": Worth(0.05, 0.02, 0.08)})
    assert claims.contradictions(gains, text=minor.details) != []
    for each in (none, both, minor, alike, worse, gains):
        assert claims.contradictions(each) == []


def of_two(**worths):
    """A diagnosis whose errors two effects remove."""
    diag = made.diagnosis()
    return replace(diag, worth=worths, detectable=())


def test_effects_with_one_share_are_told_together():
    share = Worth(0.9, 0.8, 0.95, together=("command_deadband", "actuator_lag"))
    diag = of_two(command_deadband=share, actuator_lag=share)
    words = "unseen logs command dead band and actuator lag together remove 90 % (80 % to 95 %)."
    assert words in diag.details
    assert claims.contradictions(diag) == []


def test_errors_from_sample_to_sample_are_held_against_runs_of_the_same_logs():
    """Of training logs 0.49 N stood beside 3.2 N of unseen ones, whose manoeuvres were larger."""
    diag = replace(made.unexplained(), verdict="undecided")
    trained = diag.fit.train.channels["thrust"].rmse
    assert diag.fit.holdout.channels["thrust"].rmse > 1.02 * trained
    far = replace(diag, one_step={"thrust": trained / 4.01})
    (words,) = growth_words(far)
    assert f"whole runs of the training logs it errs by {trained:.2g} N (RMS)" in words
    assert growth_words(replace(diag, one_step={"thrust": trained / 3.99})) == []
    # where structure remains that says why: and of a boat, "the last reading" did as well
    assert growth_words(replace(far, verdict="unexplained")) == []
    # runs that failed are no disturbance: "predicted to within - N; it errs by inf N" was one
    channels = diag.fit.train.channels.items()
    failed = {name: replace(error, rmse=np.inf, nrmse=np.inf) for name, error in channels}
    assert growth_words(made.with_fit(far, train=replace(diag.fit.train, channels=failed))) == []


def test_shares_that_add_up_to_more_than_all_are_seen():
    share = Worth(0.7, 0.6, 0.8)
    diag = of_two(command_deadband=share, actuator_lag=share)
    assert any("more is removed" in words for words in claims.contradictions(diag))


def test_every_share_says_of_which_error_it_is():
    """On one page stood shares of three wholes, one of them under "Removes" without a word."""
    unsure, sure = Worth(0.02, -0.01, 0.03), Worth(0.05, 0.01, 0.08)
    speed = Worth(0.1, -0.1, 0.2, {"speed": Worth(0.8, 0.7, 0.9), "thrust": unsure})
    diag = of_two(command_deadband=speed, actuator_lag=replace(unsure, everywhere=sure))
    diag = replace(diag, possible={"coulomb_friction": sure}, detectable=("thrust_sensor_lag",))
    diag = replace(diag, worth={**diag.worth, "thrust_sensor_lag": SMALL})
    table = {row[0]: row[-1] for row in worth_rows(diag).blocks[0]}
    assert table == {
        "command dead band": "squared speed error as given, unseen logs",
        "actuator lag": "squared error of all channels as given, training and unseen logs",
        "Coulomb friction": "squared error of all channels that is left, unseen logs",
        "thrust sensor lag": "squared error of all channels that is left, unseen logs",
    }
    text = diag.details
    assert "Of the squared speed error as given over whole runs of unseen logs" in text
    assert "Of the squared error of all channels as given over whole runs of training and" in text
    assert "remove 1 % (0.5 % to 2 %) of the squared error of all channels that is left)" in text
    assert "share of the squared error of all channels that is left on unseen logs" in text
    assert claims.contradictions(diag) == []


def test_what_an_effect_does_beside_the_others_is_told_and_decides_whether_it_adds_little():
    """A small thruster's load exponent came second and "adds little"; first it removes 87 %."""
    last = Worth(0.12, 0.08, 0.2)
    second = Worth(0.01, 0.005, 0.02)
    diag = of_two(
        command_deadband=Worth(0.86, 0.8, 0.9, beside_others=last),
        actuator_lag=replace(second, beside_others=replace(last, share=0.15)),
    )
    assert (
        "Beside all others, of the squared error of all channels that is left without it over "
        "whole runs of unseen logs each removes: command dead band 12 % (8 % to 20 %) and actuator "
        "lag 15 % (8 % to 20 %)."
    ) in diag.details
    assert "Adds little" not in diag.summary
    assert [row[:3] for row in worth_rows(diag).blocks[0]][1::2] == [
        ("", "beside the others", "12 %"),
        ("", "beside the others", "15 %"),
    ]
    assert claims.contradictions(diag) == []
    less = replace(diag.worth["actuator_lag"], beside_others=second)
    assert "Adds little: " in replace(diag, worth={**diag.worth, "actuator_lag": less}).summary


def test_an_effect_of_which_nothing_is_sure_is_not_said_to_matter():
    """On the maps of a T200 stood "Coulomb friction | matters | nothing sure"."""
    diag = of_two(command_deadband=Worth(0.7, 0.6, 0.8), actuator_lag=Worth(0.2, -0.1, 0.4))
    assert [row[:3] for row in worth_rows(diag).blocks[0]] == [
        ("command dead band", "matters", "70 %"),
        ("actuator lag", "perhaps", "nothing sure"),
    ]
    assert "Perhaps: " in diag.summary


def test_a_constant_is_told_by_its_name_alone():
    """Reports said "an alpha", and "lever arm of a lever arm stopped at its bound"."""
    assert [an_effect(n) for n in ("alpha", "lever_arm", "wind")] == [
        *("alpha", "a lever arm", "wind"),
    ]
    assert parameter_words("lever_arm", "lever_arm") == "Lever arm"
    assert parameter_words("gain", "differential_gain") == "Gain of a differential gain"


def test_undecided_says_what_is_possible_and_which_record_would_decide():
    text = made.undecided().details
    assert text.startswith("Undecided: over whole runs of unseen logs the thrust error is ")
    assert "these logs cannot tell a disturbance from missing physics" in text
    assert "each would remove: a command dead band 40 % (20 % to 60 %)" in text
    assert "repeats the inputs of one of these logs" in text
    constant = replace(made.undecided(), possible={"alpha": Worth(0.4, 0.2, 0.6)})
    assert "each would remove: another value of alpha 40 % (20 % to 60 %)" in constant.details
    assert "Possibly also: another value of alpha" in constant.summary
    proposed = replace(made.undecided(), experiment=made.diagnosis().experiment)
    assert f"A further record would decide: {proposed.experiment.sentence}" in proposed.details
    assert "lacks" not in text


def test_a_parameter_that_a_bound_stopped_is_told_with_the_mend():
    diag = made.found()
    tried = diag.ranking[1]
    estimate = diag.fit.parameters["command_deadband.half_width"]
    stopped = replace(tried, parameters={"time_constant": replace(estimate, at_bound=True)})
    told = replace(diag, ranking=(diag.ranking[0], stopped)).report()
    assert "Time constant of an actuator lag stopped at its bound of" in " ".join(told.split())
    assert "stopped at its bound" not in diag.report()


def at_bound(diag, index, **values):
    """A diagnosis in which some parameters of a stage were stopped at these values."""
    fit = diag.stages[index].fit
    known = {n: replace(fit.parameters[n], value=v, at_bound=True) for n, v in values.items()}
    model = fit.model.replace(
        {n: {"value": v, "bounds": (0.5 * v, v)} for n, v in values.items() if v > 0}
    )
    return made.with_fit(diag, index, model=model, parameters={**fit.parameters, **known})


def test_a_bound_that_stopped_the_model_itself_is_told_in_the_summary():
    stopped = at_bound(made.unexplained(), 0, beta=0.2)
    words = "beta stopped at its bound of 0.2: these logs favour a higher value."
    unit = stopped.fit.parameters["beta"].unit
    assert stopped.details.startswith(words.replace("0.2", f"0.2 {unit}".rstrip()))
    assert "widen it, if physically possible, and diagnose again." in stopped.details
    assert "stopped at its bound" not in made.unexplained().details
    idle = replace(stopped, idle_bounds=(next(n for n, e in stopped.fit.parameters.items()
                                              if e.at_bound),))  # fmt: skip
    assert "beyond it whole runs do not surely err less." in idle.details
    assert "widen" not in idle.details
    assert claims.contradictions(idle) == []
    assert claims.contradictions(stopped, text=idle.details) != []
    # nothing is stopped at the zero of a logarithm: it is gone, as a note of the fit says
    gone = at_bound(made.unexplained(), 0, alpha=0.0)
    assert "stopped at its bound" not in gone.details
    added = at_bound(made.found(), 1, **{"command_deadband.half_width": 0.5}).details
    assert added.startswith("The basic thruster lacks a command dead band")
    assert (
        "Half-width of a command dead band stopped at its bound of 0.5 V: the effect may" in added
    )
    # what was added may stand for what a bound kept out
    before = at_bound(made.found(), 0, beta=0.2).details
    assert "without a command dead band, which may stand in for a higher beta:" in before
    assert "stopped at its bound" not in before


def test_a_rival_that_came_in_the_place_of_an_effect_is_told():
    diag = replace(made.found(), exchanged={"actuator_lag": "command_deadband"})
    words = "In the place of an actuator lag came a command dead band: whole runs err less with it."
    assert words in " ".join(diag.report().split())
    assert claims.contradictions(diag) == []
    assert claims.contradictions(made.found(), text=words) != []
    more = replace(diag, stages=diag.stages[::-1])
    assert claims.contradictions(more, text=words) != []


@pytest.mark.parametrize(("limit", "said"), [(1.0, False), (0.8, True)])
def test_a_share_that_is_whole_has_no_bound_to_widen(limit, said):
    """A full sag was to be widened."""
    sag = dft.effects.SupplyVoltageSag(share=limit)
    model = (dft.Thruster() + sag).replace({"supply_voltage_sag.share": {"bounds": (0, limit)}})
    width = made.found().fit.parameters["command_deadband.half_width"]
    estimates = {
        name: replace(width, value=p.value, at_bound=name.endswith("share"))
        for name, p in model.parameters.items()
    }
    fit = replace(made.found().fit, model=model, parameters=estimates)
    diag = replace(made.found(), stages=(made.found().stages[0], Stage((sag.name,), fit)))
    assert bool(added_bound_words(diag)) is said
    words = (
        f"Share of a supply voltage sag stopped at its bound of {limit:g}: the effect may explain "
        "more beyond it. Widen the bound, if physically possible."
    )
    assert (claims.contradictions(diag, text=words) == []) is said


@pytest.mark.parametrize(("said", "right"), [("60 %", True), ("89 %", False)])
def test_a_sag_is_told_in_the_voltages_of_the_logs(said, right):
    """The maps of a T200, from 10 to 18 V, told of "a sag of 0.89": of a drive at 24 V."""
    sag = dft.effects.SupplyVoltageSag(share=0.886, nominal=24.0)
    model = dft.Thruster() + sag
    log = SimpleNamespace(inputs={"supply_voltage": np.array([18.0, 9.6])})
    ranges = {"supply_voltage": (9.6, 18.0)}
    fit = SimpleNamespace(model=model, parameters=model.parameters, ranges=ranges, logs=[log])
    words = sized_words(sag.name, fit)
    assert words == "a supply voltage sag (the drive at 9.6 V is 60 % of that at 18 V)"
    diag = SimpleNamespace(fit=fit)
    wrong = [*sagging_drive(re.search(SAGGING, words.replace("60 %", said)), diag)]
    assert (wrong == []) is right


def test_a_term_of_the_model_that_effects_have_brought_to_zero_is_told():
    """On the bench of the NGS the quadratic load went beside a linear one; only a note said so."""
    diag = made.found()
    fit = diag.stages[1].fit
    gone = {**fit.parameters, "alpha": replace(fit.parameters["alpha"], value=1e-19, at_bound=True)}
    diag = made.with_fit(diag, parameters=gone, model=fit.model.replace(alpha=1e-19))
    words = (
        "Beside a command dead band alpha goes to zero: the model does as well without its term."
    )
    assert words in diag.details
    assert words in diag.summary
    (wrong,) = claims.contradictions(diag, text=words)  # that loads of this shaft are quadratic
    assert wrong.startswith("without alpha the NRMSE is")
    assert "goes to zero" not in made.found().details


def test_a_last_fit_with_too_coarse_steps_is_a_caution():
    diag = made.found()
    rough = made.with_fit(diag, coarse=("At the optimum the model needs more steps.",))
    assert "Caution: the last fit needs finer integrator steps." in rough.summary
    assert claims.contradictions(rough) == []
    assert claims.contradictions(diag, text="Caution: the last fit needs finer integrator steps.")


def test_what_has_no_size_does_not_show():
    """A force that reaches no measurement was told as "a signal of 0.0 rad/s^2 is missing"."""
    (missing,) = made.found().missing
    ((time, signal, error),) = missing.runs
    silent = replace(missing, signal=None, runs=((time, 0 * signal, np.nan * error),))
    words = missing_words(silent, made.found().model)
    assert words.endswith("no missing signal is significant.")
    tiny = replace(missing, runs=((time, 1e-9 * signal, error),))
    assert "a signal of 1.5e-08 rad/s^2 (RMS)" in missing_words(tiny, made.found().model)
    remaining = replace(made.diagnosis().remaining, port=silent.port)
    beside = missing_words(silent, made.found().model, remaining)
    assert "no missing signal" not in beside
    assert (
        f"something enters there shows by the errors' dependence on {remaining.depends_on}"
        in beside
    )


def test_what_no_channel_measures_is_fitted_at_the_start_of_unseen_runs_too():
    """An Otter's sway began at -3 m/s there, and "unseen runs begin at measured states" stood."""
    fit = SimpleNamespace(
        holdout=True,
        begins_freely=True,
        model=SimpleNamespace(states=("surge", "sway")),
        train=SimpleNamespace(channels={"surge": None}),
        initial=({"surge": 0.0, "sway": 0.0},),
    )
    words = beginnings(fit)
    assert words.endswith(
        "unseen runs at measured ones, but for the sway, which no channel measures."
    )
    fit.train.channels["sway"] = None
    assert beginnings(fit).endswith("unseen runs at measured ones.")


def test_two_measures_that_name_two_signals_are_told_in_one_sentence():
    """One line of a boat's page named the left force, the next but one the right force."""
    (missing,) = made.found().missing
    remaining = replace(made.diagnosis().remaining, port=missing.port)
    assert remaining.depends_on != missing.depends_on
    words = missing_words(missing, made.found().model, remaining)
    assert f"depends most on {missing.depends_on}" in words
    assert f"while errors from one sample to the next depend on {remaining.depends_on}." in words
    assert "while" not in missing_words(
        missing, made.found().model, replace(remaining, port="load2")
    )


@pytest.mark.parametrize(("share", "right"), [(79, True), (91, False)])
def test_how_uneven_two_thrusters_are_is_held_against_their_efforts(share, right):
    gain = dft.effects.DifferentialGain(gain=0.049)
    model = dft.Vessel(drive="twin", command="effort", exponent=2.35) + gain
    words = f"({gain.consequence(model)})".replace("79", str(share))
    diag = SimpleNamespace(fit=SimpleNamespace(model=model, parameters=model.parameters))
    wrong = [*uneven_thrusters(re.search(UNEVEN, words), diag)]
    assert (wrong == []) is right


@pytest.mark.parametrize(
    ("logs", "words", "wrong"),
    [
        ({"heading"}, "a wind from 302 deg pushes the vessel, taken as 4 m/s", False),
        ({"heading"}, "a wind from 122 deg pushes the vessel, taken as 4 m/s", True),
        (set(), "a wind pushes the vessel, taken as 4 m/s", False),
        (set(), "a wind pushes the vessel, taken as 5 m/s", True),
        ({"heading", "wind_speed"}, "", False),
    ],
)
def test_a_wind_that_no_log_measures_is_told_with_what_is_known_of_it(logs, words, wrong):
    """ "The wind pushes the vessel" said neither from where nor for which speed."""
    wind = dft.effects.Wind(direction=-1.02, speed=4.0)
    model = dft.Vessel() + wind
    assert wrong or wind.consequence(model, logs) == words
    train = SimpleNamespace(channels=dict.fromkeys(logs))
    fit = SimpleNamespace(parameters=model.parameters, ranges={}, train=train)
    told = re.search(BLOWING, words)
    found = [*blowing_wind(told, SimpleNamespace(fit=fit))] if told else []
    assert (found != []) is wrong


@pytest.mark.parametrize(("speed", "right"), [("0.22", True), ("0.30", False)])
def test_how_fast_the_water_moves_is_held_against_its_components(speed, right):
    model = dft.Vessel() + dft.effects.WaterCurrent(to_north=0.18, to_east=-0.12)
    words = model.effects[0].consequence(model)
    assert words == "the water moves at 0.22 m/s"
    diag = SimpleNamespace(fit=SimpleNamespace(model=model, parameters=model.parameters))
    wrong = [*moving_water(re.search(MOVING, words.replace("0.22", speed)), diag)]
    assert (wrong == []) is right
