"""A fit draws itself over its logs, and over others."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

import diffthrust as dft
from tests.short_logs import made_log


def titles(figure) -> str:
    return " ".join(axes.get_title("left") for axes in figure.axes)


def test_a_fit_draws_its_unseen_logs_or_those_of_its_training(tmp_path: Path) -> None:
    log, unseen = made_log(1, name="run1"), made_log(2, name="run2")
    trained = dft.fit(dft.Thruster(), log, starts=1, doubts=False)
    assert "run1" in titles(trained.plot())
    held_out = dft.fit(dft.Thruster(), log, holdout=unseen, starts=1, doubts=False)
    assert "run2" in (words := titles(held_out.plot()))
    assert "run1" not in words
    assert "run1" in titles(held_out.plot(log))
    # what is drawn is the comparison with the same logs
    rmse = dft.compare(held_out, unseen).errors.channels["speed"].shown.value
    assert f"speed: RMSE {rmse:.3g}" in words


def test_a_fit_from_a_file_or_another_process_asks_for_logs(tmp_path: Path) -> None:
    log = made_log(1, name="run1")
    fit = dft.fit(dft.Thruster(), log, starts=1, doubts=False)
    fit.save(tmp_path / "run.fit.json")
    for copy in (dft.load(tmp_path / "run.fit.json"), pickle.loads(pickle.dumps(fit))):
        with pytest.raises(dft.InputError, match=r"fit\.plot\(logs\)"):
            copy.plot()
        assert "run1" in titles(copy.plot(log))
