"""Regression fits: what moves is seen, and updating touches the [expected] block alone."""

from __future__ import annotations

import hashlib
import re
import shutil
import warnings
from pathlib import Path

import jax
import numpy as np
import pytest
from places import FITS

import diffthrust
from diffthrust import InputError
from diffthrust.checks import check
from diffthrust.checks._expected import Marks, with_expected  # private: texts no spec may have
from diffthrust.simulation import CoarseStepWarning
from diffthrust.specs import Spec, load_spec
from diffthrust.specs._parts import ExpectedNumber  # private: what a block holds


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


# texts that no spec may have, too: an update must never spoil what it does not know
MARKS = Marks("diffthrust 1.0", "5bec", {"a.csv": "da7a"})
TOP = """\
status = "ok"
train_nrmse = 2
library = "diffthrust 1.0"
spec = "5bec"
data = { "a.csv" = "da7a" }
"""
REST = '\n[expected.parameters]\np = { value = 1, std_error = 0.1 }\n"e.q" = 3\n'


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("a = 1", f"a = 1\n\n[expected]\n{TOP}{REST}"),
        ("[expected]\ny = 1", f"[expected]\n{TOP}{REST}"),
        ("[expected]\ny = 1\n\n[b]\n", f"[expected]\n{TOP}{REST}\n[b]\n"),
        ("[expected.parameters]\ny = [\n 1]\n[b]\n", f"[expected]\n{TOP}{REST}[b]\n"),
        (
            "[expected]\ny = 1\n[b]\n[expected.c]\nz = 1\n[d]\n",
            f"[expected]\n{TOP}{REST}\n[b]\n[d]\n",
        ),
        (
            "[ expected ]\n# note\ny = 1\n# next\n[b]\n",
            f"[ expected ]\n# note\n{TOP}{REST.replace('expected', ' expected ')}# next\n[b]\n",
        ),
        ("[expectedly]\ny = 1\n", f"[expectedly]\ny = 1\n\n[expected]\n{TOP}{REST}"),
        (
            "\ufeff[expected]\n[expected.parameters]\n# why\ne.q = 1\np = 3 # so\n\n# next\n[b]",
            f"\ufeff[expected]\n{TOP}\n[expected.parameters]\n# why\n"
            'p = { value = 1, std_error = 0.1 } # so\n"e.q" = 3\n\n# next\n[b]',
        ),
    ],
)
def test_a_block_is_written_into_any_text(text, result):
    """Comments stay, and so does the order of what is there already."""
    numbers = {
        "train_nrmse": ExpectedNumber(value=2),
        "parameters.p": ExpectedNumber(value=1, std_error=0.1),
        "parameters.e.q": ExpectedNumber(value=3),
    }
    assert with_expected(text, Path("fit.toml"), "ok", numbers, MARKS) == result


def written(fits: Path, key: str):
    expected = load_spec(spec_of(fits)).file.expected
    assert expected is not None
    return expected.parameters[key]


def move(fits: Path, key: str, std_errors: float) -> None:
    """Write another value to expect, so many standard errors above the one that is written."""
    path, number = spec_of(fits), written(fits, key)
    assert number.std_error is not None
    line = f"\n{key} = {{ value = "
    assert f"{line}{number.value:.10g}," in path.read_text()
    new = f"{line}{number.value + std_errors * number.std_error:.10g},"
    path.write_text(path.read_text().replace(f"{line}{number.value:.10g},", new))


@pytest.mark.parametrize("std_errors", [4.0, -4.0, 0.2])
def test_a_moved_parameter_is_told_in_standard_errors(fits, std_errors):
    move(fits, "slope", std_errors)
    checked = check(fits)
    (row,) = [row for row in checked.rows if not row.ok]
    assert row.quantity == "slope"
    assert row.verdict == "moved"
    assert row.difference == pytest.approx(-std_errors, abs=1e-3)


def test_rounding_is_no_move(fits):
    move(fits, "slope", 0.05)
    assert check(fits).ok
    path = spec_of(fits)  # the standard error of a fit without noise is below what refits agree to
    path.write_text(re.sub("std_error = [^ ]+", "std_error = 1e-12", path.read_text()))
    assert not check(fits).ok
    check(fits, update=True)
    text = re.sub("std_error = [^ ]+", "std_error = 1e-12", path.read_text())
    value = written(fits, "slope").value
    path.write_text(text.replace(f"{value:.10g}", f"{value * (1 + 5e-9):.10g}"))
    assert check(fits).ok


def test_the_expected_standard_error_judges_not_the_new_one(fits):
    """A fit that has lost its certainty must not thereby pass."""
    move(fits, "slope", 4.0)
    data = fits / "depth_sensor" / "train.csv"
    rows = data.read_text().splitlines()
    data.write_text("\n".join([rows[0], *rows[1:3], ""]))  # two readings: no certainty at all
    rows = {row.quantity: row for row in check(fits).rows}
    assert not rows["slope"].ok
    assert rows["slope"].tolerance == pytest.approx(0.1 * 0.002365)


def test_a_block_without_standard_errors_stays_valid(fits):
    path = spec_of(fits)
    path.write_text(re.sub(", std_error = [^ ]+", ", tolerance = 1e-5", path.read_text()))
    checked = check(fits)
    assert checked.ok
    (slope,) = [row for row in checked.rows if row.quantity == "slope"]
    assert slope.tolerance == 1e-5
    assert slope.std_error == pytest.approx(0.002365, rel=1e-3)  # that of the new fit
    assert check(fits, update=True).updated == ("depth_sensor",)
    assert written(fits, "slope").std_error == pytest.approx(0.002365, rel=1e-3)
    assert written(fits, "slope").tolerance == 1e-5
    assert check(fits, update=True).updated == ()


def test_fits_are_found_at_any_depth(tmp_path):
    for name in ("b", "b/c", "a/deep/er", ".hidden/x", "a/.git"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "fit.toml").write_text("")
    (tmp_path / "z").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "b" / "loop").symlink_to(tmp_path)
    outside = tmp_path.parent / f"{tmp_path.name}_outside"
    outside.mkdir()
    (outside / "fit.toml").write_text("")
    (tmp_path / "linked").symlink_to(outside)
    checked = check(tmp_path, jobs=1)
    assert checked.fits == ("a/deep/er", "b", "b/c", "linked")
    assert checked.runs[2].file == tmp_path / "b" / "c" / "fit.toml"
    (tmp_path / "fit.toml").write_text("")  # the folder of one fit may hold others
    assert set(check(tmp_path, jobs=1).fits) > {tmp_path.name, "b/c"}


def test_rows_come_in_the_order_of_the_fits(fits):
    for name in "efg":  # these end long before the first, which is a fit
        (fits / name).mkdir()
        (fits / name / "fit.toml").write_text("")
    seen: list[tuple[str, float]] = []
    checked = check(fits, jobs=2, progress=lambda name, done: seen.append((name, done)))
    assert checked.fits == ("depth_sensor", "e", "f", "g")
    assert [done for _, done in seen] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert (seen[0][0], seen[-1][0]) == ("depth_sensor", "depth_sensor")
    assert {name for name, _ in seen} == set(checked.fits)
    assert all("expected the key" in str(row.found) for row in checked.rows if not row.ok)


def test_a_defect_in_one_fit_does_not_hide_the_others(fits, monkeypatch):
    shutil.copytree(fits / "depth_sensor", fits / "other")

    def broken(path, **given):
        if path.parent.name == "other":
            raise ZeroDivisionError("oh")
        return load_spec(path, **given)

    monkeypatch.setattr("diffthrust.checks._check.load_spec", broken)
    checked = check(fits)
    assert [run.ok for run in checked.runs] == [True, False]
    assert "A defect of diffthrust" in str(checked.rows[-1].found)
    monkeypatch.setenv("DIFFTHRUST_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        check(fits)


def test_what_a_fit_warns_of_names_it(fits, monkeypatch):
    def warned(spec):
        warnings.warn("too coarse", CoarseStepWarning, stacklevel=1)
        raise InputError("no", "none")

    monkeypatch.setattr("diffthrust.specs._spec.Spec.fit", warned)
    with pytest.warns(CoarseStepWarning, match="depth_sensor: too coarse"):
        check(fits)


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


def fit_of(checked, name="depth_sensor"):
    return next(run for run in checked.runs if run.fit == name)


def test_a_block_says_of_which_data_spec_and_library_it_is(fits):
    path = spec_of(fits)
    assert load_spec(path).file.expected.data.keys() == {"train.csv", "holdout.csv"}
    without_expected(path)
    check(fits, update=True)
    expected = load_spec(path).file.expected
    bits = (fits / "depth_sensor" / "train.csv").read_bytes()
    assert hashlib.sha256(bits).hexdigest().startswith(expected.data["train.csv"])
    assert expected.library == ", ".join(
        f"{name} {version}"
        for name, version in (
            *(("diffthrust", diffthrust.__version__), ("jax", jax.__version__)),
            ("numpy", np.__version__),
        )
    )
    assert fit_of(check(fits)).since == ""  # nothing to tell where nothing moved


def moved(path: Path) -> None:
    """Expect something else than this fit gives."""
    path.write_text(path.read_text().replace("slope = { value = 0.159", "slope = { value = 0.259"))


def altered_data(path: Path) -> None:
    data = path.parent / "train.csv"
    data.write_text(data.read_text().replace("1.622", "1.662"))


def altered_spec(path: Path) -> None:
    path.write_text(path.read_text().replace("[expected]", "[fit]\nstarts = 7\n\n[expected]", 1))


def altered_library(path: Path) -> None:
    path.write_text(
        re.sub("library = .diffthrust [^,]+", 'library = "diffthrust 0.0.7', path.read_text())
    )


@pytest.mark.parametrize(
    ("alterations", "words"),
    [
        ((), "Data, spec and versions are as stored"),
        ((altered_data,), "the data (train.csv) changed; spec and library are the same."),
        ((altered_spec,), "the spec changed; data and library are the same."),
        ((altered_library,), "the library (it was diffthrust 0.0.7, "),
        ((altered_data, altered_spec), "the data (train.csv) and the spec changed; library is"),
    ],
)
def test_what_moved_is_told_beside_what_changed_since(fits, alterations, words, tmp_path):
    for alter in (moved, *alterations):
        alter(spec_of(fits))
    checked = check(fits, junit=tmp_path / "out.xml")
    assert not checked.ok
    assert words in fit_of(checked).since
    shown = " ".join(checked.report().split())
    assert words in shown
    assert words in (tmp_path / "out.xml").read_text()
    assert words in fit_of(checked).to_json()["since"]


def test_data_that_changed_are_told_though_no_result_moved(fits):
    data = fits / "depth_sensor" / "train.csv"
    reading = data.read_text().splitlines()[1].split(",")[1]
    data.write_text(data.read_text().replace(reading, f"{float(reading) + 1e-7:.9f}", 1))
    checked = check(fits)
    assert checked.ok
    words = "The data (train.csv) changed since it was stored; the results stay within"
    assert words in fit_of(checked).since
    assert words in " ".join(checked.report().split())
    check(fits, update=True)
    assert fit_of(check(fits)).since == ""


def test_what_says_nothing_of_its_making_still_compares(fits):
    path = spec_of(fits)
    path.write_text(re.sub("(library|spec|data) = [^\n]*\n", "", path.read_text()))
    assert check(fits).ok
    moved(path)
    assert "--update adds them" in fit_of(check(fits)).since
    path.write_text(path.read_text().replace("0.259", "0.159"))
    assert check(fits, update=True).updated == ("depth_sensor",)  # for these lines alone
    assert path.read_bytes() == (FITS / "depth_sensor" / "fit.toml").read_bytes()


def test_comments_and_order_do_not_change_a_spec(fits):
    path = spec_of(fits)
    spec = load_spec(path)
    path.write_text("# about the sensor\n" + path.read_text().replace(" = {", "={"))
    assert load_spec(path).sha256 == spec.sha256
    assert spec.fit().origin.spec == spec.sha256
    altered_spec(path)
    assert load_spec(path).sha256 != spec.sha256


def test_a_script_that_a_spec_names_is_part_of_it(fits):
    path = spec_of(fits)
    script = path.parent / "own.py"
    script.write_text(
        "import diffthrust as dft\n\n\nclass Own(dft.LinearSensor):\n    name = 'own'\n"
    )
    path.write_text(path.read_text().replace('"linear_sensor"', '"own.py:Own"'))
    before = load_spec(path).sha256
    script.write_text(script.read_text() + "    horizon = 3.0\n")
    assert load_spec(path).sha256 != before


def test_an_edit_that_comes_while_the_fit_runs_is_not_lost(fits, monkeypatch):
    path = spec_of(fits)
    without_expected(path)
    fitted = Spec.fit

    def slowly(self, *args, **kwargs):
        fit = fitted(self, *args, **kwargs)
        path.write_text(path.read_text() + "# looked at by hand\n")
        return fit

    monkeypatch.setattr(Spec, "fit", slowly)
    checked = check(fits, update=True, jobs=1)
    assert not checked.ok
    assert "edited while its fit ran" in str(checked.rows)
    assert path.read_text().endswith("# looked at by hand\n")
    assert "[expected]" not in path.read_text()
    beside = path.with_name("fit.toml.updated")
    assert "[expected]" in beside.read_text()
    monkeypatch.undo()
    beside.unlink()
    assert check(fits, update=True, jobs=1).ok
    assert "# looked at by hand" in path.read_text()
    assert check(fits, jobs=1).ok
