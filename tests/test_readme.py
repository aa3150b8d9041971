"""What the README and the pages of docs/ show works: Python, spec files, commands, links."""

import re
import shutil

import pytest
from places import ROOT, docs_pages

from diffthrust.estimation import Status
from diffthrust.specs import load_spec

README = ROOT / "README.md"
PAGES = [README, *docs_pages()]
LONG = {
    *("craft", "effects", "choose_a_model", "uncertainty", "plan_experiment", "per_log"),
    *("write_a_noise", "write_a_model", "read_a_status", "manoeuvres"),
}
"""Pages whose code takes over four seconds."""
RUN = [
    pytest.param(page, marks=pytest.mark.thorough if page.stem in LONG else ()) for page in PAGES
]
TEXT = README.read_text(encoding="utf-8")


def blocks(language: str, page=README) -> list[str]:
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A folder as a new user has it after a clone, where nothing else gets written to."""
    shutil.copytree(ROOT / "fits" / "jason_thruster", tmp_path / "fits" / "jason_thruster")
    shutil.copytree(ROOT / "examples" / "bench", tmp_path / "examples" / "bench")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.stem)
def test_python_runs(page, checkout, capsys):
    code = "\n".join(blocks("python", page))
    exec(compile(code, page.name, "exec"), {"__name__": "readme"})
    printed = capsys.readouterr().out
    if page is README:
        assert "Status: converged" in printed
        assert re.search(r"Found: \d+ % less thrust in reverse", printed)  # which removes most
        assert "Found: commands within ±2" in printed  # about 25 us
        before, after = map(float, printed.split()[-2:])
        assert after < 0.8 * before
        assert (checkout / "unseen.png").stat().st_size > 10_000
        assert "<html" in (checkout / "diagnosis.html").read_text(encoding="utf-8")
    if page.stem == "manoeuvres":
        shown = [line.split()[-7:] for line in blocks("text", page)[0].splitlines()[1:]]
        found = [line.split()[-7:] for line in printed.splitlines()[1:]]
        assert [[e == "-" for e in row] for row in found] == [
            [e == "-" for e in row] for row in shown
        ]
    if page.stem == "effects":
        assert "thruster + coulomb_friction" in printed


def test_the_readme_is_short_and_begins_with_the_strangers_path():
    assert len(TEXT.split()) < 1200
    places = [TEXT.index(f"diffthrust {word} ") for word in ("look", "fit", "compare", "diagnose")]
    assert places == sorted(places)
    assert TEXT.index("diffthrust look") < TEXT.index("```python")


def test_spec_file_is_read(tmp_path):
    (tmp_path / "fit.toml").write_text(
        blocks("toml", ROOT / "docs" / "guides" / "spec_files.md")[0]
    )
    for name in ("run1", "run2", "run3"):
        (tmp_path / f"{name}.csv").write_text("t,u,rpm\n0,1,0\n0.1,1,10\n0.2,1,18\n")
    spec = load_spec(tmp_path)
    assert str(spec.model) == "thruster + command_deadband"
    assert [len(log) for log in spec.train_logs()] == [3, 3]
    assert spec.train_logs()[0].unsigned == {"speed"}


@pytest.mark.parametrize("status", list(Status), ids=lambda status: status.value)
def test_every_status_is_explained(status):
    assert f"| `{status.value}` |" in TEXT


@pytest.mark.parametrize("verdict", ["adequate", "effects_found", "unexplained", "undecided"])
def test_every_verdict_is_explained(verdict):
    assert f"| `{verdict}` |" in TEXT


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", text):
        made = target.endswith(("atlas/index.md", "reference/index.md"))
        assert made or (page.parent / target).exists(), target  # a build of the site makes these


def test_the_first_commands_install_what_they_need():
    assert "python -m pip install -e '.[test]' && diffthrust demo" in TEXT
    assert "python -m pip install -e '.[test]' && pytest" in TEXT
