"""What the README shows works: its Python runs, its spec file is read, its commands exist."""

import re
import shutil
from typing import get_args

import pytest
from places import ROOT

from diffthrust import Status
from diffthrust.diagnosis._findings import Verdict  # private: no user types it
from diffthrust.specs import load_spec

TEXT = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def test_python_runs(tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / "fits" / "jason_thruster", tmp_path / "fits" / "jason_thruster")
    monkeypatch.chdir(tmp_path)
    assert len(blocks("python")) == 5
    exec(compile("\n".join(blocks("python")), "README.md", "exec"), {"__name__": "readme"})
    printed = capsys.readouterr().out
    assert "Status: converged" in printed
    assert "thruster + coulomb_friction" in printed
    assert (tmp_path / "unseen.png").stat().st_size > 10_000
    assert "<html" in (tmp_path / "diagnosis.html").read_text()


def test_first_snippet_is_short():
    lines = [line for line in blocks("python")[0].splitlines() if line.strip()]
    assert len(lines) <= 10


def test_spec_file_is_read(tmp_path):
    (tmp_path / "fit.toml").write_text(blocks("toml")[0])
    for name in ("run1", "run2", "run3"):
        (tmp_path / f"{name}.csv").write_text("t,u,rpm\n0,1,0\n0.1,1,10\n0.2,1,18\n")
    spec = load_spec(tmp_path)
    assert str(spec.model) == "thruster + command_deadband"
    assert [len(log) for log in spec.train_logs()] == [3, 3]
    assert spec.train_logs()[0].unsigned == {"speed"}


@pytest.mark.parametrize("status", list(Status), ids=lambda status: status.value)
def test_every_status_is_explained(status):
    assert f"| `{status.value}` |" in TEXT


@pytest.mark.parametrize("verdict", get_args(Verdict))
def test_every_verdict_is_explained(verdict):
    assert f"| `{verdict}` |" in TEXT


def test_links_lead_somewhere():
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target
    assert "python -m pip install -e '.[test]' && diffthrust demo" in TEXT
    assert "python -m pip install -e '.[test]' && pytest" in TEXT
