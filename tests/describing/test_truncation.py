"""What a harmonic balance leaves out: points that need more harmonics are marked, others not."""

from __future__ import annotations

import json

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import effects
from diffthrust.describing import Reason, describing_function
from diffthrust.describing._describe import periodic_values  # private: shows marked points, too
from diffthrust.describing._periodic.harmonic_balance import (  # private: promises
    GAIN_ERROR,
    PHASE_ERROR,
)
from diffthrust.describing._request import request  # private: what periodic_values takes

A, W = np.geomspace(0.05, 10.0, 6), np.geomspace(0.1, 30.0, 6)
DEADBAND = dft.Thruster() + effects.CommandDeadband(half_width=0.3)
SATURATED = dft.Thruster() + effects.CommandSaturation(limit=2.0)
RUBBING = dft.Thruster() + effects.CoulombFriction(level=20.0)


def balanced(
    model: dft.Model, harmonics: int, output: str = "thrust"
) -> tuple[np.ndarray, np.ndarray]:
    """First harmonics, those of marked points too, and the reasons."""
    asked = request(
        model, A, W, input="command", output=output, method="harmonic_balance",
        harmonics=harmonics, samples=None, bias=0.0, others=None, sensors=False,
    )  # fmt: skip
    values = {name: np.array([p.value]) for name, p in model.parameters.items()}
    found, _ = periodic_values(asked, values)
    return found.first.reshape(6, 6), found.reason.reshape(6, 6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "enough"),
    [
        (DEADBAND, 31),
        (SATURATED, 31),
        (RUBBING, 63),
    ],
    ids=str,
)
def test_few_harmonics_are_marked_where_they_differ_from_simulation(model, enough):
    """Errors with 3: 1 %, 0.6 %, 8 %; with enough: below 5e-5, 2e-5, 3e-4."""
    exact = describing_function(model, A, W, samples=8192).complex
    moves = np.abs(exact) > 0
    for harmonics in (3, enough):
        first, reason = balanced(model, harmonics)
        ratio = first[moves] / exact[moves]
        wrong = (np.abs(np.abs(ratio) - 1) > GAIN_ERROR) | (
            np.abs(np.angle(ratio, deg=True)) > PHASE_ERROR
        )
        marked = (reason == Reason.FEW_HARMONICS)[moves]
        print(f"{model}, {harmonics}: {np.abs(ratio - 1).max():.1e}, {marked.sum()} marked")
        assert not np.any(wrong & ~marked)
        assert np.all(np.isin(reason, (Reason.SETTLED, Reason.FEW_HARMONICS)))
        if harmonics == enough:
            assert not marked.any()
        else:
            assert wrong.sum() > 10
            assert np.sum(marked & ~wrong) <= 3  # close to the border


@pytest.mark.thorough
def test_the_consistent_formula_is_harmonic_balance_with_one_harmonic():
    """One is too few for the map, but the one that it finds is that of the closed form."""
    for output in ("thrust", "speed"):
        formula = describing_function(dft.Thruster(), A, W, output=output, method="consistent")
        first, reason = balanced(dft.Thruster(), 1, output)
        np.testing.assert_allclose(first, formula.complex, rtol=2e-4)
        assert np.any(reason == Reason.FEW_HARMONICS)


@pytest.mark.slow
def test_smooth_models_are_not_marked():
    for model in (dft.Thruster(), dft.Thruster() + effects.LinearDamping(rate=1.0)):
        found = describing_function(model, A, W, method="harmonic_balance")
        assert found.settled.all()
        assert found.left_out is not None
        assert np.abs(found.left_out).max() < 5e-4


def test_a_moment_between_the_instants_of_the_balance_is_felt():
    """Static friction catches a slow shaft for a thousandth of the period."""
    model, at = dft.Thruster() + effects.StaticFriction(), ([0.144], [0.1])
    found = describing_function(model, *at, method="harmonic_balance")
    assert found.reason[0, 0] == Reason.FEW_HARMONICS


@pytest.mark.thorough
def test_marks_are_told_with_their_mend():
    found = describing_function(DEADBAND, A, W, method="harmonic_balance", harmonics=3)
    marked = found.reason == Reason.FEW_HARMONICS
    assert np.all(np.isnan(found.gain[marked]))
    assert found.left_out is not None
    assert np.all(np.isfinite(found.left_out))
    text = " ".join(found.report().split())
    assert f"{marked.sum()} of 36 points are marked: more harmonics would change" in text
    assert 'give harmonics=15, or method="simulation"' in text
    data = json.loads(json.dumps(found.to_json(), allow_nan=False))
    gain = np.array(data["left_out"]["gain"])
    np.testing.assert_allclose(gain, np.abs(np.real(found.left_out)))
    plain = describing_function(DEADBAND, [1.0], [1.0], samples=512)
    assert plain.left_out is None
    assert plain.to_json()["left_out"] is None
