"""Learning what no effect explains: evidence, closed forms, and a whole diagnosis."""

import re
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import claims
import made_diagnosis as made
import numpy as np
import pytest
from command_line import run
from hidden import sets
from scipy.stats import multivariate_normal
from steps import (
    FORMS,
    LearnedLaw,
    Match,
    PortSeries,
    TriedForm,
    Worth,
    as_estimated,
    as_formula,
    best_match,
    bind,
    channel_of,
    compiled_fitter,
    curve_fits,
    evidence,
    fitting,
    parameter_names,
    places_of,
    project_out,
    ranked_matches,
    regressors_of,
    term_along,
    with_companion,
    with_jump,
)

import diffthrust as dft
from diffthrust.effects import Curve
from diffthrust.logs import PWM, Written


def projected(information, scores, base):
    """Information and gradient beside what is estimated, and the information of each by itself."""
    left, clear = project_out(information, scores, base)
    return left, clear.sum(axis=1), np.diagonal(information)[base:]


def test_evidence_is_the_likelihood_ratio_with_the_coefficients_integrated_out():
    # a linear model with known unit noise: the marginal likelihood is a normal one, by SciPy
    rng = np.random.default_rng(2)
    known, own = rng.standard_normal((60, 2)), rng.standard_normal((60, 5))
    errors = own @ np.array([0.4, 0.0, 0.3, -0.2, 0.1]) + rng.standard_normal(60)
    rows = np.concatenate([known, own], axis=1)
    scores = rows.T[:, :, None] * errors[None, :, None]
    best = evidence.marginal_likelihood(*projected(rows.T @ rows, scores[:, :, 0], 2), 1.0)
    widths = best.size * np.array([1.0, 2.0, *[best.bend] * 3])
    flat = 1e6 * known @ known.T  # of the known coordinates nothing is known before
    with_it = flat + own @ np.diag(widths**2) @ own.T + np.eye(60)
    expected = multivariate_normal.logpdf(errors, cov=with_it)
    expected -= multivariate_normal.logpdf(errors, cov=flat + np.eye(60))
    assert np.isclose(best.evidence, expected, atol=1e-3)


def test_what_the_estimated_parameters_do_is_no_evidence():
    rng = np.random.default_rng(4)
    known = rng.standard_normal((80, 1))
    own = np.concatenate([known, rng.standard_normal((80, 4))], axis=1)
    rows = np.concatenate([known, own], axis=1)
    errors = 5.0 * known[:, 0] + rng.standard_normal(80)
    best = evidence.marginal_likelihood(*projected(rows.T @ rows, rows.T * errors, 1), 1.0)
    assert best.shared.tolist() == [True, False, False, False, False]
    assert best.evidence < 1.0


def test_an_answer_that_overflows_is_no_evidence():
    left, clear = np.diag([1.0, 2.0, np.nan]), np.array([1.0, np.nan, 0.0])
    best = evidence.marginal_likelihood(left, clear, np.ones(3), 1.0)
    assert best.evidence == -np.inf
    assert not best.shape.any()


LAWS = {
    "constant": lambda x: 3.0 + 0 * x,
    "linear": lambda x: 0.2 * x,
    "even square": lambda x: -0.01 * x**2,
    "square with sign": lambda x: 0.02 * x * np.abs(x),
    "cubic": lambda x: 1e-3 * x**3,
    "power": lambda x: np.sign(x) * np.abs(x / 20.0) ** 1.5,
    "saturating": lambda x: np.tanh(x / 12.0),
    "dead zone": lambda x: 0.3 * np.sign(x) * np.maximum(np.abs(x) - 15.0, 0.0),
    "ramp above": lambda x: 0.3 * np.maximum(x - 10.0, 0.0),
    "square beyond": lambda x: -0.01 * np.maximum(np.abs(x) - 18.0, 0.0) ** 2,
    "hump": lambda x: 2.0 * np.exp(-(((x - 12.0) / 9.0) ** 2)),
    "step": lambda x: 0.5 * (1.0 + np.tanh((x + 14.0) / 6.0)),
    "exponential": lambda x: np.exp(x / 15.0) - 1.0,
    "levelling": lambda x: 1.0 - np.exp(-x / 18.0),
    "square below": lambda x: np.maximum(-5.0 - x, 0.0) ** 2,
    "ripple": lambda x: np.sin(0.5 * (x - 3.0)),
}


def judged(law, readings=None):
    """What samples of a law with noise say of the shapes over their signal, by plain least squares.

    The noise is a hundredth of the law's scatter, which a constant does not have: without noise
    rounding would choose the form. The model is taken to have nothing of its own.
    """
    rng = np.random.default_rng(11)
    samples = rng.uniform(-40.0, 40.0, 4000)
    if readings is not None:
        samples = rng.choice(readings, 4000)
    fine = Curve("load", "speed", -40.0, 40.0, pieces=29)
    values = law(samples)
    noise = 0.01 * max(np.std(values), 0.01 * np.max(np.abs(values)))
    rows = fine.basis(samples) / noise
    errors = -(values / noise + rng.standard_normal(samples.size))
    gradient = (rows * errors).sum(axis=1)
    x = np.linspace(-40.0, 40.0, 241)
    projection = np.linalg.pinv(fine.basis(x).T)
    readings = np.unique(samples)
    return evidence.LinearizedEvidence(x, projection, rows @ rows.T, gradient, readings, 23.0)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_that_has_a_closed_form_is_given_its_name(name):
    price = np.log(4000.0)
    found = ranked_matches({"": judged(LAWS[name])})
    best = min(found, key=lambda one: price * len(one.form.parameters) - one.gain)
    assert best.form.name == name, [(one.form.name, one.gain) for one in found[:3]]


def named(law):
    """The form that fits samples of a law best, with what earns its price beside it."""
    price, seen = np.log(4000.0), judged(law)
    matches = [with_companion(m, seen, None, price) for m in ranked_matches({"": seen})]
    count = [len(m.form.parameters) + len(m.form.amplitudes) - 1 for m in matches]
    _, best = min(zip(count, matches, strict=True), key=lambda each: price * each[0] - each[1].gain)
    return best


@pytest.mark.parametrize(
    ("law", "name", "companion", "values"),
    [
        (lambda x: 21.0 * np.tanh(x / 0.46) - 3.3, "dry", "constant", {"a": 21.0, "d": -3.3}),
        (lambda x: 1e-3 * x**3 + 9.0, "cubic", "constant", {"a": 1e-3, "d": 9.0}),
        (
            lambda x: 0.02 * x * np.abs(x) + 0.008 * x**2,
            "square with sign", "even part", {"a": 0.02, "d": 0.008},
        ),
        (lambda x: 0.2 * x + 0.05 * np.abs(x), "linear", "even part", {"a": 0.2, "d": 0.05}),
    ],
)  # fmt: skip
def test_a_form_is_named_with_the_constant_or_the_even_part_beside_it(law, name, companion, values):
    best = named(law)
    assert (best.form.name, best.form.companion) == (name, companion)
    assert {n: best.values[n] for n in values} == pytest.approx(values, rel=0.03)


@pytest.mark.parametrize("name", LAWS)
def test_nothing_stands_beside_a_form_that_fits_alone(name):
    form = named(LAWS[name]).form
    assert (form.name, form.companion) == (name, "")


def test_whole_runs_may_ask_for_a_constant_that_one_step_errors_do_not_show():
    dry = judged(lambda x: 21.0 * np.tanh(x / 0.46))
    offset = judged(lambda x: 21.0 * np.tanh(x / 0.46) - 3.3)
    alone = best_match(next(form for form in FORMS if form.name == "dry"), dry)
    assert with_companion(alone, dry, None, np.log(4000.0)) is alone
    asked = with_companion(alone, dry, offset, np.log(4000.0))
    assert asked.form.companion == "constant"
    scaled = alone._replace(times="value")  # a share of what arrives has no constant of its own
    assert with_companion(scaled, dry, offset, np.log(4000.0)) is scaled


def test_no_wave_is_seen_between_readings_and_no_form_of_as_many_parameters_as_readings():
    ripple, hump, line = (
        next(form for form in FORMS if form.name == name) for name in ("ripple", "hump", "line")
    )
    law = LAWS["ripple"]  # 12.6 from wave to wave
    assert best_match(ripple, judged(law)).gain > 0.0
    assert best_match(ripple, judged(law, np.linspace(-40.0, 40.0, 17))).gain > 0.0
    uneven = np.sort(np.concatenate([np.linspace(-40.0, 40.0, 4) + d for d in (-0.01, 0.01)]))
    assert best_match(ripple, judged(law, uneven)).gain == 0.0  # 8 values, in 4 places
    at_three = judged(law, np.array([-40.0, -10.0, 40.0]))
    assert best_match(hump, at_three).gain == 0.0
    assert best_match(line, at_three).gain > 0.0


def test_the_gain_of_two_shapes_is_that_of_both_fitted_together():
    rows = np.random.default_rng(8).standard_normal((3, 50))
    errors = 0.7 * rows[0] - 0.4 * rows[1] + 0.1 * np.random.default_rng(9).standard_normal(50)
    x = np.arange(3.0)
    seen = evidence.LinearizedEvidence(x, np.eye(3), rows @ rows.T, rows @ errors, x, 1.0)
    amplitudes, misfit, _, _ = np.linalg.lstsq(rows[:2].T, -errors, rcond=None)
    gain, best = seen.gain_of(np.eye(3)[:2])
    np.testing.assert_allclose(best, amplitudes)
    assert gain == pytest.approx(errors @ errors - misfit[0])
    assert seen.gain_of(np.eye(3)[[0, 0]])[0] == 0.0  # the same shape twice


def test_the_gain_of_a_shape_is_the_likelihood_ratio_at_its_best_amplitude():
    seen = judged(LAWS["hump"])
    shape = LAWS["hump"](seen.x)
    gain, amplitude = seen.gain(shape)
    assert amplitude == pytest.approx(1.0, abs=5e-3)
    # the squares of the standardised law are what it takes off the misfit
    weights = seen.projection @ shape
    assert gain == pytest.approx(weights @ seen.information @ weights, rel=0.02)
    assert seen.gain(np.zeros(241)) == (0.0, 0.0)


def test_a_curve_fitted_to_whole_runs_tells_where_its_form_is_whatever_a_slope_of_it_is():
    # an ordinary least-squares fit of a curve beside a slope that is the model's own: the curve may
    # have any share of that, and the hump is found all the same
    rng = np.random.default_rng(3)
    curve = Curve("load", "speed", -40.0, 40.0)
    samples = rng.uniform(-40.0, 40.0, 4000)
    rows = curve.basis(samples)
    hump = 2.0 * np.exp(-(((samples - 12.0) / 9.0) ** 2)) + 0.02 * rng.standard_normal(4000)
    weak = 1e-4 * np.eye(len(rows))  # else the slope and the curve's own would be one
    both = np.concatenate([rows, samples[None]])
    information = both @ both.T / 0.02**2
    information[: len(rows), : len(rows)] += weak
    covariance = np.linalg.inv(information)
    shape = (covariance @ both @ (hump + 0.3 * samples))[: len(rows)] / 0.02**2
    names = tuple(f"curve.{n}" for n in curve.coefficients)
    fit = SimpleNamespace(free=(*names, "slope"), covariance=covariance)
    fitted = Curve("load", "speed", -40.0, 40.0, shape=tuple(shape))
    law = LearnedLaw(curve=fitted, fit=fit, worth=None, evidence=0.0, samples=samples)
    form = next(one for one in FORMS if one.name == "hump")
    found = best_match(form, evidence.evidence_of_fit(law))
    assert found.values == pytest.approx({"a": 2.0, "b": 12.0, "c": 9.0}, rel=0.05)


def test_a_form_begins_with_the_parameters_that_are_best_beside_it():
    """Ordinary least squares again: a curve may take a part of the load on itself."""
    rng = np.random.default_rng(5)
    curve = Curve("load", "speed", -40.0, 40.0)
    samples = rng.uniform(-40.0, 40.0, 4000)
    both = np.concatenate([curve.basis(samples), (samples * np.abs(samples))[None]])
    hump = 2.0 * np.exp(-(((samples - 12.0) / 9.0) ** 2))
    load = 0.05 * both[-1] + hump + 0.02 * rng.standard_normal(4000)
    weak = np.diag([1e-4] * (len(both) - 1) + [0.0])
    covariance = np.linalg.inv(both @ both.T / 0.02**2 + weak)
    *shape, alpha = covariance @ both @ load / 0.02**2
    model = dft.Thruster(alpha=alpha) + Curve("load", "speed", -40.0, 40.0, shape=tuple(shape))
    free = (*(f"curve.{n}" for n in curve.coefficients), "alpha")
    fit = SimpleNamespace(free=free, covariance=covariance, model=model)
    law = LearnedLaw(curve=model.effects[-1], fit=fit, worth=None, evidence=0.0, samples=samples)
    here = evidence.model_beside(law, np.array(shape))
    assert here.parameters["alpha"].value == pytest.approx(alpha, rel=1e-12)
    other = np.array(shape) + 5.0 * rng.standard_normal(len(shape))
    rest = load - other @ both[:-1]
    (best,) = np.linalg.lstsq(both[-1:].T, rest)[0]
    beside = evidence.model_beside(law, other)
    assert beside.effects == ()
    assert beside.parameters["alpha"].value == pytest.approx(best, rel=1e-6)
    assert abs(best / alpha - 1.0) > 0.01
    far = [np.array(shape) + by * (other - np.array(shape)) for by in (-1e3, 1e3)]
    least = min(evidence.model_beside(law, one).parameters["alpha"].value for one in far)
    assert least == pytest.approx(0.1 * alpha)  # it stays positive


def test_a_form_is_a_formula_that_begins_where_it_is_likeliest():
    curve = Curve("load", "speed", -40.0, 40.0, name="slack")
    best = next(
        m for m in ranked_matches({"": judged(LAWS["dead zone"])}) if m.form.name == "dead zone"
    )
    model = dft.Thruster() + as_formula(best, curve, "rad/s^2", "rad/s", "speed")
    assert model.parameters["slack_form.a"].unit == "1/s"
    assert model.parameters["slack_form.b"].channel == "speed"  # told as the logs write that
    assert model.parameters["slack_form.b"].unit == "rad/s"
    assert model.parameters["slack_form.a"].value == pytest.approx(0.3, rel=0.01)
    assert model.parameters["slack_form.b"].value == pytest.approx(15.0, abs=0.2)
    assert model.parameters["slack_form.a"].null == 0.0


@pytest.mark.parametrize(
    ("signal", "channel"),
    [
        ("speed", "speed"),
        ("lag(speed, time_constant)", "speed"),
        ("command - play(command, half_width)", "command"),
        ("lag(command**2, time_constant, 0)", ""),
        ("integral(speed)", ""),
        ("sin(wave_number * speed + phase)", ""),
        ("value", ""),
    ],
)
def test_a_signal_is_in_the_unit_of_the_channel_that_it_is(signal, channel):
    assert channel_of(signal, dft.Thruster()) == channel


@pytest.mark.parametrize("end", [0.0001 / 3, 2e-4 / 3])
def test_a_form_at_an_end_of_its_range_is_within_its_rounded_bounds(end):
    curve = Curve("load", "speed", 0.0, end)
    form = next(one for one in FORMS if one.name == "saturating")
    for share in (0.01, 2.0):
        match = Match(form, {"a": 1.0, "c": share * end}, 10.0, end, np.inf)
        made = as_formula(match, curve, "rad/s^2", "rad/s", "")
        assert made.c == pytest.approx(share * end, rel=1e-4)


def test_two_humps_that_nearly_cancel_are_one_rise_and_fall():
    """The friction of the EMPS axis was told as a hump about 0.00017 m/s of -6958 N."""
    humps, rise = (
        next(form for form in FORMS if form.name == name) for name in ("odd humps", "rise and fall")
    )
    v, width, near = np.linspace(-0.13, 0.13, 261), 0.071, 1.7e-4
    peak = width / np.sqrt(2.0)  # where the derivative of v exp(-(v / c)^2) is zero
    twice = humps.over(v, {"a": -6958.0, "b": near, "c": width})
    once = rise.over(v, {"a": -28.3, "c": peak})
    assert once == pytest.approx(twice, abs=0.3)
    assert abs(v[np.argmax(np.abs(once))]) == pytest.approx(peak, abs=1e-3)
    assert rise.name in humps.plain
    assert rise.is_odd


def friction_as_told(name, values, curve, speeds):
    """A diagnosis with a law at the load whose form is told, with an offset beside it."""
    form = next(one for one in FORMS if one.name == name)
    form = next(one for one in form.companions if one.companion == "constant")
    formula = as_formula(Match(form, values, 10.0, 1.0, np.inf), curve, "rad/s^2", "rad/s", "speed")
    fit = made.found().fit
    width = fit.parameters["command_deadband.half_width"]
    sizes = {
        f"{formula.name}.{n}": replace(width, value=v, per=1.0, shown_unit=formula.given[n]["unit"])
        for n, v in values.items()
    }
    fit = replace(fit, parameters={**fit.parameters, **sizes})
    tried = TriedForm(form.name, formula, fit, -100.0, 0.0, companion="constant")
    law = LearnedLaw(
        curve, fit, Worth(0.5, 0.4, 0.6), 9.0, forms=(tried,), named=True, samples=speeds,
        signal_unit="rad/s", channel="speed", port_unit="rad/s^2",
    )  # fmt: skip
    return replace(made.unexplained(), laws=(law,))


@pytest.mark.parametrize(
    ("share", "named", "pieces"), [(0.5, False, 16), (0.05, False, 8), (0.5, True, 8)]
)
def test_a_curve_without_a_name_is_made_finer_where_that_surely_pays(
    share, named, pieces, monkeypatch
):
    """The friction of the EMPS axis turns within one piece of eight."""
    fit, speeds = made.found().fit, np.linspace(-60.0, 60.0, 241)
    curve = Curve("load", "speed", -60.0, 60.0, shape=tuple(np.sin(np.arange(11.0))))
    told = friction_as_told("rise and fall", {"a": 2.8, "c": 25.0, "d": -0.3}, curve, speeds)
    law = replace(told.laws[0], named=named)
    monkeypatch.setattr(curve_fits, "_with_curve", lambda context, baseline, curve: (fit, curve))
    worth = Worth(share, share - 0.04, share + 0.04)
    monkeypatch.setattr(curve_fits, "worth_between_fits", lambda *_: worth)
    refined = curve_fits._with_pieces(None, fit, law)
    assert refined.curve.pieces == pieces
    x = np.linspace(law.curve.low, law.curve.high, 50)
    np.testing.assert_allclose(refined.curve.at_signal(x), law.curve.at_signal(x), atol=1e-9)


def test_the_size_of_a_law_is_that_of_the_form_that_is_told():
    """The friction of the EMPS axis: "up to 37 N" of the curve, beside a form of 31 N."""
    speeds = np.linspace(-60.0, 60.0, 241)
    curve = Curve("load", "speed", -60.0, 60.0, shape=(3.7,) * 9)
    diag = friction_as_told("rise and fall", {"a": 2.8, "c": 25.0, "d": -0.3}, curve, speeds)
    assert "up to 3.1 rad/s^2" in diag.summary
    assert claims.contradictions(diag, text=diag.summary) == []


def test_the_size_of_a_law_is_worked_out_from_its_estimates_and_not_from_their_print():
    """A formula has its numbers to five digits: 2.85 + 0.40 of 2.850049 + 0.40 makes 3.2."""
    speeds = np.linspace(-60.0, 60.0, 241)
    curve = Curve("load", "speed", -60.0, 60.0, shape=(3.7,) * 9)
    diag = friction_as_told("rise and fall", {"a": 2.85, "c": 25.0, "d": -0.4}, curve, speeds)
    (law,), (form,) = diag.laws, diag.laws[0].forms
    of_a = f"{form.formula.name}.a"
    estimate = replace(form.fit.parameters[of_a], value=2.850049)
    fit = replace(form.fit, parameters={**form.fit.parameters, of_a: estimate})
    told = replace(diag, laws=(replace(law, forms=(replace(form, fit=fit),)),))
    assert "up to 3.3 rad/s^2" in told.summary


def test_the_caution_is_of_the_fit_that_is_copied():
    """A T200's stage ended in a kink of its error; what was copied was the law beside it."""
    curve = Curve("load", "speed", -60.0, 60.0, shape=(3.7,) * 9)
    sizes = {"a": 2.8, "c": 25.0, "d": -0.3}
    diag = friction_as_told("rise and fall", sizes, curve, np.linspace(-60.0, 60.0, 241))
    (law,), stuck = diag.laws, dft.estimation.Status.NOT_CONVERGED
    of_stage = made.with_fit(diag, status=stuck)
    assert "Caution" not in of_stage.summary
    forms = tuple(replace(form, fit=replace(form.fit, status=stuck)) for form in law.forms)
    of_law = replace(diag, laws=(replace(law, forms=forms),))
    assert "Caution: the last fit did not converge" in of_law.summary
    assert "The fit with what was learned has the status 'not_converged'" in of_law.report()
    for told in (of_stage, of_law):
        assert claims.contradictions(told, text=told.summary) == []


def test_a_form_that_the_model_takes_back_has_no_size():
    """A dead zone of -16 kN s/m beside a viscous friction of as much more: 18 N of dry friction."""
    speeds = np.linspace(-60.0, 60.0, 241)
    curve = Curve("load", "speed", -60.0, 60.0, shape=(1.8,) * 9)
    diag = friction_as_told("dead zone", {"a": -16.0, "b": 2.0, "d": 0.0}, curve, speeds)
    assert "up to" not in diag.summary


def test_every_form_is_one_that_a_spec_file_may_hold():
    own = {"half_width": {"unit": "rad/s", "value": 3.0, "bounds": (0.1, 30.0)}}
    curve = Curve("load", "speed - play(speed, half_width)", -40.0, 40.0, **own)
    for match in ranked_matches({"": judged(LAWS["hump"]), "value": judged(LAWS["linear"])}):
        table = as_formula(match, curve, "rad/s^2", "rad/s", "").as_table()
        assert "play(speed, half_width)" in table["formula"] or match.form.name == "constant"
    assert len({form.name for form in FORMS}) == len(FORMS)


@pytest.mark.parametrize("signal", ["value", "value - play(value, half_width)"])
def test_a_form_of_what_arrives_is_added_to_it(signal):
    own = {"half_width": {"unit": "rad/s^2", "value": 3.0, "bounds": (0.1, 30.0)}}
    curve = Curve("drive", signal, -40.0, 40.0, **(own if "play" in signal else {}))
    for match in ranked_matches({"": judged(LAWS["dead zone"])}):
        formula = as_formula(match, curve, "rad/s^2", "rad/s^2", "")
        assert formula.declared["a"].null == 0.0
        assert formula.adds or formula.expression.startswith("value + ")


def test_a_value_at_its_bound_stays_within_it_when_it_is_rounded():
    told = {"unit": "rad/s", "value": 0.149034, "bounds": (0.149034, 1490.34)}
    law = dft.effects.Formula("load", "speed - play(speed, half_width)", half_width=told)
    assert as_estimated(law).half_width == 0.149034


@pytest.mark.parametrize("signal", ["a", "b", "c", "p", "k"])
def test_parameters_of_forms_are_told_from_signals_of_their_names(signal):
    curve = Curve("load", signal, -40.0, 40.0)
    for match in ranked_matches({"": judged(LAWS["hump"])}):
        formula = as_formula(match, curve, "rad/s^2", "rad/s", "")
        assert formula.reads == ((signal,) if match.form.name != "constant" else ())
        names = zip(parameter_names(match.form), formula.given, strict=False)
        own = {n: getattr(formula, name) for n, name in names}
        assert own == pytest.approx({n: match.values[n] for n in own})


def test_a_place_for_both_signs_is_positive_and_a_ripple_is_more_than_a_flank():
    for law in (lambda x: 0.2 * x + 3.0 * np.sign(x), lambda x: 0.2 * (x + 60.0)):
        for match in ranked_matches({"": judged(law)}):
            assert match.form.even <= (match.values.get("b", 1.0) >= 0.0)
    line = min(
        ranked_matches({"": judged(lambda x: 0.2 * (x + 60.0))}),
        key=lambda one: np.log(4000.0) * len(one.form.parameters) - one.gain,
    )
    assert (line.form.name, line.values["b"]) == ("line", pytest.approx(-60.0, abs=0.5))


@pytest.mark.thorough
def test_laws_that_go_through_the_logs_together_are_judged_as_alone():
    hidden = sets.draw("outside/load_hump", 5001)
    fit = dft.fit(hidden.model, hidden.train, starts=1)
    records = bind(fit.model, hidden.train)
    trials, trial = compiled_fitter(fit, [], [], records, [], records)
    seen = regressors_of(trials, trial)
    laws = [
        term_along(seen, port, signal, "", {})
        for signal in ("speed", "command", "integral(1)")
        for port in ("load", "drive")
    ]
    together = evidence.likely_curves(trials, trial, laws)
    alone = [one for law in laws for one in evidence.likely_curves(trials, trial, [law])]
    alone.sort(key=lambda one: -one.evidence)
    assert [one.term for one in together] == [one.term for one in alone]
    for ours, theirs in zip(together, alone, strict=True):
        assert ours.evidence == pytest.approx(theirs.evidence, rel=1e-8)
        np.testing.assert_allclose(ours.curve.shape, theirs.curve.shape, rtol=1e-6, atol=1e-9)


def low_battery(loss):
    """Evidence by its jump and by its curve, of a thrust that is lost at a battery's voltage."""
    rng = np.random.default_rng(12)
    t = np.arange(0.0, 40.0, 0.05)
    volts = 15.0 - 0.05 * t + np.sin(0.7 * t)
    command = np.repeat(rng.uniform(-4.0, 4.0, 20), 40)
    inputs = {"command": command, "supply_voltage": volts}
    speed = dft.simulate(dft.Thruster(), dft.Log(t, inputs))["speed"]
    thrust = 0.018 * speed * np.abs(speed) - loss(volts) * speed
    measured = {
        "speed": speed + 0.2 * rng.standard_normal(t.size),
        "thrust": thrust + 0.5 * rng.standard_normal(t.size),
    }
    log = dft.Log(t, inputs, measured)
    fit = dft.fit(dft.Thruster(), log, starts=1)
    records = bind(fit.model, [log])
    trials, trial = compiled_fitter(fit, [], [], records, [], records)
    seen = regressors_of(trials, trial)
    term = term_along(seen, "propeller", "supply_voltage", "speed", {})
    (curve,) = evidence.likely_curves(trials, trial, [term])
    return with_jump(trial, seen, curve).evidence, curve.evidence


@pytest.mark.thorough
def test_a_law_that_changes_at_once_is_likelier_as_a_jump_and_one_that_does_not_as_a_curve():
    jump, curve = low_battery(lambda volts: 0.12 * (volts < 14.0))
    assert jump > curve + 20.0
    jump, curve = low_battery(lambda volts: 0.04 * (16.0 - volts))
    assert jump == curve


def test_the_form_of_a_jump_may_be_narrower_than_splines_show():
    curve = Curve("load", "speed", -40.0, 40.0)
    narrow = judged(lambda x: 0.5 * (1.0 + np.tanh((x + 14.0) / 0.1)))
    widths = {}
    for match in ranked_matches({"": narrow}):
        if match.form.name in ("step", "hump"):
            form = as_formula(match, curve, "rad/s^2", "rad/s", "speed")
            widths[match.form.name] = form.declared["c"].limits[0]
    assert widths["step"] <= 0.1 < 0.5 < widths["hump"]


def test_what_a_parameter_does_already_leaves_nothing_at_a_held_input():
    """A share of the drive, which the held command makes, is beta: exactly, between samples too."""
    hidden = sets.draw("outside/load_hump", 5001)
    fit = dft.fit(hidden.model, hidden.train, starts=1)
    records = bind(fit.model, hidden.train)
    trials, trial = compiled_fitter(fit, [], [], records, [], records)
    law = term_along(regressors_of(trials, trial), "drive", "speed", "value", {})
    level = law.basis(Curve("drive", "speed", -1e4, 1e4).basis)
    level = PortSeries(*([rows[:1] for rows in part] for part in level))
    ((left, _, alone),) = evidence.projected_information(trial, "drive", [level])
    assert left[0, 0] < 1e-9 * alone[0]


def test_laws_add_where_forces_do_and_take_a_share_of_what_is_only_measured():
    hidden = sets.draw("outside/load_hump", 5001)
    model, log = hidden.model, hidden.train[0]
    (record,) = bind(model, [log])
    places = places_of(model, record, ["speed", "thrust"])
    tools = SimpleNamespace(fitter=SimpleNamespace(model=model, records=[record], places=places))
    ports = ("drive", "load", "shaft", "propeller")
    assert [fitting._usually_adds(tools, port) for port in ports] == [True, True, True, False]


def test_of_forms_that_tie_the_usual_one_is_told_and_no_likelier_one_of_more_parameters_counts():
    def form(name, bic, times, size):
        declared = dict.fromkeys("abcdef"[:size])
        return SimpleNamespace(
            name=name, bic=bic, times=times, formula=SimpleNamespace(declared=declared)
        )

    adding, scaling = form("odd humps", -99.5, "", 3), form("hump of both signs", -100, "value", 3)
    wide = form("step", -109.8, "", 4)
    assert fitting._plainest([wide, scaling, adding], adds=True) is adding
    assert fitting._plainest([wide, adding, scaling], adds=False) is scaling
    clear = form("hump of both signs", -120.0, "value", 3)
    assert fitting._plainest([adding, clear], adds=True) is clear
    assert fitting._plainest([clear, form("linear", -30.0, "value", 1)], adds=True).name == "linear"


@pytest.fixture(scope="module")
def hump():
    """A thruster with a hump in its load and a dead band; an exponent can imitate the hump."""
    hidden = sets.draw("outside/load_hump+command_deadband", 5000)
    names = ["linear_damping", "command_deadband", "load_exponent"]
    return hidden, dft.diagnose(hidden.model, hidden.train, holdout=hidden.unseen, candidates=names)


@pytest.mark.thorough
def test_a_hump_that_is_in_no_catalogue_is_learned_and_named(hump):
    hidden, diag = hump
    assert diag.verdict == "unexplained"
    (law,) = diag.laws
    assert law.curve.port in hidden.ports
    assert law.signals[0] == "speed"
    assert law.form is not None
    assert law.form.name == "odd humps"  # a share of the load does as well: but forces add up
    assert "hump of both signs" in [one.name for one in law.alike]
    assert law.worth.low > 0.5  # of an error of which the dead band makes a part
    assert law.form.fit.holdout.nrmse < 0.4 * diag.stages[0].holdout.nrmse
    assert law.form.formula.c == pytest.approx(
        law.form.fit.parameters["curve_form.c"].value, rel=1e-4
    )
    told = hidden.plant.hidden["load_hump"]  # middle and width of the truth
    assert law.form.fit.parameters["curve_form.c"].value == pytest.approx(told["width"], rel=0.3)


@pytest.mark.thorough
def test_what_only_imitates_the_law_is_dropped_and_what_is_there_beside_it_is_kept(hump):
    _, diag = hump
    assert diag.added == ("command_deadband",)
    assert diag.detectable == ()
    assert diag.groups == (("command_deadband",),)
    assert diag.stages[-1].effects == ("command_deadband",)
    (law,) = diag.laws
    assert law.superfluous == ("load_exponent",)
    assert "load_exponent" in diag.dropped
    assert {"command_deadband", law.form.formula.name} <= {
        e.name for e in law.reported.model.effects
    }
    assert "Superfluous beside it: load exponent." in diag.details
    # of what is left without it
    left = (law.reported.holdout.nrmse / diag.stages[-1].holdout.nrmse) ** 2
    assert law.worth.share == pytest.approx(1.0 - left, abs=1e-6)


@pytest.mark.thorough
def test_what_was_learned_is_told_in_words_json_and_a_figure(hump, tmp_path):
    _, diag = hump
    data = diag.to_json()["learned"]
    assert [one["port"] for one in data] == [diag.laws[0].curve.port]
    assert data[0]["form"] == diag.laws[0].form.name
    assert 0.5 < data[0]["worth"]["share"] <= 1.0
    assert "Learned: at the port" in diag.details
    assert diag.laws[0].curve.times == "value"  # and its form adds: told as its form is
    assert "a curve of speed is added" in diag.details
    assert "It is a hump of speed" in diag.details
    assert "another form: its factor is a hump of speed" in diag.details
    diag.save(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "What was learned" in page
    figure = diag.plot_learned()
    assert {axes.get_ylabel() for axes in figure.axes} >= {"samples"}


@pytest.mark.thorough
def test_a_law_is_told_in_the_units_of_the_logs(hump):
    _, diag = hump
    law = diag.laws[0]
    in_rpm = replace(law, fit=replace(law.fit, written={"speed": Written("rpm")}))
    assert in_rpm.shown.value == pytest.approx(30 / np.pi)
    told = replace(diag, laws=(in_rpm,))
    assert re.search(r"Valid from -\d+ to \d+ rpm\.", told.details)
    curve, samples = told.plot_learned().axes
    assert samples.get_xlabel().endswith("[rpm]")
    assert curve.get_xlim()[1] > 30 / np.pi * law.curve.high


@pytest.mark.thorough
def test_what_was_learned_is_copied_into_a_spec_file(hump):
    _, diag = hump
    lines = diag.report().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("effects = "))
    last = next(i for i, line in enumerate(lines) if i > first and line.startswith("model = "))
    spec = tomllib.loads("\n".join(line for line in lines[first:last] if line[:1] != "#"))
    known, table = spec["effects"]
    assert known == "command_deadband"
    text = table.pop("formula")
    again = dft.effects.Formula(expression=text, **table)
    model, law = diag.model + again, diag.laws[0].form
    (name, ours), *_ = again.declared.items()
    assert model.parameters[f"curve_form.{name}"].unit == ours.unit
    told = [spec["parameters"][f"curve_form.{n}"] for n in again.declared]
    assert told == pytest.approx([getattr(law.formula, n) for n in again.declared], rel=1e-4)


@pytest.mark.thorough
def test_a_form_that_one_step_errors_set_apart_is_not_told_as_alike(hump):
    _, diag = hump
    law = diag.laws[0]
    near = replace(law.forms[0], name="hump", bic=law.forms[0].bic + 1.0)
    assert [one.name for one in replace(law, forms=(law.forms[0], near)).alike] == ["hump"]
    far = replace(near, one_step=near.one_step + 20.0)
    assert replace(law, forms=(law.forms[0], far)).alike == ()


@pytest.mark.thorough
def test_widths_of_pulses_are_told_from_the_stop(hump):
    _, diag = hump
    law = diag.laws[0]
    way = Written("us", pwm=PWM(stop=1500, full=1900))
    driven = replace(law, channel="command", signal_unit="effort")
    driven = replace(driven, fit=replace(law.fit, written={"command": way}))
    assert (driven.shown.value, driven.place_unit) == (400.0, "us from the stop")


@pytest.mark.thorough
def test_what_was_learned_becomes_a_class_of_ones_own(hump, tmp_path):
    hidden, diag = hump
    diag.save(tmp_path / "diag.json")
    asked = ["tip_stall", "--learned", str(tmp_path / "diag.json"), "--directory", str(tmp_path)]
    run("new-effect", *asked)
    scope: dict = {}
    exec((tmp_path / "tip_stall.py").read_text(), scope)
    model = hidden.model + scope["TipStall"]()
    ours = dft.simulate(model, hidden.unseen)["speed"]
    theirs = dft.simulate(hidden.model + diag.laws[0].form.formula, hidden.unseen)["speed"]
    np.testing.assert_allclose(ours, theirs, atol=0.02 * np.std(theirs))  # four digits of a class
    more = run("new-effect", *asked, "--port", "load", status=2)
    assert "Leave out --formula" in more.output


@pytest.mark.thorough
def test_a_model_with_what_was_learned_simulates_fits_and_is_saved(hump, tmp_path):
    hidden, diag = hump
    model = diag.model + diag.learned
    assert "curve" in {effect.name for effect in model.effects}
    diag.laws[0].fit.save(tmp_path / "fit.json")
    back = dft.load(tmp_path / "fit.json").model
    seen = dft.simulate(back, hidden.unseen)["speed"]
    assert np.array_equal(seen, dft.simulate(diag.laws[0].fit.model, hidden.unseen)["speed"])
    diag.save(tmp_path / "diag.json")
    loaded = dft.load(tmp_path / "diag.json")
    assert loaded.laws[0].curve.shape == diag.laws[0].curve.shape
    assert loaded.details == diag.details


@pytest.mark.thorough
def test_a_diagnosis_that_learned_nothing_has_no_figure_of_it():
    hidden = sets.draw("none", 3)
    diag = dft.diagnose(
        hidden.model, hidden.train, holdout=hidden.unseen, candidates=["actuator_lag"]
    )
    assert diag.learned == ()
    assert diag.to_json()["learned"] == []
    with pytest.raises(dft.InputError, match="learned no law"):
        diag.plot_learned()
