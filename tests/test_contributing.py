"""The patches of CONTRIBUTING apply to the package as it is, and do what they promise.

They are applied to a copy of the package, in which a new law of errors, noise, model and effect
then work through the public interface: spec files, fits, messages and advice know them.
"""

import os
import re
import shutil
import subprocess
import sys
import textwrap

import pytest
from places import ROOT

PATCHES = {
    title: patch
    for title, patch in re.findall(
        r"^(An? [^\n]*?):\n\n```diff\n(.*?)```$",
        (ROOT / "CONTRIBUTING.md").read_text(),
        re.M | re.S,
    )
}


def files_of(patch):
    """Each file of a patch with its changes, in the order of the patch."""
    for section in re.split(r"^--- ", patch, flags=re.M)[1:]:
        name, _, body = section.partition("\n")
        lines = body.splitlines()
        if name == "/dev/null":
            name, lines = lines[0].removeprefix("+++ b/"), lines[1:]
        yield name.removeprefix("a/"), lines


def blocks(lines):
    """Old and new text of each change: a run of added lines with what it stands in or replaces."""
    old, new, changes = [], [], []
    for line in [*lines, None]:
        replaces = line is not None and line.startswith("-")
        if line is None or (replaces and old and new):
            changes.append(("\n".join(old), "\n".join(new)))
            old, new = [], []
        if line is None:
            continue
        if not line.startswith("+"):
            old.append(line[1:])
        if not line.startswith("-"):
            new.append(line[1:])
    return changes


def apply(patch, root):
    for name, lines in files_of(patch):
        path = root / name
        text = path.read_text() if path.exists() else ""
        for old, new in blocks(lines):
            assert not old or text.count(old) == 1, f"{name} has changed: {old}"
            text = text.replace(old, new) if old else f"{text}{new}\n"
        path.write_text(text)


@pytest.fixture(scope="module")
def patched(tmp_path_factory):
    """A copy of the package with all patches."""
    root = tmp_path_factory.mktemp("patched")
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "diffthrust", root / "diffthrust", ignore=ignored)
    for patch in PATCHES.values():
        apply(patch, root)
    return root


def run(root, code):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_there_is_a_patch_for_each_kind():
    assert list(PATCHES) == [
        "An effect",
        "A noise",
        "A law of errors",
        "A model",
        "A table of the report, in the terminal and on the page",
    ]


def test_effect_model_and_noise_are_known_by_name(patched):
    told = run(
        patched,
        """
        import numpy as np
        import diffthrust as dft
        model = dft.Thruster() + "cubic_damping"
        print(model, list(dft.models.MODELS)[-1])
        time = 0.05 * np.arange(80)
        run = dft.simulate(dft.models.FirstOrder(), dft.Log(time, {"command": np.ones(80)}))
        print(round(float(run["speed"][-1]), 1))
        """,
    )
    assert told.splitlines() == ["thruster + cubic_damping first_order", "40.0"]


@pytest.mark.thorough
def test_a_third_law_of_errors_is_one_class_and_one_line(patched):
    """In spec files, `fit`, its messages, the advice on noise, and what follows from a fit."""
    told = run(
        patched,
        """
        from pathlib import Path
        import numpy as np
        import diffthrust as dft
        rng = np.random.default_rng(5)
        count = 3000
        time = 0.05 * np.arange(count)
        command = np.repeat(rng.uniform(-2.0, 2.0, count // 20), 20)
        clean = dft.simulate(dft.Thruster(), dft.Log(time, {"command": command}))["speed"]
        speed = clean + 0.4 * rng.logistic(size=count)
        rows = "\\n".join(f"{t},{u},{w}" for t, u, w in zip(time, command, speed))
        Path("run.csv").write_text("t,u,rpm\\n" + rows)
        spec = '''
        model = "thruster"
        [logs]
        train = ["run.csv"]
        time = {column = "t", unit = "s"}
        [channels]
        command = {column = "u", unit = "V"}
        speed = {column = "rpm", unit = "rad/s"}
        [parameters]
        ct = {value = 0.02, fixed = true}
        [fit]
        starts = 2
        loss = "LOSS"
        '''
        Path("fit.toml").write_text(spec.replace("LOSS", "logistic"))
        fit = dft.load_spec("fit.toml").fit()
        alpha = fit.parameters["alpha"]
        assert fit.loss == "logistic" and fit.status.ok, fit.report()
        assert abs(alpha.value - 0.037) < 4 * alpha.std_error, alpha
        assert abs(fit.noise["speed"] - 0.4) < 0.05, fit.noise
        log = dft.Log(time, {"command": command}, {"speed": speed})
        again = dft.fit(dft.Thruster().fix("ct"), log, loss="logistic", starts=2)
        assert abs(again.parameters["alpha"].value - alpha.value) < 1e-6
        advice = dft.compare(dft.fit(dft.Thruster().fix("ct"), log, starts=2), log).noise_advice
        print(advice.loss, len(advice.bic), "loss='logistic'" in advice.sentence)
        band = dft.uncertainty.predict(again, log, draws=50).channels["speed"]
        print(bool(band.noisy_high[5] > band.high[5]))
        for loss in ("logistik", "huber"):
            try:
                dft.fit(dft.Thruster(), log, loss=loss)
            except dft.InputError as error:
                print(str(error).splitlines()[0])
        Path("fit.toml").write_text(spec.replace("LOSS", "logistik"))
        try:
            dft.load_spec("fit.toml").fit()
        except dft.InputError as error:
            print(str(error).splitlines()[0])
        import subprocess, sys
        subprocess.run([sys.executable, "-m", "diffthrust", "new", "made"], check=True,
                       capture_output=True)
        text = Path("fits/made/fit.toml").read_text()
        print([line for line in text.splitlines() if "loss" in line][0])
        """,
    )
    lines = told.splitlines()
    assert lines[0] == "logistic 9 True"
    assert lines[1] == "True"
    expected = "loss: expected one of gaussian, student_t, logistic, found "
    assert lines[2] == f"{expected}'logistik' (the nearest is 'logistic')."
    assert lines[3] == f"{expected}'huber'."
    assert "'gaussian' or 'student_t' or 'logistic' (the nearest is 'logistic'), found" in lines[4]
    assert lines[5] == (
        '# loss = "gaussian" # "student_t" where there are outliers, '
        '"logistic" where large errors are a little more frequent'
    )
