"""What a diagnosis tries on a craft: one program an effect, no matter on how many thrusters."""

import numpy as np
import pytest
from steps import CandidateFitter, added, bind, candidates_of, probes, shift_of

import diffthrust as dft

PLACES = {"t1": (0.1, 0.2, 0.0), "t2": (0.1, -0.2, 0.0)}


@pytest.fixture(scope="module")
def craft():
    thruster = dft.Thruster()
    mounts = {name: thruster.at(place) for name, place in PLACES.items()}
    return dft.Craft(dft.bodies.Planar(), **mounts, share=[tuple(PLACES)])


@pytest.fixture(scope="module")
def record(craft):
    rng = np.random.default_rng(5)
    time = 0.1 * np.arange(60)
    commands = {n: np.repeat(rng.uniform(-1.0, 1.0, 6), 10) for n in craft.inputs}
    out = dft.simulate(craft, dft.Log(time, commands))
    measured = {n: out[n] + rng.normal(0.0, 0.01, time.size) for n in ("surge", "yaw_rate")}
    return bind(craft, [dft.Log(time, commands, measured)])


def test_an_effect_on_the_net_force_of_a_body_is_tried_on_no_thruster(craft, record):
    tried, untestable = candidates_of(craft, record)
    names = {effect.name for effect in tried} | {*untestable}
    assert "t2.actuator_lag" in names
    assert not any("buoyancy" in name for name in names)


def test_placed_effects_of_the_catalogue_are_not_the_users_own(craft, record):
    """Each of the user's own is fitted to whole runs from several starts, promising or not."""

    class Fouling(dft.Effect):
        name = "fouling"
        port = "propeller"
        loss: float = dft.parameter(0.1, bounds=(0, 1), null=0.0)

        def __call__(self, value, s):
            return (1.0 - self.loss) * value

    tried, _ = candidates_of(craft, record)
    assert len(tried) > 20
    assert [effect.name for effect in tried if effect.of_user] == []
    assert craft.placed(Fouling(), "t1").of_user


@pytest.mark.thorough
@pytest.mark.parametrize("word", ["command_deadband", "actuator_lag"])
def test_one_program_serves_an_effect_on_every_thruster(craft, record, word):
    effects = [*craft.placements(dft.effects.EFFECTS[word]())]
    fitter = CandidateFitter(craft, effects, record, [])
    response, before = fitter.base().response, added.traces
    shifts = []
    for effect in effects:
        _, far = probes(effect, {})
        values = {n.rpartition(".")[2]: v for n, v in far[0].items()}
        shifts.append(shift_of(response, effect, values))
    assert added.traces <= before + 1
    on_all, *on_one = shifts
    assert {*on_all} == {place for shift in on_one for place in shift}
    for shift in on_one:
        for place, (now, _) in shift.items():
            np.testing.assert_allclose(now, on_all[place][0])
            assert np.any(now[0])
