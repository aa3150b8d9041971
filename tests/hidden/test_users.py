"""Users' sets are fair: the truth, begun at its true start, reaches the noise of the sensors."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from marks import slow_but

from diffthrust.effects import EFFECTS

from . import users
from .users.__main__ import line, main
from .users.work import plain, work

BEYOND = {
    # a twentieth of the commands is not in the log
    "bench": 1.6,
    # something random acts on the shaft
    "astern_runs": 3.5,
}
"""Error of the truth to the noise, where it is not 1 to within a tenth."""
QUICK = ("gear_motor", "tanks", "periodic_force")


@pytest.mark.parametrize("kind", slow_but(QUICK, users.KINDS))
def test_the_truth_reaches_the_noise(kind):
    made = users.draw(kind, 0)
    ratios = made.from_truth()
    for channel in made.ruled:  # what rules it is in no equation
        assert ratios.pop(channel) > 10.0
    for channel, ratio in ratios.items():
        assert 0.85 <= ratio <= BEYOND.get(kind, 1.1), channel


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("kind", users.KINDS)
def test_every_set_is_sane(kind, seed):
    made = users.draw(kind, seed)
    logs = (*made.train, *made.unseen)
    assert len(logs) == len(made.starts)
    for log in logs:
        assert np.all(np.diff(log.time) > 0)
        for name, series in log.inputs.items():
            assert np.isfinite(series).all(), name
            assert np.ptp(series) > 0, name
        for name, series in log.measured.items():
            assert np.isfinite(series).sum() > 50, name
            assert np.nanstd(series) > 0, name
    ratios = made.from_truth()
    assert max(r for c, r in ratios.items() if c not in made.ruled) <= BEYOND.get(kind, 1.1)
    assert made.model.inputs.keys() <= made.train[0].inputs.keys()


def test_the_same_seed_gives_the_same_set():
    first, again, other = (users.draw("periodic_force", seed) for seed in (3, 3, 4))
    assert first.files == again.files
    assert first.files != other.files


@pytest.mark.parametrize("kind", slow_but(("astern_runs",), users.KINDS))
def test_what_is_hidden_has_the_parameters_of_the_effect_that_names_it(kind):
    for hidden in users.draw(kind, 2).hidden:
        for name in hidden.names:
            for parameter in hidden.parameters:
                assert hasattr(EFFECTS[name](), parameter), f"{name}.{parameter}"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("kind", users.KINDS)
def test_the_true_structure_is_identified(kind, seed):
    made = users.draw(kind, seed)
    assert plain(made, starts=0)["identified"]


def _diagnosis(added=(), groups=(), laws=(), error=0.1, **values):
    """What a judge reads of a diagnosis."""
    estimates = {n: SimpleNamespace(value=v, std_error=0.01) for n, v in values.items()}
    stage = SimpleNamespace(holdout=SimpleNamespace(nrmse=error))
    none = dict.fromkeys(("detectable", "detectable_groups", "notes"), ())
    return SimpleNamespace(
        added=added,
        groups=groups,
        laws=laws,
        remaining=None,
        details="",
        stages=[stage],
        fit=SimpleNamespace(parameters=estimates),
        **none,
    )


def _law(port, signal, error):
    reported = SimpleNamespace(holdout=SimpleNamespace(nrmse=error))
    curve = SimpleNamespace(port=port)
    return SimpleNamespace(signals=(signal,), curve=curve, form=None, reported=reported)


BAND = users.Hidden("dead band", frozenset({"command_deadband"}), parameters={"half_width": 0.4})
TORQUE = users.Hidden("imbalance", ports=frozenset({"torque"}), signals=("angle",))


def _set(*hidden, close=None):
    made = users.draw("periodic_force", 3)
    return replace(made, hidden=hidden, says=(), never=(), close=close)


def test_a_law_at_the_right_port_is_right_only_where_the_error_reaches_the_true_structures():
    made = _set(TORQUE, close=1.15)
    for error, right in ((0.11, True), (0.12, False)):
        diag = _diagnosis(laws=[_law("torque", "angle", error)], error=0.3)
        judged = users.judge(diag, made, 0.1)
        assert judged.right is right
        assert judged.ratio == pytest.approx(10.0 * error)
        assert bool(judged.astray) is not right
    elsewhere = users.judge(_diagnosis(laws=[_law("torque", "rate", 0.1)]), made, 0.1)
    assert not elsewhere.right
    assert elsewhere.leading == "law at torque of rate"


def test_a_long_list_that_holds_the_true_effect_names_nothing():
    made = _set(BAND)
    alike = ("dry_friction", "command_deadband")
    few = users.judge(_diagnosis(("dry_friction",), (alike,)), made, 0.1)
    assert few.right
    many = users.judge(_diagnosis(("dry_friction",), ((*alike, "lag", "offset"),)), made, 0.1)
    assert not many.right
    assert many.missed == ("dead band",)


def test_an_effect_with_numbers_far_from_the_true_ones_is_another():
    made = _set(BAND)
    for width, right in ((0.45, True), (1.2, False)):
        values = {"command_deadband.half_width": width}
        diag = _diagnosis(("command_deadband",), (("command_deadband",),), **values)
        assert users.judge(diag, made, 0.1).right is right


@pytest.mark.thorough
def test_a_diagnosis_is_held_against_the_true_structure_where_no_other_is_fitted(capsys):
    with pytest.raises(SystemExit):
        main(["tanks", "--starts", "-1"])
    assert "at least 0" in capsys.readouterr().err
    squares = plain(users.draw("tanks", 0), starts=0)
    assert squares.keys() == {"truth", "true", "reached", "identified"}
    row = {"kind": "tanks", "seed": 0, "plain": squares}
    assert line(row).startswith(f"tanks 0: true structure {squares['true']['errors']['all']:.3f};")


@pytest.mark.slow
def test_rows_are_written_by_the_command(tmp_path):
    rows = tmp_path / "rows.jsonl"
    command = [sys.executable, "-m", "hidden.users", "gear_motor", "--count", "1", "--plain"]
    place = Path(__file__).parents[1]
    subprocess.run([*command, "--starts", "1", "--out", rows], cwd=place, check=True, timeout=300)
    (row,) = map(json.loads, rows.read_text().splitlines())
    assert row["plain"]["identified"]


@pytest.mark.slow
def test_a_diagnosis_that_goes_on_for_too_long_is_ended():
    row = work(("gear_motor", 0), limit=0.5, only_plain=False, starts=1)
    assert row["verdict"] == "too long"
    assert row["plain"]["identified"]
