"""Regression fits: what moves is seen, and updating touches the [expected] block alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from diffthrust import InputError
from diffthrust._check import check
from diffthrust._expected import _replaced
from diffthrust._spec import load_spec

FITS = Path(__file__).parents[1] / "fits"


@pytest.fixture
def fits(tmp_path: Path) -> Path:
    """A folder with the quickest of the shipped fits."""
    shutil.copytree(FITS / "depth_sensor", tmp_path / "fits" / "depth_sensor")
    return tmp_path / "fits"


def spec_of(fits: Path) -> Path:
    return fits / "depth_sensor" / "fit.toml"


def without_expected(path: Path) -> bytes:
    data = path.read_bytes()
    data = data[: data.index(b"[expected]")].rstrip() + b"\n"
    path.write_bytes(data)
    return data


def test_a_shipped_fit_has_not_moved(fits):
    checked = check(fits)
    assert checked.ok, checked.rows
    assert checked.fits == ("depth_sensor",)
    quantities = {row.quantity for row in checked.rows}
    assert quantities == {"status", "slope", "offset", "train_nrmse", "holdout_nrmse"}


def test_the_folder_of_one_fit_will_do(fits):
    assert check(fits / "depth_sensor").fits == ("depth_sensor",)


def test_altered_data_are_seen(fits):
    data = fits / "depth_sensor" / "train.csv"
    data.write_text(data.read_text().replace("1.622", "1.662"))
    checked = check(fits)
    assert not checked.ok
    assert {row.quantity for row in checked.rows if not row.ok} >= {"offset", "train_nrmse"}


def test_a_fit_without_expected_values_fails_until_they_are_written(fits):
    before = without_expected(spec_of(fits))
    checked = check(fits)
    assert not checked.ok
    assert "--update" in checked.rows[0].mend
    written = check(fits, update=True)
    assert written.ok
    assert written.updated == ("depth_sensor",)
    assert spec_of(fits).read_bytes().startswith(before)
    assert check(fits).ok
    assert list((fits / "depth_sensor").glob(".*")) == []


def test_what_has_not_moved_is_not_written(fits):
    before = spec_of(fits).read_bytes()
    assert check(fits, update=True).updated == ()
    assert spec_of(fits).read_bytes() == before


def test_an_update_keeps_the_rest_and_the_tolerances(fits):
    path = spec_of(fits)
    head = without_expected(path).replace(b"\n", b"\r\n")
    block = (
        b"[expected] # ours\r\n# mind the gap\r\nstatus = 'converged'\r\n"
        b"train_nrmse = { value = 9.0, tolerance = 0.5 }\r\n"
        b"[expected.parameters]\r\nslope = { value = 0.2, tolerance = 0.001 }\r\n"
        b"offset = { value = 1.6, tolerance = 0.1 }\r\n"
    )
    tail = b"\r\n# about the search\r\n[fit]\r\nseed = 3\r\n"
    path.write_bytes(head + block + tail)
    assert check(fits, update=True).ok
    data = path.read_bytes()
    assert data.startswith(head + b"[expected] # ours\r\n# mind the gap\r\n")
    assert data.endswith(tail)
    assert b"\n" not in data.replace(b"\r\n", b"")
    expected = load_spec(path).file.expected
    assert expected is not None
    assert expected.train_nrmse is not None
    assert expected.train_nrmse.tolerance == 0.5
    assert expected.parameters["slope"].tolerance == 0.001
    assert expected.parameters["slope"].value == pytest.approx(0.159, abs=0.001)
    assert expected.parameters["offset"].value == 1.6  # it still holds
    assert expected.holdout_nrmse is not None


def test_a_block_that_cannot_be_replaced_is_refused(fits):
    path = spec_of(fits)
    text = without_expected(path).decode()
    path.write_text('expected = { status = "not_converged" }\n' + text)
    before = path.read_bytes()
    checked = check(fits, update=True)
    assert not checked.ok
    assert "[expected]" in str(checked.rows[0].found) or "TOML" in str(checked.rows[0].found)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("a = 1", "a = 1\n\n[expected]\nX\n"),
        ("[expected]\ny = 1", "[expected]\nX\n"),
        ("[expected]\ny = 1\n\n[b]\n", "[expected]\nX\n\n[b]\n"),
        ("[expected.parameters]\ny = [\n 1]\n[b]\n", "[expected]\nX\n[b]\n"),
        ("[expected]\ny = 1\n[b]\n[expected.c]\nz = 1\n[d]\n", "[expected]\nX\n[b]\n[d]\n"),
        ("[ expected ]\n# note\ny = 1\n# next\n[b]\n", "[ expected ]\n# note\nX\n# next\n[b]\n"),
        ("[expectedly]\ny = 1\n", "[expectedly]\ny = 1\n\n[expected]\nX\n"),
    ],
)
def test_replacing_the_block(text, result):
    assert _replaced(text, ["X"]) == result


def test_a_fit_that_cannot_run_does_not_stop_the_others(fits):
    shutil.copytree(fits / "depth_sensor", fits / "broken")
    (fits / "broken" / "train.csv").write_text("t,depth_m,reading_V\n")
    checked = check(fits)
    assert checked.fits == ("broken", "depth_sensor")
    assert [row.fit for row in checked.rows if not row.ok] == ["broken"]
    assert "train.csv" in str(checked.rows[0].found)


def test_a_misspelt_or_empty_expectation_fails(fits):
    path = spec_of(fits)
    text = path.read_text()
    path.write_text(text.replace("\nslope = { value = 0.159", "\nslop = { value = 0.159"))
    (row,) = [row for row in check(fits).rows if not row.ok]
    assert "'slope'" in row.mend
    without_expected(path)
    path.write_text(path.read_text() + "[expected]\n")
    assert not check(fits).ok


def test_no_fits(tmp_path):
    with pytest.raises(InputError, match="expected fits"):
        check(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        check(tmp_path / "nowhere")
