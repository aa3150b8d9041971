"""Fits in processes: they agree with one process, stay with their like, and survive deaths."""

from __future__ import annotations

import os
import shutil
from collections.abc import Hashable

import pytest
from places import FITS

from diffthrust import InputError
from diffthrust._support._running.pool import Groups  # private: who takes what
from diffthrust.checks import check
from diffthrust.checks._check import default_jobs, tasks_in  # private: how work is divided
from diffthrust.checks._run import run_again, run_all  # private: processes beside this one
from diffthrust.specs._compile_key import compile_key  # private: no result shows it

SENSOR = FITS / "depth_sensor"


def test_few_fits_need_no_other_process(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert [default_jobs(count) for count in (1, 3, 4, 9, 10, 200)] == [1, 1, 2, 3, 4, 8]
    with pytest.raises(InputError, match="1 or more"):
        check("fits", jobs=0)


def test_a_worker_stays_with_fits_that_share_compiled_code(tmp_path):
    for i, rows in enumerate((20, 10, 20, 10, 10, 20, 20)):
        folder = tmp_path / f"f{i}"
        folder.mkdir()
        text = (SENSOR / "fit.toml").read_text()
        (folder / "fit.toml").write_text(text)
        for name in ("train.csv", "holdout.csv"):
            (folder / name).write_text("0,0\n" * rows)
    (tmp_path / "f7").mkdir()
    (tmp_path / "f7" / "fit.toml").write_text("no toml")
    tasks = tasks_in(tmp_path)
    groups = Groups([compile_key(task.file) for task in tasks])

    def take(last: Hashable | None) -> tuple[Hashable, str]:
        given = groups.next(last)
        assert given is not None
        return given[0], tasks[given[1]].fit

    first, name = take(None)
    assert name == "f0"  # of the largest group
    second, name = take(None)
    assert name == "f1"  # another worker takes another group
    assert [take(first)[1] for _ in range(3)] == ["f2", "f5", "f6"]
    third, name = take(first)
    assert name == "f7"  # one that nobody has begun, before it helps
    assert [take(third)[1], take(second)[1]] == ["f3", "f4"]
    assert groups.next(second) is None


def test_processes_agree_with_this_one_and_survive_deaths(tmp_path, monkeypatch):
    fits = tmp_path
    shutil.copytree(SENSOR, fits / "depth_sensor")
    monkeypatch.setenv("DIFFTHRUST_CACHE", "off")
    shutil.copytree(SENSOR, fits / "deep" / "altered")
    altered = fits / "deep" / "altered" / "train.csv"
    altered.write_text(altered.read_text().replace("1.622", "1.662"))
    scripts = {
        "deadly": "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
        "loud": "print('x' * 9000)\nfrom diffthrust import LinearSensor",
    }
    for name, script in scripts.items():
        shutil.copytree(SENSOR, fits / name)
        (fits / name / "script.py").write_text(script)
        spec = fits / name / "fit.toml"
        spec.write_text(spec.read_text().replace('"linear_sensor"', '"script.py:LinearSensor"'))
    tasks = tasks_in(fits)
    assert [task.fit for task in tasks] == ["deadly", "deep/altered", "depth_sensor", "loud"]
    found = dict(run_all(tasks, 1))
    assert sorted(found) == [0, 1, 2, 3]
    (row,) = found[0].rows
    assert not row.ok
    assert "died (signal SIGKILL)" in str(row.found)
    for i in (1, 2, 3):
        here = run_again(*tasks[i])
        assert here.ok == found[i].ok == (i > 1)
        for mine, other in zip(here.rows, found[i].rows, strict=True):
            assert (mine.quantity, mine.ok) == (other.quantity, other.ok)
            assert other.found == (
                pytest.approx(mine.found, rel=1e-9) if mine.change is not None else mine.found
            )


def test_a_process_that_cannot_start_is_told_once(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.executable", shutil.which("false"))
    for name in "ab":
        shutil.copytree(SENSOR, tmp_path / name)
    with pytest.raises(InputError, match="cannot be started"):
        check(tmp_path, jobs=2)
