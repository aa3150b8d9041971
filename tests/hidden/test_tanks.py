"""The twin of the Cascaded Tanks: its plant, and what a diagnosis makes of it."""

import numpy as np
import pytest

import diffthrust as dft

from . import tanks

TWIN = 2


@pytest.mark.thorough
def test_the_model_with_overflow_is_the_plant():
    rng = np.random.default_rng(0)
    log = tanks.record(rng, 300, tanks.RIM, "one")
    quiet = tanks.levels(log.inputs["voltage"], np.zeros(300), tanks.RIM)
    spilling = tanks.UpperOverflow(rate=tanks.SPILL, rim=tanks.RIM, caught=tanks.CAUGHT)
    for effects, least, most in (([spilling], 0.0, 0.01), ([], 0.2, 5.0)):
        model = tanks.TwoTanks(**tanks.TRUE) + effects
        lower = dft.simulate(model, log)["lower"]
        assert least <= np.std(lower - quiet[:, 1]) / np.std(quiet[:, 1]) <= most


@pytest.mark.slow
def test_the_overflow_is_found_and_its_lack_is_told():
    drawn = tanks.drawn(TWIN)
    whole = dft.fit(drawn.model + tanks.UpperOverflow(), drawn.train, holdout=drawn.unseen)
    options = {"holdout": drawn.unseen, "experiment": False}
    named = dft.diagnose(
        drawn.model, drawn.train, candidates=["all", tanks.UpperOverflow()], **options
    )
    assert "upper_overflow" in named.added
    assert named.stages[-1].holdout.nrmse <= 1.05 * whole.holdout.nrmse
    assert named.stages[0].holdout.nrmse > 2.0 * whole.holdout.nrmse
    unnamed = dft.diagnose(drawn.model, drawn.train, **options)
    assert unnamed.verdict in ("unexplained", "undecided")


@pytest.mark.slow
def test_without_overflow_nothing_is_found():
    drawn = tanks.drawn(TWIN, overflow=False)
    found = dft.diagnose(
        drawn.model,
        drawn.train,
        holdout=drawn.unseen,
        candidates=["all", tanks.UpperOverflow()],
        experiment=False,
    )
    assert not found.added
