"""A check as JUnit XML, which GitHub, GitLab and Jenkins show as tests."""

from __future__ import annotations

import platform
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from diffthrust._support.files import ending, write_whole
from diffthrust.checks._tables import by_size, sentence

if TYPE_CHECKING:
    from diffthrust.checks._check import Checked
    from diffthrust.checks._run import Run

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML cannot hold, such as those of a terminal's colours."""


def write_junit(path: Path, checked: Checked, directory: Path) -> None:
    """Write a check as JUnit XML.

    One suite for the check, and in it one case for each fit, with the seconds that it took: the
    services show one failure for each case, and their counts are then those of the command. All
    quantities that moved stand in it, the largest move first. A fit that was not compared is an
    error, one that moved a failure. The elements and attributes are those of junit-10.xsd, the
    schema of Jenkins' xUnit plugin.

    Args:
        path: the file to write, ending in ``.xml``.
        checked: the outcome.
        directory: the folder of the fits, which names the suite.

    Raises:
        InputError: another ending, or a folder that cannot be written to.
    """
    ending(path, ".xml")
    tree = _suites(checked, directory)
    ElementTree.indent(tree)
    text = ElementTree.tostring(tree, encoding="utf-8", xml_declaration=True)
    write_whole(path, text + b"\n")


def _suites(checked: Checked, directory: Path) -> ElementTree.Element:
    cases = [_case(run, directory.resolve().name) for run in checked.runs]
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(case.find("failure") is not None for case in cases)),
        "errors": str(sum(case.find("error") is not None for case in cases)),
        "time": f"{sum(run.seconds for run in checked.runs):.3f}",
    }
    suites = ElementTree.Element("testsuites", {"name": "diffthrust check", **counts})
    stamp = datetime.now(UTC).isoformat(timespec="seconds")
    about = {"name": _plain(f"diffthrust check {directory}"), "skipped": "0", "timestamp": stamp}
    suite = ElementTree.SubElement(suites, "testsuite", {**about, **counts})
    properties = ElementTree.SubElement(suite, "properties")
    for name, value in _versions():
        ElementTree.SubElement(properties, "property", {"name": name, "value": value})
    suite.extend(cases)
    return suites


def _case(run: Run, group: str) -> ElementTree.Element:
    about = {"classname": _plain(group), "name": _plain(run.fit), "time": f"{run.seconds:.3f}"}
    case = ElementTree.Element("testcase", about)
    rows = by_size(row for row in run.rows if not row.ok)
    if rows:
        first = rows[0]
        kind = "error" if first.verdict == "not compared" else "failure"
        more = f", and {len(rows) - 1} more" if len(rows) > 1 else ""
        told = {"type": first.verdict, "message": _plain(sentence(first) + more)}
        lines = [str(run.file), *map(sentence, rows)]
        lines += dict.fromkeys(f"Mend: {row.mend}" for row in rows if row.mend)
        ElementTree.SubElement(case, kind, told).text = _plain("\n".join(lines))
    if run.warnings:
        ElementTree.SubElement(case, "system-err").text = _plain("\n".join(run.warnings))
    return case


def _versions() -> Iterable[tuple[str, str]]:
    import jax

    from diffthrust import __version__

    yield "diffthrust", __version__
    yield "jax", jax.__version__
    yield "python", platform.python_version()
    yield "platform", platform.platform()


def _plain(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
