"""Terms of a state that is not measured, found by whole runs of a small cascade."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from steps import bind, form_words, library, places_of, state_terms

import diffthrust as dft

STEP, NOISE = 0.25, 0.02
KNEE, SPILL, LEAK = 1.2, 0.6, 0.3


class Cascade(dft.Model):
    """What is pushed in runs through a first state that is not measured into a second one."""

    name = "cascade"
    inputs: ClassVar[dict] = {"push": "m/s"}
    states: ClassVar[dict] = {"behind": "m", "seen": "m"}
    outputs: ClassVar[dict] = {"seen": "m"}
    ports: ClassVar[dict] = {"first": "into the first [m/s]", "second": "into the second [m/s]"}
    through: float = dft.parameter(0.5, "1/s", bounds=(0, None))
    out: float = dft.parameter(0.5, "1/s", bounds=(0, None))

    def equations(self, s, port):
        through = self.through * s.behind
        first = port("first", s.push - through)
        second = port("second", through - self.out * s.seen)
        return {"behind": first, "seen": second}, {"seen": s.seen}


def log(seed, spill):
    """A log of the plant, by Euler's method in small steps; it spills above its knee."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(240)
    push = rng.uniform(0.0, 1.4, 240)[(time / 5.0).astype(int)]
    behind = seen = 0.0
    levels = []
    for held in push:
        levels.append(seen)
        for _ in range(50):
            through = 0.7 * behind
            spilt = spill * max(behind - KNEE, 0.0)
            behind += STEP / 50 * (held - through - spilt)
            seen += STEP / 50 * (through - LEAK * seen)
    read = np.array(levels) + NOISE * rng.standard_normal(240)
    return dft.Log(time, {"push": push}, {"seen": read}, name=f"cascade {seed}")


def context_of(model, train, unseen):
    """What the terms need of a search: the logs, and fits to them."""
    records, others = bind(model, train), bind(model, unseen)
    fitter = SimpleNamespace(
        model=model, records=records, channels=("seen",), samples=sum(map(len, records)),
        places=places_of(model, records[0], ["seen"]),
    )  # fmt: skip

    def refit(changed, starts):
        return SimpleNamespace(fit=dft.fit(changed, train, holdout=unseen, starts=starts))

    guess = {name: p.value for name, p in model.parameters.items()}
    return SimpleNamespace(fitter=fitter, records=records, unseen=others, guess=guess, refit=refit)


@pytest.mark.thorough
def test_an_overflow_of_a_state_that_is_not_measured_is_learned():
    model, train, unseen = Cascade(), [log(1, SPILL), log(2, SPILL)], [log(3, SPILL)]
    given = dft.fit(model, train, holdout=unseen, starts=2)
    laws = state_terms(context_of(model, train, unseen), given)
    assert all(law.together and law.form for law in laws)
    assert laws[0].worth.low > 0.8
    floor = NOISE / np.std(unseen[0].measured["seen"])
    assert given.holdout.nrmse > 2.0 * floor
    assert laws[0].reported.holdout.nrmse < 1.15 * floor
    spill = next(law for law in laws if law.form.name == "ramp above")
    assert (spill.curve.port, spill.signals) == ("first", ("behind",))
    assert spill.form.formula.a == pytest.approx(-SPILL, rel=0.2)
    assert spill.form.formula.b == pytest.approx(KNEE, rel=0.1)
    assert spill.effect is spill.form.formula
    x, drawn, _ = spill.drawn()
    np.testing.assert_allclose(drawn, -SPILL * np.maximum(x - KNEE, 0.0), atol=0.15)
    assert "goes in proportion to behind, above 1." in form_words(spill, spill.form)


def test_a_bend_may_stand_where_a_tank_is_empty():
    """At zero, the lower end of its range: its coordinate is no logarithm."""
    context = context_of(Cascade(), [log(1, SPILL)], [log(3, SPILL)])
    ranges = {"behind": np.linspace(0.0, 2.0, 9), "seen": np.linspace(0.0, 1.0, 9)}
    formulas, terms = library(context, Cascade(), ranges)
    model = Cascade() + formulas
    places = [term.place for term in terms if term.place]
    assert len(terms) == 16
    assert len(places) == 12
    moved = model.replace(dict.fromkeys(places, 0.0))
    assert {moved.parameters[n].to_coordinate(0.0) for n in places} == {0.0}


@pytest.mark.thorough
def test_no_term_is_learned_where_none_is_missing():
    model, train, unseen = Cascade(), [log(1, 0.0), log(2, 0.0)], [log(3, 0.0)]
    given = dft.fit(model, train, holdout=unseen, starts=2)
    assert state_terms(context_of(model, train, unseen), given) == ()


def test_without_unseen_logs_or_hidden_states_nothing_is_tried():
    model, train = Cascade(), [log(1, 0.0)]
    context = context_of(model, train, [])
    assert state_terms(context, SimpleNamespace()) == ()
    context = context_of(model, train, train)
    context.fitter.channels = ("behind", "seen")
    assert state_terms(context, SimpleNamespace()) == ()
