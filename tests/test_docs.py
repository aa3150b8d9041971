"""The pages of the site, without building it: toctrees, links, anchors, commands, the gallery."""

import json
import re
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from command_line import COMMANDS
from places import EXAMPLES, ROOT, docs_pages

from diffthrust.models import MODELS

DOCS = ROOT / "docs"
PAGES = docs_pages()
MADE = {"atlas", "gallery", "reference"}
"""Folders whose pages a build writes."""
sys.path.append(str(DOCS / "_ext"))


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def without_code(text: str) -> str:
    """The text without blocks of code and what stands between backticks."""
    text = re.sub(r"^(`{3,})(?!\{).*?^\1$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^```\{code-cell\}.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]+`", "", text)


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as MyST makes them (those of GitHub)."""
    text = re.sub(r"^```.*?^```$", "", text_of(page), flags=re.MULTILINE | re.DOTALL)
    included = re.findall(r"^```\{include\} (\S+)", text_of(page), flags=re.MULTILINE)
    text += "".join(text_of(page.parent / path) for path in included)
    heads = re.findall(r"^#{1,3} (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


def entries(page: Path) -> list[str]:
    """What the toctrees of a page name, from the folder docs."""
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```$", text_of(page), re.MULTILINE | re.DOTALL)
    lines = [line.strip() for tree in trees for line in tree.splitlines()]
    here = page.parent.relative_to(DOCS)
    return [(here / line).as_posix() for line in lines if line and not line.startswith(":")]


def test_every_page_stands_in_one_toctree():
    named = [entry for page in PAGES for entry in entries(page)]
    assert len(named) == len(set(named))
    pages = {page.relative_to(DOCS).with_suffix("").as_posix() for page in PAGES} - {"index"}
    made = {f"{folder}/index" for folder in MADE}
    assert pages == set(named) - made
    assert made <= set(named)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_a_page_has_one_title_and_its_headings_go_down_by_one(page):
    text = re.sub(r"^```(?!\{include).*?^```$", "", text_of(page), flags=re.MULTILINE | re.DOTALL)
    levels = [len(marks) for marks in re.findall(r"^(#+) ", text, flags=re.MULTILINE)]
    if "{include}" in text:
        assert not levels  # the title is that of the file
        return
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_every_link_and_its_anchor_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?://)([^)\s]+)\)", without_code(text_of(page))):
        path, _, anchor = target.partition("#")
        other = (page.parent / path).resolve() if path else page
        assert other.is_file(), target  # also for who reads the pages as they are
        # Nothing else is beside the site; its gallery stands for the examples.
        assert other in PAGES or other.suffix == ".png" or other.parent == EXAMPLES, target
        if anchor:
            assert anchor in anchors(other), target


def test_a_link_to_an_example_leads_to_the_gallery_of_the_site():
    from example_gallery import link_examples

    source = ["See [examples/export.py](../../examples/export.py) and [units](units.md)."]
    link_examples(None, "guides/export", source)
    assert (
        source[0] == "See [examples/export.py](#sphx_glr_gallery_export.py) and [units](units.md)."
    )


def test_readme_has_no_dead_link():
    targets = re.findall(
        r"\]\((?!https?://)([^)\s#]+)\)", without_code(text_of(ROOT / "README.md"))
    )
    assert len(targets) > 8
    assert not [target for target in targets if not (ROOT / target).exists()]


def test_the_page_of_models_lists_the_ports_of_each():
    rows = re.findall(
        r"^\| (`.*?) \| `(\w+)` \| ", text_of(DOCS / "guides/choose_a_model.md"), re.M
    )
    listed = {(cls, port) for classes, port in rows for cls in re.findall(r"`(\w+)`", classes)}
    models = [cls() for cls in MODELS.values()]
    assert listed == {(type(model).__name__, port) for model in models for port in model.ports}


def test_every_card_of_the_first_page_leads_somewhere():
    links = re.findall(r"^:link: (\S+)$", text_of(DOCS / "index.md"), flags=re.MULTILINE)
    assert len(links) >= 5
    made = {f"{folder}/index" for folder in MADE}
    assert all(link in made or (DOCS / f"{link}.md").is_file() for link in links)


def commands_shown() -> set[tuple[str, str, str]]:
    """Page, command and option of every line `diffthrust ...`; an empty option with each."""
    found = set()
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]:
        for line in re.findall(r"\bdiffthrust ([a-z][a-z-]* ?[^`#\n]*)", text_of(page)):
            command = line.split()[0]
            shown = page.relative_to(ROOT).as_posix()
            found.add((shown, command, ""))
            found |= {(shown, command, o) for o in re.findall(r"(?<!\S)(--[a-z-]+)", line)}
    return found


def test_every_command_and_option_that_is_shown_exists():
    known = {
        name: {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
        for name, command in COMMANDS.items()
    }
    lines = [
        shown
        for page in [ROOT / "README.md", *PAGES]
        for shown in re.findall(r"^(?:\$ |    )diffthrust ([a-z-]+)", text_of(page), re.MULTILINE)
    ]
    assert len(lines) > 20
    assert set(lines) <= set(known)
    for page, command, option in commands_shown():
        if command in known and option:
            assert option in known[command] | {"--help"}, (page, command, option)


def test_the_gallery_knows_every_example_and_each_begins_with_its_title():
    from example_gallery import ORDER, runs

    scripts = {path.stem for path in EXAMPLES.glob("[a-z]*.py")}
    assert scripts == set(ORDER)
    measured = {path.stem for path in EXAMPLES.glob("[a-z]*.py") if "runs_of(" in text_of(path)}
    for name, reason in ORDER.items():
        title, line = text_of(EXAMPLES / f"{name}.py").removeprefix('"""').splitlines()[:2]
        assert line == "=" * len(title)
        assert not runs(name) or name not in measured
        assert reason is None or reason.startswith("Not run")


def test_versions_stand_beside_each_other(tmp_path):
    from versions import publish

    html, site = tmp_path / "html", tmp_path / "site"
    html.mkdir()
    (html / "index.html").write_text("first")
    for version in ("dev", "0.9.0", "0.10.0"):
        publish(html, site, version, "/diffthrust")
    told = json.loads((site / "switcher.json").read_text())
    assert [entry["version"] for entry in told] == ["0.10.0", "0.9.0", "dev"]
    assert told[0]["url"] == "/diffthrust/0.10.0/"
    assert [entry["preferred"] for entry in told] == [True, False, False]
    assert "0.10.0/" in (site / "index.html").read_text()
    with pytest.raises(SystemExit, match="expected a version"):
        publish(html, site, "../elsewhere")


def test_code_shown_on_a_page_is_no_wider_than_a_page():
    for page in PAGES:
        if page.parent.name in MADE:
            continue
        for block in re.findall(r"^```(?!\{include).*?^```$", text_of(page), re.M | re.S):
            assert all(len(line) <= 100 for line in block.splitlines()), (page, block)


def test_the_recipe_names_every_dependency_of_the_package():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / ".github" / "conda-recipe" / "meta.yaml").read_text(encoding="utf-8")
    listed = recipe.partition("  run:")[2].partition("test:")[0]
    wanted = {re.sub(r"(?=[<>=])", " ", one, count=1) for one in project["dependencies"]}
    found = set(re.findall(r"^    - (.*)$", listed, re.MULTILINE)) - {"python >=3.11"}
    assert {one.replace("matplotlib-base", "matplotlib") for one in found} == wanted
    assert f'version = "{project["version"]}"' in recipe
