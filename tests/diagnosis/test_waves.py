"""Waves along a position: found in white errors only where there are any, and learned as a law."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import diffthrust as dft
from diffthrust.diagnosis import _residual_structure  # private: what no result shows


def trial_of(position, errors):
    """What a trial over one log of one channel shows of its waves."""
    one = SimpleNamespace(path={"position": position}, errors=errors[None])
    return SimpleNamespace(passed=[one], quadratic=SimpleNamespace(sigma=[1.0]))


def position_of(rng):
    return np.cumsum(0.3 * rng.standard_normal(1500)) + 0.05 * np.arange(1500)


def test_a_wave_in_noise_is_found_where_it_is():
    rng = np.random.default_rng(3)
    x = position_of(rng)
    errors = rng.standard_normal(1500)
    errors[1:] += 0.5 * np.sin(2.7 * x[:-1] + 0.6)
    wave = _residual_structure.wave_along(trial_of(x, errors), "position")
    span = np.ptp(x)
    assert wave.number == pytest.approx(2.7, abs=0.5 / span)
    middle = 0.5 * (x.min() + x.max())  # there the phase is told best
    off = (wave.number - 2.7) * middle + wave.phase - 0.6
    assert abs((off + np.pi) % (2 * np.pi) - np.pi) < 0.3
    assert wave.length == pytest.approx(2 * np.pi / wave.number)


def test_white_errors_have_no_waves():
    # one in e^10 is the share of false alarms
    rng = np.random.default_rng(4)
    for _ in range(100):
        trial = trial_of(position_of(rng), rng.standard_normal(1500))
        assert _residual_structure.wave_along(trial, "position") is None


def test_what_does_not_move_has_no_waves():
    assert _residual_structure.wave_along(trial_of(np.ones(50), np.ones(50)), "position") is None


class Screw(dft.Model):
    """A carriage on a screw, with viscous friction."""

    name = "screw"
    inputs = {"force": "N"}
    states = {"position": "m", "velocity": "m/s"}
    outputs = states
    ports = {"friction": "force against the motion [N]"}
    mass: float = dft.parameter(8.0, "kg", bounds=(0, None))
    viscous: float = dft.parameter(60.0, "N s/m", bounds=(0, None))

    def equations(self, s, port):
        friction = port("friction", self.viscous * s.velocity)
        seen = {"position": s.position, "velocity": s.velocity}
        return {"position": s.velocity, "velocity": (s.force - friction) / self.mass}, seen


def run_of(seed):
    """A record by SciPy: 10 kg, 50 N s/m, and 2 N that come again every 20 mm of the screw."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 12.0, 0.01)
    phases = rng.uniform(0.0, 2 * np.pi, 3)

    def force(t):
        return sum(6.0 * np.sin((0.9 + 0.7 * k) * t + p) for k, p in enumerate(phases))

    def rates(t, state):
        x, v = state
        return v, (force(t) - 50.0 * v - 2.0 * np.sin(2 * np.pi * x / 0.02)) / 10.0

    ran = solve_ivp(rates, (0.0, time[-1]), (0.0, 0.0), "DOP853", time, rtol=1e-9, atol=1e-11)
    x, v = ran.y
    measured = {
        "position": x + 1e-4 * rng.standard_normal(time.size),
        "velocity": v + 1e-3 * rng.standard_normal(time.size),
    }
    return dft.Log(time, {"force": force(time)}, measured, name=f"screw {seed}")


def test_a_ripple_of_a_screw_is_learned_by_its_pitch():
    train, unseen = run_of(1), run_of(2)
    diag = dft.diagnose(Screw(), train, holdout=unseen, candidates=[], experiment=False)
    assert diag.verdict == "unexplained"
    assert diag.remaining.signal.name == "position"
    assert diag.remaining.signal.wave == pytest.approx(0.02, rel=0.01)
    (law,) = diag.laws
    assert law.curve.port == "friction"
    assert law.signals == ("sin(wave_number * position + phase)",)
    assert 2 * np.pi / law.told.parameters["curve_form.wave_number"].value == pytest.approx(
        0.02, rel=2e-3
    )
    assert abs(law.told.parameters["curve_form.a"].value) == pytest.approx(2.0, rel=0.05)
    assert law.told.holdout.nrmse < 0.2 * diag.stages[0].holdout.nrmse
    assert "waves of position, 0.020 m long" in diag.summary
    assert "model = Screw() + dft.effects.Formula(" in diag.report()
