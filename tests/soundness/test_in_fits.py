"""Doubts as words of a fit: of training logs, and of the unseen ones."""

import numpy as np
import pytest
from short_logs import made_log

import diffthrust as dft


def test_an_unseen_log_is_looked_at_too():
    train, unseen = made_log(seed=0, count=800), made_log(seed=1, count=800)
    thrust = {**unseen.measured, "thrust": -unseen.measured["thrust"]}
    odd = unseen.replaced(measured=thrust, name="odd.csv")
    sound = dft.fit(dft.Thruster(), train, holdout=unseen, starts=2)
    assert sound.doubts == ()
    fit = dft.fit(dft.Thruster(), train, holdout=odd, starts=2)
    assert any(d.channel == "thrust" and "odd.csv" in d.evidence for d in fit.doubts)
    assert "odd.csv" in fit.report().split("Status:")[0]


class Turning(dft.Model):
    """A body that turns as it is told to."""

    name = "turning"
    inputs = {"rate": "rad/s"}
    states = {"yaw": "rad"}
    outputs = {"yaw": "rad"}
    ports = {"turn": "rate of the yaw [rad/s]"}
    gain: float = dft.parameter(1.0, "", bounds=(0.1, 10.0))

    def equations(self, s, port):
        """A rate."""
        return {"yaw": port("turn", self.gain * s.rate)}, {"yaw": s.yaw}


class TurningRound(Turning):
    """The same, whose yaw comes round."""

    name = "turning_round"
    angles = ("yaw",)


@pytest.mark.thorough
def test_a_yaw_that_jumps_asks_for_angles_in_the_class():
    time = np.arange(0.0, 60.0, 0.1)
    rate = 0.5 + 0.4 * np.sin(0.3 * time)
    yaw = 0.1 * np.cumsum(1.05 * rate) + 0.01 * np.random.default_rng(0).standard_normal(time.size)
    log = dft.Log(time, {"rate": rate}, {"yaw": np.degrees((yaw + np.pi) % (2 * np.pi) - np.pi)},
                  units={"yaw": "deg"})  # fmt: skip
    doubted = dft.fit(Turning(), log, starts=1).doubts
    assert doubted[0].channel == "yaw"
    assert "360 degrees" in doubted[0].evidence
    assert "angles = ('yaw',)" in doubted[0].mend
    assert not any("sign, unit and column" in doubt.mend for doubt in doubted)
    mended = dft.fit(TurningRound(), log, starts=1)
    assert mended.doubts == ()
    assert mended.parameters["gain"].value == pytest.approx(1.05, rel=0.01)
