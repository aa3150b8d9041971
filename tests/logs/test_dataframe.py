"""Logs of pandas' data frames, whatever their index holds."""

import numpy as np
import pandas as pd
import pytest

from diffthrust import Column, InputError, Log

T = np.array([0.0, 0.1, 0.25, 0.4])


def frame(index=None, **more):
    columns = {"u": [0, 1, 2, 2], "rpm": [0.0, 60.0, np.nan, 120.0], **more}
    return pd.DataFrame(columns, index=index)


def make(given, **more):
    channels = dict(inputs={"command": "u"}, measured={"speed": Column("rpm", unit="rpm")})
    return Log.from_dataframe(given, **{**channels, **more})


START = pd.Timestamp("2025-03-30 01:59:59.9")


@pytest.mark.parametrize(
    "index",
    [
        pd.Index(T, name="time"),
        pd.Index(T),
        pd.to_timedelta(T, unit="s"),
        START + pd.to_timedelta(T, unit="s"),
        # the hour in which Berlin's clocks are put on
        (START.tz_localize("UTC") + pd.to_timedelta(T, unit="s")).tz_convert("Europe/Berlin"),
        (START.tz_localize("Europe/Berlin") + pd.to_timedelta(T, unit="s")),
        pd.Index([str(START + pd.Timedelta(seconds=s)) for s in T]),
        pd.to_datetime([0, 100, 250, 400], unit="ms"),
        pd.to_datetime([0, 100, 250, 400], unit="ms").astype("datetime64[ms]"),
        pd.PeriodIndex(START + pd.to_timedelta(T, unit="s"), freq="ms"),
    ],
)
def test_any_index_that_is_a_time(index):
    log = make(frame(index))
    np.testing.assert_allclose(log.time, T, atol=1e-9)
    np.testing.assert_array_equal(log.inputs["command"], [0, 1, 2, 2])
    np.testing.assert_allclose(log.values("speed", "rpm"), [0, 60, np.nan, 120])
    assert log.units["speed"] == "rad/s"
    assert "measured 'speed': 1 of 4 samples are missing and carry no weight." in log.notes


def test_a_whole_number_counts_where_it_is_named():
    log = make(frame(pd.Index([0, 20, 40, 60], name="t")), time=Column("t", unit="ms"))
    np.testing.assert_allclose(log.time, [0, 0.02, 0.04, 0.06])
    np.testing.assert_array_equal(make(frame(pd.Index([5, 6, 8, 9], name="t"))).time, [5, 6, 8, 9])


@pytest.mark.parametrize("index", [None, pd.RangeIndex(0, 8, 2), pd.Index([3, 5, 6, 9])])
def test_an_index_that_counts_rows_is_no_time_and_each_mend_works(index):
    given = frame(index, t=T)
    with pytest.raises(InputError, match="an index that counts rows") as caught:
        make(given)
    assert "time = 't'" in caught.value.mend
    np.testing.assert_array_equal(make(given, time="t").time, T)
    assert "time = 0.05" in caught.value.mend
    np.testing.assert_allclose(make(given, time=0.05).time, [0, 0.05, 0.1, 0.15])
    assert "frame.index.name = 'time'" in caught.value.mend
    given.index.name = "time"
    np.testing.assert_array_equal(make(given).time, given.index)


def test_columns_of_every_type():
    given = frame(
        pd.Index(T),
        on=[True, False, True, False],
        kind=pd.Categorical(["1", "2", "1", "2"]),
        whole=pd.array([1, 2, None, 4], dtype="Int64"),
        single=np.array([1, 2, 3, 4], dtype=np.float32),
        text=["1", "2,5", None, "n/a"],
        mixed=[1, 2.5, None, "n/a"],
        arrow=pd.array([1, 2, None, 4], dtype="int64[pyarrow]"),
    )
    for column, expected in [
        ("on", [1, 0, 1, 0]),
        ("kind", [1, 2, 1, 2]),
        ("whole", [1, 2, np.nan, 4]),
        ("single", [1, 2, 3, 4]),
        ("text", [1, 2.5, np.nan, np.nan]),
        ("mixed", [1, 2.5, np.nan, np.nan]),
        ("arrow", [1, 2, np.nan, 4]),
    ]:
        log = make(given, measured={"q": column}, missing_values=["n/a"])
        np.testing.assert_array_equal(log.measured["q"], expected)


@pytest.mark.parametrize(
    ("given", "more", "words"),
    [
        (frame(pd.Index(T)), {"measured": {"q": "rpn"}}, "nearest is 'rpm'"),
        (frame(pd.Index(T), w=["a", 1, 2, 3]), {"measured": {"q": "w"}}, "row 1, column 'w'.*'a'"),
        (frame(pd.Index(T), w=[[1], 2, 3, 4]), {"measured": {"q": "w"}}, "values of type object"),
        (frame(pd.Index(T), w=[1j] * 4), {"measured": {"q": "w"}}, "values of type complex"),
        (frame(pd.Index([0.0, 1.0, 0.5, 2.0])), {}, "row 3, column 'the index'.*backward"),
        (frame(pd.Index(T), u2=T).rename(columns={"u2": "u"}), {}, "several"),
        (frame(pd.MultiIndex.from_product([[0, 1], [0, 1]])), {}, "2 levels"),
        (
            frame(pd.Index(["03/04/2025", "04/04/2025", "05/04/2025", "06/04/2025"])),
            {},
            "several d",
        ),
        ({"u": [1]}, {}, "expected a pandas DataFrame, found dict"),
        (frame(pd.Index(T)), {"time": -0.1}, "a step above zero, found -0.1"),
        (frame(pd.Index(T)), {"time": "nothing"}, "column 'nothing'"),
        (frame(pd.Index(T))[:0], {}, "found none in 0 rows"),
    ],
)
def test_defects(given, more, words):
    with pytest.raises(InputError, match=words) as caught:
        make(given, **more)
    assert caught.value.problem.startswith("log")
    assert caught.value.mend


def test_columns_of_several_levels():
    given = pd.DataFrame(
        {("left", "rpm"): [1.0, 2.0], ("right", "rpm"): [3.0, 4.0]}, index=[0.0, 1]
    )
    log = make(given, inputs={}, measured={"speed": "right.rpm"})
    np.testing.assert_array_equal(log.measured["speed"], [3, 4])


def test_the_frame_stays_as_it_was():
    given = frame(pd.Index(T))
    before = given.copy()
    make(given, missing_values=[60.0], start=0.1)
    pd.testing.assert_frame_equal(given, before)
