"""Many members at once: results of single fits, errors of their own, programs shared."""

import os
import subprocess
import sys
from functools import partial

import jax
import numpy as np
import pytest
from places import ROOT
from problems import Quadratic, Solved, distinct
from processes import SharedRuns, program, run_stacked

import diffthrust as dft
from diffthrust.effects import ActuatorLag
from diffthrust.many._batch import calls  # private: patched, to fail
from diffthrust.many._batch.each import ladder  # private: the cheapest lengths
from diffthrust.many._batch.result import named_members  # private: names alone

TRUTH = {"alpha": 0.03, "beta": 40.0, "ct": 0.02}
MODEL = dft.Thruster(alpha=0.025, beta=35.0, ct=0.015)


def record(seed: int, samples: int = 300, **values) -> dft.Log:
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(samples)
    command = 1.5 * np.sin(np.cumsum(0.2 * rng.normal(size=samples)))
    empty = dft.Log(time, {"command": command})
    truth = dft.Thruster().replace({**TRUTH, **values})
    clean = dft.simulate(truth, empty, initial={"speed": 0.0}, substeps=2)
    measured = {
        "speed": clean["speed"] + 0.2 * rng.normal(size=samples),
        "thrust": clean["thrust"] + 0.2 * rng.normal(size=samples),
    }
    return dft.Log(time, {"command": command}, measured, name=f"run{seed}")


@pytest.fixture(scope="module")
def logs():
    return [record(i, 300 - 20 * (i % 3), alpha=0.02 + 0.002 * i) for i in range(10)]


@pytest.fixture(scope="module")
def fits(logs):
    return dft.many.fit(MODEL, logs, holdout=[record(90)] * len(logs), starts=2, width=4)


@pytest.mark.thorough
def test_fits_are_those_of_one_at_a_time(logs, fits):
    assert not fits.failed
    for i in (0, 1, 5):
        alone = dft.fit(MODEL, logs[i], holdout=record(90), starts=2)
        together = fits[i]
        assert together.status is alone.status
        assert together.message == alone.message
        for name, estimate in alone.parameters.items():
            found = together.parameters[name]
            assert found.value == pytest.approx(estimate.value, rel=1e-8)
            assert found.std_error == pytest.approx(estimate.std_error, rel=1e-6)
        assert together.train.nrmse == pytest.approx(alone.train.nrmse, rel=1e-8)
        assert together.holdout.nrmse == pytest.approx(alone.holdout.nrmse, rel=1e-8)
        assert together.log_likelihood == pytest.approx(alone.log_likelihood, rel=1e-10)


def test_rounding_does_not_choose_among_equal_optima():
    def solved(z, cost):
        zeros = np.zeros(1)
        q = Quadratic(np.float64(cost), zeros, np.eye(1), zeros, zeros, np.zeros((1, 0)))
        return Solved(np.array([z]), q, True, 5, np.zeros(1, bool))

    for rounding in (-1e-12, 1e-12):
        found = distinct([(solved(0.0, 5.0), 1), (solved(1e-5, 5.0 + rounding), 1)])
        assert [(one.z[0], count) for one, count in found] == [(0.0, 2)]


def test_the_table_has_a_row_for_each(logs, fits):
    table = fits.table()
    assert list(table["name"]) == [log.name for log in logs]
    assert set(table["status"]) == {"ok"}
    true = 0.02 + 0.002 * np.arange(10)
    away = (table["alpha"] - true) / table["alpha_std_error"]
    assert np.abs(away).max() < 4.0
    assert 0.5 < away.std() < 2.0
    assert fits["run3"] is fits[3]
    assert len(list(fits)) == len(fits) == 10


@pytest.mark.thorough
def test_a_member_that_fails_costs_the_others_nothing(logs, fits):
    time = 0.05 * np.arange(300)
    wrong = dft.Log(time, {"current": np.ones(300)}, {"speed": np.ones(300)}, name="wrong")
    wild = dft.Log(time, {"command": np.full(300, 1e160)}, {"speed": np.ones(300)}, name="wild")
    members = [logs[0], wrong, wild, logs[1]]
    found = dft.many.fit(MODEL, members, starts=2, width=4)
    assert list(found.failed) == ["wrong"]
    with pytest.raises(dft.InputError, match="needs the input 'command'"):
        found["wrong"]
    table = found.table().set_index("name")
    assert "command" in table.loc["wrong", "error"]
    assert "Map a column" in table.loc["wrong", "mend"]
    assert table.loc["wild", "fit_status"] != "converged"
    for place, i in ((0, 0), (3, 1)):
        for name, estimate in found[place].parameters.items():
            assert estimate.value == pytest.approx(fits[i].parameters[name].value, rel=1e-8)


def test_logs_of_many_lengths_share_one_program(logs, nothing_stored):
    before = run_stacked.traces
    dft.many.fit(MODEL, logs[:8], starts=1, substeps=1, width=5)
    once = run_stacked.traces - before
    others = [record(20 + i, 240 + 7 * i) for i in range(8)]
    others.append(record(40, 300))  # the longest, as before
    dft.many.fit(MODEL, others, starts=1, substeps=1, width=5)
    assert run_stacked.traces - before == once
    assert once == 3  # the search, and two grids of the step's check


def test_comparisons_and_models_of_each(logs, fits):
    found = dft.many.compare(fits, logs, width=4)
    alone = dft.compare(fits[2], logs[2])
    assert found[2].errors.nrmse == pytest.approx(alone.errors.nrmse, rel=1e-10)
    np.testing.assert_allclose(
        found[2].runs[0].channels["speed"].modelled, alone.runs[0].channels["speed"].modelled,
        rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    by_model = dft.many.compare([fit.model for fit in fits], logs, width=4)
    assert by_model.table()["nrmse"].max() < 0.5


@pytest.mark.thorough
def test_maps_of_many_models_are_those_of_each(fits):
    models = [fits[0], fits[1].model, fits[2].model + ActuatorLag(time_constant=0.2), dft.Vessel()]
    amplitudes, frequencies = [0.5, 2.0], [0.5, 3.0]
    found = dft.many.describing_function(models, amplitudes, frequencies, names=list("abcd"))
    assert list(found.failed) == ["d"]
    for i in range(3):
        alone = dft.describing_function(models[i], amplitudes, frequencies)
        np.testing.assert_allclose(found[i].complex, alone.complex, rtol=1e-9)
        assert found[i].notes == alone.notes


@pytest.mark.slow  # compiles the samplers
@pytest.mark.parametrize(
    "options",
    [{"method": "emcee", "draws": 200, "warmup": 100}, {"method": "nuts", "draws": 60}],
    ids=["emcee", "nuts"],
)
def test_posteriors_are_those_of_one_at_a_time(logs, fits, options, nothing_stored):
    shared = run_stacked.traces
    found = dft.many.sample(fits[:6], logs[:6], width=32, **options)  # chains of several at once
    assert not found.failed
    assert run_stacked.traces > shared
    alone = dft.sample(fits[1], logs[1], **options)
    for name in ("alpha", "beta", "ct"):
        ours, theirs = found[1].posterior[name].values, alone.posterior[name].values
        if options["method"] == "emcee":
            np.testing.assert_allclose(ours, theirs, rtol=1e-6)
        else:  # long trajectories make much of rounding: equal in law, 1 in 2000 by chance not
            assert abs(ours.mean() - theirs.mean()) < 0.5 * theirs.std()
            assert 0.6 < ours.std() / theirs.std() < 1.6


def test_bad_arguments_are_told():
    log = record(0)
    for call, words in (
        (lambda: dft.many.fit(MODEL, log), "list with the log"),
        (lambda: dft.many.fit([MODEL], [log, log]), "one for each of 2 members"),
        (lambda: dft.many.fit(MODEL, [log], holdout=[]), "holdout"),
        (lambda: dft.many.fit(MODEL, [log], names=["a", "b"]), "names"),
        (lambda: dft.many.fit(MODEL, [log], width=0), "width"),
        (lambda: dft.many.fit(MODEL, [log], devices=[]), "devices"),
        (lambda: dft.many.fit(MODEL, [log], devices=jax.devices() * 2), "each once"),
        (lambda: dft.many.fit(MODEL, [log], devices=jax.devices()[0]), "expected a list"),
        (lambda: dft.many.fit(MODEL, [log], holdout=log), "holdout: expected a list"),
        (lambda: dft.many.fit(MODEL, [log], start=3), "no option 'start'"),
        (lambda: dft.many.compare(MODEL, [log], horizon=3), "no option 'horizon'"),
        (lambda: dft.many.describing_function([MODEL], 1.0, 1.0, width=3), "no option 'width'"),
        (lambda: dft.many.sample([], [log]), "fits"),
        (lambda: dft.many.sample([1], [log], file="x.h5"), "file"),
        (lambda: dft.many.describing_function(MODEL, 1.0, 1.0), "models"),
    ):
        with pytest.raises(dft.InputError, match=words):
            call()
    wrong = dft.many.fit(MODEL, [log], starts=0)  # an argument of each fit is an error of each
    assert isinstance(wrong.errors[0], dft.InputError)
    assert not dft.many.fit(MODEL, []).names


def test_members_of_one_name_are_numbered():
    log = record(0)
    assert dft.many.compare(MODEL, [log, log], substeps=1).names == ("run0", "run0 (2)")
    assert named_members(["a", "a", "a (2)", "a"], range(4)) == ("a", "a (3)", "a (2)", "a (4)")


def test_places_and_slices(fits):
    assert fits[-1] is fits[9]
    some = fits[2:8:3]
    assert isinstance(some, dft.many.Many)
    assert some.names == ("run2", "run5")
    assert some[1] is fits[5]
    assert list(dft.many.fit(MODEL, []).table()) == ["name", "status", "error", "mend", "seconds"]


def test_members_without_a_fit_keep_their_error(logs):
    time = 0.05 * np.arange(300)
    wrong = dft.Log(time, {"current": np.ones(300)}, {"speed": np.ones(300)}, name="wrong")
    tried = dft.many.compare(MODEL, [logs[0], wrong], substeps=1)
    again = dft.many.compare(tried, [logs[0], logs[0]], names=["a", "b"], substeps=1)
    assert again.errors[1] is tried.errors[1]
    frame = tried.errors[1].__traceback__
    while frame.tb_next:
        frame = frame.tb_next
    assert not frame.tb_frame.f_locals  # where it happened is kept, the arrays are not


def test_the_ladder_is_the_cheapest():
    rng = np.random.default_rng(3)
    lengths = rng.integers(100, 2000, 9)

    def cost(rungs):
        places = np.searchsorted(rungs, lengths)
        return 2000 * len(rungs) + np.asarray(rungs)[places].sum()

    found = ladder(lengths, program=2000)
    sizes = np.unique(lengths)
    every = [
        [*(int(s) for j, s in enumerate(sizes[:-1]) if bits >> j & 1), int(sizes[-1])]
        for bits in range(2 ** (sizes.size - 1))
    ]
    assert cost(found) == min(cost(rungs) for rungs in every)
    assert ladder([]) == []
    assert ladder(range(1, 5000), program=1.0)[-1] == 4999  # of very many, neighbours are one
    assert ladder([1000] * 50 + [1010] * 50, program=20_000) == [1010]


@program(1)
def _square(factor, x):
    return factor * x["value"] ** 2


def _done(shared, *works):
    """Do all of some work."""
    for _ in shared.drive(works):
        pass


def test_each_member_gets_its_own_row():
    shared, found = SharedRuns(3), {}

    def work(i):
        asked = [shared.ask(_square, 2.0, {"value": np.float64(i + k)}) for k in range(4)]
        found[i] = [float(x) for x in asked]

    _done(shared, *(partial(work, i) for i in range(7)))
    assert found == {i: [2.0 * (i + k) ** 2 for k in range(4)] for i in range(7)}


def test_nobody_waits_for_the_slowest():
    shared, ended, rounds = SharedRuns(2), [], []

    def straggler():
        while len(ended) < 6 and len(rounds) < 2000:
            rounds.append(shared.ask(_square, 1.0, {"value": np.float64(1.0)}))

    def quick():
        for _ in range(3):
            shared.ask(_square, 1.0, {"value": np.float64(2.0)})
        ended.append(True)

    _done(shared, straggler, *[quick] * 6)
    assert len(ended) == 6
    assert 0 < len(rounds) < 2000  # the others did not wait for the last of its rounds


@program(1)
def _broken(_, x):
    raise ValueError("no such thing")


def test_an_error_of_a_program_reaches_those_who_asked():
    shared, told, found = SharedRuns(2), [], []

    def work(program):
        try:
            found.append(shared.ask(program, 1.0, {"value": np.float64(3.0)}))
        except ValueError as error:
            told.append(str(error))

    _done(shared, *(partial(work, p) for p in (_broken, _square, _broken, _broken)))
    assert told == ["no such thing"] * 3
    assert found == [9.0]


def test_programs_of_several_kinds_are_under_way_together():
    shared, most = SharedRuns(4), []

    def work(factor):
        for _ in range(5):
            shared.ask(_square, factor, {"value": np.float64(2.0)})
            most.append(len(shared._under_way))

    _done(shared, *(partial(work, float(i)) for i in range(3)))  # no run is ever full
    assert max(most) > 0


def test_work_that_is_given_up_gets_no_further_program():
    shared, told = SharedRuns(1), []

    def stubborn():
        try:
            while True:
                shared.ask(_square, 1.0, {"value": np.float64(2.0)})
        finally:
            told.append("ended")
            shared.ask(_square, 1.0, {"value": np.float64(2.0)})
            told.append("went on")

    drive = shared.drive([lambda: None, stubborn, lambda: None])
    next(drive), next(drive)
    drive.close()
    assert told == ["ended"]


class _Exits(dft.Thruster):
    def equations(self, s, port):
        raise SystemExit(3)


def test_what_ends_a_program_ends_it_all(logs):
    with pytest.raises(SystemExit):
        dft.many.fit([_Exits(), *[MODEL] * 3], logs[:4], starts=1)


def test_an_interruption_ends_the_work_of_all(logs, monkeypatch):
    begun, ended = [], []

    def noted(*given, **options):
        begun.append(given)
        try:
            return dft.fit(*given, **options)
        finally:
            ended.append(given)

    def stop(message, share):
        raise KeyboardInterrupt

    monkeypatch.setattr(calls, "fit_one", noted)
    monkeypatch.setattr(calls, "check_options", lambda *_: None)
    with pytest.raises(KeyboardInterrupt):
        dft.many.fit(MODEL, logs, starts=4, width=2, progress=stop)
    assert 1 < len(ended) == len(begun) < len(logs)
    assert len(dft.many.fit(MODEL, logs[:2], starts=1, width=2)) == 2  # nothing is left behind


def test_a_map_that_fails_costs_the_others_nothing(fits, monkeypatch):
    real = calls.maps_of

    def failing(asked, models):
        if fits[1] in models:
            raise ArithmeticError("not this one")
        return real(asked, models)

    monkeypatch.setattr(calls, "maps_of", failing)
    found = dft.many.describing_function(fits[:3], [0.5, 2.0], [0.5, 3.0])
    assert list(found.failed) == ["run1"]
    assert len(list(found)) == 2


SHARDED = """
import jax, numpy as np, sys
sys.path[:0] = ["tests", "tests/many"]
import diffthrust._support._running.batching, diffthrust as dft
from test_many import MODEL, record
logs = [record(i) for i in range(8)]
assert len(jax.devices()) == 4
one = dft.many.fit(MODEL, logs, starts=1, substeps=1, width=2)
four = dft.many.fit(MODEL, logs, starts=1, substeps=1, width=2, devices=jax.devices())
places = set()
placed = diffthrust._support._running.batching.run_stacked
def watched(*given):
    found = placed(*given)
    places.update(d.id for leaf in jax.tree.leaves(found) for d in leaf.devices())
    return found
diffthrust._support._running.batching.run_stacked = watched
last = dft.many.compare(MODEL, logs[:2], substeps=1, devices=jax.devices()[3:])
assert places == {3}, places
worst = max(
    abs(a.parameters[n].value / b.parameters[n].value - 1)
    for a, b in zip(one, four, strict=True) for n in a.parameters
)
print("worst", worst)
"""


@pytest.mark.thorough
def test_runs_are_divided_over_devices():
    flags = "--xla_force_host_platform_device_count=4 " + os.environ.get("XLA_FLAGS", "")
    done = subprocess.run(
        [sys.executable, "-c", SHARDED], capture_output=True, text=True, timeout=300,
        env={**os.environ, "XLA_FLAGS": flags},
        cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) < 1e-8


@pytest.mark.thorough
def test_processes_share_the_members(logs, fits):
    told = []
    wrong = dft.Log(logs[0].time, {"current": np.ones(300)}, {"speed": np.ones(300)})
    found = dft.many.fit(
        MODEL, [*logs[:3], wrong], holdout=[record(90)] * 4, starts=2, width=4, processes=2,
        progress=lambda words, share: told.append(share),
    )  # fmt: skip
    for i in range(3):
        for name, estimate in found[i].parameters.items():
            assert estimate.value == pytest.approx(fits[i].parameters[name].value, rel=1e-8)
    assert list(found.failed) == ["log"]
    with pytest.raises(dft.InputError, match="needs the input 'command'"):
        found["log"]
    assert told == [0.5, 1.0]


class OfThisTest(dft.Thruster):
    """A model that no other process can import, as one of a script."""


def test_processes_cannot_know_what_a_script_defines(logs, monkeypatch):
    monkeypatch.setattr(OfThisTest, "__module__", "__main__")
    monkeypatch.setattr(sys.modules["__main__"], "OfThisTest", OfThisTest, raising=False)
    with pytest.raises(dft.InputError, match="another process cannot do this"):
        dft.many.fit(OfThisTest(), logs[:2], starts=1, processes=2)
    for wrong in ({"processes": 0}, {"processes": 2, "devices": jax.devices()}):
        with pytest.raises(dft.InputError, match="processes"):
            dft.many.fit(MODEL, logs[:2], **wrong)


def test_the_units_of_the_columns_of_a_table(fits, logs):
    units = fits.units
    assert units["alpha"] == units["alpha_std_error"] == MODEL.parameters["alpha"].unit
    assert units["seconds"] == "s"
    compared = dft.many.compare(fits[0].model, logs[:2])
    assert compared.units == {"seconds": "s", "speed_rmse": "rad/s", "thrust_rmse": "N"}
    for found in (fits, compared):
        assert set(found.units) <= set(found.table())
