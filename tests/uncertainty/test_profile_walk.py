"""The walk along a profile on likelihoods that are known in closed form."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from posterior_cases import (
    Better,
    DeeperError,
    ParameterLine,
    ProfilePoint,
    Profiles,
    QuantityLine,
    profile_module,
    spread,
    walk,
)

import diffthrust as dft
from diffthrust import InputError

REACH = 1.96


@dataclass
class Known:
    """A cost of one number, as the walk sees it."""

    cost: object
    best: float = 0.7
    scale: float = 0.2
    limits: tuple = (-np.inf, np.inf)
    held: object = staticmethod(lambda x: x)
    asked: list = field(default_factory=list)

    def start(self):
        return ProfilePoint(self.best, float(self.cost(self.best)), None, None, self.best)

    def ends(self):
        return self.limits

    def reach(self, x, near):
        self.asked.append(x)
        at = self.held(x)
        return ProfilePoint(at, float(self.cost(at)), None, None, x)

    def value(self, x):
        return x


def quadratic(x):
    return 3.0 + 0.5 * ((x - 0.7) / 0.2) ** 2


def lopsided(x):
    return 40.0 * (np.exp(-(x - 0.7)) + (x - 0.7))


def quartic(x):
    return -5.0 + ((x - 0.7) / 0.3) ** 4


def cliff(x):
    """Its root bends so much that plain regula falsi would come near from one side only."""
    return np.exp(40.0 * abs(x - 0.7)) - 1.0


@pytest.mark.parametrize("cost", [quadratic, lopsided, quartic, cliff])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_end_is_where_the_root_of_twice_the_drop_is_reached(cost, sign):
    line = Known(cost)
    side = walk(line, sign, REACH)
    assert side.why is None
    drop = cost(side.end) - cost(0.7)
    assert np.sqrt(2 * drop) == pytest.approx(REACH, rel=2e-4)
    assert sign * (side.end - 0.7) > 0
    places = np.array([p.x for p in side.points])
    assert np.all(np.diff(sign * places) > 0)
    assert places[0] == 0.7
    assert side.points[0].cost == cost(0.7)
    # one point lies a little beyond, so that a figure shows the crossing
    assert sign * (places[-1] - side.end) > 0
    assert len(line.asked) < 14


def test_a_quadratic_is_walked_in_thirds():
    line = Known(quadratic, scale=0.21)
    side = walk(line, 1.0, REACH)
    third = 0.2 * REACH / 3
    end = 0.7 + 3 * third
    asked = [0.7 + 1.05 * third, 0.7 + 2.05 * third, 0.7 + 3.05 * third, end, end + 0.6 * third]
    np.testing.assert_allclose(line.asked, asked, rtol=1e-12)
    assert side.end == pytest.approx(end, rel=1e-12)
    np.testing.assert_allclose([p.x for p in side.points], [0.7, *sorted(asked)], rtol=1e-12)


@pytest.mark.parametrize("scale", [0.02, 2.0])
def test_a_poor_guess_of_the_scale_is_mended_on_the_way(scale):
    side = walk(Known(quadratic, scale=scale), -1.0, REACH)
    assert side.end == pytest.approx(0.7 - 0.2 * REACH, rel=2e-4)


def test_a_bound_ends_it():
    line = Known(quadratic, limits=(0.6, 0.9))
    low, high = walk(line, -1.0, REACH), walk(line, 1.0, REACH)
    assert (low.end, low.why, high.end, high.why) == (None, "bound", None, "bound")
    assert low.points[-1].x == 0.6
    assert high.points[-1].x == 0.9
    begun = walk(Known(quadratic, limits=(0.7, np.inf)), -1.0, REACH)
    assert (begun.why, len(begun.points)) == ("bound", 1)
    # the end lies within, but no room is left for a point beyond
    near = 0.7 + 0.2 * REACH * 1.1
    side = walk(Known(quadratic, limits=(-np.inf, near)), 1.0, REACH)
    assert side.why is None
    assert side.points[-1].x <= near


def test_a_likelihood_that_never_falls_is_flat():
    line = Known(lambda x: 0.0 * x)
    side = walk(line, 1.0, REACH)
    assert (side.end, side.why) == (None, "flat")
    # each step is at most four times as long as the last, up to ten thousand standard errors
    moves = np.diff([p.x for p in side.points])
    np.testing.assert_allclose(moves[1:] / moves[:-1], 4.0)
    assert side.points[-2].x - 0.7 <= 1e4 * 0.2 < side.points[-1].x - 0.7
    assert walk(Known(lambda x: np.tanh(x) * 0.1, best=-3.0), 1.0, REACH).why == "flat"


def test_a_simulation_that_fails_halves_and_halves_the_step():
    def cost(x):
        return quadratic(x) if abs(x - 0.7) < 0.21 else np.inf

    line = Known(cost)
    side = walk(line, 1.0, REACH)
    assert (side.end, side.why) == (None, "fails")
    assert side.points[-1].x < 0.91
    alone = Known(lambda x: 1.0 if x == 0.7 else np.inf)
    side = walk(alone, 1.0, REACH)
    assert (side.why, len(side.points), len(alone.asked)) == ("fails", 1, 9)
    steps = np.array(alone.asked) - 0.7
    np.testing.assert_allclose(steps, REACH / 3 * 0.2 * 0.25 ** np.arange(9), rtol=1e-6)


def test_a_quantity_that_the_bounds_hold_back():
    line = Known(quadratic, held=lambda x: min(x, 0.85))
    side = walk(line, 1.0, REACH)
    assert (side.end, side.why) == (None, "stuck")
    assert side.points[-1].x == pytest.approx(0.85)
    still = Known(quadratic, held=lambda x: 0.7)
    assert walk(still, 1.0, REACH).why == "stuck"
    steps = np.array(still.asked) - 0.7
    np.testing.assert_allclose(steps, REACH / 3 * 0.2 * 4.0 ** np.arange(4), rtol=1e-9)


def test_a_lower_cost_on_the_way_ends_it_all():
    def cost(x, depth):
        return quadratic(x) - depth * (x > 0.8)

    for depth in (0.5, 2.0):
        with pytest.raises(DeeperError, match=r"lower cost than the fit's at 0\.8"):
            walk(Known(lambda x, d=depth: cost(x, d + 0.3)), 1.0, REACH)
    best = Known(lambda x: -0.999e-3 * (x != 0.7) + 0.0 * x)
    assert walk(best, 1.0, REACH).why == "flat"  # rounding is no other optimum
    with pytest.raises(DeeperError):
        walk(Known(lambda x: -1.01e-3 * (x != 0.7)), 1.0, REACH)


# A parameter as a line.


def held(transform="linear", bounds=(None, None), z=(0.3, 1.2), low=-9.0, high=9.0, info=None):
    info = np.array([[25.0, 6.0], [6.0, 4.0]]) if info is None else info
    p = dft.Parameter(2.0, "V", bounds, transform=transform, size=0.5)
    problem = SimpleNamespace(
        free=("a", "b"),
        named={"a": p, "b": p},
        limits=lambda: (np.full(2, low), np.full(2, high)),
    )
    q = SimpleNamespace(information=info, gradient=np.array([0.5, -0.3]), cost=1.0)
    return ParameterLine(problem, "a", ProfilePoint(0.0, 1.0, np.array(z), q, 0.0))


def test_the_scale_of_a_line_is_its_standard_error_and_no_more_than_one():
    line = held()
    assert line.place == 0
    inverse = np.linalg.inv([[25.0, 6.0], [6.0, 4.0]])
    np.testing.assert_allclose(spread(line.problem, line.best), inverse, rtol=1e-9)
    assert line.scale == pytest.approx(np.sqrt(inverse[0, 0]), rel=1e-9)
    assert held(info=np.diag([0.04, 4.0])).scale == 1.0
    # the other one at its bound says nothing
    assert held(z=(0.3, 9.0)).scale == pytest.approx(0.2, rel=1e-9)
    # at its own bound, by how steep the cost is there
    assert held(z=(-9.0, 1.2)).scale == pytest.approx(1.0 / (5.0 + 0.5), rel=1e-9)
    assert held(z=(9.0, 1.2), info=np.diag([0.01, 4.0])).scale == 1.0


def test_the_ends_of_a_line_are_the_bounds_or_ten_decades_away():
    assert held().ends() == (-9.0, 9.0)
    ten = 10 * np.log(10)
    assert held("log", (0, None)).ends() == pytest.approx((0.3 - ten, 0.3 + ten), abs=0.1)
    assert held("log", (0.5, 3.0)).ends() == (-9.0, 9.0)
    assert held("log", (0.5, None)).ends()[0] == -9.0
    assert held("log", (0.0, 3.0)).ends()[1] == 9.0
    line = held("linear", (0.1, None))
    assert line.value(1.4) == pytest.approx(0.7)
    assert line.value(0.1) == 0.1
    assert (line.start().x, line.start().aim) == (0.3, 0.3)


@pytest.mark.parametrize(
    ("why", "limit", "words"),
    [
        (None, 3.0, None),
        ("bound", 3.0, "reaches the bound 3"),
        ("bound", np.inf, "the likelihood never falls far enough"),
        ("flat", 3.0, "the likelihood never falls far enough"),
        ("stuck", 3.0, "the bounds of the parameters allow no more: 0.1235"),
        ("fails", np.inf, "beyond 0.1235 the simulation fails"),
    ],
)
def test_an_open_end_in_words(why, limit, words):
    point = ProfilePoint(0.12345, 1.0, None, None, 0.12345)
    side = SimpleNamespace(points=[point], end=None, why=why)
    met = 0.12345 if words == "reaches the bound 3" else None
    assert profile_module._open_end(Known(quadratic), side, limit, "more") == (words, met)


def quantity(value, slope, information):
    q = SimpleNamespace(information=np.array(information), gradient=np.zeros(2), cost=1.0)
    best = ProfilePoint(np.nan, 1.0, np.array([0.3, 1.2]), q, np.nan)
    problem = SimpleNamespace(limits=lambda: (np.full(2, -9.0), np.full(2, 9.0)))
    line = QuantityLine(problem, "gain", None, 0, best)
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

    def one(line, estimate, threshold, level):
        name, at = line.name, int(line.best.z[0])
        if name == "b" and at < len(lower):
            raise DeeperError(ProfilePoint(0.0, 0.0, np.array([at + 1.0]), None, 0.0))
        return SimpleNamespace(name=name, at=at, threshold=threshold, level=level)

    monkeypatch.setattr(profile_module, "threshold_of", lambda problem, z, level: 3.7)
    monkeypatch.setattr(profile_module, "optimum_at", optimum)
    monkeypatch.setattr(profile_module, "_profile", one)
    problem = SimpleNamespace(values=lambda z: {"a": float(z[0])})
    fit = SimpleNamespace(parameters={"a": None, "b": None})
    found = profile_module.profiles_of(
        fit, problem, np.zeros(1), ("a", "b"), None, {}, 0.9, lambda *said: told.append(said)
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
