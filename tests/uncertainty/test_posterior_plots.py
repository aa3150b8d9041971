"""Figures of posteriors: what is shown, with which units, and what is refused."""

from __future__ import annotations

from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from posterior_cases import interval_text

import diffthrust as dft
from diffthrust import InputError
from diffthrust.uncertainty import plot_corner, plot_trace

UNITS = {"alpha": "1/rad", "beta": "rad/(V s^2)", "actuator_lag.time_constant": "s"}


def made(chains: int = 4, draws: int = 300, **more: np.ndarray) -> SimpleNamespace:
    rng = np.random.default_rng(0)
    centre = {"alpha": 0.037, "beta": 42.0, "actuator_lag.time_constant": 0.1}
    found = {
        n: (("chain", "draw"), c * (1 + 0.01 * rng.standard_normal((chains, draws))),
            {"unit": UNITS[n]})
        for n, c in centre.items()
    }  # fmt: skip
    found["noise.speed.gain.speed"] = (("chain", "draw"), rng.random((chains, draws)))
    found["sigma"] = (("chain", "draw", "channel"), rng.random((chains, draws, 1)))
    found |= {n: (("chain", "draw"), v) for n, v in more.items()}
    return SimpleNamespace(posterior=xr.Dataset(found, {"channel": ["speed"]}), attrs={})


def texts(figure) -> str:
    out = [axes.get_title(loc="left") for axes in figure.axes]
    out += [axes.get_xlabel() + axes.get_ylabel() for axes in figure.axes]
    out += [text.get_text() for axes in figure.axes for text in axes.texts]
    out += [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return "\n".join(out)


def drawn(figure) -> None:
    out = BytesIO()
    figure.savefig(out, dpi=40)
    assert out.getvalue().startswith(b"\x89PNG")


def test_a_corner_shows_the_models_parameters_with_units_and_intervals():
    figure = plot_corner(made())
    assert len(figure.axes) == 6
    told = texts(figure)
    for name, unit in UNITS.items():
        assert f"{name} [{unit}]" in told.replace(".\n", ".")
    assert "noise" not in told
    assert "95 % interval" in told
    alpha = made().posterior["alpha"].values
    ends = interval_text(*(float(q) for q in np.quantile(alpha, [0.5, 0.025, 0.975])))
    assert f"{ends[0]}\n{ends[1]} to {ends[2]}" in told
    drawn(figure)


def test_a_corner_marks_the_fit_and_published_values_near_and_far():
    time = 0.05 * np.arange(200)
    command = {"command": np.sign(np.sin(time))}
    clean = dft.simulate(dft.Thruster(), dft.Log(time, command, {}), substeps=1)
    rng = np.random.default_rng(1)
    log = dft.Log(time, command, {"speed": clean["speed"] + 0.1 * rng.standard_normal(200)})
    fit = dft.fit(dft.Thruster().fix("ct"), log, starts=1)
    marks = {"published": {"alpha": 0.0372, "beta": 60.0}, "other": {"alpha": 0.0365}}
    figure = plot_corner(made(), fit, marks, names=["alpha", "beta"])
    assert len(figure.axes) == 3
    told = texts(figure)
    assert "published 60 →" in told
    assert all(word in told for word in ("fit", "published", "other"))
    first = [line.get_xdata()[0] for line in figure.axes[0].get_lines()]
    assert {0.0372, 0.0365, fit.parameters["alpha"].value} <= {float(x) for x in first}
    low, high = figure.axes[2].get_xlim()
    assert high - low < 6  # not stretched to 60, which would hide the draws
    assert "marked" in texts(plot_corner(made(), marks={"alpha": 0.037}))
    drawn(figure)
    # values that are called so stand in place of those of the fit, and look like these
    figure = plot_corner(made(), fit, {"fit": {"alpha": 0.0372}, "x": {"alpha": 0.0365}})
    lines = {float(line.get_xdata()[0]): line for line in figure.axes[0].get_lines()}
    assert [lines[x].get_linestyle() for x in (0.0372, 0.0365)] == ["--", ":"]
    assert fit.parameters["alpha"].value not in lines


def test_single_and_constant_parameters_are_drawn():
    drawn(plot_corner(made(), names=["alpha"]))
    post = made(still=np.ones((4, 300)))
    drawn(plot_corner(post, names=["alpha", "still"]))
    drawn(plot_trace(post, names=["still"]))
    drawn(plot_trace(made(chains=1, draws=4)))
    drawn(plot_corner(made(chains=1, draws=4)))


def test_a_trace_shows_every_chain_and_both_halves():
    figure = plot_trace(made())
    assert len(figure.axes) == 6
    assert len(figure.axes[0].get_lines()) == 4
    told = texts(figure)
    assert "4 chains of 300 draws" in told
    assert "alpha [1/rad]" in told
    drawn(figure)
    drawn(plot_trace(made(chains=32), names=["noise.speed.gain.speed"]))


def test_wrong_input_is_told():
    with pytest.raises(InputError, match="no parameter 'gamma'"):
        plot_corner(made(), names=["gamma"])
    with pytest.raises(InputError, match="no parameter 'sigma'"):
        plot_trace(made(), names=["sigma"])
    with pytest.raises(InputError, match="marks: there is no parameter 'ct'"):
        plot_corner(made(), marks={"ct": 0.02})
    empty = SimpleNamespace(posterior=made().posterior.isel(draw=[]), attrs={})
    for plot in (plot_corner, plot_trace):
        with pytest.raises(InputError, match="The posterior is empty"):
            plot(empty)
        with pytest.raises(InputError, match="Expected a fit or a posterior"):
            plot({"alpha": [1.0]})


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((0.0370107, 0.036952, 0.037068), ("0.037011", "0.036952", "0.037068")),
        ((1234.5, 1100.0, 1400.0), ("1234", "1100", "1400")),
        ((2e-7, 1e-7, 3e-7), ("2.0e-07", "1.0e-07", "3.0e-07")),
        ((5.0, 5.0, 5.0), ("5.000", "5.000", "5.000")),
    ],
)
def test_intervals_end_at_the_digits_that_are_known(given, expected):
    assert interval_text(*given) == expected
