"""What a mend of the logs is worth: told of fits that several starts reach, or not at all."""

from dataclasses import replace
from types import SimpleNamespace

import made_diagnosis as made
import numpy as np
import pytest
from steps import FitRuns, FittedStage, MeasuredMend, Worth, mend_trials_module, mends_lead

import diffthrust as dft

RNG = np.random.default_rng(0)
MEASURED, ERROR = RNG.standard_normal(600), RNG.standard_normal(600)
READINGS = tuple(dft.soundness.Reading(words, "") for words in ("turned", "exchanged"))
DOUBT = dft.soundness.Doubt("thrust", "sign", "It is odd.", "look", READINGS)


def ended(size, agreeing, starts=4):
    """A fit with errors of this size, in which so many of its starts ended."""
    checks = SimpleNamespace(starts=starts, starts_agreeing=agreeing)
    trace = SimpleNamespace(measured=MEASURED, residual=size * ERROR)
    run = SimpleNamespace(channels={"thrust": trace})
    errors = SimpleNamespace(nrmse=size, channels={"thrust": SimpleNamespace(rmse=size)})
    parameters = {"ct": SimpleNamespace(value=size, fixed=False)}
    fit = SimpleNamespace(
        checks=checks, doubts=(DOUBT,), train=errors, model=None, parameters=parameters
    )
    return FitRuns(fit, (run,), (run,))


@pytest.fixture
def measured(monkeypatch):
    """What is told of the mends of a fit, and the guesses and records of each further fit."""

    def of(first, *further):
        fits, asked = list(further), []

        def refit(model, guesses, starts, segments, records=None):
            asked.append((list(guesses), records is not None))
            return fits.pop(0)

        for name, work in (("bind", lambda model, logs: tuple(logs)),
                           ("pooled_errors", lambda runs: SimpleNamespace(nrmse=np.std(
                               [run.channels["thrust"].residual for run in runs])))):  # fmt: skip
            monkeypatch.setattr(mend_trials_module, name, work)
        given = SimpleNamespace(inputs=("command",), optional_inputs=())
        context = SimpleNamespace(
            given=given, records=(), unseen=(), guess={"ct": 1.0},
            refit=refit, say=lambda *_: None,
        )  # fmt: skip
        return mend_trials_module.measured_mends(context, FittedStage((), *first)), asked

    return of


def test_each_reading_is_fitted_from_where_the_others_ended(measured):
    mends, asked = measured(ended(1.0, 3), ended(0.5, 2), ended(0.4, 2))
    assert [mend.reading.words for mend in mends] == ["turned", "exchanged"]
    assert [mend.worth.share for mend in mends] == pytest.approx([0.75, 0.84])
    assert asked == [([{"ct": 1.0}], True), ([{"ct": 1.0}, {"ct": 0.5}], True)]


def test_what_more_starts_do_to_the_logs_as_they_are_is_no_merit_of_a_mend(measured):
    """A BlueBoat's own fit had ended in 0.95, where several starts reach 0.85."""
    mends, asked = measured(ended(1.0, 1, 1), ended(0.5, 2), ended(0.5, 2), ended(0.6, 2))
    assert [mend.before.nrmse for mend in mends] == pytest.approx([0.6 * ERROR.std()] * 2)
    assert [mended for _, mended in asked] == [True, True, False]
    # they begin where the fits to mended logs ended, too
    assert asked[-1][0] == [{"ct": 1.0}, {"ct": 0.5}, {"ct": 0.5}]


def test_logs_that_no_two_starts_fit_alike_have_mends_that_are_told(measured):
    mends, _ = measured(ended(1.0, 1), ended(0.5, 2), ended(0.4, 2), ended(1.0, 1))
    assert [mend.worth.share for mend in mends] == pytest.approx([0.75, 0.84])


def test_nothing_is_told_of_a_reading_whose_fits_do_not_agree(measured):
    mends, asked = measured(ended(1.0, 3), ended(0.5, 1), ended(0.4, 1))
    assert mends == ()
    assert len(asked) == 2  # the logs as they are are not fitted for nothing


@pytest.mark.parametrize(
    ("judged", "share", "low", "failing", "leads"),
    [
        (("turned",), 0.5, 0.4, False, True),
        (("turned",), 0.05, 0.04, False, False),
        (("turned",), 0.05, 0.04, True, True),  # its other reading may be the true one
        (("turned", "exchanged"), 0.05, 0.04, True, False),
        (("turned", "exchanged"), 0.5, -0.3, True, True),
        (("turned", "exchanged"), 0.5, -0.3, False, False),
        ((), 0.0, 0.0, True, True),
        ((), 0.0, 0.0, False, False),
    ],
)
def test_mends_lead_where_one_helps_or_the_model_fails(judged, share, low, failing, leads):
    errors = made.found().judged.errors
    worth = Worth(share, low, 1.2 * share)
    mends = [
        MeasuredMend(DOUBT, reading, errors, errors, worth, True)
        for reading in READINGS
        if reading.words in judged
    ]
    assert mends_lead([DOUBT], mends, failing) is leads
    assert not mends_lead([replace(DOUBT, kind="stuck")], [], True)


def test_the_other_reading_of_its_doubt_is_told(measured):
    """Of a BlueBoat with free masses an exchange ended apart; a turned yaw rate removed 60 %."""
    mends, _ = measured(ended(1.0, 3), ended(0.5, 2), ended(0.4, 1))
    assert [mend.reading.words for mend in mends] == ["turned"]
