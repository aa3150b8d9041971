"""Public data sets: from a local folder, or downloaded once and compared ever after."""

import os
import threading
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import openpyxl
import pytest
from command_line import run

from diffthrust import InputError, datasets
from diffthrust.datasets import _blueboat as blueboat_module  # private: its record is exchanged
from diffthrust.datasets import _catalogue, _fetch  # private: fetching from elsewhere
from tests.shared_data import data_folder

CONTENT = b"t,u\n0,1\n1,2\n"
HEADER = "original_timestamp,surge,sway,yaw_rate,left_force,right_force\n"


@pytest.fixture(autouse=True)
def own_folders(tmp_path, monkeypatch):
    """No test reads the user's data or writes into the user's cache."""
    monkeypatch.delenv("DIFFTHRUST_DATA", raising=False)
    monkeypatch.setenv("DIFFTHRUST_CACHE", str(tmp_path / "cache"))


@contextmanager
def served(files, cut=()):
    """A server on this machine that holds some files, and stops halfway through those in cut."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            name = self.path.lstrip("/")
            if name not in files:
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Length", str(len(files[name])))
            self.end_headers()
            self.wfile.write(files[name][: len(files[name]) // 2] if name in cut else files[name])

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/{{commit}}/{{path}}", asked
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def small(address, checksum=None):
    file = datasets.DataFile("run_1.csv", "data/raw_1.csv", "abc123", checksum)
    return replace(blueboat_module.BLUEBOAT, name="small", files=(file,), address=address)


def left(tmp_path):
    return sorted(p.name for p in (tmp_path / "cache" / "datasets" / "small").iterdir())


@pytest.mark.parametrize("checksum", [None, sha256(CONTENT).hexdigest()], ids=["first", "known"])
def test_a_file_is_downloaded_once(tmp_path, checksum):
    with served({"abc123/data/raw_1.csv": CONTENT}) as (address, asked):
        for _ in range(3):
            path = _fetch.located(small(address, checksum))["run_1.csv"]
            assert path.read_bytes() == CONTENT
        assert asked == ["/abc123/data/raw_1.csv"]
    assert left(tmp_path) == ["run_1.csv"] + (["sha256.json"] if checksum is None else [])


@pytest.mark.skipif(os.name == "nt", reason="has no such permissions")
def test_a_downloaded_file_can_be_read_by_others(tmp_path):
    """Caches are often shared, also by those whose own files are for nobody else."""
    before = os.umask(0o077)
    try:
        with served({"abc123/data/raw_1.csv": CONTENT}) as (address, _):
            path = _fetch.located(small(address))["run_1.csv"]
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o644


def test_half_a_download_is_no_file(tmp_path):
    name = "abc123/data/raw_1.csv"
    refused = pytest.raises(InputError, match=r"run_1\.csv cannot be downloaded")
    with served({name: CONTENT * 1000}, cut={name}) as (address, _), refused:
        _fetch.located(small(address))
    assert left(tmp_path) == []


@pytest.mark.parametrize("known", [True, False])
def test_a_file_that_changed_on_the_server_is_refused(tmp_path, known):
    was, now = (sha256(c).hexdigest() for c in (CONTENT, CONTENT + b"2,3\n"))
    files = {"abc123/data/raw_1.csv": CONTENT}
    with served(files) as (address, _):
        about = small(address, was if known else None)
        path = _fetch.located(about)["run_1.csv"]
        path.unlink()
        files["abc123/data/raw_1.csv"] = CONTENT + b"2,3\n"
        with pytest.raises(InputError) as caught:
            _fetch.located(about)
        assert f"expected the sha256 {was}, found {now}" in caught.value.problem
        assert not path.exists()
        files["abc123/data/raw_1.csv"] = CONTENT
        assert _fetch.located(about)["run_1.csv"] == path


def test_a_file_that_changed_on_this_machine_is_refused():
    with served({"abc123/data/raw_1.csv": CONTENT}) as (address, _):
        about = small(address)
        path = _fetch.located(about)["run_1.csv"]
        path.write_bytes(b"else")
        with pytest.raises(InputError, match="has changed since it was downloaded") as caught:
            _fetch.located(about)
        assert sha256(CONTENT).hexdigest() in str(caught.value)
        path.unlink()
        assert _fetch.located(about)["run_1.csv"].read_bytes() == CONTENT


@pytest.mark.parametrize("served_at_all", [True, False])
def test_no_network_gives_one_message_with_the_mend(served_at_all):
    with served({}) as (address, _):
        if served_at_all:  # but not this file
            with pytest.raises(InputError, match="404") as caught:
                _fetch.located(small(address))
    if not served_at_all:
        with pytest.raises(InputError) as caught:
            _fetch.located(small(address))
    assert "small" in caught.value.problem
    assert address.format(commit="abc123", path="data/raw_1.csv") in caught.value.problem
    assert "set DIFFTHRUST_DATA to a folder that holds small/run_1.csv" in caught.value.mend


def test_recorded_sums_that_cannot_be_read(tmp_path):
    folder = tmp_path / "cache" / "datasets" / "small"
    folder.mkdir(parents=True)
    (folder / "sha256.json").write_text("{")
    with pytest.raises(InputError, match="recorded checksums cannot be read"):
        _fetch.located(small("http://127.0.0.1:9/{commit}/{path}"))


def test_a_folder_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_DATA", str(tmp_path / "mine"))
    with pytest.raises(InputError, match="there is no such folder"):
        datasets.blueboat("run_216")
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError, match="it has no folder 'blueboat'"):
        datasets.blueboat("run_216")
    folder = tmp_path / "mine" / "blueboat"
    folder.mkdir()
    (folder / "run_261.csv").write_text("")
    with pytest.raises(InputError, match="no such file; the nearest is 'run_261") as caught:
        datasets.blueboat("run_216")
    assert str(folder / "run_216.csv") in caught.value.problem
    assert "unset DIFFTHRUST_DATA" in caught.value.mend


def test_the_repository_s_files_are_read_as_well_as_rounded_copies(monkeypatch):
    """Those of the repository have an unnamed index column before the others."""
    rows = ["1444243.083,0.1,0.2,0.3,1,2", "1444343.083,,,,1,2"]
    local = HEADER + "".join(f"{row}\n" for row in rows)
    upstream = "," + HEADER + "".join(f"{i},{row}\n" for i, row in enumerate(rows))
    commit = blueboat_module.BLUEBOAT.files[0].commit
    for text in (local, upstream):
        with served({f"{commit}/sorted_data/fixed_00000228.csv": text.encode()}) as (address, _):
            about = replace(blueboat_module.BLUEBOAT, address=address)
            monkeypatch.setattr(blueboat_module, "BLUEBOAT", about)
            runs = datasets.blueboat("run_228")
        log = runs["run_228"]
        np.testing.assert_allclose(log.time - log.time[0], [0, 0.1])
        np.testing.assert_array_equal(log.measured["surge"], [0.1, np.nan])
        assert runs.unseen == (log,)
        assert runs.train == ()
        (_fetch.place(about) / "run_228.csv").unlink()
        (_fetch.place(about) / "sha256.json").unlink()


@pytest.mark.parametrize("name", ["ngs_thruster", "t200"])
def test_sets_that_cannot_be_downloaded_say_so(name):
    with pytest.raises(InputError, match="read from a local folder only") as caught:
        getattr(datasets, name)()
    assert "DIFFTHRUST_DATA" in caught.value.mend


@pytest.mark.parametrize("about", datasets.list(), ids=lambda about: about.name)
def test_every_set_tells_whose_it_is(about):
    assert about.licence
    assert about.citation
    assert about.defects
    assert about.homepage.startswith("https://")
    assert len({file.name for file in about.files}) == len(about.files)
    assert bool(about.address) != bool(about.local_only)
    for file in about.files if about.address else ():
        address = about.address.format(commit=file.commit, path=file.path)
        assert len(file.commit) == 40
        assert address.startswith("https://raw.githubusercontent.com/")
        assert address.endswith(".csv")
    loader = getattr(datasets, about.name)
    for part in ("Source:", "Known defects:", "Raises:", "Example:"):
        assert part in loader.__doc__
    with pytest.raises(InputError, match="expected names of logs, found 'runn'"):
        loader("runn")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "count", "train", "unseen"),
    [
        ("ngs_thruster", 26, 12, 6),
        ("blueboat", 12, 9, 3),
        ("esso_osaka", 27, 9, 6),
        ("emps", 2, 1, 1),
    ],
)
def test_measured_logs(monkeypatch, name, count, train, unseen):
    folder = data_folder(name)
    monkeypatch.setenv("DIFFTHRUST_DATA", str(folder.parent))
    runs = getattr(datasets, name)()
    assert list(runs.logs) == sorted(runs.logs, key=list(runs.logs).index)
    assert len(runs.logs) == len(list(folder.glob("*.csv"))) == count
    assert (len(runs.train), len(runs.unseen)) == (train, unseen)
    assert not set(runs.train) & set(runs.unseen)
    assert all(unit for log in runs.logs.values() for unit in log.units.values())
    assert datasets.fetch(name) == folder


def test_splits_are_those_that_figures_refer_to(monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_DATA", str(data_folder("esso_osaka").parent))
    names = sorted(p.stem for p in data_folder("esso_osaka").glob("*.csv"))
    zigzag, cut, september, october = (
        [n for n in names if n.startswith(word)]
        for word in ("zigzag", "turn_cut", "turn_14-Sep", "turn_14-Oct")
    )
    runs = datasets.esso_osaka([*zigzag, *cut, *september, *october])
    assert [log.name for log in runs.train] == [
        f"{n}.csv" for n in (*zigzag[:5], *cut, *september[:2])
    ]
    assert [log.name for log in runs.unseen] == [f"{n}.csv" for n in (*zigzag[5:], *october[:4])]
    assert max(log.duration for log in runs.logs.values()) <= 150.0 + 1e-6
    assert datasets.esso_osaka(zigzag[0], stop=None)[zigzag[0]].duration >= 140
    with pytest.raises(InputError, match="expected the name of a log"):
        runs["zigzag"]


def test_the_static_map_of_six_voltages(monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_DATA", str(data_folder("t200").parent))
    runs = datasets.t200()
    assert list(runs.logs) == ["10V", "12V", "14V", "16V", "18V", "20V"]
    for name, log in runs.logs.items():
        assert len(log) == 201
        np.testing.assert_allclose(log.values("supply_voltage", "V"), float(name[:-1]))
        np.testing.assert_allclose(log.values("pulse_width", "us"), np.arange(1100, 1901, 4))
        assert log.unsigned == {"speed"}
    twelve = runs["12V"]
    assert twelve.measured["thrust"][0] == pytest.approx(-2.90374478666667 * 9.80665)
    assert twelve.values("speed", "rpm")[0] == pytest.approx(2975.71166666667)


def test_a_spreadsheet_of_another_kind(tmp_path, monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_DATA", str(tmp_path))
    (tmp_path / "t200").mkdir()
    path = tmp_path / "t200" / "T200-Public-Performance-Data-10-20V-September-2019.xlsx"
    path.write_bytes(b"no spreadsheet")
    with pytest.raises(InputError, match="cannot be read"):
        datasets.t200()
    book = openpyxl.Workbook()
    book.active.title = "10 V"
    book.active.append(["PWM (µs)", " RPM"])
    book.save(path)
    with pytest.raises(InputError, match=r"sheet '10 V': expected a column 'Voltage \(V\)'"):
        datasets.t200("10V")
    with pytest.raises(InputError, match="expected a sheet '12 V', found '10 V'"):
        datasets.t200("12V")


def test_command_line(tmp_path, monkeypatch):
    listed = run("datasets")
    assert all(about.name in listed.output for about in datasets.list())
    with served({"abc123/data/raw_1.csv": CONTENT}) as (address, _):
        monkeypatch.setattr(_catalogue, "list", lambda: (small(address),))
        monkeypatch.setattr(datasets, "list", lambda: (small(address),))
        fetched = run("datasets", "small")
    assert "small" in fetched.output
    assert (tmp_path / "cache" / "datasets" / "small" / "run_1.csv").is_file()
    assert "the nearest is 'small'" in run("datasets", "smal", status=2).output
