"""Campaigns: what is done once stays done, what is bad is a row, and nothing is half-written."""

from __future__ import annotations

import errno
import json
import os
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from pathlib import Path

import command_line
import numpy as np
import pandas as pd
import pytest
from campaign_specs import SENSOR, InPlace, sensor_log, sensor_spec
from processes import ProcessDied, Worker, own_worker

import diffthrust as dft
from diffthrust.many._campaign import campaign, task  # private: patched, for what goes wrong
from diffthrust.many._campaign.job import Job  # private: one task by itself
from diffthrust.many._campaign.task import helped, run_job  # private: its process
from diffthrust.specs import load_spec


@pytest.fixture
def dives(tmp_path: Path) -> Path:
    """A folder with three specs at different depths, and a TOML file that is none."""
    root = tmp_path / "dives"
    sensor_spec(root / "a", 0.1)
    sensor_spec(root / "b" / "first", 0.2)
    sensor_log(root / "b" / "train.csv", 0.3, 1.0)
    (root / "b" / "second.toml").write_text(SENSOR)
    (root / "pyproject.toml").write_text("[project]\n")
    return root


def ran(dives: Path, **kwargs):
    """A campaign in place, and the names of the tasks that it did."""
    executor = kwargs.pop("executor", None) or InPlace()
    out = kwargs.pop("output", dives.parent / "out")
    done = dft.many.campaign(dives, output=out, executor=executor, **kwargs)
    assert not list(out.glob(".*")), "something half-written was left"
    return done, getattr(executor, "done", None)


def test_each_spec_has_its_folder_and_its_row(dives):
    told = []
    done, names = ran(dives, progress=lambda message, share: told.append((message, share)))
    assert names == ["a", "b/second", "b/first"]
    table = pd.read_parquet(done.path)
    pd.testing.assert_frame_equal(table, done.table)
    assert list(table["name"]) == ["a", "b/first", "b/second"]
    assert list(table["folder"]) == ["a", "b__first", "b__second"]
    assert done.counts == {"ok": 3}
    for row, spec in zip(table.itertuples(), ("a", "b/first", "b/second.toml"), strict=True):
        fit = load_spec(dives / spec).fit()
        data = json.loads((done.output / row.folder / "fit.json").read_text())
        assert data["parameters"]["slope"]["value"] == row.slope == fit.parameters["slope"].value
        assert row.slope_std_error == fit.parameters["slope"].std_error
        assert row.train_nrmse == fit.train.nrmse
        assert row.fit_status == fit.status.value
    assert told[-1] == ("3 of 3 done", 1.0)
    assert any("left" in message for message, _ in told)
    assert "3 specs" in done.report()
    json.dumps(done.to_json(), allow_nan=False)


def test_what_is_done_is_not_done_again(dives):
    ran(dives)
    before = {p: p.stat().st_mtime_ns for p in (dives.parent / "out").rglob("*.json")}
    done, names = ran(dives)
    assert names == []
    assert done.kept == 3
    assert before == {p: p.stat().st_mtime_ns for p in before}
    again = dft.many.campaign([dives / "a", dives / "b"], output=done.output, executor=InPlace())
    assert again.table.equals(done.table)


@pytest.mark.parametrize("what", ["log", "spec", "result", "status", "page"])
def test_what_changed_is_done_again(dives, what):
    done, _ = ran(dives)
    folder, kwargs, expected = done.output / "a", {}, ["a"]
    if what == "log":
        sensor_log(dives / "a" / "train.csv", 0.4, 1.0)
    elif what == "spec":
        (dives / "a" / "fit.toml").write_text(SENSOR + "[fit]\nstarts = 2\n")
    elif what == "result":
        (folder / "fit.json").unlink()
    elif what == "status":
        (folder / "status.json").write_text("{")
    else:
        kwargs, expected = {"report": True}, ["a", "b/second", "b/first"]
    done, names = ran(dives, **kwargs)
    assert names == expected
    assert done.table["slope"][0] == pytest.approx(0.4 if what == "log" else 0.1, abs=0.01)
    assert (folder / "report.html").exists() == (what == "page")


def own_script(dives: Path) -> Path:
    """The script of a user's own model, which the first spec names."""
    spec = dives / "a" / "fit.toml"
    spec.write_text(SENSOR.replace('"linear_sensor"', '"own.py:Own"'))
    script = dives / "a" / "own.py"
    script.write_text("import diffthrust as dft\nclass Own(dft.LinearSensor): name = 'own'\n")
    return script


def test_a_script_that_a_spec_names_counts(dives):
    script = own_script(dives)
    done, _ = ran(dives)
    assert done.table["model"][0] == "own"
    script.write_text(script.read_text() + "\n")
    assert ran(dives)[1] == ["a"]


def test_what_is_changed_while_it_is_worked_on_is_no_result(dives, monkeypatch):
    script, fitted = own_script(dives), task._TASKS["fit"]

    def edited(spec, job):
        result = fitted(spec, job)
        if job.name == "a":
            script.write_text(script.read_text() + "MARK = 1\n")
        return result

    with monkeypatch.context() as patched:
        patched.setitem(task._TASKS, "fit", edited)
        done, names = ran(dives)
    row = list(done.table["name"]).index("a")
    assert done.table["status"][row] == "failed"
    assert "was changed while it was worked on" in done.table["error"][row]
    done, names = ran(dives)
    assert (names, done.table["status"][row]) == (["a"], "ok")


def test_bad_specs_and_logs_are_rows_and_are_tried_again(dives):
    (dives / "a" / "train.csv").write_text("depth_m,reading_V\n1,x\n")
    (dives / "broken.toml").write_text("model = [")
    (dives / "latin.toml").write_bytes(b"model = '\xff'")
    (dives / "no_log.toml").write_text(SENSOR.replace("train.csv", "none.csv"))
    done, _ = ran(dives)
    assert done.counts == {"ok": 2, "failed": 4}
    assert not done.ok
    errors = done.table.set_index("name")["error"]
    for name, words in {
        "a": ["train.csv", "line 2", "'x'"],
        "broken": ["broken.toml, line 1", "TOML"],
        "latin": ["UTF-8"],
        "no_log": ["none.csv"],
    }.items():
        assert all(word in errors[name] for word in words), errors[name]
        row = json.loads((done.output / name / "status.json").read_text())["row"]
        assert row["mend"]
        assert f"{name}: failed" in done.report()
    sensor_log(dives / "a" / "train.csv", 0.1, 1.0)
    done, names = ran(dives)
    assert sorted(names) == ["a", "broken", "latin", "no_log"]
    assert done.counts == {"ok": 3, "failed": 3}


def test_a_result_that_went_bad_is_not_kept(dives):
    done, _ = ran(dives)
    (dives / "a" / "train.csv").unlink()
    done, _ = ran(dives)
    assert [p.name for p in (done.output / "a").iterdir()] == ["status.json"]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow text alone")
def test_names_that_are_no_text_have_rows_too(dives):
    (dives / "a").rename(dives / os.fsdecode(b"a\xff"))
    (dives / os.fsdecode(b"b\xff.toml")).write_text("model = [")
    done, _ = ran(dives)
    assert done.counts == {"ok": 3, "failed": 1}
    assert list(done.table["name"])[:2] == ["a\\xff", "b/first"]
    assert "b\\xff.toml, line 1" in " ".join(done.report().split())
    assert ran(dives)[0].kept == 3


def test_a_defect_is_a_row(dives, monkeypatch):
    monkeypatch.setattr("diffthrust.specs._spec.Spec.fit", lambda *_, **__: 1 / 0)
    done, _ = ran(dives)
    assert done.counts == {"failed": 3}
    assert "ZeroDivisionError" in done.table["error"][0]


@pytest.mark.parametrize("stop", [0, 2])
def test_stopped_and_continued(dives, stop):
    out = dives.parent / "out"
    with pytest.raises(KeyboardInterrupt, match=f"{stop} of 3 specs are done"):
        dft.many.campaign(dives, output=out, executor=InPlace(stop, KeyboardInterrupt()))
    assert len(pd.read_parquet(out / "campaign.parquet")) == stop
    done, names = ran(dives)
    assert (done.kept, len(names)) == (stop, 3 - stop)
    assert done.counts == {"ok": 3}


def test_lost_workers_are_rows_and_the_next_campaign_goes_on(dives):
    done, _ = ran(dives, executor=InPlace(1, BrokenProcessPool("a process died")))
    assert done.counts == {"ok": 1, "lost": 2}
    assert "a process died" in done.table["error"][2]
    done, names = ran(dives)
    assert len(names) == 2
    assert done.ok


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_a_row_and_loses_nothing(dives, monkeypatch):
    done, _ = ran(dives)
    before = (done.output / "a" / "fit.json").read_bytes()
    sensor_log(dives / "a" / "train.csv", 0.4, 1.0)
    write = task.write_json

    def half(path, data):
        path.write_text("{")
        if path.name == "status.json":
            full_disk()
        write(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(task, "write_json", half)
        done, names = ran(dives)
    assert names == ["a"]
    assert done.counts == {"failed": 1, "ok": 2}
    assert "No space left" in done.table["error"][0]
    assert (done.output / "a" / "fit.json").read_bytes() == before
    assert ran(dives)[0].ok


def test_what_failed_holds_no_memory_while_its_row_is_written(dives, monkeypatch):
    made, left = [], []

    def greedy(*_):
        array = np.ones(3)
        made.append(weakref.ref(array))
        raise MemoryError

    monkeypatch.setitem(task._TASKS, "fit", greedy)
    monkeypatch.setattr(task, "store", lambda *_: left.append(made[-1]() is not None))
    done, _ = ran(dives)
    assert done.counts == {"failed": 3}
    assert left == [False] * 3


def test_a_table_that_cannot_be_written_is_an_error_at_once(dives, monkeypatch):
    done, _ = ran(dives)
    before = done.path.read_bytes()
    (dives / "a" / "fit.toml").write_text(SENSOR + "[fit]\nseed = 1\n")
    monkeypatch.setattr(os, "replace", full_disk)
    executor = InPlace()
    with pytest.raises(dft.InputError, match="table of the campaign cannot be written"):
        dft.many.campaign(dives, output=done.output, executor=executor)
    assert executor.done == []
    assert done.path.read_bytes() == before


def test_bad_input_is_told_before_the_work(dives):
    out = dives.parent / "out"

    def refused(*specs, **kwargs) -> str:
        executor = InPlace()
        with pytest.raises(dft.InputError) as told:
            dft.many.campaign(specs or dives, **{"output": out, "executor": executor, **kwargs})
        assert executor.done == []
        assert told.value.mend
        return told.value.problem

    assert "nowhere" in refused(dives / "nowhere")
    assert "train.csv" in refused(dives / "a" / "train.csv")
    (dives / "empty").mkdir()
    assert "found none" in refused(dives / "empty")
    assert "'fti'" in refused(task="fti")
    assert "'candidats'; the nearest is" in refused(task="diagnose", candidats=["x"])
    assert "candidates" in refused(task="diagnose", candidates="actuator_lag")
    assert "draws" in refused(task="sample", draws=3)
    assert "time_limit" in refused(time_limit=0)
    assert "int" in refused(executor=3)
    assert "jobs" in refused(jobs=2)
    assert "jobs" in refused(executor=None, jobs=0)
    (dives / "file").write_text("")
    assert "file" in refused(output=dives / "file")
    (dives / "a.toml").write_text(SENSOR)
    both = refused()
    assert str(dives / "a.toml") in both
    assert str(dives / "a" / "fit.toml") in both


def test_a_folder_of_other_results_is_refused(dives):
    done, _ = ran(dives)
    with pytest.raises(dft.InputError, match="'fit'"):
        ran(dives, task="diagnose")
    sensor_spec(dives.parent / "others" / "a", 0.1)
    with pytest.raises(dft.InputError, match="others"):
        ran(dives.parent / "others", output=done.output)
    dives.rename(dives.parent / "moved")
    done, names = ran(dives.parent / "moved", output=done.output)
    assert names == []
    assert "moved" in done.table["spec"][0]


@pytest.mark.thorough
def test_a_cluster_that_is_not_there(dives):
    pytest.importorskip("distributed")
    with pytest.raises(dft.InputError, match=r"no Dask scheduler .* 'tcp://127\.0\.0\.1:9'"):
        ran(dives, executor="tcp://127.0.0.1:9")
    with pytest.raises(dft.InputError, match="no Dask scheduler"):
        ran(dives, executor="nonsense")


def test_the_command(dives, monkeypatch):
    monkeypatch.setattr(campaign, "executor_for", lambda *_: nullcontext(InPlace()))
    monkeypatch.setenv("DIFFTHRUST_CACHE", "off")
    monkeypatch.chdir(dives.parent)

    def run(*words: str, status: int):
        return command_line.run("campaign", "dives", *words, status=status)

    result = run("--json", "c.json", status=0)
    assert "campaign.parquet" in result.stdout
    assert "3 done" in result.stdout
    assert json.loads(Path("c.json").read_text())["counts"] == {"ok": 3}
    (dives / "broken.toml").write_text("model = [")
    result = run(status=1)
    assert "broken: failed" in result.stdout
    assert "Mend:" in result.stdout
    assert "another output folder" in run("--task", "diagnose", status=2).stderr
    assert "candidates" in run("--candidates", "x", status=2).stderr


def test_workers_that_end_while_they_write_leave_nothing(dives, monkeypatch):
    """As where a full disk refuses the table: the workers of this machine end with the campaign."""
    left = dives.parent / "out" / f".a.{32 * '0'}.tmp"

    def ended(*_):
        left.mkdir()
        raise dft.InputError("The table cannot be written.", "Make room.")

    monkeypatch.setattr(campaign, "_run", ended)
    with pytest.raises(dft.InputError, match="table cannot be written"):
        ran(dives)
    assert not left.exists()


TRAP = """
import os, pathlib, signal, time
import diffthrust as dft
print("a model may print")
if pathlib.Path(__file__).with_name("hang").exists():
    time.sleep(3600)
once = pathlib.Path(__file__).with_name("kill")
if once.exists():
    once.unlink()
    os.kill(os.getpid(), signal.SIGKILL)
class Own(dft.LinearSensor):
    name = "own"
"""


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
def test_a_process_that_hangs_or_dies_takes_no_other_task_with_it(tmp_path):
    for name in ("a", "b", "c"):
        folder = sensor_spec(tmp_path / "specs" / name, 0.1).parent
        (folder / "fit.toml").write_text(SENSOR.replace('"linear_sensor"', '"own.py:Own"'))
        (folder / "own.py").write_text(TRAP)
    (tmp_path / "specs" / "a" / "kill").write_text("")
    (tmp_path / "specs" / "b" / "hang").write_text("")
    # A sound task takes a second on a machine of its own, and a minute where many share one: the
    # limit is more than twice what it takes now, in a process that compiles what theirs will find.
    alone = dft.many.campaign(tmp_path / "specs" / "c", output=tmp_path / "alone", jobs=1)
    limit = 10.0 + 2.0 * alone.table["seconds"][0]
    with ThreadPoolExecutor(1) as thread:
        done = dft.many.campaign(
            tmp_path / "specs", output=tmp_path / "out", executor=thread, time_limit=limit
        )
        pid = thread.submit(lambda: own_worker().pid).result()
    assert list(done.table["status"]) == ["ok", "timed_out", "ok"]
    assert f"{limit:g} s" in done.table["error"][1]
    assert done.table["slope"][2] == pytest.approx(0.1, abs=0.01)
    assert pid is not None
    with pytest.raises(ProcessLookupError):  # it ended with the thread that it belonged to
        os.kill(pid, 0)


def test_a_task_that_always_kills_its_process_is_lost(tmp_path):
    class Dead(Worker):
        def ask(self, *arguments, limit=None):
            raise ProcessDied("signal SIGKILL, no memory")

    job = Job("a", "/x/fit.toml", str(tmp_path / "a"), "fit", time_limit=1.0)
    row = helped(Dead(run_job), job)
    assert row["status"] == "lost"
    assert "died 3 times: signal SIGKILL, no memory." in row["error"]
