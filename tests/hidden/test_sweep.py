"""The sweep: comparisons note where they turn; settings are replaced everywhere and put back."""

import operator

import numpy as np
import pytest

from diffthrust.diagnosis import _explained_share  # private: a file that decides by settings
from diffthrust.diagnosis._settings import SETTINGS  # private: what is swept

from . import sweep
from .sweep_watch import Watched, changed, named, using, watching

COMPARISONS = (operator.lt, operator.le, operator.gt, operator.ge)


@pytest.mark.parametrize("compare", COMPARISONS)
@pytest.mark.parametrize("kind", [float, np.float64])
@pytest.mark.parametrize(("slope", "offset"), [(1.0, 0.0), (-2.0, 3.0), (0.5, -1.0)])
def test_a_comparison_comes_out_as_with_a_number_and_turns_where_it_notes(
    compare, kind, slope, offset
):
    for other in map(kind, (-4.0, 0.3, 7.0)):
        noted = []
        threshold = Watched(2.0, noted.append) * slope + offset
        assert compare(other, threshold) == compare(other, slope * 2.0 + offset)
        (turn,) = noted
        outcomes = {bool(compare(other, slope * (turn + step) + offset)) for step in (-1e-6, 1e-6)}
        assert outcomes == {True, False}


def test_arithmetic_of_a_watched_setting_is_that_of_the_number():
    watched = Watched(2.0, lambda turn: None)
    assert (-watched, watched / 4.0, 1.0 - watched, 3.0 + watched) == (-2.0, 0.5, -1.0, 5.0)
    assert watched - 0.5 == 1.5
    assert max(watched, 1.0) == 2.0


def test_settings_are_replaced_in_every_file_and_put_back():
    worth = _explained_share.Worth(0.02, 0.01, 0.03)
    assert not worth.sure
    with using(changed(whole_runs__negligible_share=0.015)):
        assert worth.sure
    assert not worth.sure
    assert named(SETTINGS)["whole_runs.negligible_share"] == 0.03


def test_the_decisions_of_a_share_are_noted():
    with watching() as decisions:
        assert _explained_share.Worth(0.04, 0.01, 0.05).sure
        assert not _explained_share.Worth(0.02, 0.01, 0.05).sure
        assert _explained_share.Worth(0.5, 0.4, 0.6).sure
    (below, above) = decisions["whole_runs.negligible_share"]
    assert below == [pytest.approx(0.02), "sure"]
    assert above == [pytest.approx(0.04), "sure"]


def row(kind, decisions, **diagnosis):
    return {"kind": kind, "seed": 1, "decisions": decisions, "diagnosis": diagnosis}


def test_the_nearest_set_bounds_the_range_on_either_side():
    name = "admission.least_bic_gain"
    rows = [
        row("a", {name: [[3.0, "admit"], [9.0, "drop"]]}),
        row("b", {name: [[1.0, "admit"], None]}),
        row("c", {}),
    ]
    (found,) = sweep.swept(rows).values()
    assert found["value"] == 4.0
    assert (found["below"]["value"], found["below"]["kind"]) == (3.0, "a")
    assert (found["above"]["value"], found["above"]["where"]) == (9.0, "drop")
    assert [turn.kind for turn in sweep.turns(rows, name, "below")] == ["a", "b"]
    assert sweep.past(4.0, sweep.turns(rows, name, "below")[0]) < 3.0


def test_an_answer_is_what_is_said_and_not_its_numbers():
    before = sweep.answer({"verdict": "adequate", "added": [], "worth": {"drag": 0.1}})
    after = sweep.answer({"verdict": "effects_found", "added": ["drag"], "worth": {}})
    assert not sweep.difference(before, sweep.answer({"verdict": "adequate", "added": []}))
    assert sweep.difference(before, after) == (
        "verdict adequate becomes effects_found; added nothing becomes drag"
    )
