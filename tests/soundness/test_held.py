"""Sensors that repeat their last reading, among made logs of all kinds.

``python -m soundness.held 400``: of 800 channels that are not held none is said to be, so that with
95 % certainty fewer than 0.4 % are; of 100 that are, every one is found.
"""

from . import held


def test_no_channel_that_is_read_at_every_sample_is_called_held():
    assert held.false_alarms(40, 5) == {}  # up to 0.4 % of 80: less than one


def test_channels_read_at_irregular_times_are_found():
    found, right, missed, false = held.detected(10, 5)
    assert (found, false) == (10, 0)
    assert missed < 0.06 * (right + missed)  # a reading may equal the previous one
