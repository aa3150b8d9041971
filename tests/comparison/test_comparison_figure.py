"""The comparison figure: every channel, with units, readable and without global state."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from presentation import thinned

import diffthrust as dft


def log(name: str, n: int = 200, thrust: bool = True) -> dft.Log:
    time = np.arange(n) * 0.05
    measured = {"speed": 30 * np.sin(0.2 * time)}
    if thrust:
        measured["thrust"] = np.where(time > 3, np.nan, 5.0 + 0.1 * time)
    return dft.Log(time=time, inputs={"command": np.sin(time)}, measured=measured, name=name)


@pytest.mark.parametrize("count", [1, 3, 4])
def test_one_pair_of_axes_for_each_channel_of_each_run(count):
    comparison = dft.compare(dft.Thruster(), [log(f"run {i}") for i in range(count)])
    figure = comparison.plot()
    assert len(figure.axes) == (1 + 2 * 2) * count  # the command on top of each run
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert all(f"run {i}" in titles for i in range(count))
    labels = {axes.get_ylabel() for axes in figure.axes}
    assert labels >= {
        "command\n[V]",
        "speed [rad/s]",
        "thrust [N]",
        "residual [rad/s]",
        "residual [N]",
    }
    assert sum(axes.get_xlabel() == "time [s]" for axes in figure.axes) == count
    (legend,) = figure.legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts == ["measured", "modelled", "measured - modelled"]
    out = BytesIO()
    figure.savefig(out, dpi=40)
    assert out.getvalue().startswith(b"\x89PNG")


def drawn_marks(axes, label: str) -> int:
    """Samples of a line that leave a mark or a stretch of line."""
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    seen = np.isfinite(np.asarray(line.get_ydata(), float))
    dotted = line.get_marker() not in ("None", "", None)
    return int(seen.sum() if dotted else (seen[1:] & seen[:-1]).sum())


@pytest.mark.parametrize("n", [400, 12_000])
def test_a_channel_at_half_the_rate_of_its_log_is_drawn(n):
    every = log("run", n=n)
    half = np.where(np.arange(n) % 2, np.nan, every.measured["speed"])
    figure = dft.compare(dft.Thruster(), every.replaced(measured={"speed": half})).plot()
    (top,) = [axes for axes in figure.axes if axes.get_ylabel() == "speed [rad/s]"]
    (below,) = [axes for axes in figure.axes if axes.get_ylabel() == "residual [rad/s]"]
    assert drawn_marks(top, "measured") >= 200
    assert drawn_marks(below, "measured - modelled") >= 200


def test_a_run_may_lack_a_channel():
    figure = dft.compare(dft.Thruster(), [log("a", thrust=False), log("b")]).plot()
    assert len(figure.axes) == 3 + 5
    assert len(dft.compare(dft.Thruster(), [log("a"), log("b")]).plot(["a"]).axes) == 5


def test_each_command_of_a_craft_of_eight_thrusters_is_drawn_and_named():
    law = dft.actuators.StaticThruster()
    mounts = {f"t{k}": law.at((0.1 * k, -0.1 * k, 0)) for k in range(1, 9)}
    craft = dft.Craft(dft.bodies.Planar(), **mounts)
    time = np.arange(40) * 0.1
    commands = {name: 0.1 * np.sin(time + k) for k, name in enumerate(craft.inputs)}
    run = dft.Log(time, commands, {"surge": 0.1 * time}, units=dict(craft.inputs))
    drive = dft.compare(craft, run).plot().axes[0]
    lines = drive.get_lines()
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 8
    assert [text.get_text() for text in drive.get_legend().get_texts()] == [*mounts]
    assert drive.get_ylabel() == "command\n[effort]"


def test_a_table_is_drawn_by_sample():
    table = dft.Log(
        time=np.arange(4),
        inputs={"depth": np.arange(4)},
        measured={"reading": np.arange(4)},
        static=True,
    )
    figure = dft.compare(dft.LinearSensor(), table).plot()
    assert figure.axes[-1].get_xlabel() == "sample"


def test_a_simulation_that_failed_can_be_drawn():
    comparison = dft.compare(dft.Thruster(), log("a"))
    (run,) = comparison.runs
    nothing = np.full(run.time.size, np.inf)
    trace = replace(run.channels["speed"], modelled=nothing, residual=nothing)
    run = replace(run, channels={"speed": trace})
    figure = replace(comparison, runs=(run,)).plot()
    figure.savefig(BytesIO(), dpi=40)


def test_thinning_keeps_every_spike():
    time = np.linspace(0, 1, 100_000)
    values = np.sin(time)
    values[31_234] = 50.0
    values[77_777] = -50.0
    values[5] = np.nan
    t, y = thinned(time, values)
    assert t.size < 5000
    assert np.nanmax(y) == 50.0
    assert np.nanmin(y) == -50.0
    assert np.all(np.diff(t) >= 0)
    gaps = np.full(100_000, np.nan)
    assert np.isnan(thinned(time, gaps)[1]).all()


@pytest.mark.slow
def test_a_model_with_many_effects_is_drawn_with_its_name_wrapped(tmp_path):
    time = np.arange(100) * 0.04
    log = dft.Log(
        time=time, inputs={"command": np.ones(100)}, measured={"speed": 30 * np.tanh(time)}
    )
    model = dft.Thruster()
    for effect in dft.effects.EFFECTS.values():
        if effect.port in model.ports and not effect.needs:
            model = model + effect()
    assert len(model.effects) > 8
    for suffix in ("png", "svg", "pdf"):
        dft.compare(model, log).plot().savefig(tmp_path / f"figure.{suffix}")
        assert (tmp_path / f"figure.{suffix}").stat().st_size > 1000
