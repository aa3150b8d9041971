"""A fit on its way out: what goes along, in which units, and what is refused."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from exported_programs import compiled, needs_compiler, run_python

import diffthrust as dft
from diffthrust.export import TARGETS, Exported, export_model

WIDTHS = {"stop": 1500, "full": 1900, "reverse": 1200}


@pytest.fixture(scope="module")
def fit(tmp_path_factory) -> dft.estimation.Fit:
    """Of pulses, revolutions per minute and kilograms of force."""
    rng = np.random.default_rng(5)
    time = 0.05 * np.arange(600)
    widths = np.repeat(rng.choice(np.arange(1250, 1851, 50), 20), 30)
    span = np.where(widths >= 1500, 400.0, 300.0)
    model = dft.SpeedLoopThruster(gain=280.0, exponent=1.0, time_constant=0.25, ct=7e-4)
    effort = dft.Log(time, {"command": (widths - 1500) / span}, {}, units={"command": "effort"})
    found = dft.simulate(model, effort)
    path = tmp_path_factory.mktemp("logs") / "run.csv"
    rows = [time, widths, found["speed"] * 30 / np.pi, found["thrust"] / 9.80665]
    rows[2], rows[3] = rows[2] + rng.normal(0, 5, 600), rows[3] + rng.normal(0, 0.02, 600)
    np.savetxt(path, np.stack(rows, 1), delimiter=",", header="t,pwm,rpm,F", comments="")
    log = dft.read_log(
        path,
        time="t",
        inputs={"command": dft.Column("pwm", pwm=WIDTHS)},
        measured={"speed": dft.Column("rpm", unit="rpm"), "thrust": dft.Column("F", unit="kgf")},
    )
    return dft.fit(dft.SpeedLoopThruster().fix("exponent"), log, starts=2)


@pytest.mark.thorough
def test_a_fit_knows_its_inputs_and_how_they_were_written(fit):
    assert fit.ranges["command"] == pytest.approx((-5 / 6, 0.875))
    assert fit.written["thrust"].unit == "kgf"
    assert fit.hold == {"command": "zero"}
    straight = replace(fit, hold={"command": "linear"}).export("c").text
    assert "but for command: straight" in straight
    exported = fit.export("python")
    assert isinstance(exported, Exported)
    assert str(exported) == exported.text
    for words in (
        "standard error",
        "Fit: converged",
        "stop 1500, full 1900, astern 1200 us",
        "1 kgf is",
    ):
        assert words in exported.text


@pytest.mark.thorough
def test_a_fit_that_was_saved_gives_the_same_files(fit, tmp_path):
    fit.save(tmp_path / "fit.json")
    again = dft.load(tmp_path / "fit.json")
    for target in TARGETS:
        assert again.export(target).text == fit.export(target).text
    assert "run.csv" in fit.export("c").text  # the logs that it was made of


def test_the_table_of_a_fit_is_in_the_units_of_its_logs(fit, tmp_path):
    path = tmp_path / "t200.csv"
    exported = fit.export("lut", path)
    lines = path.read_text().splitlines()
    assert (exported.path, exported.text) == (path, path.read_text())
    assert lines[0] == "thrust [kgf],command [us]"
    table = np.array([line.split(",") for line in lines[1:]], float)
    assert table[[0, -1], 1] == pytest.approx([1250.0, 1850.0])
    full = fit.model.replace()  # the law at the estimates, ahead
    force = full.ct * (full.gain * 0.5) ** 2 / 9.80665
    assert np.interp(1700.0, table[:, 1], table[:, 0]) == pytest.approx(force, rel=3e-3)
    narrow = fit.export("lut", limits=(1400, 1600)).text.splitlines()
    assert float(narrow[1].split(",")[1]) == pytest.approx(1400.0)
    assert float(narrow[-1].split(",")[1]) == pytest.approx(1600.0)


@needs_compiler
def test_programs_take_the_widths_of_the_logs(fit, tmp_path):
    scope: dict = {}
    exec(fit.export("python", tmp_path / "t200.py").text, scope)
    widths = np.array([1200.0, 1350.0, 1500.0, 1900.0, 0.0])
    effort = [scope["T200"].command_of_width(width) for width in widths]
    assert effort == pytest.approx([-1.0, -0.5, 0.0, 1.0, 0.0])
    fit.export("c", tmp_path / "t200.h")
    checks = " && ".join(
        f"fabs(t200_command_of_width({w!r}) - {e!r}) < 1e-15"
        for w, e in zip(widths.tolist(), map(float, effort), strict=True)
    )
    (tmp_path / "main.c").write_text(f'#include "t200.h"\nint main(void) {{ return !({checks}); }}')
    compiled(tmp_path / "main.c", tmp_path / "main")
    assert subprocess.run([tmp_path / "main"], check=False).returncode == 0


def test_steps_and_estimates_go_along(fit):
    finer = replace(fit, substeps=4)
    text = finer.export("python", None).text
    assert "substeps = 4" in text
    assert f"gain = {fit.model.gain!r}" in text
    log = dft.Log(0.05 * np.arange(200), {"command": np.full(200, 0.4)}, {})
    wanted = dft.simulate(fit.model, log, substeps=4)
    found = run_python(text, "SpeedLoopThruster", log)
    assert found["thrust"] == pytest.approx(wanted["thrust"], rel=1e-12)


def test_an_exponent_that_is_one_within_its_error_is_taken_as_one(fit):
    model = fit.model.replace(exponent={"value": 1.004, "fixed": False})
    estimate = replace(fit.parameters["exponent"], value=1.004, std_error=0.003, fixed=False)
    near = replace(fit, model=model, parameters={**fit.parameters, "exponent": estimate})
    assert near.export("uuv").notes == (
        "The exponent is taken as 1: it is 1.004, within its error.",
    )
    sure = replace(estimate, std_error=0.001)
    far = replace(near, parameters={**fit.parameters, "exponent": sure})
    assert "|command|^1.004" in far.export("uuv").notes[0]


@pytest.mark.parametrize("target", TARGETS)
def test_the_ending_says_what_is_in_a_file(fit, target, tmp_path):
    with pytest.raises(dft.InputError, match="expected a file ending in"):
        fit.export(target, tmp_path / "thruster.toml")
    assert not list(tmp_path.iterdir())


def test_names_begin_with_that_of_the_file(fit, tmp_path):
    text = fit.export("c", tmp_path / "2-left thruster.h").text
    assert "m2_left_thruster_step(" in text
    text = fit.export("python", tmp_path / "left_thruster.py").text
    assert "class LeftThruster:" in text


def test_what_cannot_be_exported_is_refused(fit):
    with pytest.raises(dft.InputError, match="nearest is 'python'"):
        fit.export("pyton")
    loose = replace(fit, status=dft.estimation.Status.NOT_IDENTIFIABLE, message="Two go together.")
    assert loose.export("c").notes == ("The fit is not_identifiable: Two go together.",)
    failed = replace(fit, status=dft.estimation.Status.SIMULATION_FAILED, message="It diverged.")
    with pytest.raises(dft.InputError, match="It diverged"):
        failed.export("c")
    with pytest.raises(dft.InputError, match="does not read 'depth'"):
        export_model(dft.Thruster(), "c", ranges={"depth": (0.0, 1.0)})


def test_a_parameter_that_differs_by_log_is_said_to_be_the_mean():
    model = dft.Thruster().replace({"ct": {"per_log": True}})
    (note,) = dft.export.export_model(model, "python").notes
    assert note == "By log: 'ct'. What stands here is the mean of all logs."
    assert dft.export.export_model(dft.Thruster(), "python").notes == ()
