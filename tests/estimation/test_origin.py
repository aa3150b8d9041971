"""The last lines of a report: when, with what and of which logs, and the model to copy."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import short_logs as short
from problems import Origin, origin_of

import diffthrust as dft

VERSIONS = {"diffthrust": "1.2.3", "jax": "0.10.2", "numpy": "2.4.6"}


def log(seed=0):
    return short.made_log(seed, name=f"run{seed}.csv")


def origin(train, holdout=(), spec=None):
    created = "2026-11-22T16:05:00+00:00"
    return Origin(
        created, VERSIONS, *(tuple(x.identity for x in y) for y in (train, holdout)), spec
    )


def test_the_sentences_name_date_versions_and_hashes():
    a, b = log(0), log(1)
    made, told = origin([a], [b], "abcdef0123456789").sentences
    assert made == "Made 2026-11-22 16:05 UTC by diffthrust 1.2.3 (jax 0.10.2, numpy 2.4.6)."
    assert told == (
        f"Logs: run0.csv {a.sha256[:8]}; unseen: run1.csv {b.sha256[:8]}. Spec abcdef01."
    )
    assert origin([a] * 9).sentences[1].endswith("and 3 more.")
    assert len(origin([]).sentences) == 1


def test_a_result_is_made_now():
    told = origin_of([log()])
    age = datetime.now(UTC) - datetime.fromisoformat(told.created)
    assert timedelta(0) <= age < timedelta(minutes=5)
    assert told.library["numpy"] == np.__version__
    assert told.library["diffthrust"] == dft.__version__


@pytest.mark.thorough
def test_reports_end_with_where_they_come_from():
    a, b = log(0), log(1)
    fit = dft.fit(short.MODEL + "actuator_lag", a, holdout=b, starts=1)
    assert fit.data == (a.identity,)
    lines = fit.report().splitlines()[-3:]
    assert lines == [*fit.origin.sentences, 'effects = ["actuator_lag"]']
    seen = dft.compare(fit, [a]).report().splitlines()[-1]
    assert seen == f"The fit was made of run0.csv {a.sha256[:8]}: these logs took part in it."
    unseen = dft.compare(fit, b).report().splitlines()[-1]
    assert unseen.endswith(": none of these logs took part in it.")
    both = dft.compare(fit, [a, b])
    assert both.closing[-1].endswith(": run0.csv took part in it.")
    assert re.match("Made .* by diffthrust", both.closing[0])
    assert "The fit was made" not in dft.compare(short.MODEL, a).report()


@pytest.mark.thorough
def test_a_diagnosis_tells_that_a_fit_is_of_other_logs():
    a, b = log(0), log(1)
    fit = short.fitted(a)
    options = {"candidates": ["actuator_lag"], "experiment": False}
    other = dft.diagnose(fit, b, **options)
    assert other.notes == (
        "The fit that was given is of other logs: its model was fitted anew to these.",
    )
    assert other.notes[0] in " ".join(other.report().split())
    same = dft.diagnose(fit, a, **options)
    assert same.notes == ()
    assert same.origin.train == fit.origin.train
    code = same.report()[same.report().index("model = dft.Thruster()") :]
    exec(code, scope := {"dft": dft})
    copied, error = (dft.compare(m, a).errors.nrmse for m in (scope["model"], same.fit))
    assert copied == pytest.approx(error, rel=1e-6)


@pytest.mark.thorough
def test_a_diagnosis_tells_that_it_does_not_begin_with_a_fit_that_failed():
    a = log(0)
    fit = short.fitted(a)
    lost = replace(fit.train, nrmse=float("nan"))
    failed = replace(fit, status=dft.estimation.Status.SIMULATION_FAILED, train=lost)
    diag = dft.diagnose(failed, a, candidates=["actuator_lag"], experiment=False)
    (note,) = diag.notes
    assert note.startswith("The fit that was given had failed")
    assert note.endswith("what is called as given here is that fit (converged).")
    assert np.isfinite(diag.stages[0].train.nrmse)
