"""A sensor that fails with a spike and is then lost: the trials must still begin."""

import math

import numpy as np
import pytest
from short_logs import made_log

import diffthrust as dft
from diffthrust.diagnosis._innovations_fit import (
    CandidateFitter,  # private: the beginning of a diagnosis
)


@pytest.mark.parametrize("spike", [1e3, 1e6])
def test_corrections_that_run_away_do_not_stop_a_diagnosis(spike):
    log = made_log(seed=0, count=800)
    speed = log.measured["speed"].copy()
    speed[300], speed[301:380] = spike, np.nan
    log = dft.Log(log.time, log.inputs, {**log.measured, "speed": speed})
    fit = dft.fit(dft.Thruster(), log, loss="student_t", doubts=False)
    assert fit.status.ok
    begun = CandidateFitter(fit.model, [], [log], []).base()
    assert math.isfinite(begun.cost)
    for name in ("alpha", "beta", "ct"):  # and the spike did not take it anywhere
        assert begun.values[name] == pytest.approx(fit.parameters[name].value, rel=0.02)
