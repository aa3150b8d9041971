"""Fits in processes: they agree with one process, and survive deaths."""

from __future__ import annotations

import os
import shutil

import pytest
from places import FITS

from diffthrust import InputError
from diffthrust.checks import check

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
