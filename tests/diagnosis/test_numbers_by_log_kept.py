"""A diagnosis of a fit with numbers that differ by log keeps them, and finds what is missing."""

from types import SimpleNamespace

import numpy as np
import pytest
from steps import CandidateFitter, bind, stage_fit_module

import diffthrust as dft
from diffthrust.estimation._one_step import cost  # private: without a search

HALF_WIDTH = 0.6


class Tare(dft.effects.ThrustSensorOffset):
    """It is another in each log."""

    by_log = ("offset",)


def run(number, tare):
    rng = np.random.default_rng([29, number])
    time, command = 0.05 * np.arange(300), np.repeat(rng.uniform(-4.0, 4.0, 15), 20)
    truth = dft.Thruster() + dft.effects.CommandDeadband(half_width=HALF_WIDTH)
    out = dft.simulate(truth, dft.Log(time, {"command": command}))
    measured = {
        "speed": out["speed"] + rng.normal(0.0, 0.3, time.size),
        "thrust": out["thrust"] + tare + rng.normal(0.0, 0.2, time.size),
    }
    return dft.Log(time, {"command": command}, measured, name=f"run {number}")


@pytest.mark.slow
def test_a_dead_band_is_found_and_each_log_keeps_its_tare():
    tares = [1.4, -0.9, 0.6, 2.1]
    *logs, unseen = [run(k, tare) for k, tare in enumerate(tares)]
    name = "thrust_sensor_offset.offset"
    model = dft.Thruster() + "thrust_sensor_offset"
    fit = dft.fit(model, logs, holdout=unseen, per_log=[name], starts=2)
    diag = dft.diagnose(
        fit, logs, holdout=unseen, candidates=["command_deadband"], experiment=False
    )
    assert str(diag.fit.model) == "thruster + thrust_sensor_offset + command_deadband"
    assert diag.fit.model.per_log == (name,)
    for value, tare in zip(diag.fit.per_log[name].values.values(), tares, strict=False):
        assert abs(value.value - tare) < 4.0 * value.std_error
    text = diag.report()
    assert "Numbers by log, last stage" in text
    assert "per_log = true" in text
    assert "Estimated from the first 25 % of each run" in " ".join(text.split())


@pytest.mark.thorough
def test_a_candidate_differs_by_log_where_it_is_present_alone():
    tares = [1.4, -0.9, 0.6]
    records = bind(dft.Thruster(), [run(k, tare) for k, tare in enumerate(tares)])
    offset = Tare().differing()
    fitter = CandidateFitter(dft.Thruster(), [offset], records[:2], records[2:])
    base = fitter.base()
    apart = np.zeros(base.at_values.local)
    apart[base.at_values.layout.local.index("thrust_sensor_offset.offset")] = 1.0
    program = fitter.ready((offset.name,)).problem

    def at(effects, begin):
        return cost(base.clip.on(program.focus(fitter.moved(effects), base.values, begin)))

    # its distance from the mean costs half its square over its width, whether it acts or not
    assert at((), apart) - at((), 0.0 * apart) == pytest.approx(0.5, abs=1e-6)
    # the first log has a tare: its own value brings it nearer
    assert at((offset.name,), apart) < at((offset.name,), 0.0 * apart) - 2.0
    fitted = fitter.settled((offset.name,), base.values, None, base.clip)
    assert fitted.count(fitted.parameters_of()) == 2
    own = fitted.unseen.numbers_by_log(fitted.unseen.start())
    assert own[0]["thrust_sensor_offset.offset"] == pytest.approx(tares[2], abs=0.3)


@pytest.mark.thorough
def test_what_may_differ_by_log_is_one_value_where_one_will_do():
    """A boat's steady current, one for each log, stood in for a weak thruster."""
    *logs, unseen = [run(k, 1.0) for k in range(3)]
    fit = dft.fit(dft.Thruster() + "command_deadband", logs, holdout=unseen, starts=2)
    diag = dft.diagnose(fit, logs, holdout=unseen, candidates=[Tare()], experiment=False)
    assert diag.added == ("thrust_sensor_offset",)
    assert diag.fit.model.per_log == ()


@pytest.mark.parametrize(
    ("north", "matters", "left", "fitted"),
    [(0.17, False, False, 1), (0.17, True, True, 1), (0.05, False, True, 0)],
)
def test_a_current_that_is_nearly_the_same_in_all_logs_is_one_again(
    monkeypatch, north, matters, left, fitted
):
    """A boat's, "of 0.18 to 0.18 m/s, another in each log", once its drags were there."""
    current = dft.effects.WaterCurrent(to_north=0.18, to_east=0.0).differing()
    model = dft.Vessel() + current
    initial = [{"water_current.to_north": v, "water_current.to_east": 0.0} for v in (0.18, north)]
    train = SimpleNamespace(nrmse=0.1)
    fit = SimpleNamespace(model=model, initial=initial, parameters=model.parameters, train=train)
    apart = stage_fit_module.FittedStage(("water_current",), fit, (), ())
    asked = []

    def refit(model, starts, like, substeps):
        asked.append([effect.differs for effect in model.effects])
        return SimpleNamespace(model=model, train=train, holdout=None), (), ()

    for name, answer in (
        ("_refitted", apart), ("no_better", None), ("matters", matters), ("worth_between", None)
    ):  # fmt: skip
        monkeypatch.setattr(stage_fit_module, name, lambda *_, answer=answer: answer)
    monkeypatch.setattr(stage_fit_module, "stage_effects", lambda _: apart.effects)
    context = SimpleNamespace(
        given=dft.Vessel(), refit=refit, fitter=SimpleNamespace(candidates={current.name: current})
    )
    stage = stage_fit_module.refitted_stage(context, SimpleNamespace(stages=(apart,)))
    assert [effect.differs for effect in stage.fit.model.effects] == [left]
    assert asked == [[False]] * fitted
