"""What stands around a walk: lines of quantities, lower optima on the way, names that are none."""

from types import SimpleNamespace

import numpy as np
import pytest

from diffthrust import InputError
from diffthrust.uncertainty import _profile as profile_module  # private: its rounds
from diffthrust.uncertainty._profile_lines import (  # private: a line of one's own
    ProfilePoint,
    QuantityLine,
)
from diffthrust.uncertainty._profile_result import Better, Profiles  # private: made by a call
from diffthrust.uncertainty._profile_walk import DeeperError  # private: raised by a walk


def quantity(value, slope, information):
    q = SimpleNamespace(information=np.array(information), gradient=np.zeros(2), cost=1.0)
    best = ProfilePoint(np.nan, 1.0, np.array([0.3, 1.2]), q, np.nan)
    problem = SimpleNamespace(limits=lambda: (np.full(2, -9.0), np.full(2, 9.0)))
    line = QuantityLine(problem, None, 0, best)
    line.__dict__["_slope"] = (value, np.array(slope))
    return line


def test_a_quantity_as_a_line():
    line = quantity(2.5, [1.5, -0.4], [[25.0, 6.0], [6.0, 4.0]])
    inverse = np.linalg.inv([[25.0, 6.0], [6.0, 4.0]])
    variance = np.array([1.5, -0.4]) @ inverse @ np.array([1.5, -0.4])
    assert line.scale == pytest.approx(np.sqrt(variance), rel=1e-9)
    assert quantity(-2.5, [0.0, 0.0], np.eye(2)).scale == pytest.approx(0.25)
    assert quantity(0.0, [0.0, 0.0], np.eye(2)).scale == 0.1
    assert line.ends() == (-np.inf, np.inf)
    assert (line.start().x, line.start().aim, line.start().cost) == (2.5, 2.5, 1.0)
    assert line.value(1.75) == 1.75


def rounds(monkeypatch, lower):
    """Profiles of two parameters whose walks come to these lower costs, one after the other."""
    costs, told = [10.0, *lower], []

    def optimum(problem, z):
        at = int(z[0])
        return ProfilePoint(np.nan, costs[at], np.array([float(at)]), None, np.nan)

    def one(fit, problem, name, line, threshold, level):
        at = int(line.best.z[0])
        if name == "b" and at < len(lower):
            raise DeeperError(ProfilePoint(0.0, 0.0, np.array([at + 1.0]), None, 0.0))
        return SimpleNamespace(name=name, at=at, threshold=threshold, level=level)

    monkeypatch.setattr(profile_module, "threshold_of", lambda problem, z, level: 3.7)
    monkeypatch.setattr(profile_module, "optimum_at", optimum)
    monkeypatch.setattr(profile_module, "_profile", one)
    problem = SimpleNamespace(values=lambda z: {"a": float(z[0])})
    found = profile_module.profiles_of(
        None, problem, np.zeros(1), ("a", "b"), None, {}, 0.9, lambda *said: told.append(said)
    )
    return found, told


def test_profiles_belong_to_the_lowest_optimum(monkeypatch):
    found, told = rounds(monkeypatch, [])
    assert found.better is None
    assert [(p.name, p.at, p.threshold, p.level) for p in found.profiles.values()] == [
        ("a", 0, 3.7, 0.9),
        ("b", 0, 3.7, 0.9),
    ]
    assert told == [("profile of a", 0.0), ("profile of b", 0.5)]
    found, told = rounds(monkeypatch, [9.2, 8.5])
    assert found.better == Better({"a": 2.0}, 1.5)
    assert [p.at for p in found.profiles.values()] == [2, 2]
    assert len(told) == 6
    with pytest.raises(InputError, match="3 times a lower cost than the best so far"):
        rounds(monkeypatch, [9.0, 8.0, 7.0])


def test_names_that_can_be_profiled():
    fit = SimpleNamespace(free=("alpha", "beta"), parameters={"alpha": 1, "beta": 2, "ct": 3})
    wanted = profile_module._wanted
    assert wanted(fit, None) == ("alpha", "beta")
    assert wanted(fit, "beta") == ("beta",)
    assert wanted(fit, ["beta", "alpha"]) == ("beta", "alpha")
    with pytest.raises(InputError, match="'ct' is held in this fit") as refused:
        wanted(fit, "ct")
    assert refused.value.mend == "Free it and fit again."
    with pytest.raises(InputError, match="'alpa' is no parameter in this fit") as refused:
        wanted(fit, "alpa")
    assert "alpha" in refused.value.mend


@pytest.mark.parametrize("level", [0.0, 1.0, 1, 0, 95.0, -0.1, "0.9", None])
def test_levels_that_are_none(level):
    with pytest.raises(InputError, match="profile, level: expected a number between 0 and 1"):
        profile_module.check_level(level, "profile")
    profile_module.check_level(0.5, "profile")


def test_a_better_optimum_is_told():
    better = Better({"a": 1.25, "b": 3.0}, 2.3456)
    found = Profiles({}, 0.9, better)
    (told,) = found.sentences
    assert "was found on the way, by 2.35 in log-likelihood" in told
    assert "a = 1.250, b = 3.000" in told
    data = found.to_json()
    assert data["better"] == {"values": {"a": 1.25, "b": 3.0}, "gain": 2.3456}
    assert (data["schema"], data["level"], data["profiles"]) == (1, 0.9, {})
    assert Profiles({}, 0.9).to_json()["better"] is None
    assert Profiles({}, 0.9).sentences == []
    assert (len(found), list(found), found._line()) == (0, [], "90 %: ")
