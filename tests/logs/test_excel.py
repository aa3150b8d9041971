"""Excel's files, written by XlsxWriter and openpyxl, are read as a stranger keeps them."""

import zipfile
from datetime import datetime, time, timedelta

import numpy as np
import openpyxl
import pytest
import xlsxwriter
from file_contents import contents

from diffthrust import Column, InputError, read_log
from tests.damaged_files import outcomes

ROWS = [(k / 10, k % 3, 60.0 + k) for k in range(12)]
HEAD = ("t", "u", "rpm")


def book(path, **sheets):
    """Write a book with XlsxWriter: by sheet its rows, a cell at a time."""
    with xlsxwriter.Workbook(path, {"default_date_format": "dd/mm/yyyy hh:mm:ss"}) as workbook:
        for title, rows in sheets.items():
            sheet = workbook.add_worksheet(title)
            for k, row in enumerate(rows):
                sheet.write_row(k, 0, row)
    return path


def read(path, **more):
    given = dict(time="t", inputs={"command": "u"}, measured={"speed": Column("rpm", unit="rpm")})
    return read_log(path, **{**given, **more})


def check(log):
    np.testing.assert_array_equal(log.time, [row[0] for row in ROWS])
    np.testing.assert_array_equal(log.inputs["command"], [row[1] for row in ROWS])
    np.testing.assert_allclose(log.values("speed", "rpm"), [row[2] for row in ROWS])


def test_a_plain_sheet(tmp_path):
    log = read(book(tmp_path / "run.xlsx", Log=[HEAD, *ROWS]))
    check(log)
    assert log.notes == ()
    assert log.name == "run.xlsx"


def test_what_a_file_is_its_content_says(tmp_path):
    check(read(book(tmp_path / "a.xlsx", Log=[HEAD, *ROWS]).rename(tmp_path / "run.csv")))


def test_a_title_above_units_below_and_empty_columns_beside_the_table(tmp_path):
    rows = [
        ("Thruster test", None, None, None),
        (None, None, None, None),
        (None, *HEAD),
        (None, "[s]", "[V]", "[rpm]"),
        *((None, *row) for row in ROWS),
    ]
    path = book(tmp_path / "run.xlsx", Log=rows)
    log = read(path)
    check(log)
    assert log.notes == (
        "a row was skipped: the header is row 3.",
        "row 4 was skipped: it holds units (, [s], [V], [rpm]).",
    )
    assert {f.name: f.unit for f in contents(path).fields if f.name} == {
        "t": "s",
        "u": "V",
        "rpm": "rpm",
    }


def test_the_sheet_that_has_the_columns_is_taken_and_the_others_are_told(tmp_path):
    path = book(
        tmp_path / "run.xlsx",
        About=[("Operator", "Bob"), ("Boat", "A")],
        Run1=[HEAD, *ROWS],
        Run2=[("t", "u", "thrust"), *ROWS],
    )
    log = read(path)
    check(log)
    assert log.notes == ("sheet 'Run1' was read; there are also 'About', 'Run2'.",)
    with pytest.raises(InputError) as caught:
        read(path, measured={})
    assert caught.value.problem == (
        "run.xlsx: several sheets have the wanted columns: 'Run1', 'Run2'."
    )
    assert caught.value.mend == "name one: sheet = 'Run1'."
    check(read(path, sheet="Run1"))
    with pytest.raises(InputError, match=r"run\.xlsx, sheet 'Run2': expected a column 'rpm'"):
        read(path, sheet="Run2")
    with pytest.raises(InputError, match="the nearest is 'Run1'"):
        read(path, sheet="run 1")
    found = contents(path)
    assert (found.kind, found.sheet) == ("Excel sheet 'Run1'", "Run1")


def test_defects_name_sheet_row_and_column(tmp_path):
    rows = [*ROWS[:3], (0.3, 1, "n/a"), *ROWS[4:]]
    path = book(tmp_path / "run.xlsx", Log=[HEAD, *rows])
    with pytest.raises(InputError) as caught:
        read(path)
    assert caught.value.problem == (
        "run.xlsx, sheet 'Log', row 5, column 'rpm': expected a number, found 'n/a'."
    )
    assert np.isnan(read(path, missing_values=["n/a"]).measured["speed"][3])
    for content, words in [
        ([HEAD], "expected samples below the header in row 1"),
        ([], "empty sheets"),
        ([HEAD, (0.0, 1, 2), (0.0, 1, 3)], "the same again"),
    ]:
        with pytest.raises(InputError, match=words):
            read(book(tmp_path / "run.xlsx", Log=content))


def test_text_with_decimal_commas(tmp_path):
    rows = [tuple(str(x).replace(".", ",") for x in row) for row in ROWS]
    check(read(book(tmp_path / "run.xlsx", Log=[HEAD, *rows])))


@pytest.mark.parametrize(
    "moment",
    [
        lambda s: datetime(2025, 3, 21, 23, 59, 59) + timedelta(seconds=s),
        lambda s: (datetime(2025, 3, 21, 10, 0, 0) + timedelta(seconds=s)).time(),
        lambda s: timedelta(hours=30, seconds=s),
    ],
)
def test_dates_times_and_durations(tmp_path, moment):
    workbook = openpyxl.Workbook()
    sheet = workbook.active
    sheet.append(HEAD)
    for t, u, rpm in ROWS:
        sheet.append((moment(10 * t), u, rpm))
    workbook.save(tmp_path / "run.xlsx")
    log = read(tmp_path / "run.xlsx")
    np.testing.assert_allclose(log.time, [10 * row[0] for row in ROWS], atol=2e-3)
    assert "dates" in log.notes[0]
    field = contents(tmp_path / "run.xlsx").fields[0]
    assert field.dates
    with pytest.raises(InputError, match="expected numbers, found dates"):
        read(tmp_path / "run.xlsx", time=0.1, inputs={"command": "t"})
    assert isinstance(moment(0.0), datetime | time | timedelta)


def test_formulas_without_results(tmp_path):
    workbook = openpyxl.Workbook()  # which computes nothing, as any library
    sheet = workbook.active
    sheet.append(HEAD)
    for k, (t, u, _) in enumerate(ROWS):
        sheet.append((t, u, f"=B{k + 2}*60"))
    workbook.save(tmp_path / "run.xlsx")
    with pytest.raises(InputError, match="found formulas whose results are not in the file"):
        read(tmp_path / "run.xlsx")


def test_no_change_of_a_byte_ends_in_a_traceback(tmp_path):
    path = book(tmp_path / "run.xlsx", Log=[HEAD, *ROWS])
    ended = outcomes(path, (read, contents), rounds=60)
    assert min(ended["read"], ended["told"]) > 3
    assert not ended["unnamed"]


def test_an_archive_that_is_no_book(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.xlsx", "w") as archive:
        archive.writestr("run.csv", "t,u\n0,1\n")
    with pytest.raises(InputError, match="an archive"):
        read(tmp_path / "run.xlsx")
