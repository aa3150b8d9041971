"""Parameters that run away are named, with a mend; those that were merely guessed badly are not."""

import numpy as np
import pytest

import diffthrust as dft

pytestmark = pytest.mark.filterwarnings("ignore::diffthrust.simulation.CoarseStepWarning")


class Follower(dft.Model):
    """A level that follows its input at a rate; a user's own class."""

    name = "follower"
    inputs = {"target": "m"}
    states = {"level": "m"}
    outputs = {"level": "m"}
    rate: float = dft.parameter(1.0, "1/s", bounds=(0, None))

    def equations(self, s, port):
        return {"level": self.rate * (s.target - s.level)}, {"level": s.level}


def followed(rate):
    """A log at 2 Hz of levels that follow within a second or at once."""
    rng = np.random.default_rng(5)
    target = np.repeat(rng.uniform(-1, 1, 30), 5)
    level, keep = np.zeros(150), np.exp(-0.5 * rate)
    for k in range(149):
        level[k + 1] = target[k] + keep * (level[k] - target[k])
    noisy = level + 0.05 * rng.standard_normal(150)
    return dft.Log(0.5 * np.arange(150), {"target": target}, {"level": noisy})


def test_a_parameter_that_runs_away_is_named_with_a_mend():
    fit = dft.fit(Follower(rate=0.2), followed(rate=200.0), starts=1, doubts=False)
    assert fit.parameters["rate"].value > 5.0
    notes = [note for note in fit.notes if note.startswith("rate runs away: from 0.2000 to ")]
    assert len(notes) == 1
    assert 'model.replace({"rate": ...}).fix("rate")' in notes[0]
    assert "give it an upper bound" in notes[0]
    assert notes[0] in " ".join(fit.report().split())
    coarse = [note for note in fit.notes if "integrator steps per sample, but" in note]
    assert all("Fit with substeps=" in note for note in coarse)


@pytest.mark.parametrize("guess", [1.0, 0.02])
def test_a_parameter_that_the_logs_bound_is_not(guess):
    fit = dft.fit(Follower(rate=guess), followed(rate=0.8), starts=1, doubts=False)
    assert fit.parameters["rate"].value == pytest.approx(0.8, rel=0.1)
    assert not any("runs away" in note for note in fit.notes)
