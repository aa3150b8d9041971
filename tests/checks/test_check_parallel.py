"""Fits in processes: they agree with one process, stay with their like, and survive deaths."""

from __future__ import annotations

import os
import queue
import shutil
import threading

import pytest
from places import FITS
from processes import Worker, WorkerPool, own_worker

from diffthrust import InputError
from diffthrust.checks import check
from diffthrust.specs._file import compile_key  # private: no result shows it

SENSOR = FITS / "depth_sensor"


def test_few_fits_need_no_other_process(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setattr("sys.executable", shutil.which("false"))
    for name in "abc":
        (tmp_path / name).mkdir()
        (tmp_path / name / "fit.toml").write_text("")
    assert len(check(tmp_path).fits) == 3
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "fit.toml").write_text("")
    with pytest.raises(InputError, match="cannot be started"):
        check(tmp_path)
    with pytest.raises(InputError, match="at least 1"):
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
    names = [f"f{i}" for i in range(8)]
    submitted, begun = threading.Event(), queue.SimpleQueue()

    class Ready(Worker):
        """Without a process; ready when all tasks are there."""

        def start(self):
            submitted.wait(60.0)

    def work(name: str) -> None:
        go = threading.Event()
        begun.put((own_worker(), name, go))
        go.wait(60.0)

    def next_of(worker: Worker, last: threading.Event) -> tuple[str, threading.Event]:
        last.set()
        taker, name, go = begun.get(timeout=60.0)
        assert taker is worker
        return name, go

    workers = [Ready(work), Ready(work)]
    with WorkerPool(workers, lambda name: compile_key(tmp_path / name / "fit.toml")) as pool:
        futures = [pool.submit(work, name) for name in names]
        submitted.set()
        both = {name: (worker, go) for worker, name, go in (begun.get(timeout=60.0), begun.get())}
        assert set(both) == {"f0", "f1"}  # of the largest group, and of another one
        first, go = both["f0"]
        # f7, which nobody has begun, before it helps with f3
        for name in ("f2", "f5", "f6", "f7", "f3"):
            taken, go = next_of(first, go)
            assert taken == name
        last, go_last = next_of(*both["f1"])
        assert last == "f4"
        go.set(), go_last.set()
        assert [future.result(60.0) for future in futures] == [None] * 8
    with pytest.raises(RuntimeError, match="shutdown"):
        pool.submit(work, "f0")


@pytest.mark.thorough
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
    found = {run.fit: run for run in check(fits, jobs=2).runs}
    assert list(found) == ["deadly", "deep/altered", "depth_sensor", "loud"]
    (row,) = found["deadly"].rows
    assert not row.ok
    assert "died (signal SIGKILL)" in str(row.found)
    shutil.rmtree(fits / "deadly")
    for here in check(fits, jobs=1).runs:
        there = found[here.fit]
        assert here.ok == there.ok == (here.fit != "deep/altered")
        for mine, other in zip(here.rows, there.rows, strict=True):
            assert (mine.quantity, mine.ok) == (other.quantity, other.ok)
            assert other.found == (
                pytest.approx(mine.found, rel=1e-9) if mine.change is not None else mine.found
            )
