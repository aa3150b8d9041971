"""The state of a workbench: changes, undo, the staircase, and what is saved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import command_line
import example_names
import made_diagnosis
import numpy as np
import pytest

import diffthrust as dft
from diffthrust.diagnosis._explained_share import Worth  # private: what a law is worth
from diffthrust.diagnosis._findings import HeldValue  # private: what a diagnosis says of constants
from diffthrust.diagnosis._learned import LearnedLaw  # private: what a diagnosis learns
from diffthrust.workbench._leaving import save, script, spec_text  # private: the page's buttons
from diffthrust.workbench._session import Session, Stretch  # private: what the page shows
from diffthrust.workbench._source import Source, opened  # private: `explore` opens by it
from tests.workbench.page import lacking_folder


@pytest.fixture(scope="module")
def lacking(tmp_path_factory) -> Path:
    return lacking_folder(tmp_path_factory.mktemp("lacking"))


@pytest.fixture
def session(lacking) -> Session:
    return Session(opened(lacking))


def with_script(lacking: Path, home: Path) -> Path:
    """The spec in another folder, with a model of its own, and what its script leaves when run."""
    for log in ("run1.csv", "run2.csv"):
        (home / log).write_bytes((lacking / log).read_bytes())
    text = (lacking / "fit.toml").read_text().replace('"thruster"', '"own.py:Mine"')
    (home / "fit.toml").write_text(text)
    ran = home / "ran"
    (home / "own.py").write_text(
        f"from pathlib import Path\nPath({str(ran)!r}).touch()\nfrom diffthrust import Thruster\n"
        "class Mine(Thruster):\n    '''Mine.'''\n"
    )
    return ran


def fitted(session: Session) -> Session:
    task = session.task
    session.accept(task, task.fit())
    return session


# -- opening ---------------------------------------------------------------------------------------


def test_a_spec_is_opened_with_its_logs_and_options(lacking):
    source = opened(str(lacking))
    assert (source.name, [log.name for log in source.train]) == (lacking.name, ["run1.csv"])
    assert source.options == {"starts": 2}
    assert source.unseen[0].name == "run2.csv"


def test_bare_logs_are_opened_by_the_drafted_spec(lacking, monkeypatch):
    one = opened(lacking / "run1.csv")
    assert (one.name, one.model.name, one.drafted) == ("run1", "thruster", True)
    folder = lacking / "logs"
    folder.mkdir()
    for name in ("run1.csv", "run2.csv"):
        (folder / name).write_bytes((lacking / name).read_bytes())
    several = opened(folder)
    assert [log.name for log in (*several.train, *several.unseen)] == ["run1.csv", "run2.csv"]
    monkeypatch.chdir(folder)
    assert opened(".").name == "logs"


def test_a_fit_and_a_diagnosis_are_opened_with_what_they_know():
    fit, diag = example_names.fit(), example_names.diag()
    of_fit = Session(opened(fit))
    assert of_fit.fitted
    assert of_fit.fit is fit
    assert of_fit.source.unseen == (example_names.unseen(),)
    of_diagnosis = Session(opened(diag))
    assert of_diagnosis.diagnosis is diag
    of_diagnosis.tick("command_deadband")
    assert [step.added for step in of_diagnosis.staircase] == ["", "command_deadband"]
    assert of_diagnosis.staircase[1].unseen < 0.5 * of_diagnosis.staircase[0].unseen


def test_what_cannot_be_opened_is_said(tmp_path):
    with pytest.raises(dft.InputError, match="expected a spec, a log, a fit"):
        opened(3)
    with pytest.raises(dft.InputError, match="expected training logs, found none"):
        opened(dft.Thruster())


def test_a_script_is_run_only_from_a_trusted_folder(lacking, tmp_path):
    ran = with_script(lacking, tmp_path)
    with pytest.raises(dft.InputError, match=r"script own.py, which the workbench does not run"):
        opened(tmp_path)
    assert not ran.exists()
    assert opened(tmp_path, trust=[tmp_path]).model.name == "thruster"
    assert ran.exists()


# -- changes ---------------------------------------------------------------------------------------


def test_a_tick_and_a_fit_make_a_step_down_and_an_untick_takes_it_back(session):
    fitted(session)
    session.tick("command_deadband")
    assert not session.fitted
    fitted(session)
    first, second = session.staircase
    assert (first.added, second.added) == ("", "command_deadband")
    assert second.unseen < 0.5 * first.unseen
    assert session.setup.values["command_deadband.half_width"] == pytest.approx(0.4, abs=0.05)
    session.untick("command_deadband")
    assert session.staircase == (first,)
    assert session.setup.values["alpha"] == first.fit.parameters["alpha"].value
    session.tick("command_deadband")  # fitted before: nothing is fitted again
    assert session.fitted
    assert session.staircase == (first, second)


def test_every_change_is_undone_and_done_again(session):
    setups = [session.setup]
    for change in (
        lambda: session.tick("actuator_lag"),
        lambda: session.move({"alpha": 0.05}),
        lambda: session.leave_out(Stretch("run1.csv", 1.0, 2.0, "weed")),
        lambda: session.shift(0.1, "speed", "thrust"),
        lambda: session.take_in(0),
        lambda: session.untick("actuator_lag"),
    ):
        change()
        setups.append(session.setup)
    assert len({setup.fitted_by for setup in setups}) == 6  # all but the slider ask for a fit
    for setup in reversed(setups[:-1]):
        session.undo()
        assert session.setup == setup
    session.undo()  # there is nothing more
    for setup in setups[1:]:
        session.redo()
        assert session.setup == setup
    session.undo()
    session.move({"beta": 40.0})
    session.redo()  # nothing to do again after another change
    assert session.setup.values["beta"] == 40.0


def test_moves_of_one_slider_are_undone_together_and_those_of_two_apart(session):
    first = session.setup
    for value in (0.041, 0.042, 0.043):
        session.move({"alpha": value})
    second = session.setup
    session.move({"beta": 40.0})
    session.move({"alpha": 0.044})
    session.undo()
    session.undo()
    assert session.setup is second
    session.undo()
    assert session.setup is first
    assert session.at == 0


def test_undo_goes_back_to_a_fit_and_what_was_fitted_has_its_values_again(session):
    session.move({"alpha": 0.05})
    optimum = fitted(session).setup
    session.move({"alpha": 0.05})  # of the same slider, but after a fit
    session.undo()
    assert session.setup is optimum
    session.leave_out(Stretch("run1.csv", 1.0, 2.0))
    fitted(session)
    session.take_in(0)
    assert session.fitted
    assert session.setup.values == optimum.values


def test_a_slider_stays_where_it_was_moved_once_a_stretch_counts_again(session):
    fitted(session)
    session.leave_out(Stretch("run1.csv", 1.0, 2.0))
    session.move({"alpha": 0.05})
    session.take_in(0)
    assert session.setup.values["alpha"] == 0.05
    assert session.fit is not None
    assert not session.fitted


def test_values_of_the_fit_of_other_logs_are_not_called_fitted(session):
    fitted(session)
    session.leave_out(Stretch("run1.csv", 1.0, 2.0))
    others = session.setup
    session.tick("actuator_lag")
    session.untick("actuator_lag")
    fitted(session)  # of the logs without the stretch
    session.undo()
    session.undo()
    assert session.setup is others
    assert session.fit is not None
    assert not session.fitted


def test_a_slider_to_which_an_undo_came_back_is_moved_anew(session):
    session.move({"alpha": 0.0407})
    first = session.setup
    session.move({"beta": 40.0})
    session.undo()
    for value in (0.047, 0.048):
        session.move({"alpha": value})
    session.undo()
    assert session.setup is first


def test_a_slider_let_go_where_it_was_changes_nothing(session):
    session.move({"alpha": 0.05})
    session.move({"beta": 40.0})
    session.undo()
    history = session.history
    for values in ({"alpha": 0.05}, {"beta": session.task.model.beta}, {}):
        session.move(values)
        assert session.history is history
    session.redo()
    assert session.setup.values["beta"] == 40.0


def test_a_fit_that_comes_late_is_kept_and_takes_no_slider_back(session):
    task, fit = session.task, session.task.fit()
    session.move({"alpha": 0.05})
    session.accept(task, fit)
    assert session.setup.values == {"alpha": 0.05}
    assert session.fit is fit
    assert not session.fitted


def test_refused_changes_change_nothing(session):
    before = session.setup
    for change, expected in (
        (lambda: session.tick("wind"), "'wind' cannot be added"),
        (lambda: session.move({"alpha": -1.0}), "expected a value within"),
        (lambda: session.leave_out(Stretch("run1.csv", 90.0, 99.0)), "expected samples from"),
        (lambda: session.shift(0.1, "rpm"), "expected channels to shift"),
    ):
        with pytest.raises(dft.InputError, match=expected):
            change()
        assert session.setup is before
        assert session.history == (before,)


def test_left_out_stretches_and_shifts_reach_the_logs(session):
    session.leave_out(Stretch("run2.csv", 1.0, 2.0, "weed"))
    session.shift(0.1, "speed", "thrust")
    (train,), (unseen,) = session.task.train, session.task.unseen
    assert train.notes == ("'speed' moved by +0.1 s.", "'thrust' moved by +0.1 s.")
    assert unseen.notes[-1] == "1 to 2 s are left out: weed."
    assert np.isnan(unseen.measured["speed"][20:41]).all()


def test_a_slider_keeps_steps_and_starts_and_gives_the_same_comparison(session):
    fitted(session)
    like = session.task.compare()
    session.move({"alpha": 0.05})
    quick, slow = session.task.compare(like), session.task.compare()
    for fast, full in zip(quick.runs, slow.runs, strict=True):
        np.testing.assert_allclose(fast.channels["speed"].modelled, full.channels["speed"].modelled)
    assert quick.errors.nrmse > like.errors.nrmse
    for one in (session.task.compare(like, only=1), session.task.compare(only=1)):
        assert [run.record.name for run in one.runs] == ["run2.csv"]


def test_a_stretch_is_diagnosed_alone(session, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "diffthrust.workbench._session.diagnose", lambda *a, **k: asked.append((a, k))
    )
    session.task.diagnose_stretch(Stretch("run2.csv", 2.0, 6.0))
    ((_, log), options) = asked[0]
    assert (log.name, log.duration) == ("run2.csv", pytest.approx(4.0))
    assert options["experiment"] is False


# -- leaving ---------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_what_is_saved_is_accepted_by_check_and_opened_again(session, tmp_path):
    fitted(session)
    session.tick("command_deadband")
    session.leave_out(Stretch("run2.csv", 1.0, 2.0, 'weed "in" the propeller'))
    session.shift(0.05, "thrust")
    fitted(session)
    paths = save(session, tmp_path / "explored")
    names = ["errors.png", "fit.json", "fit.toml", "report.html", "script.py"]
    assert sorted(p.name for p in paths) == names
    command_line.run("check", tmp_path / "explored")
    again = Session(opened(tmp_path / "explored"))
    assert again.setup.effects == ("command_deadband",)
    assert "# by hand" in again.source.spec.text
    for old, new in zip(session.task.logs, again.task.logs, strict=True):
        assert old.sha256 == new.sha256
    assert Session(opened(tmp_path / "explored" / "fit.json")).fit.parameters == (
        session.fit.parameters
    )
    again = fitted(again)
    assert again.fit.holdout.nrmse == pytest.approx(session.fit.holdout.nrmse, rel=1e-4)
    again.untick("command_deadband")
    fitted(again)
    save(again, tmp_path / "explored")  # it may overwrite its own
    assert "command_deadband" not in (tmp_path / "explored" / "fit.toml").read_text()


@pytest.mark.thorough
def test_a_learned_law_is_added_with_its_fit_and_saved(session, tmp_path):
    task = session.task
    curve = dft.effects.Curve(
        "drive", "command", -3.0, 3.0, unit="rad/s^2", pieces=4, size=20.0, name="learned"
    )
    fit = dft.fit(task.model + curve, task.train, holdout=task.unseen, starts=1)
    law = LearnedLaw(curve, fit, Worth(0.9, 0.8, 0.95), 9.0)
    session.accept_diagnosis(task, replace(made_diagnosis.unexplained(), laws=(law,)))
    assert session.found == ("learned",)
    session.tick(*session.found)
    assert session.fit is fit  # it is not fitted again
    assert session.setup.values["learned.level"] == fit.parameters["learned.level"].value
    save(session, tmp_path / "explored")
    command_line.run("check", tmp_path / "explored")
    again = opened(tmp_path / "explored" / "fit.json")
    assert [effect.name for effect in again.model.effects] == ["learned"]
    names: dict = {}
    exec(script(session), names)
    assert names["fit"].holdout.nrmse == pytest.approx(fit.holdout.nrmse, rel=0.1)


@pytest.mark.thorough
def test_a_save_touches_no_other_fit_and_a_broken_one_nothing(session, tmp_path, monkeypatch):
    folder = tmp_path / "explored"
    other = folder / "by_hand" / "fit.toml"
    other.parent.mkdir(parents=True)
    text = session.source.spec.text
    other.write_text(text)
    for log in ("run1.csv", "run2.csv"):
        (other.parent / log).write_bytes((session.source.spec.path.parent / log).read_bytes())
    save(fitted(session), folder)
    assert other.read_text() == text  # `check` of the folder would have given it [expected]
    saved = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    session.move({"alpha": 0.05})

    def killed(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("diffthrust.workbench._leaving.write_comparison_page", killed)
    with pytest.raises(KeyboardInterrupt):
        save(session, folder)
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == saved
    assert {path.name for path in folder.iterdir()} == {"by_hand", *(path.name for path in saved)}


def test_a_folder_that_cannot_be_made_is_said(session, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(dft.InputError, match="the folder cannot be made"):
        save(fitted(session), tmp_path / "file" / "explored")


@pytest.mark.thorough
def test_a_model_of_ones_own_is_saved_and_its_fit_runs_no_script_untrusted(lacking, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    ran = with_script(lacking, home)
    session = fitted(Session(opened(home, trust=[home])))
    save(session, home / "explored")
    command_line.run("check", home / "explored", "--trust", home)
    ran.unlink()
    with pytest.raises(dft.InputError, match=r"script own.py, which the workbench does not run"):
        opened(home / "explored" / "fit.json")
    assert not ran.exists()
    again = opened(home / "explored" / "fit.json", trust=[home])
    assert again.fit.parameters == session.fit.parameters


def test_a_spec_that_somebody_has_written_is_not_overwritten(session, lacking):
    with pytest.raises(dft.InputError, match="is not fitted"):
        save(session, lacking)
    before = (lacking / "fit.toml").read_text()
    with pytest.raises(dft.InputError, match="nothing that somebody has written is overwritten"):
        save(fitted(session), lacking)
    assert (lacking / "fit.toml").read_text() == before


def test_sliders_say_where_a_fit_begins_and_comments_stay(session, lacking, tmp_path):
    text = (lacking / "fit.toml").read_text() + (
        "\n[parameters]\nalpha = { value = 0.04, bounds = [0, 1] }  # of the sheet\n"
    )
    (lacking / "bounded.toml").write_text(text)
    bounded = Session(opened(lacking / "bounded.toml"))
    bounded.move({"alpha": 0.05, "ct": 0.018})
    written = spec_text(bounded, tmp_path)
    assert "alpha = { value = 0.05, bounds = [0, 1] }  # of the sheet" in written
    assert "ct = 0.018" in written


CHANNELS = {
    "columns": '[channels]\ncommand = "command"\nspeed = "speed"  # by hand\n',
    "dotted": '[channels]\ncommand.column = "command"\nspeed.column = "speed"  # by hand\n',
    "dotted columns": 'channels.command = "command"\nchannels.speed = "speed"  # by hand\n',
    "apart": """\
[channels.command]
column = "command"

[fit]
starts = 1

[channels]
speed = "speed"  # by hand
""",
}


@pytest.mark.parametrize("channels", CHANNELS.values(), ids=CHANNELS)
def test_shifts_are_saved_however_channels_are_written(lacking, channels):
    logs = '[logs]\ntrain = ["run1.csv"]\n'
    text = f'model = "thruster"\n{channels}{logs}'
    (lacking / "channels.toml").write_text(text)
    session = Session(opened(lacking / "channels.toml"))
    session.shift(0.1, "speed", "command")
    written = spec_text(session, lacking)
    assert "# by hand" in written
    (lacking / "shifted.toml").write_text(written)
    saved = dft.load_spec(lacking / "shifted.toml")
    assert {n: channel.shift for n, channel in saved.file.channels.items()} == {
        "speed": 0.1,
        "command": 0.1,
    }


def test_the_command_of_a_thruster_is_shifted(tmp_path):
    text = """model = "craft"
body = "planar"
[thrusters.port]
at = [-0.35, -0.285, 0]
input = "c1"
pwm = { stop = 1500, full = 1900 }
[logs]
train = "run.csv"
[channels]
surge = "u"
"""
    (tmp_path / "fit.toml").write_text(text)
    rows = np.c_[0.1 * np.arange(20), np.full(20, 1700), np.linspace(0.0, 1.0, 20)]
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time,c1,u", comments="")
    session = Session(opened(tmp_path))
    session.shift(0.1, "port.command")
    (tmp_path / "shifted.toml").write_text(spec_text(session, tmp_path))
    channel = dft.load_spec(tmp_path / "shifted.toml").file.channels["port.command"]
    assert (channel.column, channel.shift, channel.pwm.full) == ("c1", 0.1, 1900)


PARAMETERS = {
    "alone": "[parameters]\nresistance = 1.2\ninductance = 0.0052  # by hand\n",
    "dotted": "[parameters]\nresistance.value = 1.2\ninductance.value = 0.0052  # by hand\n",
    "apart": """\
[parameters.resistance]
value = 1.2

[fit]
starts = 1

[parameters]
inductance = 0.0052  # by hand
""",
}


@pytest.mark.parametrize("parameters", PARAMETERS.values(), ids=PARAMETERS)
def test_what_is_freed_and_moved_is_saved_however_parameters_are_written(lacking, parameters):
    text = (lacking / "fit.toml").read_text().replace("[fit]\nstarts = 2\n", parameters)
    text = text.replace('"thruster"', '"dc_motor_thruster"')
    (lacking / "parameters.toml").write_text(text)
    session = Session(opened(lacking / "parameters.toml"))
    session.tick("inductance")
    session.move({"inductance": 0.00624, "resistance": 1.5})
    written = spec_text(session, lacking)
    assert written.count("# by hand") == 2
    (lacking / "moved.toml").write_text(written)
    model = dft.load_spec(lacking / "moved.toml").model
    assert (model.inductance, model.resistance) == (0.00624, 1.5)
    assert not model.parameters["inductance"].fixed


@pytest.fixture
def held(lacking) -> Session:
    """Of a thruster whose ct is held at half of what it is."""
    text = (lacking / "fit.toml").read_text()
    text += "\n[parameters]\nct = { value = 0.01, fixed = true }  # of the sheet\n"
    (lacking / "held.toml").write_text(text)
    return Session(opened(lacking / "held.toml"))


def test_a_constant_is_estimated_with_a_tick_and_held_again_without(held, tmp_path):
    fitted(held)
    assert "ct" in held.constants
    held.tick("ct")
    fitted(held)
    first, second = held.staircase
    assert second.added == "ct"
    assert second.unseen < 0.7 * first.unseen
    assert held.task.model.ct > 0.015
    written = spec_text(held, tmp_path)
    assert "ct = { value = 0.01, fixed = false }  # of the sheet" in written
    names: dict = {}
    exec(script(held), names)
    assert names["fit"].parameters["ct"].value == pytest.approx(held.task.model.ct, rel=1e-6)
    held.untick("ct")
    assert held.task.model.ct == 0.01
    assert held.task.model.parameters["ct"].fixed
    with pytest.raises(dft.InputError, match="cannot be added"):
        held.tick("beta")  # is estimated already


def test_a_constant_that_a_diagnosis_wants_elsewhere_is_among_what_was_found(held):
    task = held.task
    fit = dft.fit(task.model.free("ct"), task.train, holdout=task.unseen, starts=1)
    diag = made_diagnosis.found()
    stages = (diag.stages[0], replace(diag.stages[0], effects=("ct",), fit=fit))
    wanted = HeldValue(0.01, fit.model.ct, 1e-4)
    diag = replace(diag, stages=stages, held={"ct": wanted}, best=(), laws=())
    held.accept_diagnosis(task, diag)
    assert held.found == ("ct",)
    held.tick(*held.found)
    assert held.fit is fit


def test_the_script_does_the_same(session, tmp_path):
    session.tick("command_deadband")
    session.leave_out(Stretch("run2.csv", 1.0, 2.0, "weed"))
    session.shift(0.05, "thrust")
    names: dict = {}
    exec(script(session), names)
    assert names["fit"].holdout.nrmse == session.task.fit().holdout.nrmse
    fit = example_names.fit()
    assert "model = dft.Thruster" in script(Session(opened(fit)))


def test_a_session_needs_no_spec(tmp_path):
    session = Session(Source("own", dft.Thruster(), (example_names.log(),)))
    fitted(session)
    paths = save(session, tmp_path)
    assert [p.name for p in paths] == [
        "fit.json",
        "report.html",
        "script.py",
        "errors.png",
    ]
    with pytest.raises(dft.InputError, match="was not opened from a spec file"):
        spec_text(session, tmp_path)
    assert replace(session.setup, values={}).effects == ()
