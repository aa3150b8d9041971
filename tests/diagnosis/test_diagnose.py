"""The diagnosis as a user meets it; how often it is right, the bench in ``hidden`` measures."""

import json
from functools import cached_property
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import inputs, noise, thruster
from trajectories import trajectory_module

import diffthrust as dft
from diffthrust.diagnosis._search_start import blind_notes  # private: of a trial without a screen

TIME = np.arange(700) * 0.05
FEW = ("command_deadband", "linear_damping", "thrust_sensor_offset")


def logs(count=3, seed=0, **hidden):
    """Training logs and, as the last, an unseen one."""
    rng = np.random.default_rng(seed)
    out = []
    for i in range(count):
        command = inputs.low_passed_random(TIME, 2.0, rng)
        command[100 * i : 100 * i + 150] *= 0.1
        record = thruster.simulate(TIME, command, method="rk4", **hidden)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.2))
        out.append(dft.Log(record.time, record.inputs, record.measured, name=f"run {i}"))
    return out


class SquareRootDrag(dft.Effect):
    """A user's own effect: a load that grows with the root of the speed."""

    name = "square_root_drag"
    port = "shaft"
    size: float = dft.parameter(1.0, null=0.0, size=1.0, probes=(0.5, 2.0))

    def __call__(self, value, s):
        softened = (s.speed**2 + 0.01) ** 0.25
        return value - self.size * s.speed / softened


TRIED = [*FEW, SquareRootDrag]  # of all diagnoses, which so share what they compile


@pytest.fixture(scope="module")
def simulations():
    """What was simulated so far: which model, how, over which log, from where."""
    return []


@pytest.fixture(scope="module")
def diag(simulations):
    *train, unseen = logs(command_deadband=0.4, thrust_sensor_offset=1.0)
    said = []
    simulated = trajectory_module._run

    def counted(key, grid, values, time, inputs, start):
        numbers = jax.tree.map(lambda value: np.asarray(value).tobytes(), (values, inputs, start))
        simulations.append((key, grid, str(numbers), time.tobytes()))
        return simulated(key, grid, values, time, inputs, start)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trajectory_module, "_run", counted)
        found = dft.diagnose(
            dft.Thruster(),
            train,
            holdout=unseen,
            candidates=TRIED,
            progress=lambda message, share: said.append((message, share)),
        )
    return found, said, train, unseen


@pytest.mark.thorough
def test_nothing_is_simulated_twice(diag, simulations):
    _, _, train, unseen = diag
    # by the first and the last model every log with the steps that it has, and with half of them
    assert len(simulations) >= 2 * 2 * len([*train, unseen])
    assert len(set(simulations)) == len(simulations)


def test_both_hidden_effects_are_found_and_the_errors_fall(diag):
    found, _, train, unseen = diag
    assert found.verdict == "effects_found"
    assert set(found.added) == {"command_deadband", "thrust_sensor_offset"}
    assert [len(stage.effects) for stage in found.stages] == [0, 1, 2]
    unseen_errors = [stage.holdout.nrmse for stage in found.stages]
    assert unseen_errors == sorted(unseen_errors, reverse=True)
    values = found.fit.parameters
    assert values["command_deadband.half_width"].value == pytest.approx(0.4, abs=0.02)
    assert values["thrust_sensor_offset.offset"].value == pytest.approx(1.0, abs=0.05)
    again = dft.fit(dft.Thruster() + found.best, train, holdout=unseen)
    assert again.holdout.nrmse == pytest.approx(unseen_errors[-1], rel=0.02)


def test_the_result_is_plain_data_of_the_contract(diag):
    found, *_ = diag
    plain = json.loads(json.dumps(found.to_json()))
    assert plain["schema"] == 1
    assert plain["remaining"] is None
    assert [
        set(group) & {name} for group, name in zip(plain["groups"], plain["added"], strict=True)
    ]
    first = plain["ranking"][0]
    assert set(first) == {
        *("stage", "effect", "parameters", "delta_bic", "p_value", "train_nrmse", "holdout_nrmse")
    }
    assert first["effect"] == plain["stages"][1]["effects"][0]
    assert first["delta_bic"] < -10


def test_progress_names_what_is_tried_and_never_falls(diag):
    found, said, *_ = diag
    messages = [message for message, _ in said]
    assert f"stage 1: trying {len(TRIED)} candidates" in messages
    for number, name in enumerate(found.added, 1):
        assert f"stage {number}: {name} in whole runs" in messages
        assert f"stage {number}: fitting with {name}" in messages
    shares = [share for _, share in said]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert max(np.diff(shares)) < 0.4


def test_the_missing_signals_are_in_the_units_of_their_ports(diag):
    found, _, train, _ = diag
    missing = {m.port: m for m in found.missing}
    assert set(missing) == {"shaft", "propeller"}
    assert missing["shaft"].unit == "rad/s^2"
    assert missing["propeller"].unit == "N"
    time, signal, error = missing["propeller"].runs[0]
    assert time.shape == signal.shape == error.shape == train[0].time.shape
    # the tare is there as it is, whatever its form was taken to be
    assert np.median(signal) == pytest.approx(1.0, abs=0.15)


def first_three(log):
    rows = {name: values[:3] for name, values in log.measured.items()}
    return dft.Log(log.time[:3], {"command": log.inputs["command"][:3]}, rows)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda log: [], "at least one log"),
        (first_three, "hold 6 measurements"),
    ],
)
def test_logs_that_tell_nothing_are_refused(change, words):
    with pytest.raises(dft.InputError, match=words):
        dft.diagnose(dft.Thruster(), change(logs(1)[0]))


def test_limits_of_an_input_that_is_not_there_are_refused_before_the_work():
    with pytest.raises(dft.InputError, match=r"limits: .* no input 'thrust'"):
        dft.diagnose(dft.Thruster(), logs(1), limits={"thrust": (-1.0, 1.0)})


@pytest.mark.slow
def test_the_diagnosis_tells_the_errors_of_its_own_logs():
    one, other, unseen = logs(command_deadband=0.4)
    fit = dft.fit(dft.Thruster(), one, holdout=other)
    found = dft.diagnose(fit, one, candidates="linear_damping", experiment=False)
    assert found.stages[0].holdout is None
    found = dft.diagnose(fit, one, holdout=unseen, candidates="linear_damping", experiment=False)
    expected = dft.compare(found.stages[0].fit, unseen).errors.nrmse
    assert found.stages[0].holdout.nrmse == pytest.approx(expected, rel=1e-9)
    assert expected != pytest.approx(fit.holdout.nrmse, rel=1e-3)


@pytest.mark.slow
def test_an_optional_input_that_only_the_first_log_has_is_left_out():
    one, other, unseen = logs()
    flow = {**one.inputs, "inflow": np.sin(one.time)}
    first = dft.Log(one.time, flow, one.measured, name=one.name)
    found = dft.diagnose(
        dft.Thruster(), [first, other], holdout=unseen, candidates=FEW[:1], experiment=False
    )
    assert found.verdict == "adequate"


def test_nothing_is_named_where_nothing_is_missing():
    *train, unseen = logs(seed=4)
    found = dft.diagnose(dft.Thruster(), train, holdout=unseen, candidates=TRIED)
    assert found.verdict == "adequate"
    assert not found.added
    assert found.remaining is None


@pytest.mark.thorough
def test_an_unseen_log_may_lack_a_channel():
    """A load cell was out of the water: it ended in an error of zip()."""
    *train, unseen = logs(command_deadband=0.4)
    less = {"speed": unseen.measured["speed"]}
    unseen = unseen.replaced(time=unseen.time, inputs=dict(unseen.inputs), measured=less)
    diag = dft.diagnose(dft.Thruster(), train, holdout=[unseen], candidates=FEW, experiment=False)
    assert diag.added == ("command_deadband",)
    assert "The speed error on" in diag.summary
    assert "thrust error" not in diag.summary


@pytest.mark.thorough
def test_an_effect_of_the_user_is_found_without_unseen_logs():
    rng = np.random.default_rng(3)
    model = dft.Thruster() + SquareRootDrag(size=2.0)
    out = []
    for seed in (5, 6):
        log = logs(1, seed)[0]
        run = dft.simulate(model, log)
        measured = {n: run[n] + 0.2 * rng.standard_normal(TIME.size) for n in model.outputs}
        out.append(dft.Log(log.time, log.inputs, measured))
    found = dft.diagnose(dft.Thruster(), out, candidates=TRIED)
    assert found.added == ("square_root_drag",)
    assert found.stages[0].holdout is None


class Rooted(dft.Effect):
    """An effect whose derivative at its null is infinite."""

    name = "rooted"
    port = "shaft"
    size: float = dft.parameter(0.0, "rad^2/s^4", bounds=(0, None), null=0.0, size=1.0)

    def __call__(self, value, s):
        return value - jnp.sqrt(self.size)


@pytest.mark.slow
def test_an_effect_that_stops_the_trials_is_named():
    with pytest.raises(dft.InputError, match="effect 'rooted' cannot be tried"):
        dft.diagnose(dft.Thruster(), logs(1), candidates=["coulomb_friction", Rooted()])


class RootOfCommand(dft.Effect):
    """An effect whose slope is infinite where the command is zero, also at its null."""

    name = "root_of_command"
    port = "shaft"
    size: float = dft.parameter(0.0, "rad/s^2", bounds=(0, None), null=0.0, size=1.0)

    def __call__(self, value, s):
        return value + self.size * jnp.sqrt(jnp.abs(s.command))


def with_stops():
    """A log whose command is zero at first."""
    return [log.replaced(inputs={"command": np.where(log.time < 5.0, 0.0, log.inputs["command"])})
            for log in logs(1)]  # fmt: skip


def test_an_effect_that_blinds_the_trials_is_named():
    candidates = ["coulomb_friction", RootOfCommand()]
    with pytest.raises(dft.InputError, match="effect 'root_of_command' cannot be tried"):
        dft.diagnose(dft.Thruster(), with_stops(), candidates=candidates)


def test_a_sound_effect_is_not_blamed_for_what_the_model_cannot_respond_to():
    model = dft.Thruster() + RootOfCommand(size=0.5)
    found = dft.diagnose(model, with_stops(), candidates=[SquareRootDrag()])
    assert found.sought
    (note,) = (note for note in found.notes if "cannot be predicted" in note)
    assert "the derivative of the rate of 'speed' by the input 'command' is not" in note
    assert "first at sample 1 (t = 0 s), where command = 0 V" in note


def test_a_note_on_what_cannot_be_predicted_works_nothing_out():
    """Of a trial that no screen looked at, no program is compiled for it."""

    class Trial:
        effects = ()

        @cached_property
        def response(self):
            raise AssertionError("it was worked out")

    state = SimpleNamespace(current=SimpleNamespace(trial=Trial()))
    assert blind_notes(state, []) == ()
