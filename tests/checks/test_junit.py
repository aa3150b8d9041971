"""JUnit XML: the elements and attributes that its readers know, and counts that add up."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from made_checks import CheckRow, FitRun, not_run, write_junit

from diffthrust import InputError
from diffthrust.checks import Checked

GOOD = FitRun(
    "one", Path("fits/one/fit.toml"), (CheckRow("one", "alpha", 1.0, 1.0, 0.1, True),), seconds=1
)
MOVED = FitRun(
    "deep/two",
    Path("fits/deep/two/fit.toml"),
    (
        CheckRow("deep/two", "status", "converged", "not_converged", None, False),
        CheckRow("deep/two", "alpha", 1.0, 1.2, 0.01, False, std_error=0.1),
        CheckRow("deep/two", "beta", 5.0, 1.0, 0.01, False, std_error=1.0),
        CheckRow("deep/two", "gamma", 5.0, 5.0, 0.01, True, std_error=1.0),
    ),
    seconds=0.25,
    warnings=("a coarse step",),
)
BROKEN = not_run("three", Path("fits/three/fit.toml"), "found \x1b[31m'<&>'\x00", "Mend it.")
BROKEN = replace(BROKEN, seconds=0.5)

# junit-10.xsd of Jenkins' xUnit plugin: attributes (those required with a star) and children
SCHEMA = {
    "testsuites": ("name time tests failures errors", "testsuite"),
    "testsuite": (
        "name* tests* failures* errors* group time skipped timestamp hostname id package file log "
        "url",
        "testsuite properties testcase system-out system-err",
    ),
    "properties": ("", "property"),
    "property": ("name* value*", ""),
    "testcase": (
        "name* time classname group",
        "skipped error failure rerunFailure rerunError flakyFailure flakyError system-out "
        "system-err",
    ),
    "failure": ("type message", ""),
    "error": ("type message", ""),
    "system-err": ("", ""),
}
TIME = r"(([0-9]{0,3},)*[0-9]{3}|[0-9]{0,3})*(\.[0-9]*)?"


def written(tmp_path: Path, *runs: FitRun) -> ElementTree.Element:
    path = tmp_path / "fits.xml"
    write_junit(path, Checked(runs), tmp_path / "fits")
    assert list(tmp_path.iterdir()) == [path]  # nothing half-written is left
    return ElementTree.parse(path).getroot()


def test_it_keeps_to_the_schema(tmp_path):
    root = written(tmp_path, GOOD, MOVED, BROKEN)
    assert root.tag == "testsuites"
    for element in root.iter():
        attributes, children = SCHEMA[element.tag]
        known = {word.rstrip("*") for word in attributes.split()}
        assert set(element.attrib) <= known
        assert {word[:-1] for word in attributes.split() if word.endswith("*")} <= set(
            element.attrib
        )
        assert {child.tag for child in element} <= set(children.split())
        if element.tag in ("testsuites", "testsuite"):
            assert re.fullmatch(TIME, element.attrib["time"])
            assert not (element.text or "").strip()


def test_counts_and_times_add_up(tmp_path):
    root = written(tmp_path, GOOD, MOVED, BROKEN)
    (suite,) = root
    for element in (root, suite):
        counts = {key: element.attrib[key] for key in ("tests", "failures", "errors")}
        assert counts == {"tests": "3", "failures": "1", "errors": "1"}
        assert float(element.attrib["time"]) == 1.75
    cases = suite.findall("testcase")
    assert [case.get("name") for case in cases] == ["one", "deep/two", "three"]
    assert {case.get("classname") for case in cases} == {"fits"}
    assert [float(case.get("time", "")) for case in cases] == [1.0, 0.25, 0.5]
    names = {p.get("name") for p in suite.iter("property")}
    assert names == {"diffthrust", "jax", "python", "platform"}


def test_a_case_tells_what_moved_the_largest_first(tmp_path):
    one, two, three = written(tmp_path, GOOD, MOVED, BROKEN).iter("testcase")
    assert len(one) == 0
    failure = two.find("failure")
    assert failure is not None
    assert failure.get("message", "").startswith("status: expected converged, found not_converged")
    lines = (failure.text or "").splitlines()
    assert lines[0] == str(MOVED.file)
    assert [line.split(":")[0] for line in lines[1:]] == ["status", "beta", "alpha"]
    assert "found 1.00 (-4.0 std errors)" in lines[2]
    assert two.findtext("system-err") == "a coarse step"
    error = three.find("error")
    assert error is not None
    assert error.get("type") == "not compared"
    assert "'<&>'" in error.get("message", "")
    assert "\ufffd[31m" in error.get("message", "")
    assert "Mend: Mend it." in (error.text or "")


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.xml"):
        write_junit(tmp_path / "fits.toml", Checked((GOOD,)), tmp_path)
