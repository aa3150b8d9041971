"""A library of an extra that is not installed: which one, and how to install it."""

import sys

import numpy as np
import pandas as pd  # before a case hides what it may work with
import pytest

import diffthrust as dft

SPEC = """model = "thruster"
logs.train = "run.csv"
channels.command = "u"
channels.speed = "y"
"""


def table(folder, ending):
    """The beginning of a file that would be read."""
    path = folder / f"run{ending}"
    path.write_bytes((b"PAR1" if ending == ".parquet" else b"PK\3\4") + b"\0" * 100)
    return path


def campaign(folder, **options):
    (folder / "fit.toml").write_text(SPEC)
    return dft.many.campaign(folder / "fit.toml", output=folder / "results", **options)


def read(path):
    return dft.read_log(path, measured={"speed": "y"})


CASES = {
    "a spreadsheet": ("openpyxl", "excel", lambda f: read(table(f, ".xlsx"))),
    "a Parquet log": ("pyarrow", "parquet", lambda f: read(table(f, ".parquet"))),
    "a campaign": ("pyarrow", "parquet", campaign),
    "its table": ("pyarrow", "parquet", lambda f: dft.many.fleet(table(f, ".parquet"))),
    "a cluster": ("distributed", "dask", lambda f: campaign(f, executor="tcp://127.0.0.1:9")),
    "results for CI": ("junitparser", "junit", lambda f: dft.checks.check(f, junit=f / "a.xml")),
}


@pytest.mark.parametrize(("library", "extra", "asked"), CASES.values(), ids=CASES)
def test_it_is_named_before_any_work(tmp_path, monkeypatch, library, extra, asked):
    for name in [name for name in sys.modules if name.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "diffthrust.checks._junit", raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(dft.InputError, match=f"needs {library}, which cannot be") as caught:
        asked(tmp_path)
    assert caught.value.mend.endswith(f"python -m pip install 'diffthrust[{extra}]'.")


def test_a_table_of_text_needs_none(tmp_path, monkeypatch):
    for library, *_ in CASES.values():
        monkeypatch.setitem(sys.modules, library, None)
    count = 200_000  # enough to be read by pandas
    frame = pd.DataFrame({"time": 0.1 * np.arange(count), "u": 1.0, "y": np.arange(count)})
    frame.to_csv(tmp_path / "run.csv", index=False)
    log = dft.read_log(tmp_path / "run.csv", inputs={"u": "u"}, measured={"y": "y"})
    assert log.measured["y"][-1] == count - 1
