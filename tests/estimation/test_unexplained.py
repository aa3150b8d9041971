"""A fit that explains next to nothing says what to look at: a constant force."""

import numpy as np
import pytest
from problems import unexplained_module

import diffthrust as dft

MASS, DRAG, BUOYANCY = 26.0, 60.0, 60.0


def dive(seed, buoyancy):
    """A vehicle that goes to drawn depths; the thrust holds against the buoyancy."""
    rng = np.random.default_rng(seed)
    count, step = 600, 0.1
    wanted = np.repeat(rng.uniform(0.5, 3.0, 12), 50)
    depth, speed, thrust = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(count):
        push = 40.0 * (wanted[k] - depth[k]) - 60.0 * speed[k] + buoyancy
        thrust[k] = np.clip(push, -150.0, 150.0)
        if k < count - 1:
            water = DRAG * speed[k] * abs(speed[k])
            speed[k + 1] = speed[k] + step * (thrust[k] - buoyancy - water) / MASS
            depth[k + 1] = depth[k] + step * speed[k]
    noisy = speed + 0.01 * rng.standard_normal(count)
    return dft.Log(step * np.arange(count), {"thrust": thrust}, {"velocity": noisy})


@pytest.mark.thorough
def test_a_thrust_that_holds_against_a_constant_is_hinted_at_with_a_mend():
    log = dive(1, BUOYANCY)
    fit = dft.fit(dft.AxisVehicle(), log, starts=1)
    assert fit.train.nrmse > 0.8
    (doubt,) = [doubt for doubt in fit.doubts if doubt.kind == "silent"]
    assert "N on average, and velocity none: something constant (buoyancy" in doubt.mend
    mend = 'model + "buoyancy"'
    assert mend in doubt.mend
    mended = dft.fit(eval(mend, {"dft": dft, "model": dft.AxisVehicle()}), log, starts=1)
    assert mended.train.nrmse < 0.1
    assert mended.parameters["buoyancy.excess"].value == pytest.approx(-BUOYANCY, abs=1.0)


def test_one_that_pushes_where_the_vehicle_goes_is_not():
    log = dive(1, 0.0)
    steady = 40.0 + np.abs(log.inputs["thrust"])
    speed = np.sqrt(steady / DRAG) + 0.05 * np.random.default_rng(2).standard_normal(log.time.size)
    other = dft.Log(log.time, {"thrust": steady[::-1].copy()}, {"velocity": speed})
    fit = dft.fit(dft.AxisVehicle(), other, starts=1)
    assert any(doubt.kind == "silent" for doubt in fit.doubts)
    assert not any("something constant" in doubt.mend for doubt in fit.doubts)


def test_nothing_is_doubted_before_somebody_looks(monkeypatch):
    """Doubts take longer than a small fit, and most fits are asked for their numbers alone."""
    looked = []
    look = lambda logs, model: looked.append(logs) or ()  # noqa: E731
    monkeypatch.setattr(unexplained_module, "doubts_of", look)
    log, model = dive(1, 0.0), dft.AxisVehicle()
    fit = dft.fit(model, log, starts=1)
    assert not looked
    assert fit.doubts == ()
    assert looked == [(log,)]
    assert dft.fit(model, log, starts=1, doubts=False).doubts == ()
    assert len(looked) == 1
