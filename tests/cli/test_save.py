"""Results of the command line, saved, are those that Python loads."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import run
from places import FITS

import diffthrust as dft

pytestmark = pytest.mark.usefixtures("no_cache")

SPEC = FITS / "depth_sensor"


def test_a_fit_is_saved_and_loaded(tmp_path):
    path = tmp_path / "depth.json"
    output = run("fit", SPEC, "--save", path).output
    fit = dft.load(path)
    spec = dft.load_spec(SPEC)
    assert fit.origin.spec == spec.sha256
    assert [log.sha256 for log in fit.data] == [log.sha256 for log in spec.train_logs()]
    assert f"Spec {spec.sha256[:8]}." in output
    assert f"Written: {path}" in output
    assert fit.parameters == spec.fit().parameters


def test_a_diagnosis_is_saved_and_loaded(tmp_path):
    path = tmp_path / "depth.json"
    run("diagnose", SPEC, "--save", path)
    diag = dft.load(path)
    assert diag.verdict in ("adequate", "effects_found", "unexplained", "undecided")
    assert diag.origin.spec == dft.load_spec(SPEC).sha256
    assert "\nmodel = dft.LinearSensor()" in diag.report()


def test_a_posterior_is_saved_and_loaded(tmp_path):
    path = tmp_path / "depth.nc"
    run("sample", SPEC, "--draws", 20, "--warmup", 10, "--save", path)
    post = dft.load(path)
    fit = dft.load_spec(SPEC).fit()
    draws = dft.predict(post, fit, dft.load_spec(SPEC).holdout_logs()[0])
    assert np.isfinite(draws.channels["reading"].median).all()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("command", "name"), [("fit", "a.toml"), ("sample", "a.json")])
def test_another_ending_is_refused_before_the_work(command, name, tmp_path):
    run(command, SPEC, "--save", tmp_path / name, status=2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--save", "--report", "--json"])
def test_a_folder_that_is_not_there_is_refused_before_the_work(option, tmp_path):
    """A diagnosis of half a minute ended in "No such file or directory"."""
    path = (tmp_path / "nowhere" / "depth").with_suffix(".html" if "rep" in option else ".json")
    missing = tmp_path / "no.toml"  # read only after the options
    result = run("diagnose", missing, option, path, status=2)
    told = "".join(result.output.split())  # lines are broken anywhere
    assert f"expectedthefolder'{path.parent}',foundnone" in told
