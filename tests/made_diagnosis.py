"""A diagnosis put together by hand from real fits: what words, tables, figures and pages show."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from reference import inputs, noise, thruster
from steps import Missing, Remaining, SignalForm, Stage, TriedEffect, Worth

import diffthrust as dft
from diffthrust.effects import ActuatorLag, CommandDeadband

BAND = 0.4  # hidden dead band [V]
NASTY = "<script>alert(1)</script>"  # the name of the unseen log


def logs() -> tuple[dft.Log, dft.Log]:
    """One log to train and one unseen, of a thruster that ignores small commands."""
    made = []
    for seed, name in ((1, "staircase.csv"), (2, NASTY)):
        rng = np.random.default_rng(seed)
        time = inputs.grid(30.0, 0.05)
        command = inputs.staircase(time, rng.uniform(-2.0, 2.0, 15), 2.0)
        record = thruster.simulate(time, command, method="rk4", command_deadband=BAND)
        record = noise.measure(record, rng, speed=noise.Sensor(0.3), thrust=noise.Sensor(0.4))
        made.append(dft.Log(record.time, record.inputs, record.measured, name=name))
    return made[0], made[1]


@cache
def found() -> dft.diagnosis.Diagnosis:
    """A dead band found, and nothing left."""
    train, unseen = logs()
    model = dft.Thruster()
    plain, fit = (
        dft.fit(changed, train, holdout=unseen, starts=2)
        for changed in (model, model + CommandDeadband())
    )
    time = train.time
    signal = 17.0 * np.clip(train.values("command", "V") / BAND, -1, 1)
    abscissa = np.linspace(-2.0, 2.0, 41)
    return dft.diagnosis.Diagnosis(
        verdict="effects_found",
        model=model,
        best=fit.model.effects,
        groups=(("command_deadband",),),
        stages=(Stage((), plain), Stage(("command_deadband",), fit)),
        ranking=(
            _candidate(0, "command_deadband", 812.0, 1e-30, fit),
            _candidate(0, "actuator_lag", 31.5, 2e-4, None),
        ),
        remaining=None,
        untestable={"supply_voltage_sag": "the logs have no input 'supply_voltage'"},
        dropped=(),
        before=dft.compare(plain, unseen),
        after=dft.compare(fit, unseen),
        missing=(
            Missing(
                port="drive",
                unit="rad/s^2",
                runs=((time, -signal, np.full(time.size, 2.0)),),
                signal=SignalForm("command"),
                dependence_unit="V",
                share=0.91,
                p_value=1e-12,
                curve=(abscissa, -17 * np.clip(abscissa / BAND, -1, 1), np.full(41, 1.5)),
            ),
        ),
        experiment=None,
        seconds={"compile": 4.0, "screen": 2.5, "refit": 6.0},
    )


@cache
def diagnosis() -> dft.diagnosis.Diagnosis:
    """A dead band found first, an actuator lag second, and something left over at the load."""
    first = found()
    train, unseen = logs()
    one = first.stages[1].fit
    two = dft.fit(one.model + ActuatorLag(), train, holdout=unseen, starts=2)
    time, signal, _ = first.missing[0].runs[0]
    return replace(
        first,
        verdict="unexplained",
        best=two.model.effects,
        groups=(*first.groups, ("actuator_lag", "thrust_sensor_lag")),
        stages=(*first.stages, Stage(("command_deadband", "actuator_lag"), two)),
        ranking=(
            *first.ranking,
            _candidate(1, "actuator_lag", 14.2, 6e-4, two),
            _candidate(1, "thrust_sensor_lag", 13.1, 9e-4, None),
        ),
        remaining=Remaining("load", SignalForm("speed"), 0.34),
        dropped=("coulomb_friction",),
        after=dft.compare(two, unseen),
        missing=(
            *first.missing,
            Missing(
                port="load",
                unit="rad/s^2",
                runs=((time, -0.2 * signal, np.full(time.size, 3.0)),),
                signal=None,
                dependence_unit="",
                share=0.0,
                p_value=0.4,
                curve=(np.zeros(0), np.zeros(0), np.zeros(0)),
            ),
        ),
        experiment=dft.suggest_experiment(
            [one, two], duration=6.0, step=0.2, limits={"command": (-2.0, 2.0)}
        ),
    )


def adequate() -> dft.diagnosis.Diagnosis:
    """A model with a dead band from which nothing is missing, without an unseen log."""
    full = found()
    fit = replace(full.stages[1].fit, holdout=None)
    held = dft.compare(fit, logs()[0])
    return replace(
        full,
        verdict="adequate",
        model=fit.model,
        best=(),
        groups=(),
        stages=(Stage((), fit),),
        ranking=(),
        remaining=None,
        untestable={},
        dropped=(),
        before=held,
        after=held,
        missing=(),
        experiment=None,
        silent=("coulomb_friction",),
    )


def unexplained() -> dft.diagnosis.Diagnosis:
    """Nothing known helps, but structure remains."""
    full = found()
    return replace(
        adequate(),
        verdict="unexplained",
        model=full.model,
        stages=full.stages[:1],
        ranking=full.ranking[1:2],
        remaining=Remaining("drive", SignalForm("command"), 0.62),
        before=full.before,
        after=full.before,
        missing=full.missing[:1],
    )


def undecided() -> dft.diagnosis.Diagnosis:
    """Whole runs are poor, and random forces explain them as well as a dead band."""
    return replace(
        unexplained(),
        verdict="undecided",
        remaining=None,
        one_step={"speed": 0.1, "thrust": 0.1},
        possible={"command_deadband": Worth(0.4, 0.2, 0.6)},
    )


def with_fit(diag: dft.diagnosis.Diagnosis, stage: int = -1, **changes) -> dft.diagnosis.Diagnosis:
    """The same with another fit of a stage."""
    stages = [*diag.stages]
    stages[stage] = replace(stages[stage], fit=replace(stages[stage].fit, **changes))
    return replace(diag, stages=tuple(stages))


def _candidate(
    stage: int, effect: str, ratio: float, p_value: float, fit: dft.estimation.Fit | None
) -> TriedEffect:
    estimates = fit.parameters if fit else {}
    return TriedEffect(
        stage=stage,
        effect=effect,
        likelihood_ratio=ratio,
        delta_bic=6.2 - ratio,
        p_value=p_value,
        holdout_gain=0.45 * ratio,
        train_nrmse=fit.train.nrmse if fit else None,
        holdout_nrmse=fit.holdout.nrmse if fit and fit.holdout else None,
        parameters={
            name.split(".")[1]: e
            for name, e in estimates.items()
            if name.startswith(f"{effect}.") and not e.fixed
        },
    )
