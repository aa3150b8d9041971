"""Parameters that run away are named, with a mend; those that were merely guessed badly are not."""

from dataclasses import replace

import numpy as np
import pytest
from problems import farthest_runaway

import diffthrust as dft
from diffthrust.estimation._unexplained import with_runaways  # private: beside a doubt of one's own
from diffthrust.soundness import Doubt

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


@pytest.mark.thorough
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


class Body(dft.Model):
    """A mass that its input pushes against a drag; a user's own class."""

    name = "body"
    inputs = {"push": "N"}
    states = {"speed": "m/s"}
    outputs = {"speed": "m/s"}
    weighed: float = dft.parameter(1.0, "kg", bounds=(0, None))
    drag: float = dft.parameter(1.0, "N s/m", bounds=(0, None))

    def equations(self, s, port):
        return {"speed": (s.push - self.drag * s.speed) / self.weighed}, {"speed": s.speed}


@pytest.mark.parametrize(("begun", "said"), [(31.0, True), (250.0, False)])
def test_a_mass_far_beyond_what_was_given_is_pointed_out(begun, said):
    rng = np.random.default_rng(3)
    push = np.repeat(rng.uniform(-100, 100, 40), 10)
    log = dft.Log(0.5 * np.arange(400), {"push": push})
    speed = dft.simulate(Body(weighed=600.0, drag=30.0), log)["speed"]
    measured = {"speed": speed + 0.01 * rng.standard_normal(400)}
    log = dft.Log(log.time, {"push": push}, measured)
    fit = dft.fit(Body(weighed=begun, drag=20.0), log, starts=1)
    assert fit.parameters["weighed"].value == pytest.approx(600.0, rel=0.05)
    notes = [note for note in fit.notes if note.startswith("weighed ended at 19 times where")]
    assert bool(notes) == said
    assert all('.fix("weighed")' in note for note in notes)


def test_a_logarithm_that_ended_where_numbers_do_has_run_away():
    """The inertia of a BlueBoat ended at 2e15 kg m^2: no bound of its own, and yet "at bound"."""
    fit = dft.fit(Follower(rate=1.0), followed(rate=0.8), starts=1, doubts=False)
    far = replace(fit.parameters["rate"], value=1.0 * np.exp(35.0), at_bound=True)
    for bounds, ran in (((0, None), True), ((0, far.value), False)):
        model = Follower(rate={"value": 1.0, "bounds": bounds})
        ended = replace(fit, model=model, parameters={"rate": far})
        assert (farthest_runaway(ended, {"rate": 1.0}) is not None) == ran


@pytest.mark.thorough
def test_a_parameter_at_a_thousand_times_its_start_is_doubted_however_well_it_fits():
    """Readings in mm that were declared in m: the gain takes the factor on, and all converges."""

    class Scaled(Follower):
        """A level in other units than its target."""

        name = "scaled"
        gain: float = dft.parameter(1.0, "", bounds=(0, None))

        def equations(self, s, port):
            return {"level": self.rate * (self.gain * s.target - s.level)}, {"level": s.level}

    log = followed(rate=0.8)
    millimetres = dft.Log(log.time, log.inputs, {"level": 1500.0 * log.measured["level"]})
    fit = dft.fit(Scaled(), millimetres, starts=1)
    assert fit.parameters["gain"].value == pytest.approx(1500.0, rel=0.05)
    (doubt,) = fit.doubts
    assert (doubt.channel, doubt.kind) == ("gain", "runaway")
    assert "it began at 1.000 and ended at 14" in doubt.evidence
    assert "units and scales of the channels" in doubt.mend
    assert "But gain ran very far from the first guess: look at the doubts." in fit.message
    begun = eval(doubt.mend.split("begin there: ")[1].rstrip("."), {"model": Scaled()})
    assert dft.fit(begun, millimetres, starts=1).doubts == ()
    turned = Doubt("target", "sign", "run: target is turned round.", 'read it with "scale = -1".')
    beside = with_runaways(
        replace(fit, doubts=(turned,)), dft.compare(fit, millimetres).runs, doubts=True
    )
    assert tuple(beside.doubts) == (turned,)


def test_a_converged_fit_that_explains_less_than_a_fifth_of_a_channel_is_doubted():
    log = followed(rate=0.8)
    rng = np.random.default_rng(7)
    drowned = dft.Log(log.time, log.inputs, {"level": rng.standard_normal(150)})
    fit = dft.fit(Follower(), drowned, starts=1)
    assert fit.train.channels["level"].fit_percent < 20
    assert any(doubt.channel == "level" for doubt in fit.doubts)
    assert "of level: look at the doubts first" in fit.message


class Pushed(dft.Model):
    """A speed against drag, pushed by a power of turns; mass and drag are divided by its size."""

    name = "pushed"
    inputs = {"turns": "rev/s"}
    states = {"speed": "m/s"}
    outputs = {"speed": "m/s"}
    mass: float = dft.parameter(1.0, "kg/A", bounds=(0, None))
    drag: float = dft.parameter(0.5, "N s/m/A", bounds=(0, None))
    exponent: float = dft.parameter(0.3, bounds=(0.05, 6.0), transform="log")

    def equations(self, s, port):
        push = s.turns**self.exponent
        return {"speed": (push - self.drag * s.speed) / self.mass}, {"speed": s.speed}


def pushed(turns, mass=2000.0, drag=1000.0, exponent=2.9):
    """A log at 5 Hz of a speed that is pushed, with a tenth of noise."""
    rng, push = np.random.default_rng(3), turns**exponent
    speed, keep = np.zeros(turns.size), np.exp(-0.2 * drag / mass)
    for k in range(turns.size - 1):
        speed[k + 1] = push[k] / drag + keep * (speed[k] - push[k] / drag)
    noisy = speed + 0.1 * rng.standard_normal(turns.size)
    return dft.Log(0.2 * np.arange(turns.size), {"turns": turns}, {"speed": noisy})


def test_parameters_that_share_a_scale_which_the_logs_do_not_tell_are_doubted_once():
    """A tanker's masses and dampings are divided by the propulsion constant: all grew with it."""
    nearly_even = np.repeat(np.random.default_rng(4).uniform(9.8, 10.2, 20), 15)
    fit = dft.fit(Pushed(), pushed(nearly_even), starts=4)
    grown = [fit.parameters[name].value / fit.guess[name] for name in ("mass", "drag")]
    assert min(grown) > 1e3
    (doubt,) = [doubt for doubt in fit.doubts if doubt.kind == "runaway"]
    assert "mass and drag grew together, mass from 1.000 to " in doubt.evidence
    assert "they share one scale, which these logs do not tell well." in doubt.evidence
    assert doubt.mend.startswith(
        'hold one of them at what you know of it, model.replace({"mass": ...}).fix("mass"), or'
    )


def test_a_scale_that_the_logs_tell_is_one_of_the_channels():
    uneven = np.repeat(np.random.default_rng(4).uniform(2.0, 20.0, 20), 15)
    fit = dft.fit(Pushed(), pushed(uneven), starts=4)
    assert fit.parameters["exponent"].value == pytest.approx(2.9, rel=0.02)
    (doubt,) = [doubt for doubt in fit.doubts if doubt.kind == "runaway"]
    assert doubt.evidence.endswith("they share one scale.")
    assert "units and scales of the channels" in doubt.mend
    begun = eval(doubt.mend.split("begin there: ")[1].rstrip("."), {"model": Pushed()})
    assert begun.mass > 1e3
    assert begun.drag > 500
