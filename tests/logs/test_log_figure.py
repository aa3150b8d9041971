"""The channels of a log over time."""

from __future__ import annotations

import numpy as np
import pytest

import diffthrust as dft


def title(axes):
    return axes.get_title(loc="left")


def test_inputs_stand_on_top_in_the_units_of_the_log_from_the_first_sample():
    log = dft.Log(
        time=1000 + 20 * np.arange(50),
        inputs={"command": np.linspace(0, 5000, 50)},
        measured={"speed": np.linspace(0, 600, 50), "thrust": np.linspace(0, 2, 50)},
        units={"time": "ms", "command": "mV", "speed": "rpm", "thrust": "kgf"},
        name="run_1",
    )
    figure = log.plot()
    assert [title(axes) for axes in figure.axes] == [
        "command [mV]", "speed [rpm]", "thrust [kgf]",
    ]  # fmt: skip
    lines = [axes.get_lines()[0] for axes in figure.axes]
    assert lines[0].get_drawstyle() == "steps-post"
    assert [line.get_ydata()[-1] for line in lines] == pytest.approx([5000, 600, 2])
    assert [line.get_xdata()[0] for line in lines] == [0, 0, 0]
    assert lines[0].get_xdata()[-1] == pytest.approx(0.98)


def test_a_command_in_pulses_is_drawn_in_pulses(tmp_path):
    (tmp_path / "run.csv").write_text("t,pwm,rpm\n0,1500,0\n0.1,1700,10\n0.2,1100,20\n")
    log = dft.read_log(
        tmp_path / "run.csv",
        time="t",
        inputs={"command": dft.Column("pwm", pwm={"stop": 1500, "full": 1900})},
        measured={"speed": dft.Column("rpm", unit="rpm")},
    )
    top = log.plot().axes[0]
    assert title(top) == "command [us]"
    assert top.get_lines()[0].get_ydata().tolist() == pytest.approx([1500, 1700, 1100])


def test_gaps_in_time_are_shaded_and_missing_samples_leave_one_in_the_line():
    time = np.concatenate([np.arange(0, 5, 0.1), np.arange(9, 12, 0.1)])
    speed = np.sin(time)
    speed[10:20] = np.nan
    figure = dft.Log(time=time, inputs={"command": time}, measured={"speed": speed}).plot()
    for axes in figure.axes:
        (shade,) = axes.patches
        left, right = shade.get_x(), shade.get_x() + shade.get_width()
        assert (left, right) == pytest.approx((4.9, 9.0))
    assert np.isnan(figure.axes[1].get_lines()[0].get_ydata()).sum() == 11  # and one for the gap
    even = dft.Log(time=np.arange(50), inputs={"command": np.arange(50)}).plot()
    assert not even.axes[0].patches


def test_sparse_samples_among_the_stamps_of_others_are_joined():
    speed = np.full(400, np.nan)
    speed[::10] = np.sin(np.arange(40))
    log = dft.Log(time=np.arange(400) / 50, inputs={}, measured={"speed": speed})
    line = log.plot().axes[0].get_lines()[0]
    assert len(line.get_xdata()) == 40
    assert line.get_marker() == "o"


@pytest.mark.parametrize("count", [1, 12])
def test_titles_of_few_and_many_channels_do_not_touch(count):
    time = np.arange(0, 60, 0.05)
    log = dft.Log(
        time=time,
        inputs={"command": np.sign(np.sin(time))},
        measured={f"a_rather_long_name_{k}": 1e4 * np.sin(time + k) for k in range(count)},
    )
    figure = log.plot()
    figure.draw_without_rendering()
    boxes = [axes._left_title.get_tightbbox() for axes in figure.axes]
    panels = [axes.get_window_extent() for axes in figure.axes]
    assert all(box.y0 >= panel.y1 for box, panel in zip(boxes, panels, strict=True))
    assert all(box.y1 < panel.y0 for box, panel in zip(boxes[1:], panels, strict=False))
    assert all(panel.height > 40 for panel in panels)
