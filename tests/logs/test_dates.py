"""Dates that do not begin with the year are never guessed, and each mend works when followed."""

import re
from datetime import datetime, timedelta

import numpy as np
import pytest
from file_contents import contents
from text_readers import BadCell, many_dates, seconds_of

from diffthrust import Column, InputError, read_log
from diffthrust.specs import load_spec

SECONDS = [0.0, 0.5, 1.0, 2.5]


def write(tmp_path, stamps):
    rows = [f'"{stamp}";{k};{60 * k}' for k, stamp in enumerate(stamps)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["t;u;rpm", *rows, ""]))
    return path


def read(path, time="t"):
    return read_log(path, time=time, measured={"speed": Column("rpm", unit="rpm")})


def stamps(form, start="2025-03-21 10:00:00", seconds=SECONDS):
    moments = [datetime.fromisoformat(start) + timedelta(seconds=s) for s in seconds]
    return [m.strftime(form)[:-5] if form.endswith("%f") else m.strftime(form) for m in moments]


@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%d %H:%M:%S.%f",
        "%Y-%m-%dT%H:%M:%S,%f",
        "%Y/%m/%d %H:%M:%S.%f",
        "%Y.%m.%d %H:%M:%S.%f",
        "%Y-%m-%d %H:%M:%S.%f +01:00",
        "%Y-%m-%d %H:%M:%S.%f UTC",
    ],
)
def test_the_year_first_is_read(tmp_path, form):
    moments = [datetime(2025, 3, 21, 9, 59, 59) + timedelta(seconds=s) for s in SECONDS]
    log = read(write(tmp_path, [m.strftime(form) for m in moments]))
    np.testing.assert_allclose(log.time, SECONDS)
    assert "dates" in log.notes[0]


@pytest.mark.parametrize(
    ("form", "start", "formats"),
    [
        ("%d.%m.%Y %H:%M:%S.%f", "2025-03-21 10:00:00", 1),
        ("%d.%m.%Y %H:%M:%S,%f", "2025-03-21 10:00:00", 1),
        ("%m/%d/%Y %H:%M:%S.%f", "2025-03-21 10:00:00", 1),
        ("%d/%m/%Y %H:%M:%S.%f", "2025-04-03 10:00:00", 2),
        ("%d/%m/%y %H:%M:%S.%f", "2025-04-03 10:00:00", 3),
        ("%d-%b-%Y %H:%M:%S.%f", "2025-04-03 10:00:00", 1),
        ("%H:%M:%S.%f", "2025-04-03 10:00:00", 1),
        ("%H:%M:%S.%f", "2025-04-03 23:59:59", 1),
    ],
)
def test_another_order_is_told_and_the_mend_works(tmp_path, form, start, formats):
    path = write(tmp_path, stamps(form, start))
    with pytest.raises(InputError) as caught:
        read(path)
    assert "run.csv, line 2, column 't'" in caught.value.problem
    offered = re.findall(r"dates='([^']+)'", caught.value.mend)
    assert len(offered) == formats
    assert offered[0] == form
    np.testing.assert_allclose(read(path, Column("t", dates=offered[0])).time, SECONDS)
    for other in offered[1:]:  # readings that are as good, so the user must say
        assert read(path, Column("t", dates=other)).time.size == 4
    field = contents(path).fields[0]
    assert field.dates
    assert field.date_formats == tuple(offered)
    np.testing.assert_allclose(field.values, SECONDS)

    line = re.search(r"in a spec file (time = \{.*\})\.$", caught.value.mend)[1]
    spec = tmp_path / "fit.toml"
    text = 'model = "thruster"\n[logs]\ntrain = "run.csv"\n{}\n[channels]\ncommand = "u"\n'
    text += 'speed = {{ column = "rpm", unit = "rpm" }}\n'
    spec.write_text(text.format('time = "t"'))
    with pytest.raises(InputError, match=r"fit\.toml, line 4, logs\.time"):
        load_spec(spec).train_logs()
    spec.write_text(text.format(line))
    np.testing.assert_allclose(load_spec(spec).train_logs()[0].time, SECONDS)


def test_the_whole_column_tells_the_day_from_the_month(tmp_path):
    path = write(tmp_path, ["12/03/2025 23:59:59", "13/03/2025 00:00:00", "13/03/2025 00:00:01"])
    with pytest.raises(InputError) as caught:
        read(path)
    assert "%m/%d" not in caught.value.mend
    np.testing.assert_allclose(read(path, Column("t", dates="%d/%m/%Y %H:%M:%S")).time, [0, 1, 2])


def test_a_format_that_does_not_fit(tmp_path):
    path = write(tmp_path, [*stamps("%d.%m.%Y %H:%M:%S"), "n/a"])
    time = Column("t", dates="%d.%m.%Y %H:%M:%S")
    with pytest.raises(InputError, match=r"line 6, column 't': expected a date as in .* 'n/a'"):
        read(path, time)
    for wrong in ("%d.%m.%Y", "%Q", "%d.%m.%Y %H:%M:%S %"):
        with pytest.raises(InputError, match=r"expected a date as in") as caught:
            read(path, Column("t", dates=wrong))
        assert wrong in caught.value.mend
    with pytest.raises(InputError, match="for the time only"):
        read_log(path, time=time, measured={"speed": Column("rpm", dates="%d")})


@pytest.mark.parametrize("form", ["%d.%m.%Y %H:%M:%S.%f", "%H:%M:%S,%f", "%d-%b-%Y %H:%M:%S"])
def test_many_dates_read_as_few_do(monkeypatch, form):
    seconds = np.arange(0, 400, 7 if "%f" not in form else 6.5)
    moments = [datetime(2025, 3, 21, 23, 58) + timedelta(seconds=float(s)) for s in seconds]
    cells = [m.strftime(form) for m in moments]
    cells[3:5] = [None, "n/a"]
    few = seconds_of(cells, {"n/a"}, form)
    many_dates(monkeypatch)
    many = seconds_of(cells, {"n/a"}, form)
    np.testing.assert_allclose(many, few, atol=1e-9)
    seen = np.isfinite(many)
    assert np.flatnonzero(~seen).tolist() == [3, 4]
    np.testing.assert_allclose(many[seen], seconds[seen], atol=1e-9)
    with pytest.raises(BadCell) as caught:
        seconds_of([*cells[:6], "x", *cells[6:]], {"n/a"}, form)
    assert caught.value.index == 6
