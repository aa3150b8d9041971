"""Doubts as words of a fit: of training logs, and of the unseen ones."""

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
