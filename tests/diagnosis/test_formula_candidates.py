"""A user's own hypotheses among the candidates of a diagnosis."""

from __future__ import annotations

import math
import tomllib
from functools import cache

import numpy as np
import pytest
from one_truth import contradictions
from reference import inputs, thruster
from reference.hidden import THRUSTER, Effect

import diffthrust as dft
from diffthrust import InputError
from diffthrust.diagnosis._candidates import candidates_of  # private: what is tried, without trials
from diffthrust.effects import Formula

LEVEL, WIDTH = 8.0, 9.0
HUMP = "-a * speed / width * exp(-(speed / width)**2)"


def hump(acceleration, s, *, level=0.0, width=WIDTH):
    """What is hidden, and is in no catalogue: a resistance that fades where the shaft is fast."""
    return acceleration - level * s.speed / width * math.exp(-((s.speed / width) ** 2))


def asked(name="hump", text=HUMP, **more):
    parameters = {"a": "rad/s^2", "width": {"unit": "rad/s", "value": 6.0, "bounds": (0, None)}}
    return Formula("shaft", text, name=name, **{**parameters, **more})


@cache
def logs():
    """Two short logs, the second unseen, from the independent simulator."""
    out = []
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        time = inputs.grid(15.0, 0.05)
        command = inputs.staircase(time, list(rng.uniform(-1.5, 1.5, 20)), 0.75)
        table = {**THRUSTER, "hump": Effect("shaft", hump)}
        made = thruster.simulate(time, command, method="rk4", catalogue=table, hump=LEVEL)
        noise = {"speed": 0.1, "thrust": 0.1}
        seen = {n: made.truth[n] + rng.normal(0, level, time.size) for n, level in noise.items()}
        out.append(dft.Log(time, {"command": command}, seen))
    return out


def test_a_hypothesis_that_is_right_is_found_and_can_be_copied(tmp_path):
    train, unseen = logs()
    wrong = Formula("load", "value * (1 + b * cos(time))", name="wave", b="")
    diag = dft.diagnose(
        dft.Thruster(),
        train,
        holdout=unseen,
        candidates=[asked(), wrong, "linear_damping"],
        experiment=False,
    )
    assert diag.added == ("hump",)
    assert not contradictions(diag)
    assert diag.after.errors.nrmse < 0.5 * diag.before.errors.nrmse
    for name, value in (("hump.a", LEVEL), ("hump.width", WIDTH)):
        found = diag.fit.parameters[name]
        assert abs(found.value - value) < 4 * found.std_error  # 1 in 8000 each
    diag.save(tmp_path / "diag.html")
    assert HUMP in (tmp_path / "diag.html").read_text()  # what the effect does, in the page
    told = diag.report()
    scope = {"dft": dft}
    exec(next(row for row in told.splitlines() if row.startswith("model = ")), scope)
    line = next(row for row in told.splitlines() if row.startswith("effects = "))
    copied = Formula(**{
        {"formula": "expression"}.get(key, key): value
        for key, value in tomllib.loads(line)["effects"][0].items()
    })  # fmt: skip
    for effect in (scope["model"].effects[0], copied):
        assert effect.structure == asked().structure
        assert effect.declared == asked().declared
    diag.save(tmp_path / "diag.json")
    again = dft.load(tmp_path / "diag.json")
    assert again.report() == told
    assert dft.compare(again.fit, unseen).errors == dft.compare(diag.fit, unseen).errors


def test_it_stands_beside_the_catalogue_and_is_tried_for_what_it_needs():
    model, (train, unseen) = dft.Thruster(), logs()
    sag = Formula("drive", "value * (1 + k * (supply_voltage - 24))", name="sag", k="1/V")
    tried, untestable = candidates_of(model, (train, unseen), ["all", asked(), sag])
    assert [effect.name for effect in tried][-1] == "hump"
    assert len(tried) > 10
    assert untestable["sag"] == "needs the channel 'supply_voltage', which no log has"
    with pytest.raises(InputError, match="'sped' is no parameter"):
        candidates_of(model, (train,), asked(text=f"{HUMP} * sped"))
    assert asked().name not in [
        e.name for e in candidates_of(model + asked(), (train,), asked())[0]
    ]
