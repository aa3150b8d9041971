"""States that are not measured: where they begin, in fits, in comparisons and over unseen runs."""

import jax.numpy as jnp
import numpy as np
import pytest

import diffthrust as dft
from diffthrust.simulation._starts import felt, following, unknown_starts  # private: each alone

TRUE = {"k1": 0.07, "k2": 0.06, "k3": 0.04}


class Tanks(dft.Model):
    """Two tanks, one above the other; the level of the lower one is measured."""

    name = "two_tanks"
    inputs = {"pump": "V"}
    states = {"upper": "m", "lower": "m", "spilt": "m"}
    outputs = {"lower": "m"}
    k1: float = dft.parameter(0.05, "1/s", bounds=(0, None))
    k2: float = dft.parameter(0.05, "1/s", bounds=(0, None))
    k3: float = dft.parameter(0.05, "1/s", bounds=(0, None))

    def equations(self, s, port):
        """Torricelli's law; what leaves the lower tank is gathered, and acts on nothing."""
        down = self.k1 * jnp.sqrt(jnp.maximum(s.upper, 1e-6))
        out = self.k2 * jnp.sqrt(jnp.maximum(s.lower, 1e-6))
        rates = {"upper": self.k3 * s.pump - down, "lower": down - out, "spilt": out}
        return rates, {"lower": s.lower}


class BegunTanks(Tanks):
    """The same, with a level to which the upper tank is filled before each run."""

    name = "begun_tanks"
    level: float = dft.parameter(1.0, "m", bounds=(0, None))

    def initial(self, s):
        """Filled to the mark."""
        return {"upper": self.level}


def run(seed, upper, noise=0.02, late=0):
    rng, time = np.random.default_rng(seed), np.arange(0.0, 400.0)
    inputs = {"pump": np.repeat(rng.uniform(0.5, 3, 20), 20)}
    blank = dft.Log(time, inputs, {"lower": np.zeros(time.size)})
    begin = {"upper": upper, "lower": 2.0}
    made = dft.simulate(Tanks(**TRUE), blank, initial=begin, substeps=4)["lower"]
    measured = made + noise * rng.standard_normal(time.size)
    measured[:late] = np.nan
    return dft.Log(time, inputs, {"lower": measured}, name=f"run{seed}")


@pytest.fixture(scope="module")
def train():
    return [run(0, 4.0), run(1, 4.0)]


def test_which_states_are_unknown(train):
    assert felt(Tanks(), train) == ("upper", "lower")
    assert unknown_starts(Tanks(), train[0], {}) == ("upper",)
    assert unknown_starts(Tanks(), train[0], {"upper": 4.0}) == ()
    assert unknown_starts(Tanks(), run(3, 4.0, late=30), {}) == ("upper", "lower")
    assert unknown_starts(BegunTanks(), train[0], {}) == ()
    assert following(BegunTanks(), train) == ("upper",)
    assert following(BegunTanks().fix("level"), train) == ()


def test_a_parameter_of_the_initial_state_is_estimated_for_all_logs_together(train):
    fit = dft.fit(BegunTanks(), train, starts=2)
    level = fit.parameters["level"]
    assert level.std_error is not None
    assert abs(level.value - 4.0) < 4 * level.std_error
    assert level.std_error < 0.2
    assert all(set(states) == {"lower"} for states in fit.initial)
    assert not any("nothing about" in note for note in fit.notes)
    again = dft.compare(fit, train, initial=fit.initial)
    assert again.errors.nrmse == pytest.approx(fit.train.nrmse, rel=1e-6)


def test_states_of_their_own_are_estimated_log_by_log(train):
    fit = dft.fit(Tanks(), [train[0], run(2, 7.0)], starts=2)
    assert [states["upper"] for states in fit.initial] == pytest.approx([4.0, 7.0], abs=0.4)
    assert not any("spilt" in states for states in fit.initial)  # no sensor feels it


@pytest.mark.parametrize("upper", [1.0, 9.0])
def test_unseen_runs_begin_where_they_err_least(train, upper):
    unseen = run(4, upper)
    comp = dft.compare(Tanks(**TRUE), unseen)
    assert comp.runs[0].estimated == ("upper",)
    assert comp.runs[0].start["upper"] == pytest.approx(upper, abs=0.5)
    assert comp.errors.channels["lower"].rmse == pytest.approx(0.02, rel=0.25)
    assert "'upper' begins" in comp.report()
    from_default = dft.compare(Tanks(**TRUE), unseen, initial=[{"upper": 0.0}])
    assert from_default.errors.nrmse > 2 * comp.errors.nrmse
    assert "'upper' begins" not in from_default.report()


def test_a_fit_says_what_it_estimated_of_unseen_runs(train):
    unseen = run(5, 8.0)
    fit = dft.fit(Tanks(), train, holdout=unseen, starts=2)
    assert fit.holdout.channels["lower"].rmse == pytest.approx(0.02, rel=0.25)
    assert any("'upper' begins" in note for note in fit.notes)


def test_a_late_sensor_tells_of_the_start(train):
    comp = dft.compare(Tanks(**TRUE), run(6, 5.0, late=30))
    assert comp.runs[0].start["lower"] == pytest.approx(2.0, abs=0.3)


def test_measured_states_cost_nothing_more():
    time = 0.05 * np.arange(200)
    speed = 40 * np.tanh(time)
    log = dft.Log(time, {"command": np.ones(200)}, {"speed": speed, "thrust": 0.02 * speed**2})
    assert unknown_starts(dft.Thruster() + "axial_flow", log, {}) == ()  # its flow is settled
    assert dft.compare(dft.Thruster(), log).runs[0].estimated == ()


def test_what_the_run_hardly_feels_stays_near(train):
    """Noise alone must not send the start of a fast state anywhere."""
    time = 0.1 * np.arange(300)
    command = np.where(time % 8 < 4, 3.0, 1.0)
    model = dft.DCMotorThruster()
    blank = dft.Log(time, {"command": command}, {"speed": np.zeros(300)})
    made = dft.simulate(model, blank, initial={"speed": 0.0})
    noise = 0.01 * np.std(made["speed"]) * np.random.default_rng(0).standard_normal(300)
    log = dft.Log(time, {"command": command}, {"speed": made["speed"] + noise})
    model = model.fix(*model.parameters)
    begun = dft.compare(model, log).runs[0].start
    assert abs(begun["current"]) < 2 * np.abs(made["current"]).max()
