"""The file of a chain: killed runs, other problems, damaged files, full disks."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import emcee
import h5py
import numpy as np
import pytest
from places import TESTS
from posterior_cases import (
    chain_file,
    line,
    posterior_of,
    problem_identity,
    thruster_fit,
    thruster_log,
)

import diffthrust as dft
from diffthrust.uncertainty import sample
from diffthrust.uncertainty._sampling import ensemble  # private: how often it saves

RUN = dict(draws=60, warmup=20, seed=3)


@pytest.fixture(scope="module")
def case():
    return line(known=False)


@pytest.fixture(scope="module")
def finished(case, tmp_path_factory):
    path = tmp_path_factory.mktemp("chains") / "whole.h5"
    sample(*case, file=path, **RUN)
    return path


@pytest.fixture
def copied(finished, tmp_path):
    return Path(shutil.copy(finished, tmp_path / "chain.h5"))


def contents(path):
    """Every dataset and attribute of a file."""
    found = {}

    def visit(name, item):
        found.update({f"{name}@{key}": value for key, value in item.attrs.items()})
        if isinstance(item, h5py.Dataset):
            found[name] = item[()]

    with h5py.File(path, "r") as f:
        f.visititems(visit)
    return found


def test_emcee_reads_the_file(case, finished):
    backend = emcee.backends.HDFBackend(str(finished), read_only=True)
    assert backend.get_chain().shape == (80, 32, 2)
    assert backend.get_log_prob().shape == (80, 32)
    assert backend.get_blobs().shape[:2] == (80, 32)
    assert backend.get_last_sample().random_state[0] == "MT19937"
    post = sample(*case, **RUN)
    slope = backend.get_chain(discard=20)[..., 0] * 0.1
    np.testing.assert_allclose(np.asarray(post.posterior["slope"]).T, slope)


def test_a_finished_run_is_read_and_not_repeated(case, copied, monkeypatch):
    before = copied.read_bytes()
    whole = sample(*case, **RUN)
    monkeypatch.setattr(emcee.EnsembleSampler, "sample", None)  # nothing is left to be drawn
    again = sample(*case, file=copied, **RUN)
    assert copied.read_bytes() == before
    np.testing.assert_array_equal(again.posterior["slope"], whole.posterior["slope"])
    np.testing.assert_array_equal(again.posterior["sigma"], whole.posterior["sigma"])


def test_more_draws_go_on_from_a_finished_run(case, copied, tmp_path):
    sample(*case, file=copied, **{**RUN, "draws": 90})
    sample(*case, file=tmp_path / "at_once.h5", **{**RUN, "draws": 90})
    assert copied.read_bytes() == (tmp_path / "at_once.h5").read_bytes()


def test_fewer_draws_are_read_off_a_longer_run(case, copied):
    before = copied.read_bytes()
    few = sample(*case, file=copied, **{**RUN, "draws": 40})
    np.testing.assert_array_equal(
        few.posterior["slope"], sample(*case, **{**RUN, "draws": 40}).posterior["slope"]
    )
    assert copied.read_bytes() == before


SCRIPT = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
import diffthrust as dft
from posterior_cases import thruster_fit
from diffthrust.uncertainty._sampling import ensemble, posterior
from diffthrust.uncertainty import sample
ensemble.SAVE_EVERY, ensemble.SAVE_SHARE = 0.0, 0.0
if {slow}:
    batch = posterior.Posterior.batch
    def slower(*args):
        time.sleep(0.02)
        return batch(*args)
    posterior.Posterior.batch = slower
fit, log = thruster_fit()
sample(fit, log, draws=150, warmup=50, seed=1, file={path!r})
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "moments",
    [(40,), (1, 40, 120)],
    ids=["once", "three times"],
)
def test_a_run_killed_at_any_moment_ends_with_the_file_of_one_that_was_not(tmp_path, moments):
    def begin(path, slow):
        script = SCRIPT.format(tests=str(TESTS), path=str(path), slow=slow)
        return subprocess.Popen([sys.executable, "-c", script])

    killed, whole = tmp_path / "killed.h5", tmp_path / "whole.h5"
    steps = []
    for wanted in moments:  # the first in the warmup, the others after it
        run = begin(killed, slow=True)
        deadline = time.monotonic() + 240
        while run.poll() is None and time.monotonic() < deadline:
            if killed.exists() and _length(killed) > wanted:
                break
            time.sleep(0.01)
        assert run.poll() is None, "the run ended before it could be killed"
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        steps.append(_length(killed))
    assert steps == sorted(set(steps))
    assert steps[-1] < 200
    assert begin(killed, slow=False).wait(240) == 0
    assert begin(whole, slow=False).wait(240) == 0
    ours, theirs = contents(killed), contents(whole)
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        np.testing.assert_array_equal(ours[name], value, err_msg=name)
    assert killed.read_bytes() == whole.read_bytes()
    assert [p.name for p in tmp_path.iterdir() if p.suffix == ".tmp"] == []


def _length(path):
    try:
        with h5py.File(path, "r") as f:
            return int(f["mcmc"].attrs["iteration"])
    except OSError:  # it was replaced between its name and its opening
        return 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (dict(seed=4), "settings, seed: 3 in the file, 4 now"),
        (dict(warmup=30), "settings, warmup: 20 in the file, 30 now"),
        (dict(walkers=34), "settings, walkers: 32 in the file, 34 now"),
    ],
)
def test_a_file_of_other_settings_is_refused(case, copied, change, told):
    before = copied.read_bytes()
    with pytest.raises(dft.InputError, match=told):
        sample(*case, file=copied, **{**RUN, **change})
    assert copied.read_bytes() == before


def test_a_file_of_another_problem_is_refused(case, copied, tmp_path):
    before = copied.read_bytes()
    fit, log = line(known=False, seed=1)
    with pytest.raises(dft.InputError, match=r"another problem.*differs: data: log 1"):
        sample(fit, log, file=copied, **RUN)
    fit, log = case
    for model, told in [
        (fit.model.replace(slope={"bounds": (0, 1)}), r"parameters, slope: .*within \[0, 1\]"),
        (
            fit.model.replace(slope={"prior": dft.models.Normal(0.2, 0.04)}),
            "parameters, slope: .*std=0.04",
        ),
        (fit.model.fix("offset"), "parameters, offset: free.*fixed at"),
    ]:
        other = dft.fit(model, log, starts=4)
        with pytest.raises(dft.InputError, match=told):
            sample(other, log, file=copied, **RUN)
    known = dft.fit(fit.model, line()[1], starts=4)
    with pytest.raises(dft.InputError, match="data: noise of reading"):
        sample(known, line()[1], file=copied, **RUN)
    thruster, run = thruster_fit()
    with pytest.raises(dft.InputError, match="model: linear_sensor in the file, thruster now"):
        sample(thruster, run, file=copied, **RUN)
    assert copied.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


def test_the_identity_of_a_problem_does_not_change_from_run_to_run(case, finished):
    found = problem_identity(posterior_of(*case), seed=3, walkers=32, warmup=20)
    assert chain_file.read(finished, found) is not None


def test_a_file_that_tells_more_of_its_problem_is_of_another(case, copied, tmp_path):
    who = problem_identity(posterior_of(*case), seed=3, walkers=32, warmup=20)
    chain = chain_file.read(copied, who)
    later = tmp_path / "later.h5"
    later.write_bytes(chain_file.chain_bytes(chain, {**who, "device": {"kind": "gpu"}}, ("a", "b")))
    with pytest.raises(dft.InputError, match="device, kind: gpu in the file, absent now"):
        chain_file.read(later, who)


@pytest.mark.parametrize("damage", ["text", "empty", "cut", "torn", "other"])
def test_a_damaged_or_foreign_file_is_refused_and_left(case, copied, damage):
    whole = copied.read_bytes()
    if damage == "text":
        copied.write_text("time,speed\n0,1\n")
    elif damage == "empty":
        copied.write_bytes(b"")
    elif damage == "cut":
        copied.write_bytes(whole[: len(whole) // 2])
    elif damage == "torn":
        with h5py.File(copied, "a") as f:
            del f["mcmc"]["log_prob"]
    else:
        copied.unlink()
        with h5py.File(copied, "w") as f:
            f["speed"] = np.arange(3)
    before = copied.read_bytes()
    with pytest.raises(dft.InputError, match=r"chain\.h5: (expected the file|an HDF5 file)"):
        sample(*case, file=copied, **RUN)
    assert copied.read_bytes() == before


def test_no_damaged_copy_is_read_with_other_values(case, finished, tmp_path):
    """Of 600 such copies 244 once were: a flipped bit in the numbers is no error of HDF5."""
    who = problem_identity(posterior_of(*case), seed=3, walkers=32, warmup=20)
    whole, true = finished.read_bytes(), chain_file.read(finished, who)
    assert true is not None
    rng, refused, copy = np.random.default_rng(5), 0, tmp_path / "chain.h5"
    for _ in range(150):
        damaged = bytearray(whole)
        at = int(rng.integers(len(whole)))
        many = int(rng.choice([1, 8, 200]))
        damaged[at : at + many] = rng.integers(
            0, 256, min(many, len(whole) - at), np.uint8
        ).tobytes()
        copy.write_bytes(damaged)
        try:
            found = chain_file.read(copy, who)
        except dft.InputError:
            refused += 1
            continue
        assert found is not None
        for name, value in vars(true).items():
            if name not in ("random_state", "marks"):
                np.testing.assert_array_equal(getattr(found, name), value)
        np.testing.assert_array_equal(
            chain_file.packed(found.random_state), chain_file.packed(true.random_state)
        )
    assert refused > 100


@pytest.mark.parametrize("damage", ["a number", "too few levels", "too many steps"])
def test_the_sound_beginning_of_a_damaged_chain_goes_on_as_the_whole_one(
    case, finished, tmp_path, damage
):
    copy = Path(shutil.copy(finished, tmp_path / "chain.h5"))
    with h5py.File(copy, "a") as f:
        if damage == "a number":
            f["mcmc"]["log_prob"][70, 3] += 1e-9
        elif damage == "too few levels":
            f["mcmc"]["blobs"].resize(75, axis=0)
        else:
            f["mcmc"]["chain"].resize(85, axis=0)
    before = copy.read_bytes()
    with pytest.raises(
        dft.InputError, match=r"from step 65 on\. The sound beginning is kept in chain"
    ):
        sample(*case, file=copy, **RUN)
    assert copy.read_bytes() == before
    kept = tmp_path / "chain.sound.h5"
    sample(*case, file=kept, **RUN)
    assert kept.read_bytes() == finished.read_bytes()


def test_a_full_disk_leaves_the_old_file_intact(case, copied, monkeypatch):
    before = copied.read_bytes()

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(dft.InputError, match=r"No space left.*intact(.|\n)*Make room"):
        sample(*case, file=copied, **{**RUN, "draws": 80})
    assert copied.read_bytes() == before
    assert len(list(copied.parent.iterdir())) == 1


def test_a_save_that_failed_is_not_tried_again(case, tmp_path, monkeypatch):
    """Another run may be writing to the same file: a second try would overwrite what it saved."""
    saves = []

    def failing(path, data):
        saves.append(path)
        raise dft.InputError("Another run may be writing.", "Give each a file.")

    monkeypatch.setattr(ensemble, "SAVE_EVERY", 0.0)
    monkeypatch.setattr(chain_file, "write", failing)
    with pytest.raises(dft.InputError, match="Another run"):
        sample(*case, file=tmp_path / "chain.h5", **RUN)
    assert len(saves) == 1


def test_a_folder_that_cannot_be_written_to_is_told_before_the_work(case, tmp_path, monkeypatch):
    monkeypatch.setattr(emcee.EnsembleSampler, "sample", None)
    for path in (tmp_path / "absent" / "chain.h5", tmp_path):
        with pytest.raises(dft.InputError, match=r"could not be saved|damaged or of another"):
            sample(*case, file=path, **RUN)


def test_a_run_stopped_by_hand_is_saved(case, tmp_path):
    def stop(message, share):
        if share > 0.5:
            raise KeyboardInterrupt

    path = tmp_path / "chain.h5"
    with pytest.raises(KeyboardInterrupt):
        sample(*case, file=path, progress=stop, **RUN)
    assert _length(path) >= 40
    sample(*case, file=path, **RUN)
    sample(*case, file=tmp_path / "whole.h5", **RUN)
    assert path.read_bytes() == (tmp_path / "whole.h5").read_bytes()


def test_a_log_of_the_same_length_and_other_noise_is_other_data():
    logs = [thruster_log(seed=s) for s in (0, 1)]
    parts = []
    for log in logs:
        fit = dft.fit(dft.Thruster(), log, starts=4, substeps=1)
        parts.append(problem_identity(posterior_of(fit, log), seed=0)["data"])
    assert parts[0] != parts[1]
