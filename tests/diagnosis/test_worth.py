"""What an effect is worth over whole runs, and how sure that is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from steps import (
    BeforeAfter,
    ChannelError,
    Errors,
    Worth,
    explained_share,
    far_above_noise,
    harms,
    matters,
    negligible,
    sure_share,
    surely_less,
    told_apart,
)


def lasting(rng, size=1500, memory=0.97):
    return lfilter([1.0], [1.0, -memory], rng.standard_normal(size))


def test_the_share_is_that_of_the_squared_errors_whatever_the_unit():
    rng = np.random.default_rng(0)
    measured, rest = rng.standard_normal(400), rng.standard_normal(400)
    speed = BeforeAfter(measured, rest, 0.5 * rest)
    same = BeforeAfter(1e3 * measured, 1e3 * rest, 1e3 * rest)
    alone = explained_share([{"speed": speed}])
    assert alone.share == pytest.approx(0.75)
    both = explained_share([{"speed": speed, "thrust": same}])
    assert both.share == pytest.approx(0.375)
    assert both.channels["speed"].share == pytest.approx(0.75)
    assert both.channels["thrust"].share == pytest.approx(0.0)
    assert both.low <= both.share <= both.high


def test_samples_that_were_not_measured_do_not_count():
    rng = np.random.default_rng(1)
    measured, rest = rng.standard_normal(400), rng.standard_normal(400)
    gap = np.where(np.arange(400) % 3 == 0, np.nan, measured)
    after = np.where(np.isnan(gap), 1e9, 0.5 * rest)
    assert explained_share([{"speed": BeforeAfter(gap, rest, after)}]).share == pytest.approx(0.75)


def test_a_run_that_fails_with_an_effect_is_no_gain():
    rest = np.random.default_rng(2).standard_normal(100)
    failed = BeforeAfter(rest, rest, np.full(100, np.inf))
    worth = explained_share([{"speed": failed}])
    assert worth.share == -np.inf
    assert not worth.sure


def test_what_changes_nothing_is_rarely_sure_although_errors_last():
    """Of 200 pairs of models that err alike a tenth at most is sure: 5 % are asked, p < 0.002."""
    sure = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        logs = []
        for _ in range(2):
            common, measured = lasting(rng), 10 * rng.standard_normal(1500)
            one, other = (common + 0.5 * lasting(rng) for _ in range(2))
            logs.append({"speed": BeforeAfter(measured, one, other)})
        sure += explained_share(logs, seed).low > 0
    assert sure <= 20


def test_an_effect_matters_where_it_is_sure_and_more_than_a_trifle():
    sure, trifle = Worth(0.5, 0.3, 0.6), Worth(0.01, 0.005, 0.02)
    unsure = Worth(0.1, -0.1, 0.3)
    assert matters(sure)
    assert not matters(trifle)
    assert not matters(unsure)
    assert matters(replace(unsure, everywhere=Worth(0.1, 0.05, 0.2)))  # all are sure
    assert not matters(Worth(-0.02, -0.1, 0.1, everywhere=Worth(0.1, 0.05, 0.2)))  # unseen are not
    one = Worth(0.02, 0.01, 0.03, {"speed": Worth(0.0, 0, 0), "thrust": Worth(0.6, 0.5, 0.7)})
    assert matters(one)  # a small channel gains by much


def drowned(gain, loss=0.0):
    """A sway that nothing explains beside a surge of which a drag removes a share."""
    channels = {"surge": Worth(gain, gain - 0.1, gain + 0.1), "sway": Worth(-loss, -0.4, 0.3)}
    return Worth(0.0, -0.3, 0.3, channels)


def test_a_channel_that_nothing_explains_drowns_no_other():
    """BlueBoat exchanged: the drag removes half of the surge error, -2 % (-11 % to 5 %) of all."""
    worth = drowned(0.61)
    assert matters(worth)
    assert sure_share(worth).channel == "surge"
    assert matters(
        replace(drowned(0.61, loss=0.05), everywhere=worth)
    )  # the sway may well be as it was
    assert not matters(drowned(0.08))  # not even a tenth
    assert not matters(replace(worth, everywhere=drowned(0.05)))  # by chance
    worse = {**worth.channels, "sway": Worth(-0.2, -0.4, -0.1)}
    assert harms(Worth(-0.1, -0.3, 0.1, worse))
    assert not harms(worth)
    assert not matters(replace(worth, everywhere=Worth(-0.1, -0.3, 0.1, worse)))
    blind = {**worse, "sway": replace(worse["sway"], nrmse=1.2)}  # no better than a constant
    assert matters(replace(worth, everywhere=Worth(-0.1, -0.3, 0.1, blind)))


def test_more_than_all_is_told_only_where_nothing_else_is_sure():
    """Two drags removed 118 % of a boat's north error as given, which a current had raised."""
    north, east = Worth(1.18, 0.78, 1.64), Worth(0.2, 0.1, 0.3)
    assert sure_share(Worth(0.3, 0.2, 0.4, {"north": north, "east": east})).channel == ""
    assert sure_share(Worth(0.1, -0.1, 0.4, {"north": north, "east": east})).channel == "east"
    assert sure_share(Worth(0.1, -0.1, 0.4, {"north": north})).worth is north


def test_a_trial_of_whole_runs_that_shows_any_change_leaves_it_to_a_fit():
    nothing = Worth(0.01, -0.1, 0.1, {"surge": Worth(0.05, 0.0, 0.1), "sway": Worth(0.0, 0, 0)})
    assert negligible(nothing)
    early = {"surge": Worth(0.52, -0.02, 0.77), "yaw_rate": Worth(-0.63, -4.92, 0.66)}
    assert not negligible(
        replace(nothing, everywhere=Worth(0.02, -0.4, 0.3, early))
    )  # unsure, and large
    assert not negligible(Worth(-0.2, -0.4, -0.1, everywhere=nothing))  # worse
    assert not negligible(Worth(np.nan, np.nan, np.nan, everywhere=nothing))


def test_a_share_is_said_of_what_it_is_surely_a_share_of():
    channels = {"speed": Worth(0.83, 0.7, 0.9), "thrust": Worth(0.0, -0.1, 0.1)}
    assert sure_share(Worth(0.1, -0.05, 0.22, channels)).channel == "speed"
    assert sure_share(Worth(0.1, 0.05, 0.22, channels)).channel == "speed"  # surely more than all
    even = {"speed": Worth(0.72, 0.6, 0.8), "thrust": Worth(0.68, 0.5, 0.8)}
    assert sure_share(Worth(0.7, 0.6, 0.8, even)).channel == ""
    unsure = Worth(0.02, -0.01, 0.03)
    assert sure_share(unsure) is None
    assert sure_share(Worth(0.02, -np.inf, 0.0)) is None
    assert sure_share(Worth(0.02, 1e-4, 0.03)) is None  # printed as 0.0 %
    both = sure_share(Worth(0.02, -0.01, 0.03, everywhere=Worth(0.03, 0.01, 0.04)))
    assert both == (Worth(0.03, 0.01, 0.04), "", True)


@pytest.mark.thorough
def test_of_noise_next_to_nothing_matters_and_of_what_is_there_most():
    """Three channels, one dominating: in 3 % of 200 sets at most where an effect removes nothing.

    Where it removes a quarter of a small channel, in 90 % of 50 at least.
    """

    def unseen_and_all(logs, seed):
        return replace(explained_share(logs[:1], seed), everywhere=explained_share(logs, seed))

    false = right = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        logs, helped = [], []
        for _ in range(3):
            log = {}
            for name, size in (("sway", 10.0), ("surge", 1.0), ("yaw_rate", 1.0)):
                errors = size * lasting(rng, 800, 0.9)
                change = 0.1 * size * lasting(rng, 800, 0.9)
                log[name] = BeforeAfter(10 * rng.standard_normal(800), errors, errors + change)
            logs.append(log)
            seen, before, after = log["surge"]
            helped.append({**log, "surge": BeforeAfter(seen, before, 0.85 * after)})
        false += matters(unseen_and_all(logs, seed))
        if seed < 50:
            right += matters(unseen_and_all(helped, seed))
    assert false <= 6
    assert right >= 45


def test_errors_lie_far_above_where_they_grow_over_whole_runs_and_are_relevant():
    def whole(rmse, nrmse):
        return Errors(nrmse, {"speed": ChannelError(rmse, nrmse, 0.0, 500)})

    assert far_above_noise(whole(3.0, 0.3), {"speed": 0.3}) == ("speed",)
    assert far_above_noise(whole(3.0, 0.3), {"speed": 2.0}) == ()  # the noise of the sensor
    assert far_above_noise(whole(3.0, 0.02), {"speed": 0.3}) == ()  # too small to matter
    assert far_above_noise(whole(np.inf, np.inf), {"speed": 0.3}) == ("speed",)


def test_readings_of_a_held_sensor_make_errors_that_last_no_surer():
    """Taken as errors that come and go, every 20th sample gave a third less of an interval."""
    rng = np.random.default_rng(17)

    def width(before, after, read):
        seen = np.where(read, rng.standard_normal(before.size), np.nan)
        worth = explained_share([{"speed": BeforeAfter(seen, before, 0.7 * after)}])
        return worth.high - worth.low

    every, held = [], []
    for _ in range(20):
        errors = [lasting(rng, 4000, np.exp(-1 / 200)) for _ in range(2)]
        every.append(width(*errors, np.ones(4000, bool)))
        held.append(width(*errors, np.arange(4000) % 20 == 0))
    assert np.mean(held) > 0.85 * np.mean(every)


def alike(share):
    return Worth(share, share - 0.05, share + 0.05)


def test_a_rival_is_told_from_an_effect_where_whole_runs_are_surely_better_with_the_effect():
    """A surge drag that lowers nothing was named as what the wind at the Esso Osaka may be."""
    wind, ahead = alike(0.75), alike(0.7)
    assert told_apart(wind, ahead, ahead)
    near = alike(0.15)
    assert not told_apart(wind, near, near)  # within a tenth of the error


def test_a_rival_of_a_small_effect_must_do_what_this_does():
    """In the place of an NGS thruster's command offset, 11 %, stood what removes 4 % of it."""
    offset, ahead, nothing = alike(0.11), Worth(0.07, 0.04, 0.12), Worth(-0.005, -0.02, 0.02)
    assert told_apart(offset, nothing, ahead)
    assert not told_apart(offset, nothing, Worth(0.07, -0.01, 0.12))  # it may be chance
    assert not told_apart(None, nothing, ahead)
    by_channel = {"speed": Worth(-0.03, -0.05, -0.01), "thrust": Worth(0.09, 0.04, 0.16)}
    all_of_it = Worth(0.02, -0.01, 0.05, by_channel)
    assert told_apart(replace(offset, channels={"speed": alike(0.0), "thrust": alike(0.12)}),
                      nothing, all_of_it)  # fmt: skip


def test_only_what_an_effect_surely_does_tells_a_rival_apart():
    """A rival that errs a little more in a channel in which the effect does nothing is as good."""
    losing = {"speed": alike(0.0), "thrust": Worth(0.04, 0.01, 0.07)}
    ahead = Worth(0.02, -0.01, 0.05, losing)
    for share in (0.0, -0.3, math.nan):
        own = Worth(share, share - 0.05, share + 0.05)
        effect = Worth(0.9, 0.8, 0.95, {"speed": alike(0.9), "thrust": own})
        assert not told_apart(effect, ahead, ahead)
    assert not told_apart(Worth(math.nan, math.nan, math.nan), ahead, alike(0.1))
    # unseen logs err less with the rival, whatever the training logs say
    better = Worth(-0.15, -0.2, -0.1)
    assert not told_apart(alike(0.11), better, alike(0.08))
    assert told_apart(alike(0.11), Worth(0.01, -0.02, 0.04), alike(0.08))


@pytest.mark.parametrize(("thrust", "apart"), [(0.15, False), (0.7, True)])
def test_a_rival_must_err_as_little_in_every_channel(thrust, apart):
    """A saturation, thrust error 3.6 N, was named as what a weaker thrust astern (2.0) may be."""
    by_channel = {"speed": Worth(0.02, -0.1, 0.1), "thrust": Worth(thrust, -0.1, 0.9)}
    everywhere, unseen = Worth(0.1, -0.1, 0.2, by_channel), Worth(0.1, -0.1, 0.2)
    assert told_apart(None, unseen, everywhere) is apart
    assert told_apart(None, everywhere, unseen) is apart
    assert told_apart(None, Worth(0.18, -0.1, 0.3), unseen)  # 1.1 times the error leaves 0.174
    assert not told_apart(None, Worth(-3.0, -9.0, -1.0), unseen)  # the rival is ahead
    assert told_apart(None, Worth(-math.inf, -math.inf, -math.inf), unseen)  # nothing is known


def test_errors_are_surely_less_in_one_channel_where_no_other_suffers():
    """What a wrong constant does to one channel may drown in the errors of the others."""

    def worth(yaw_rate, sway):
        shares = {"yaw_rate": Worth(*yaw_rate), "sway": Worth(*sway)}
        return Worth(0.001, -0.01, 0.01, shares)

    assert surely_less(Worth(0.02, 0.01, 0.03))
    assert surely_less(worth((0.02, 0.01, 0.03), (0.0, -0.1, 0.1)))
    assert not surely_less(worth((0.02, 0.01, 0.03), (-0.2, -0.3, -0.1)))
    assert not surely_less(worth((0.02, -0.01, 0.03), (0.0, -0.1, 0.1)))
