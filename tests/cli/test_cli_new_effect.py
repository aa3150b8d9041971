"""``diffthrust new-effect``: a class of an effect and its tests."""

from __future__ import annotations

import command_line
import numpy as np

import diffthrust as dft
from diffthrust.specs import load_spec


def run(*words, status=0):
    return command_line.run("new-effect", *words, status=status).output


def test_a_class_is_written_and_taken_by_a_spec(tmp_path, monkeypatch):
    monkeypatch.setenv("DIFFTHRUST_CACHE", "off")
    command_line.run("new", "bollard", "--directory", tmp_path)
    folder = tmp_path / "bollard"
    law = ("--formula", "-a * speed * abs(speed)**p", "--port", "shaft")
    more = ("--parameter", "a=rad/s^2", "--parameter", "p={ value = 1.5, bounds = [0.5, 3] }")
    told = run("tip_loss", *law, *more, "--directory", folder, "--doc", "Tips lose thrust.")
    assert f"Written: {folder / 'tip_loss.py'}\nWritten: {folder / 'test_tip_loss.py'}\n" in told
    assert 'effects = ["tip_loss.py:TipLoss"]' in told
    spec = folder / "fit.toml"
    text = spec.read_text()
    spec.write_text('effects = ["tip_loss.py:TipLoss"]\n' + text.replace("\neffects =", "\n#"))
    p = load_spec(folder).model.parameters["tip_loss.p"]
    assert (p.value, p.bounds) == (1.5, (0.5, 3.0))
    assert "nothing is overwritten" in run(
        "tip_loss", *law, *more, "--directory", folder, status=2
    ).replace("\n", " ")


def test_a_law_is_asked_for_or_was_learned(tmp_path):
    told = run("drag", "--port", "shaft", "--directory", tmp_path, status=2)
    assert "expected a law and its port" in told.replace("\n", " ")
    depth = np.linspace(0.0, 4.0, 40)
    log = dft.Log(np.arange(40), {"depth": depth}, {"reading": 0.16 * depth + 1.6})
    saved = tmp_path / "fit.json"
    dft.fit(dft.LinearSensor(), log, starts=1).save(saved)
    told = run("drag", "--learned", saved, "--directory", tmp_path, status=2)
    assert "expected a diagnosis, found" in told.replace("\n", " ")


def test_a_wrong_formula_writes_nothing(tmp_path):
    law = ("--formula", "-a * sped", "--port", "shaft", "--parameter", "a=1/s")
    told = run("drag", *law, "--directory", tmp_path, status=2)
    assert "the nearest is 'speed'" in told.replace("\n", " ")
    assert not list(tmp_path.iterdir())
