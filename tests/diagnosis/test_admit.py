"""Whether an effect fills a stage: made-up fits of a model whose output is a constant."""

from types import SimpleNamespace

import numpy as np
import pytest

from diffthrust.diagnosis import _admission  # private: one step alone
from diffthrust.diagnosis._explained_share import Worth  # private: made by hand
from diffthrust.diagnosis._findings import Stage  # private: made by hand
from diffthrust.diagnosis._search_state import SearchState  # private: one step alone

RNG = np.random.default_rng(0)
MEASURED, REST = RNG.standard_normal(600), RNG.standard_normal(600)


@pytest.fixture
def recorded(monkeypatch):
    """What a search knows after an effect by which errors over whole runs shrink to so much."""

    def runs_over(size, logs, initial, substeps):
        trace = SimpleNamespace(measured=MEASURED, residual=size * REST)
        return [SimpleNamespace(channels={"speed": trace}) for _ in logs]

    monkeypatch.setattr(_admission, "runs_over", runs_over)

    def after(left, effects=("lag", "wind"), unseen=("C",), held=()):
        def stage(size, *names):
            error = SimpleNamespace(nrmse=size)
            known = {"initial": None, "substeps": 1, "train": error, "holdout": error}
            return Stage(names, SimpleNamespace(model=size, **known))

        trials = SimpleNamespace(logs=("A", "B"), constants=held)
        tools = SimpleNamespace(fitter=trials, unseen=unseen)
        known = SearchState(None, (stage(2.0), stage(1.0, "lag")), {})
        return _admission.record_stage(tools, known, stage(left, *effects), "wind")

    return after


@pytest.mark.parametrize("unseen", [("C",), ()])
def test_what_matters_fills_a_stage(recorded, unseen):
    known = recorded(0.5, unseen=unseen)
    assert [stage.effects for stage in known.stages] == [(), ("lag",), ("lag", "wind")]
    assert known.worth["wind"].share == pytest.approx(0.75 / 4)  # the lag left a quarter
    assert known.detectable == ()


def test_what_changes_nothing_is_detectable_and_fills_none(recorded):
    known = recorded(0.995)
    assert [stage.effects for stage in known.stages] == [(), ("lag",)]
    assert known.detectable == ("wind",)
    assert known.worth["wind"].share == pytest.approx(0.01 / 4, abs=0.0003)
    assert known.accepted == (1, ("wind",))  # the search goes on from there


def test_a_constant_fills_a_stage_whatever_it_changes(recorded):
    assert recorded(0.995, held=("wind",)).stages[-1].effects == ("lag", "wind")


def test_what_takes_the_place_of_another_effect_is_worth_what_both_are(recorded):
    known = recorded(0.995, effects=("wind",))
    assert known.stages[-1].effects == ("wind",)
    assert known.worth["wind"].share == pytest.approx(1 - (0.995 / 2.0) ** 2)


def test_worths_are_shares_of_one_whole():
    """What halves an error that is a tenth of the first removes 0.75 of a hundredth."""
    assert Worth(0.75, 0.5, 0.9).of(0.01).to_json() == {
        "share": pytest.approx(0.0075),
        "interval": [pytest.approx(0.005), pytest.approx(0.009)],
    }
