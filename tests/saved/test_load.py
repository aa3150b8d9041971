"""Saved results are those that were saved, to the last digit, and take their place everywhere."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import jax.numpy as jnp
import made_diagnosis as made
import numpy as np
import pytest
import short_logs as short
from exact_bits import bits

import diffthrust as dft
from diffthrust import InputError, parameter
from diffthrust.effects import CommandDeadband, CommandSaturation, Formula
from diffthrust.logs import PWM
from diffthrust.models import Normal

INFINITE = float("inf")


class OwnDrag(dft.Effect):
    """A drag of the shaft, of a user's own."""

    name = "own_drag"
    port = "shaft"
    options = ("power",)
    rate: float = parameter(0.01, "1/s", bounds=(0, None), null=0.0)

    def __init__(self, power=1, **values):
        self._set(power=power)
        super().__init__(**values)

    def __call__(self, value, s):
        return value - self.rate * s.speed * jnp.abs(s.speed) ** (self.power - 1)


SCRIPT = """\
import diffthrust as dft


class OwnDrag(dft.Effect):
    name = "own_drag"
    port = "shaft"
    rate: float = dft.parameter(0.01, "1/s", bounds=(0, None), null=0.0)

    def __init__(self, power=1, **values):
        self._set(power=power)
        super().__init__(**values)

    def __call__(self, value, s):
        return value - self.rate * s.speed
"""


@cache
def log(seed=0, **options):
    return short.made_log(seed, **dict(options))


def effort_log():
    """The same command as widths of pulses."""
    plain, pwm = log(), PWM(1500, 1900)
    effort = plain.inputs["command"] / 3
    return dft.Log(
        plain.time,
        {"command": pwm.effort(pwm.widths(effort))},
        dict(plain.measured),
        units={"command": "effort"},
        name="run.bin",
    )


def boat_log():
    rng = np.random.default_rng(5)
    time = 0.1 * np.arange(300)
    forces = {name: np.repeat(rng.uniform(-1, 3, 15), 20) for name in ("left_force", "right_force")}
    boat = dft.Vessel(drive="twin").replace(lever_arm=0.3)
    found = dft.simulate(boat, dft.Log(time, forces, {}))
    noisy = {n: found[n] + rng.normal(0, 0.01, 300) for n in ("surge", "sway", "yaw_rate")}
    return boat, dft.Log(time, forces, noisy)


def broken(model, logs):
    """A fit that failed: not one start could be simulated."""
    with np.errstate(all="ignore"):
        return dft.fit(model, logs, starts=2)


@cache
def fit_of(kind):
    """A fit of each kind, and its log."""
    a = log()
    if kind == "vessel":
        boat, b = boat_log()
        return dft.fit(boat, b, starts=1, horizon=(5.0, 10.0)), b
    if kind == "pulses":
        b = effort_log()
        return dft.fit(dft.Thruster(), b, starts=2), b
    if kind == "described":
        model = short.MODEL.replace(
            ct={"prior": Normal(0.02, 0.001), "bounds": (0.0, 1.0)}, alpha={"fixed": True}
        )
        model = model + CommandDeadband() + CommandSaturation(limit=INFINITE)
        return dft.fit(model.fix("command_saturation.limit"), a, holdout=log(1), starts=2), a
    if kind == "formula":
        text, power = "-a * speed * abs(speed)**p", dft.parameter(0.5, bounds=(0.1, None))
        law = Formula("shaft", text, name="drag", a="rad/s^2", p=power)
        limit = Formula(
            "load", "min(value, m)", m={"unit": "rad/s^2", "value": 90, "null": INFINITE}
        )
        return dft.fit((short.MODEL + law + limit).fix("formula.m"), a, starts=1), a
    if kind == "doubted":  # a thrust of the other sign
        turned = a.replaced(measured={**a.measured, "thrust": -a.measured["thrust"]})
        fit = dft.fit(short.MODEL, turned, starts=2)
        assert fit.doubts
        return fit, turned
    if kind == "silent":  # a parameter of which the log says nothing has no standard error
        still = a.replaced(inputs={"command": np.zeros(len(a))})
        return dft.fit(short.MODEL, still, starts=1), still
    options = {
        "plain": {},
        "ar1": {"noise_model": "ar1"},
        "innovations": {"likelihood": "innovations"},
        "outliers": {"likelihood": "innovations", "loss": "student_t"},
        "forgiving": {"loss": "student_t"},
    }[kind]
    return short.fitted(a, **options), a


KINDS = (
    *("plain", "ar1", "innovations", "outliers", "forgiving"),
    *("vessel", "pulses", "described", "silent", "doubted", "formula"),
)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_comes_back_to_the_last_digit(kind, tmp_path):
    fit, logs = fit_of(kind)
    fit.save(tmp_path / "a.json")
    again = dft.load(tmp_path / "a.json")
    assert bits(again) == bits(fit)
    assert again.report() == fit.report()
    assert str(again.model.structure) == str(fit.model.structure)
    again.save(tmp_path / "b.json")
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()
    assert bits(dft.compare(again, logs).to_json()) == bits(dft.compare(fit, logs).to_json())


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["plain", "ar1", "outliers", "described"])
def test_a_loaded_fit_takes_its_place_everywhere(kind, tmp_path):
    fit, a = fit_of(kind)
    fit.save(tmp_path / "fit.json")
    again = dft.load(str(tmp_path / "fit.json"))
    assert dft.intervals(again, a).report() == dft.intervals(fit, a).report()
    assert again.options == fit.options
    one, two = (dft.predict(f, log(1)) for f in (fit, again))
    assert bits(one.to_json()) == bits(two.to_json())


def test_the_file_is_for_people_too(tmp_path):
    fit, a = fit_of("plain")
    fit.save(tmp_path / "fit.json")
    text = (tmp_path / "fit.json").read_text(encoding="ascii")
    data = json.loads(text)
    assert list(data) == ["schema", "kind", "origin", "result", "sha256", "arrays"]
    assert (data["schema"], data["kind"]) == (1, "fit")
    origin = data["origin"]
    assert origin["library"]["diffthrust"] == dft.__version__
    assert origin["train"][0]["sha256"] == a.sha256
    assert data["result"]["parameters"]["alpha"]["value"] == fit.parameters["alpha"].value
    assert list(tmp_path.iterdir()) == [tmp_path / "fit.json"]
    assert max(map(len, text.splitlines())) < 200


@pytest.mark.thorough
def test_posteriors_and_diagnoses_of_a_loaded_fit_are_the_same(tmp_path):
    fit, a = fit_of("plain")
    fit.save(tmp_path / "fit.json")
    again = dft.load(tmp_path / "fit.json")
    one, two = (dft.sample(f, a, draws=20, warmup=10, seed=3) for f in (fit, again))
    assert one.posterior.equals(two.posterior)
    assert dft.predict(one, again, a).to_json() == dft.predict(two, fit, a).to_json()
    found = [
        dft.diagnose(f, a, candidates=["actuator_lag"], experiment=False) for f in (fit, again)
    ]
    assert bits(found[0].to_json()) == bits(found[1].to_json())
    assert found[1].notes == ()


def test_a_posterior_is_loaded_with_its_marks(tmp_path):
    fit, a = fit_of("plain")
    post = dft.sample(fit, a, draws=20, warmup=10)
    post.to_netcdf(str(tmp_path / "posterior.nc"))
    again = dft.load(tmp_path / "posterior.nc")
    assert again.groups() == post.groups()
    assert all(again[group].identical(post[group]) for group in post.groups())
    assert again.posterior.attrs == post.posterior.attrs
    told = json.loads(again.posterior.attrs["origin"])
    assert told["train"][0]["sha256"] == a.sha256
    assert dft.predict(again, fit, a).to_json() == dft.predict(post, fit, a).to_json()
    other = replace(fit, log_likelihood=fit.log_likelihood + 1)
    with pytest.raises(InputError, match="another fit"):
        dft.predict(again, other, a)


@pytest.mark.parametrize("kind", ["found", "diagnosis", "adequate", "unexplained"])
def test_a_diagnosis_comes_back_with_its_runs(kind, tmp_path):
    diag = getattr(made, kind)()
    diag.save(tmp_path / "diag.json")
    again = dft.load(tmp_path / "diag.json")
    assert bits(again) == bits(diag)
    assert again.report() == diag.report()
    assert bits(again.to_json()) == bits(diag.to_json())
    model = again.model + again.best
    assert bits(model) == bits(diag.model + diag.best)


@pytest.mark.thorough
def test_the_page_of_a_loaded_diagnosis_is_the_same(tmp_path):
    diag = made.unexplained()
    diag.save(tmp_path / "diag.json")
    again = dft.load(tmp_path / "diag.json")
    for one, name in ((diag, "one"), (again, "two")):
        one.save(tmp_path / f"{name}.html")
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()


@pytest.mark.thorough
@pytest.mark.parametrize("seen", [True, False])
def test_the_headroom_of_a_loaded_diagnosis_is_the_same(seen, tmp_path):
    train, _ = made.logs()
    diag = made.found() if seen else made.adequate()
    held = tuple(dft.compare(stage.fit, train) for stage in (diag.stages[0], diag.stages[-1]))
    diag = replace(diag, trained=held)
    if not seen:
        diag = replace(diag, trained=(diag.before, diag.after))
    diag.save(tmp_path / "diag.json")
    again = dft.load(tmp_path / "diag.json")
    assert [room.judged_on for room in diag.headroom] == ["unseen" if seen else "left-out"] * 2
    assert bits(again.headroom) == bits(diag.headroom)


# -- classes of the user's own ---------------------------------------------------------------------


@cache
def own_fit():
    return dft.fit(short.MODEL + OwnDrag(power=1), log(), starts=1)


def test_a_class_of_ones_own_is_made_only_when_given(tmp_path):
    path = tmp_path / "own.json"
    own_fit().save(path)
    with pytest.raises(InputError, match="own_drag") as caught:
        dft.load(path)
    assert "classes=[OwnDrag]" in caught.value.mend
    assert "test_load.py" in caught.value.problem
    for classes in (OwnDrag, [OwnDrag], (CommandDeadband, OwnDrag)):
        assert bits(dft.load(path, classes=classes)) == bits(own_fit())


def test_a_script_runs_only_when_named(tmp_path):
    path, script = tmp_path / "own.json", tmp_path / "my_effects.py"
    own_fit().save(path)
    marker = tmp_path / "it_ran"
    script.write_text(SCRIPT + f"\nopen({str(marker)!r}, 'w').close()\n")
    with pytest.raises(InputError):
        dft.load(path)
    assert not marker.exists()
    fit = dft.load(path, classes=f"{script}:OwnDrag")
    assert marker.exists()
    assert fit.parameters == own_fit().parameters
    assert fit.model.effects[0].power == 1
    assert '"my_effects.py:OwnDrag"' in fit.report()
    with pytest.raises(InputError, match="expected the class 'Nothing'"):
        dft.load(path, classes=[f"{script}:Nothing"])
    with pytest.raises(InputError, match="found 'OwnDrag'"):
        dft.load(path, classes="OwnDrag")


def test_one_folder_is_trusted_as_it_is_and_not_by_its_letters(tmp_path):
    """As text it was taken letter by letter: of an absolute path the first is the root of all."""
    path, home, other = tmp_path / "own.json", tmp_path / "home", tmp_path / "other"
    home.mkdir()
    other.mkdir()
    marker, script = home / "it_ran", home / "my_effects.py"
    script.write_text(SCRIPT + f"\nopen({str(marker)!r}, 'w').close()\n")
    own_fit().save(path)
    dft.load(path, classes=f"{script}:OwnDrag").save(path)
    marker.unlink()
    with pytest.raises(InputError, match="own_drag"):
        dft.load(path, trust=str(other))
    assert not marker.exists()
    for trust in (str(home), home, [home]):
        assert dft.load(path, trust=trust).parameters == own_fit().parameters


def test_a_class_that_has_changed_is_told(tmp_path):
    path = tmp_path / "own.json"
    own_fit().save(path)
    changed = type("OwnDrag", (OwnDrag,), {"width": parameter(1.0, "rad/s"), "name": "own_drag"})
    with pytest.raises(InputError, match="'rate'; its class OwnDrag has 'rate', 'width' now"):
        dft.load(path, classes=changed)


def test_what_cannot_be_made_again_is_refused_when_it_is_saved(tmp_path):
    class Forgetful(OwnDrag):
        name = "forgetful"

        def __init__(self, table=None, **values):
            super().__init__(**values)

    fit = replace(own_fit(), model=short.MODEL + Forgetful(table={1: 2}))
    with pytest.raises(InputError, match="argument 'table', which it does not keep"):
        fit.save(tmp_path / "own.json")
    assert list(tmp_path.iterdir()) == []
    assert "Forgetful" in fit.report()  # to tell of it takes nothing that it has not


# -- files that are none ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "fit.json"
    fit_of("plain")[0].save(path)
    return path.read_text()


def refused(path, content, match):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=match) as caught:
        dft.load(path)
    assert str(path) in caught.value.problem
    assert caught.value.mend
    return caught.value


def test_a_file_cut_off_anywhere_is_one_message(whole, tmp_path):
    path = tmp_path / "fit.json"
    for share in np.linspace(0, 0.999, 25):
        refused(path, whole[: int(share * len(whole))], "cut off, damaged or of another kind")


def test_a_number_that_was_edited_is_seen(whole, tmp_path):
    value = repr(fit_of("plain")[0].parameters["alpha"].value)
    assert whole.count(value) == 2
    edited = whole.replace(value, value[:-1] + ("1" if value[-1] != "1" else "2"), 1)
    refused(tmp_path / "fit.json", edited, "does not agree with its hash")


def test_a_file_in_a_newer_layout_asks_for_an_update(whole, tmp_path):
    newer = whole.replace('"schema": 1', '"schema": 2').replace(dft.__version__, "9.9", 1)
    error = refused(tmp_path / "fit.json", newer, "a fit in layout 2, saved by diffthrust 9.9")
    assert "Update diffthrust" in error.mend


def test_a_diagnosis_in_an_earlier_layout_asks_for_a_new_diagnosis(tmp_path):
    origin = {"library": {"diffthrust": "0.1.0"}}
    earlier = {"schema": 1, "kind": "diagnosis", "origin": origin, "result": {"verdict": "none"}}
    error = refused(tmp_path / "diag.json", json.dumps(earlier), "an earlier layout")
    assert "a diagnosis in layout 1, saved by diffthrust 0.1.0" in error.problem
    assert "Diagnose the logs again" in error.mend


def test_other_files_are_named_for_what_they_are(whole, tmp_path):
    fit, _ = fit_of("plain")
    told = refused(tmp_path / "fit.json", json.dumps(fit.to_json(), default=str), "other JSON")
    assert "--save" in told.mend
    refused(tmp_path / "list.json", "[1, 2]", "other JSON")
    refused(tmp_path / "deep.json", "[" * 100_000, "cut off, damaged")
    refused(tmp_path / "noise.json", np.random.default_rng(1).bytes(400), "cut off, damaged")
    refused(tmp_path / "page.html", "<html>", "found .html")
    refused(tmp_path / "chain.h5", b"\x89HDF", "found .h5")
    refused(tmp_path / "fit.toml", "model = 'thruster'", "found .toml")
    refused(tmp_path / "posterior.nc", b"CDF nothing", "expected a posterior")
    for name in ("none.json", "none.nc"):
        with pytest.raises(InputError, match="no such file"):
            dft.load(tmp_path / name)
    with pytest.raises(InputError, match="cannot be read"):
        dft.load(tmp_path)


def test_a_truncated_posterior_is_one_message(tmp_path):
    fit, a = fit_of("plain")
    path = tmp_path / "posterior.nc"
    dft.sample(fit, a, draws=20, warmup=10).to_netcdf(str(path))
    content = path.read_bytes()
    for share in (0.1, 0.5, 0.9):
        refused(path, content[: int(share * len(content))], "cut off, damaged or of another kind")


def test_what_this_version_does_not_know_is_told(whole, tmp_path):
    from diffthrust._support.saved_file import write_saved  # private: a file of another version

    fit = fit_of("plain")[0]
    path = tmp_path / "fit.json"
    write_saved(path, "dream", fit.origin, fit)
    with pytest.raises(InputError, match="found the kind 'dream'"):
        dft.load(path)
    write_saved(path, "fit", fit.origin, {"model": 1})
    with pytest.raises(InputError, match=f"written by version {dft.__version__}"):
        dft.load(path)


def test_nothing_is_left_where_nothing_can_be_written(tmp_path):
    fit = fit_of("plain")[0]
    with pytest.raises(InputError, match=r"\.json"):
        fit.save(tmp_path / "fit.txt")
    with pytest.raises(InputError, match="cannot be written"):
        fit.save(tmp_path / "nowhere" / "fit.json")
    with pytest.raises(InputError, match=r"\.html or \.htm or \.json"):
        made.found().save(tmp_path / "diag.txt")
    assert list(tmp_path.iterdir()) == []
