"""Sensors that repeat their last reading, among made logs of all kinds.

Of 320 channels that are not held (seeds 5 and 77, on which the rule was not set) none is said to
be, so that with 95 % certainty fewer than 0.9 % are; of 40 that are, every one is found. The rule
was set on the seed of ``python -m soundness.held 400``: its 800 without an alarm prove less.
"""

from . import held


def test_no_channel_that_is_read_at_every_sample_is_called_held():
    assert held.false_alarms(40, 5) == {}  # up to 0.9 % of 80: less than one


def test_channels_read_at_irregular_times_are_found():
    found, right, missed, false = held.detected(10, 5)
    assert (found, false) == (10, 0)
    assert missed < 0.06 * (right + missed)  # a reading may equal the previous one
