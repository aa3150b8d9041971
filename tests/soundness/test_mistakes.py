"""The study on measured logs: a part of it at each change, all of it where slow tests run."""

import pytest
from shared_data import data_folder

from . import mistakes, sound

QUICK = (
    "thrust negated",
    "speed and thrust exchanged",
    "left and right exchanged",
    "yaw rate: deg/s called rad/s",
    "time: twice as fast",
    "thrust 0.6 s late",
    "sensor stuck for a sixth",
    "missing written as -999",
    "one log of four: thrust in kgf",
)


@pytest.fixture(scope="module")
def root():
    return data_folder("ngs_thruster").parent


def test_some_mistakes_in_measured_logs_are_named(root):
    chosen = [mistake for mistake in mistakes.MISTAKES if mistake.name in QUICK]
    assert len(chosen) == len(QUICK)
    for name, tally in mistakes.study(root, chosen).items():
        assert (tally.named, tally.other, tally.beside) == (3, [], []), name


@pytest.mark.thorough
def test_measured_logs_as_published_have_the_defects_that_are_known(root):
    told = sound.real_defects(root)
    assert told
    held = ("north (stuck)", "east (stuck)")  # positions of a receiver slower than the log
    exchanged = [line for line in told if not any(words in line for words in held)]
    assert exchanged
    assert all("left_force (exchanged)" in line for line in exchanged)


@pytest.mark.slow
@pytest.mark.parametrize(("names", "least"), [(mistakes.THREE, 151), (mistakes.OTHERS, 148)])
def test_mistakes_are_named(root, names, least):
    tallies = mistakes.study(root, names=names)
    assert len(tallies) >= 50
    assert sum(tally.named for tally in tallies.values()) >= least
    assert not [tally.other for tally in tallies.values() if tally.other]
    # nothing in a log tells a constant factor of its thrust
    assert tallies["thrust: kgf called N"].missed == 3


@pytest.mark.slow
def test_sound_logs_are_not_doubted(root):
    alarms, count = sound.false_alarms(root, 300, seed=11)
    assert len(alarms) <= 0.01 * count, alarms
    alarms, count = sound.false_alarms_of_sets(root, 60, seed=11)
    assert len(alarms) <= 1, alarms
