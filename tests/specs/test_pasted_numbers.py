"""Numbers of a report, pasted into ``[parameters]`` with their units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diffthrust import InputError
from diffthrust.models import Normal
from diffthrust.specs import Spec, load_spec

SPEC = """\
model = "speed_loop_thruster"
effects = ["command_deadband", "thrust_sensor_offset"]

[logs]
train = ["run.csv"]
time = { column = "t", unit = "ms" }

[channels.command]
column = "pwm"
pwm = { stop = 1500, full = 1900 }

[channels.speed]
column = "rpm"
unit = "rpm"

[channels.thrust]
column = "kgf"
unit = "kgf"

[parameters]
"""


def load(folder: Path, line: str) -> Spec:
    rng = np.random.default_rng(0)
    effort = np.repeat(rng.uniform(0.1, 0.9, 10), 20)
    speed = np.convolve(np.pad(300 * effort, (30, 0)), 0.9 ** np.arange(31) / 9.6, "valid")
    rows = "".join(
        f"{20 * i},{1500 + 400 * u:.0f},{9.55 * n + e:.1f},{4e-5 * n * n:.4f}\n"
        for i, (u, n, e) in enumerate(zip(effort, speed, rng.normal(size=200), strict=True))
    )
    (folder / "run.csv").write_text(f"t,pwm,rpm,kgf\n{rows}")
    (folder / "spec.toml").write_text(SPEC + line)
    return load_spec(folder / "spec.toml")


@pytest.mark.parametrize(
    ("line", "name", "value"),
    [
        ('command_deadband.half_width = "25 us"', "command_deadband.half_width", 25 / 400),
        ('command_deadband.half_width = "0.025 ms"', "command_deadband.half_width", 25 / 400),
        ('command_deadband.half_width = "0.0625 effort"', "command_deadband.half_width", 0.0625),
        ("command_deadband.half_width = 0.0625", "command_deadband.half_width", 0.0625),
        ('thrust_sensor_offset.offset = "0.5 kgf"', "thrust_sensor_offset.offset", 0.5 * 9.80665),
        ('thrust_sensor_offset.offset = "5 N"', "thrust_sensor_offset.offset", 5.0),
        ('gain = "321.4 rad/s per full effort"', "gain", 321.4),
        ('gain = "3000 rpm per full effort"', "gain", 3000 * 2 * np.pi / 60),
        ('time_constant = "150 ms"', "time_constant", 0.15),
    ],
)
def test_a_number_of_a_report_pastes_back_with_its_unit(
    tmp_path: Path, line: str, name: str, value: float
) -> None:
    model = load(tmp_path, line).model
    assert model.parameters[name].value == pytest.approx(value, rel=1e-12)


@pytest.mark.thorough
def test_every_number_of_a_report_pastes_back(tmp_path: Path) -> None:
    fit = load(tmp_path, 'command_deadband.half_width = "20 us"').fit()
    lines = []
    for name, estimate in fit.parameters.items():
        value, _, unit = estimate.shown
        lines.append(f'{name} = "{float(value)!r} {unit}"' if unit else f"{name} = {value!r}")
    pasted = load(tmp_path, "\n".join(lines)).model
    for name, estimate in fit.parameters.items():
        assert pasted.parameters[name].value == pytest.approx(estimate.value, rel=1e-9, abs=1e-12)


def test_bounds_and_priors_take_units_too(tmp_path: Path) -> None:
    line = (
        'command_deadband.half_width = { value = "20 us", bounds = ["0 us", inf], '
        'prior = { mean = "20 us", std = "4 us" } }'
    )
    width = load(tmp_path, line).model.parameters["command_deadband.half_width"]
    assert width.bounds == (0.0, None)
    assert width.prior == Normal(0.05, 0.01)


@pytest.mark.parametrize(
    ("line", "problem", "mend"),
    [
        ("command_deadband.half_width = 25", "25 times it", 'with the number: "25 us"'),
        (
            'command_deadband.half_width = "25 rpm"',
            "in 'us' or 'effort', found '25 rpm'",
            "in 'us'",
        ),
        ('command_deadband.half_width = "25"', "found '25'", '"0.05 us"'),
        ("command_deadband.half_width = { value = 25, unit = 'us' }", "'unit'", 'value = "25 us"'),
        ('exponent = "2 m"', "in no unit, found '2 m'", "Leave the unit out"),
        ('gain = "3000 rpm"', "'rad/s per full effort'", "as reports do"),
    ],
)
def test_a_number_in_another_unit_is_refused_with_the_mend(
    tmp_path: Path, line: str, problem: str, mend: str
) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, line)
    assert "line 21" in caught.value.problem
    assert problem in caught.value.problem
    assert mend in caught.value.mend
