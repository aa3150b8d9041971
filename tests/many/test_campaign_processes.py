"""The processes of a campaign: killed at the time limit, or dead, they take one task with them."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import pytest
from campaign_specs import SENSOR, sensor_spec
from processes import LineProcess, ProcessDied

import diffthrust as dft
from diffthrust.many._campaign.job import Job  # private: one task by itself
from diffthrust.many._campaign.task import helped, own_process  # private: its process

TRAP = """
import os, pathlib, signal, time
import diffthrust as dft
print("a model may print")
if pathlib.Path(__file__).with_name("hang").exists():
    time.sleep(60)
once = pathlib.Path(__file__).with_name("kill")
if once.exists():
    once.unlink()
    os.kill(os.getpid(), signal.SIGKILL)
class Own(dft.LinearSensor):
    name = "own"
"""


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
def test_a_process_that_hangs_or_dies_takes_no_other_task_with_it(tmp_path):
    for name in ("a", "b", "c"):
        folder = sensor_spec(tmp_path / "specs" / name, 0.1).parent
        (folder / "fit.toml").write_text(SENSOR.replace('"linear_sensor"', '"own.py:Own"'))
        (folder / "own.py").write_text(TRAP)
    (tmp_path / "specs" / "a" / "kill").write_text("")
    (tmp_path / "specs" / "b" / "hang").write_text("")
    with ThreadPoolExecutor(1) as thread:
        done = dft.many.campaign(
            tmp_path / "specs", output=tmp_path / "out", executor=thread, time_limit=10.0
        )
        pid = thread.submit(lambda: own_process().pid).result()
    assert list(done.table["status"]) == ["ok", "timed_out", "ok"]
    assert "10 s" in done.table["error"][1]
    assert done.table["slope"][2] == pytest.approx(0.1, abs=0.01)
    assert pid is not None
    with pytest.raises(ProcessLookupError):  # it ended with the thread that it belonged to
        os.kill(pid, 0)


def test_a_task_that_always_kills_its_process_is_lost(tmp_path):
    class Dead(LineProcess):
        def ask(self, question, limit=None):
            raise ProcessDied("signal SIGKILL, no memory")

    job = Job("a", "/x/fit.toml", str(tmp_path / "a"), "fit", time_limit=1.0)
    row = helped(Dead("none:none"), job)
    assert row["status"] == "lost"
    assert "died 3 times: signal SIGKILL, no memory." in row["error"]
