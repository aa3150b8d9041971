"""``diffthrust explore`` says what it cannot open; the page itself is tested in tests/workbench."""

import example_names
from command_line import run


def test_what_cannot_be_opened_ends_with_a_message(tmp_path):
    assert "the spec file cannot be read" in run("explore", tmp_path / "no.toml", status=2).output
    text = example_names.SPEC.replace('"thruster"', '"own.py:Mine"')
    (tmp_path / "fit.toml").write_text(text)
    refused = run("explore", tmp_path, "--no-browser", status=2).output
    assert "it names the script own.py, which the workbench does not run" in refused
    assert f"--trust {tmp_path}" in refused
