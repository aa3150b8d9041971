"""Sizes of found effects that change in time, against a least squares of each part."""

from dataclasses import replace

import claims
import made_diagnosis as made
import numpy as np
import pytest
from reference import inputs, noise
from steps import ChangedSize, Size, Worth, changed_size
from trajectories import with_steps

import diffthrust as dft

TIME, CHANGE = inputs.grid(30.0, 0.1), 15.0
MODEL = dft.Thruster() + dft.effects.InflowThrustLoss()


def bench(seed, before, after, force=0.0, signal="time", level=CHANGE):
    """An inflow that takes more above a level of a signal, by default from an instant on.

    Besides, a random force of 10 s acts on the thrust.
    """
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1.5, 1.5, TIME.size // 20 + 1), 20)[: TIME.size]
    inflow = 0.6 + 0.5 * np.sin(2.0 * np.pi * TIME / 17.0 + seed)
    log = dft.Log(TIME, {"command": command, "inflow": inflow},
                  units={"command": "V", "inflow": "m/s"})  # fmt: skip
    speed = dft.simulate(dft.Thruster(alpha=0.037, beta=42.0), log)["speed"]
    signal = {"speed": speed, "inflow": inflow}.get(signal, TIME)
    loss = np.where(signal < level, before, after)
    thrust = 0.022 * speed * np.abs(speed) - loss * np.abs(speed) * inflow
    thrust += noise.ornstein_uhlenbeck(rng, TIME, force, 10.0)
    thrust += 0.4 * rng.standard_normal(TIME.size)
    measured = {"speed": speed + 0.2 * rng.standard_normal(TIME.size), "thrust": thrust}
    units = {"command": "V", "inflow": "m/s", "speed": "rad/s", "thrust": "N"}
    return dft.Log(TIME, log.inputs, measured, units, name=f"bench {seed}"), speed


def sought(seed, *args, unseen=True, substeps=(1, 1)):
    train, (last, _) = [bench(seed + k, *args)[0] for k in range(2)], bench(seed + 2, *args)
    fit = dft.fit(MODEL, train, holdout=last, starts=1)
    held = dft.compare(fit, last).runs if unseen else ()
    runs = [run for log, steps in zip(train, substeps, strict=True)
            for run in with_steps(fit.model, dft.compare(fit, log).runs, steps)]  # fmt: skip
    return changed_size(fit, ["inflow_thrust_loss"], runs, held)


def test_a_loss_that_grows_is_told_with_its_instant_and_both_sizes():
    found = sought(0, 0.12, 0.30)
    rows, thrust = [], []
    for seed in (0, 1):
        log, speed = bench(seed, 0.12, 0.30)
        taken = np.abs(speed) * log.inputs["inflow"]
        rows.append([speed * np.abs(speed), *(-taken * part for part in parts())])
        thrust.append(log.measured["thrust"])
    truth = np.linalg.lstsq(np.concatenate(rows, axis=1).T, np.concatenate(thrust), rcond=None)[0]
    assert (found.parameter, found.signal) == ("inflow_thrust_loss.loss", "time")
    assert found.level == pytest.approx(CHANGE, abs=0.3)
    assert [found.before.value, found.after.value] == pytest.approx(truth[1:], rel=0.02)
    assert found.worth.share > 0.9
    assert found.to_json()["after"] == found.after.value


@pytest.mark.parametrize(("signal", "level"), [("inflow", 0.7), ("speed", 12.0)])
def test_a_loss_that_is_larger_above_a_level_of_a_signal_is_told_with_the_signal(signal, level):
    found = sought(0, 0.12, 0.30, 0.0, signal, level)
    assert (found.parameter, found.signal) == ("inflow_thrust_loss.loss", signal)
    assert found.level == pytest.approx(level, abs=0.05 if signal == "inflow" else 1.0)
    assert [found.before.value, found.after.value] == pytest.approx([0.12, 0.30], abs=0.02)
    assert found.shown == (found.level, {"inflow": "m/s", "speed": "rad/s"}[signal])


def parts():
    return TIME < CHANGE, TIME >= CHANGE


@pytest.mark.parametrize("force", [0.0, 1.5])
def test_what_does_not_change_is_not_said_to(force):
    """0 of 240 sets, without a force and under forces of 0.5, 1.5 and 3 N.

    And 0 of 90 that lack a cubic term, a dead band or an offset besides; 5 of 30 that lack a weaker
    thrust astern seem to change at a level of the inflow.
    """
    assert not any(sought(10 * seed, 0.12, 0.12, force) for seed in range(1, 4))


def test_logs_may_need_different_numbers_of_integrator_steps():
    found, mixed = (sought(0, 0.12, 0.30, substeps=steps) for steps in ((1, 1), (1, 4)))
    assert mixed.level == pytest.approx(found.level, abs=0.02)
    for size, other in ((mixed.before, found.before), (mixed.after, found.after)):
        assert size.value == pytest.approx(other.value, rel=1e-3)


def test_a_channel_that_only_unseen_logs_measure_has_no_say():
    logs = [bench(seed, 0.12, 0.30)[0] for seed in range(3)]
    units = {"command": "V", "inflow": "m/s", "thrust": "N"}
    train = [dft.Log(TIME, log.inputs, {"thrust": log.measured["thrust"]}, units)
             for log in logs[:2]]  # fmt: skip
    fit = dft.fit(MODEL, train, holdout=logs[2], starts=1)
    runs = dft.compare(fit, train).runs, dft.compare(fit, logs[2]).runs
    found = changed_size(fit, ["inflow_thrust_loss"], *runs)
    assert found.level == pytest.approx(CHANGE, abs=0.3)


def test_without_unseen_logs_nothing_is_said():
    assert sought(0, 0.12, 0.30, unseen=False) is None


def test_the_summary_says_when_and_by_how_much():
    diag = made.found()
    width = diag.fit.parameters["command_deadband.half_width"]
    sizes = (replace(width, value=size, std_error=None) for size in (0.3, 0.5))
    changed = ChangedSize(
        "command_deadband.half_width", "time", 12.3, *sizes, Worth(0.6, 0.5, 0.7), Size(12.3, "s")
    )
    diag = replace(diag, changed=changed, verdict="unexplained")
    assert "Unexplained: the half-width of a command dead band changes at 12 s" in diag.summary
    assert "at 12 s after the start of a log: 0.30 before, 0.50 V after." in diag.details
    share = "removes 60 % (50 % to 70 %) of the squared error of all channels that is left over "
    assert share + "whole runs of" in diag.details
    assert claims.contradictions(diag) == []
    with pytest.raises(dft.InputError, match="the size of an added effect changes"):
        diag.plot_learned()
    later = replace(diag, changed=replace(changed, shown=Size(20.0, "s")))
    assert claims.contradictions(later, text=diag.details)


@pytest.mark.parametrize(("signal", "unit"), [("speed", "rpm"), ("inflow", "m/s")])
def test_the_summary_names_the_signal_at_whose_level_a_size_changes(signal, unit):
    diag = made.found()
    width = diag.fit.parameters["command_deadband.half_width"]
    sizes = (replace(width, value=size, std_error=None) for size in (0.3, 0.5))
    changed = ChangedSize(
        "command_deadband.half_width", signal, 12.3, *sizes, Worth(0.6, 0.5, 0.7), Size(117, unit)
    )
    diag = replace(diag, changed=changed, verdict="unexplained")
    where = f"changes where the {signal} is 117 {unit}"
    assert f"the half-width of a command dead band {where}." in diag.summary
    assert f"{where}: 0.30 below, 0.50 V above." in diag.details
    assert claims.contradictions(diag) == []
    for wrong in (
        replace(changed, signal="thrust"),
        replace(changed, shown=Size(117, "N")),
        replace(changed, before=changed.after, after=changed.before),
    ):
        assert claims.contradictions(replace(diag, changed=wrong), text=diag.details)
    swapped = diag.details.replace("0.30 below, 0.50 V above", "0.30 before, 0.50 V after")
    assert claims.contradictions(diag, text=swapped)


def test_a_signal_that_unseen_logs_lack_is_none_at_which_a_size_changes():
    """Training logs alone know the voltage, at a level of which the loss seems to change."""
    logs = [bench(seed, 0.12, 0.30)[0] for seed in range(3)]
    voltage = {"supply_voltage": np.where(TIME < CHANGE, 16.0, 13.0)}
    train = [log.replaced(inputs={**log.inputs, **voltage}, units={"supply_voltage": "V"},
                          hold={**log.hold, "supply_voltage": "zero"})
             for log in logs[:2]]  # fmt: skip
    fit = dft.fit(MODEL, train, holdout=logs[2], starts=1)
    runs = dft.compare(fit, train).runs, dft.compare(fit, logs[2]).runs
    assert changed_size(fit, ["inflow_thrust_loss"], *runs).signal == "time"


def test_on_ramps_a_change_in_time_is_told_as_such():
    """The command of every log rises alike: at its level the loss changes as well."""
    logs = []
    for seed in range(3):
        log, _ = bench(seed, 0.12, 0.12)
        log = log.replaced(inputs={**log.inputs, "command": 0.3 + 0.05 * TIME})
        speed = dft.simulate(dft.Thruster(alpha=0.037, beta=42.0), log)["speed"]
        loss = np.where(TIME < CHANGE, 0.12, 0.30)
        thrust = (0.022 * speed - loss * log.inputs["inflow"]) * np.abs(speed)
        thrust += 0.1 * np.random.default_rng(seed).standard_normal(TIME.size)
        logs.append(log.replaced(measured={"speed": speed, "thrust": thrust}))
    fit = dft.fit(MODEL, logs[:2], holdout=logs[2], starts=1)
    runs = dft.compare(fit, logs[:2]).runs, dft.compare(fit, logs[2]).runs
    found = changed_size(fit, ["inflow_thrust_loss"], *runs)
    assert (found.signal, found.level) == ("time", pytest.approx(CHANGE, abs=0.3))
