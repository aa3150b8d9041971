"""Campaigns on Dask and on processes of this machine, of which some are killed on the way."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import active_children, get_context
from pathlib import Path

import pandas as pd
import pytest
from campaign_specs import CANDIDATES, InPlace, sensor_spec, thruster_spec

import diffthrust as dft

distributed = pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")  # comes with it
pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="needs SIGKILL")]
COUNT = int(os.environ.get("CAMPAIGN_COUNT", "200"))


class Nothing(Executor):
    """An executor that must not be asked."""

    def submit(self, fn, /, *args, **kwargs):
        raise AssertionError("there was nothing to do")


def results(output: Path) -> dict[str, bytes]:
    return {p.parent.name: p.read_bytes() for p in output.glob("*/diagnosis.json")}


def diagnosed(specs: Path, output: Path, **kwargs) -> dft.many.Campaign:
    return dft.many.campaign(specs, task="diagnose", candidates=CANDIDATES, output=output, **kwargs)


def untimed(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=["seconds"])


@pytest.fixture(scope="module")
def serial(tmp_path_factory) -> dft.many.Campaign:
    """The specs, every second thruster with a deadband, and their diagnoses one by one."""
    root = tmp_path_factory.mktemp("serial")
    for seed in range(COUNT):
        thruster_spec(root / "specs" / f"{seed:03d}", seed)
    done = diagnosed(root / "specs", root / "out", executor=InPlace())
    print(f"serial: {done.summary}")
    return done


@pytest.mark.parametrize("workers", [2, 4])
def test_a_campaign_on_dask_of_which_a_worker_is_killed(serial, workers, tmp_path):
    specs, killed = serial.output.parent / "specs", []
    with (
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        address = cluster.scheduler_address

        def kill(message: str, share: float) -> None:
            if share >= 0.5 and not killed:
                killed.append(client.run(os.getpid).popitem()[1])
                os.kill(killed[0], signal.SIGKILL)

        done = diagnosed(specs, tmp_path / "out", executor=address, progress=kill)
        assert killed
        assert killed[0] not in client.run(os.getpid).values()
    print(f"{workers} workers, one killed: {done.summary}")
    assert done.counts == {"ok": COUNT}
    assert done.table["name"].is_unique
    assert set(done.table["verdict"]) == {"adequate", "effects_found"}
    assert results(done.output) == results(serial.output)
    pd.testing.assert_frame_equal(untimed(done.table), untimed(serial.table))
    pd.testing.assert_frame_equal(pd.read_parquet(done.path), done.table)
    assert not list(done.output.glob(".*"))

    before = {path: path.stat().st_mtime_ns for path in done.output.glob("*/*")}
    again = diagnosed(specs, done.output, executor=Nothing())
    assert again.kept == COUNT
    assert before == {path: path.stat().st_mtime_ns for path in done.output.glob("*/*")}
    assert again.table.equals(done.table)


@pytest.fixture
def scheduler():
    """A scheduler of its own process, and its address."""
    address = "tcp://127.0.0.1:8797"
    words = ["scheduler", "--host", "127.0.0.1", "--port", "8797", "--no-dashboard"]
    running = dask(*words)
    for _ in range(100):
        with suppress(OSError), distributed.Client(address, timeout=1.0, set_as_default=False):
            break
    yield running, address
    running.kill()
    running.wait()


def dask(*words: str) -> subprocess.Popen[bytes]:
    program = [sys.executable, "-m", "dask", *words]
    return subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def test_a_scheduler_without_workers_is_told_and_one_that_dies_loses_nothing(scheduler, fits):
    running, address = scheduler
    with pytest.raises(dft.InputError, match="has no workers"):
        dft.many.campaign(fits / "specs", output=fits / "out", executor=address)

    def kill(message: str, share: float) -> None:
        if share > 0.1:
            running.kill()

    worker = dask("worker", address, "--nthreads", "2", "--no-dashboard")
    try:
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=60)
        done = dft.many.campaign(
            fits / "specs", output=fits / "out", executor=address, progress=kill
        )
    finally:
        worker.terminate()
        worker.wait()
    assert set(done.counts) == {"ok", "lost"}
    again = dft.many.campaign(fits / "specs", output=fits / "out", executor=InPlace())
    assert again.counts == {"ok": 300}
    assert again.kept >= done.counts["ok"]


@pytest.fixture
def fits(tmp_path: Path) -> Path:
    for i in range(300):
        sensor_spec(tmp_path / "specs" / f"{i:03d}", 0.1 + 0.001 * i)
    return tmp_path


def command(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", "from diffthrust.cli._app import main; main()", "campaign", "specs",
         "--output", "out", "--json", "c.json", *words],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def until_done(folder: Path, count: int) -> None:
    end = time.monotonic() + 120
    while len(list((folder / "out").glob("*/fit.json"))) < count:
        assert time.monotonic() < end
        time.sleep(0.02)


def helpers_of(pid: int) -> list[int]:
    return [child.pid for child in psutil.Process(pid).children()]


def alive(pid: int) -> bool:
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


def test_a_process_that_is_killed_loses_nothing(fits):
    running = command(fits, "--jobs", "2")
    until_done(fits, 20)
    os.kill(helpers_of(running.pid)[0], signal.SIGKILL)
    out, err = running.communicate(timeout=300)
    assert running.returncode == 0, out + err
    assert json.loads((fits / "c.json").read_text())["counts"] == {"ok": 300}
    table = pd.read_parquet(fits / "out" / "campaign.parquet")
    assert len(table) == 300
    assert table["slope"].is_monotonic_increasing


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_campaign_that_is_stopped_goes_on_where_it_was(fits, how):
    running = command(fits, "--jobs", "2")
    until_done(fits, 20)
    helpers = helpers_of(running.pid)
    running.send_signal(how)
    _, err = running.communicate(timeout=60)
    if how == signal.SIGINT:
        assert running.returncode == 130
        assert "continues from there" in err
    end = time.monotonic() + 20
    while any(map(alive, helpers)):
        assert time.monotonic() < end, "a process outlived the campaign"
        time.sleep(0.1)
    whole = {path.parent for path in (fits / "out").glob("*/status.json")}
    assert {p for p in (fits / "out").iterdir() if p.is_dir() and p.name[0] != "."} == whole
    running = command(fits)
    out, err = running.communicate(timeout=300)
    assert running.returncode == 0, out + err
    told = json.loads((fits / "c.json").read_text())
    assert told["counts"] == {"ok": 300}
    assert 20 <= told["kept"] == len(whole)
    assert not list((fits / "out").glob(".*"))


def test_a_pool_of_processes_that_breaks_is_told_and_continued(fits):
    def kill(message: str, share: float) -> None:
        if share > 0.1:
            for process in active_children():
                process.kill()

    for path in list((fits / "specs").iterdir())[60:]:
        shutil.rmtree(path)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        done = dft.many.campaign(fits / "specs", output=fits / "out", executor=pool, progress=kill)
    assert set(done.counts) == {"ok", "lost"}
    assert "BrokenProcessPool" in done.table.set_index("status")["error"]["lost"].iloc[0]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        again = dft.many.campaign(fits / "specs", output=fits / "out", executor=pool)
    assert again.counts == {"ok": 60}
    assert again.kept == done.counts["ok"]


def test_sampling_every_spec(tmp_path):
    for i in range(2):
        sensor_spec(tmp_path / "specs" / str(i), 0.1 + 0.1 * i)
    done = dft.many.campaign(
        tmp_path / "specs",
        task="sample",
        draws=200,
        warmup=100,
        output=tmp_path / "out",
        executor=InPlace(),
        report=True,
    )
    assert done.ok, done.report()
    for row in done.rows:
        told = json.loads((done.output / row["folder"] / "posterior.json").read_text())
        assert row["numbers"]["slope"][0] == told["parameters"]["slope"]["median"]
        assert (done.output / row["folder"] / "report.html").stat().st_size > 10_000
    assert "Chains" in done.report()
