"""A check as JUnit XML, which GitHub, GitLab and Jenkins show as tests."""

from __future__ import annotations

import platform
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from junitparser import Error, Failure, JUnitXml, TestCase, TestSuite

from diffthrust._support.files import ending, write_whole
from diffthrust.checks._tables import by_size, sentence
from diffthrust.estimation._origin import versions

if TYPE_CHECKING:
    from diffthrust.checks._result import Checked, FitRun

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters invalid in XML, such as terminal escapes."""


def write_junit(path: Path, checked: Checked, directory: Path) -> None:
    """Write a check of a folder, which names the suite, as JUnit XML.

    One suite with a case for each fit, with its duration: services show one failure per case, so
    that their counts agree with the command. The case lists all moved quantities, the largest move
    first. A fit that was not compared is an error, one that moved a failure. The elements and
    attributes are those of junit-10.xsd, the schema of Jenkins' xUnit plugin.
    """
    ending(path, ".xml")
    tree = ElementTree.fromstring(_suites(checked, directory).tostring())
    ElementTree.indent(tree)
    text = ElementTree.tostring(tree, encoding="utf-8", xml_declaration=True)
    write_whole(path, text + b"\n")


def _suites(checked: Checked, directory: Path) -> JUnitXml:
    suite = TestSuite(_plain(f"diffthrust check {directory}"))
    suite.timestamp = datetime.now(UTC).isoformat(timespec="seconds")
    for name in ("diffthrust", "jax"):
        suite.add_property(name, versions()[name])
    suite.add_property("python", platform.python_version())
    suite.add_property("platform", platform.platform())
    suite.add_testcases([_case(run, directory.resolve().name) for run in checked.runs])
    suites = JUnitXml("diffthrust check")
    suites.append(suite)
    # update_statistics would also write the number of skipped cases, which the schema forbids.
    for count in ("tests", "failures", "errors", "time"):
        setattr(suites, count, getattr(suite, count))
    return suites


def _case(run: FitRun, group: str) -> TestCase:
    case = TestCase(_plain(run.fit), _plain(group), round(run.seconds, 3))
    rows = by_size(row for row in run.rows if not row.ok)
    if rows:
        first = rows[0]
        more = f", and {len(rows) - 1} more" if len(rows) > 1 else ""
        kind = Error if first.verdict == "not compared" else Failure
        result = kind(_plain(sentence(first) + more), first.verdict)
        lines = [str(run.file), *map(sentence, rows)]
        lines += [run.since] * bool(run.since)
        lines += dict.fromkeys(f"Mend: {row.mend}" for row in rows if row.mend)
        result.text = _plain("\n".join(lines))
        case.result = [result]
    if run.warnings:
        case.system_err = _plain("\n".join(run.warnings))
    return case


def _plain(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
