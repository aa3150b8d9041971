"""Guesses: other values that a fit begins with beside the model's own."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from reference import inputs
from test_fit import log_of, record

import diffthrust as dft


class Swinging(dft.Model):
    """A quarter turn behind a cosine: far from its frequency the error falls towards no swing."""

    name = "swinging"
    inputs: ClassVar = {"command": ""}
    states: ClassVar = {"place": "m"}
    outputs: ClassVar = {"place": "m"}
    frequency: float = dft.parameter(1.0, "rad/s", bounds=(0.1, 20.0))

    def equations(self, s, port):
        turned = s.command * jnp.cos(self.frequency * s.time)
        return {"place": turned}, {"place": s.place}


@pytest.mark.thorough
def test_a_guess_is_one_more_start_and_the_best_is_kept():
    time = inputs.grid(20.0, 0.02)
    log = dft.Log(time, {"command": np.ones(time.size)}, {"place": np.sin(3.0 * time) / 3.0})
    lost = dft.fit(Swinging(frequency=5.0), log, starts=1)
    assert lost.parameters["frequency"].value != pytest.approx(3.0, abs=0.5)
    found = dft.fit(Swinging(frequency=5.0), log, starts=1, guesses=[{"frequency": 3.05}, {}])
    assert found.parameters["frequency"].value == pytest.approx(3.0, rel=1e-4)
    assert found.guess == {"frequency": 5.0}
    assert (
        found.status is dft.estimation.Status.CONVERGED
    )  # one start and guesses claim no agreement
    assert found.checks.starts == 3


def test_a_guess_at_the_null_of_an_effect_ends_no_worse_than_without_it():
    log = log_of(record(duration=10.0))
    without = dft.fit(dft.Thruster(), log, starts=2)
    values = {name: p.value for name, p in without.model.parameters.items()}
    model = dft.Thruster().replace(alpha=2.0) + "command_saturation"
    null = {**values, "command_saturation.limit": np.inf}
    fit = dft.fit(model, log, starts=1, guesses=[null])
    assert fit.log_likelihood >= without.log_likelihood - 1e-6


@pytest.mark.parametrize(
    ("guesses", "words"),
    [
        ([{"alpha": -1.0}], "expected a value within"),
        ([{"ct": 1.0}], "'ct' is fixed"),
    ],
)
def test_guesses_that_cannot_be_meant(guesses, words):
    with pytest.raises(dft.InputError, match=words):
        dft.fit(dft.Thruster().fix("ct"), log_of(record(duration=10.0)), guesses=guesses)
