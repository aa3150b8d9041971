"""Numbers that differ by log in spec files and saved fits."""

import numpy as np
import pytest
from offsets_by_log import readings

import diffthrust as dft
from diffthrust import InputError

SPEC = """\
model = "linear_sensor"
[logs]
train = ["run*.csv"]
[channels]
depth = { column = "depth", unit = "m" }
reading = { column = "reading", unit = "V" }
[fit]
starts = 1
"""


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(5)
    for log in readings(rng, rng.normal(1.0, 0.4, 3)):
        rows = zip(log.time, log.inputs["depth"], log.measured["reading"], strict=True)
        lines = ["time,depth,reading", *(",".join(f"{v:.8g}" for v in row) for row in rows)]
        (tmp_path / f"{log.name}.csv").write_text("\n".join(lines))
    return tmp_path


def spec_of(folder, more):
    (folder / "fit.toml").write_text(SPEC + more)
    return dft.load_spec(folder / "fit.toml")


def test_a_list_under_fit_and_a_mark_of_the_parameter_are_the_same(folder):
    listed = spec_of(folder, 'per_log = ["offset"]\n').fit()
    marked = spec_of(folder, "[parameters]\noffset = { per_log = true, width = 2.0 }\n").fit()
    assert [*listed.per_log["offset"].values] == ["run0.csv", "run1.csv", "run2.csv"]
    assert marked.per_log["offset"].width == pytest.approx(listed.per_log["offset"].width, rel=1e-3)


def test_the_lines_of_a_report_make_the_model_again(folder):
    fit = spec_of(folder, 'per_log = ["offset"]\n').fit()
    block = fit.report().partition("[parameters]")[2]
    again = spec_of(folder, f"[parameters]{block}")
    assert again.model.per_log == ("offset",)
    width = again.model.parameters["offset"].width
    assert width == pytest.approx(fit.per_log["offset"].width, rel=1e-7)


def test_a_saved_fit_keeps_its_numbers(folder):
    fit = spec_of(folder, 'per_log = ["offset"]\n').fit()
    fit.save(folder / "found.json")
    again = dft.load(folder / "found.json")
    assert again.per_log == fit.per_log
    assert again.model.parameters["offset"] == fit.model.parameters["offset"]
    assert again.report() == fit.report()


def test_a_name_that_is_none_is_refused_with_its_line(folder):
    with pytest.raises(InputError, match=r"line 9, fit.per_log: .*'offsett' \(the nearest is"):
        spec_of(folder, 'per_log = ["offsett"]\n')
