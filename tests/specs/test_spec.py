"""Spec files: what they accept, and how they say what they do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from places import FITS
from scipy.io import savemat

from diffthrust import InputError
from diffthrust.specs import Spec, load_spec
from tests.robot_files import write_dataflash

GOOD = """\
model = "thruster"
effects = ["actuator_lag"]

[logs]
train = ["run1.csv"]
holdout = ["run2.csv"]
time = { column = "t", unit = "ms" }

[channels.command]
column = "u"
unit = "V"

[channels.speed]
column = "rpm"
unit = "rpm"
unsigned = true
noise = 3.0

[parameters]
alpha = { value = 0.03, bounds = [0, inf], prior = { mean = 0.03, std = 0.01 } }
beta = 50
ct = { fixed = true }
actuator_lag.time_constant = { value = 0.2 }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = "".join(f"{40 * i},{i % 3},{10 * i},{0.5 * i}\n" for i in range(30))
    for name in ("run1.csv", "run2.csv", "other.csv"):
        (tmp_path / name).write_text(f"t,u,rpm,thrust\n{rows}")
    return tmp_path


def load(folder: Path, text: str) -> Spec:
    path = folder / "spec.toml"
    path.write_text(text)
    return load_spec(path)


def refused(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, text)
    message = str(caught.value)
    assert "spec.toml" in message
    assert "\nMend: " in message
    return message


def swap(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


def test_reads_what_is_written(folder):
    spec = load(folder, GOOD)
    described = spec.model.parameters
    assert described["alpha"].value == 0.03
    assert described["alpha"].bounds == (0, None)
    assert described["alpha"].prior is not None
    assert described["beta"].value == 50
    assert described["ct"].fixed
    assert described["actuator_lag.time_constant"].value == 0.2
    (log,) = spec.train_logs()
    assert log.name == "run1.csv"
    assert log.step == pytest.approx(0.04)
    assert list(log.inputs) == ["command"]
    assert log.unsigned == {"speed"}
    assert log.values("speed", "rad/s")[3] == pytest.approx(np.pi)
    assert log.noise_in("speed", "rad/s") == pytest.approx(0.1 * np.pi)
    assert [log.name for log in spec.holdout_logs()] == ["run2.csv"]


def test_names_a_spec_by_its_folder():
    assert load_spec(FITS / "jason_thruster").name == "jason_thruster"


@pytest.mark.parametrize("name", sorted(p.parent.name for p in FITS.glob("*/fit.toml")))
def test_shipped_specs_load(name):
    spec = load_spec(FITS / name)
    assert spec.train_logs()
    assert spec.holdout_logs()
    assert spec.file.expected is not None


def test_short_forms(folder):
    text = """
    model = "thruster"
    [logs]
    train = "run1.csv"
    time = "t"
    [channels]
    command = "u"
    speed = { column = "rpm", unit = "rpm" }
    """
    spec = load(folder, text.replace('time = "t"', "time = false"))
    assert spec.train_logs()[0].step == 1.0
    assert load(folder, text).file.logs.time is not None


def test_a_table_that_was_written_as_something_else_is_shown(folder):
    text = 'model = "thruster"\nlogs = ["run1.csv"]\n[channels]\ncommand = "u"\nspeed = "rpm"\n'
    message = refused(folder, text)
    assert "line 2, logs: expected a table, found ['run1.csv']" in message
    assert "Mend: Write the table [logs] with train = ...." in message
    text = text.replace('["run1.csv"]', '{ train = "run1.csv", leave_out = ["run1.csv"] }')
    assert "Write { log = ..., start = ..., stop = ... } in its place." in refused(folder, text)


def test_globs_are_sorted_and_counted_once(folder):
    spec = load(folder, swap('["run1.csv"]', '["run1*", "o*.csv", "other.csv"]'))
    assert [p.name for p in spec.train] == ["run1.csv", "other.csv"]


def test_logs_of_the_same_name_are_told_apart(folder):
    (folder / "b").mkdir()
    (folder / "b" / "run1.csv").write_bytes((folder / "run1.csv").read_bytes())
    spec = load(folder, swap('["run1.csv"]', '["run1.csv", "b/run1.csv"]'))
    names = [log.name for log in spec.train_logs()]
    assert len(set(names)) == 2


def test_a_measured_speed_drives_the_thruster_without_a_command(folder):
    text = swap('[channels.command]\ncolumn = "u"\nunit = "V"', "").replace(
        '["actuator_lag"]', "[]"
    )
    text = text.replace("unsigned = true\nnoise = 3.0\n", "")
    text = text.replace("actuator_lag.time_constant = { value = 0.2 }", "")
    spec = load(folder, text + '[channels.thrust]\ncolumn = "thrust"\n')
    assert list(spec.inputs) == ["speed"]
    assert list(spec.measured) == ["thrust"]


def test_a_role_decides(folder):
    text = swap("unsigned = true\nnoise = 3.0", 'role = "input"')
    spec = load(folder, text + '[channels.thrust]\ncolumn = "thrust"\n')
    assert list(spec.inputs) == ["command", "speed"]
    message = refused(folder, swap("[channels.speed]", '[channels.speed]\nhold = "zero"'))
    assert "'hold'" in message
    message = refused(folder, swap('unit = "V"', 'role = "measured"'))
    assert "channels.command.role" in message


def test_twin_thrusters_are_seen_from_the_channels(folder):
    text = """
    model = "vessel"
    [logs]
    train = "run1.csv"
    time = { column = "t", unit = "ms" }
    [channels]
    left_force = "u"
    right_force = "u"
    surge = "thrust"
    """
    assert load(folder, text).model.structure[1] == "twin"
    message = refused(folder, text.replace("[logs]", '[options]\ndrive = "jet"\n[logs]'))
    assert "'jet'" in message
    message = refused(folder, text.replace("[logs]", '[options]\ndriv = "twin"\n[logs]'))
    assert "'drive'" in message


OWN = """
import diffthrust as dft

class Decay(dft.Model):
    name = "decay"
    inputs = {"push": ""}
    states = {"level": ""}
    outputs = {"level": ""}
    rate: float = dft.parameter(1.0, "1/s", bounds=(0, None))

    def equations(self, s, port):
        return {"level": s.push - self.rate * s.level}, {"level": s.level}
"""


def test_a_model_of_ones_own(folder):
    (folder / "own.py").write_text(OWN)
    text = """
    model = "own.py:Decay"
    [logs]
    train = "run1.csv"
    time = { column = "t", unit = "ms" }
    [channels]
    push = "u"
    level = "thrust"
    """
    assert load(folder, text).model.name == "decay"
    assert "'Deca'" in refused(folder, text.replace("Decay", "Deca"))
    assert "none.py" in refused(folder, text.replace("own.py", "none.py"))
    (folder / "broken.py").write_text("x = 1\nraise ValueError('no')\n")
    assert "broken.py, line 2" in refused(folder, text.replace("own.py", "broken.py"))


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("train =", "trian =", ["line 5", "'trian'", "'train'"]),
        ('model = "thruster"', 'modle = "thruster"', ["line 1", "'modle'", "'model'"]),
        ('model = "thruster"', "", ["'model'"]),
        ('model = "thruster"', 'model = "truster"', ["line 1", "'truster'", "'thruster'"]),
        ('actuator_lag"]', 'actuator_leg"]', ["line 2", "'actuator_leg'", "'actuator_lag'"]),
        ('actuator_lag"]', 'actuator_lag", "actuator_lag"]', ["line 2", "already"]),
        ("[channels.speed]", "[channels.sped]", ["line 13", "'sped'", "'speed'"]),
        ("unsigned = true", 'unsigned = "yes"', ["line 16", "channels.speed.unsigned", "'yes'"]),
        ("unsigned = true", "unsined = true", ["line 16", "'unsigned'"]),
        ("noise = 3.0", "noise = -3.0", ["line 17", "greater than 0", "-3.0"]),
        ('column = "u"', 'column = "u"\nnoise = 1.0', ["channels.command.noise", "an input"]),
        ("alpha = {", "alpa = {", ["line 20", "'alpa'", "'alpha'"]),
        ("value = 0.03,", "value = -0.03,", ["line 20", "alpha", "-0.03"]),
        ("value = 0.03,", "valeu = 0.03,", ["line 20", "'valeu'", "'value'"]),
        ("[0, inf]", "[0]", ["line 20", "parameters.alpha.bounds"]),
        ("std = 0.01", "std = 0", ["line 20", "prior"]),
        ("run1.csv", "run7.csv", ["line 5", "'run7.csv'", "the nearest is 'run"]),
        ("run1.csv", "nothing*.csv", ["line 5", "'nothing*.csv'"]),
        ("run2.csv", "run1.csv", ["line 6", "unseen"]),
        ('["run1.csv"]', "[]", ["line 5", "logs.train"]),
        ('["run1.csv"]', "[1]", ["line 5", "logs.train"]),
        ("[channels.command]", "[channels.time]", ["line 9", "[logs] time"]),
        ("[parameters]", "[fit]\nstarts = 0\n[parameters]", ["line 20", "fit.starts"]),
        ("[parameters]", '[fit]\nhorizon = "no"\n[parameters]', ["line 20", "'whole'"]),
        ("[parameters]", '[fit]\nloss = "l1"\n[parameters]', ["line 20", "'student_t'"]),
        ("[parameters]", "[parameters", ["line 19", "not TOML"]),
        ('column = "rpm"', "column = rpm", ["line 14", "not TOML"]),
        ("[logs]", "effects = []\n[logs]", ["line 4", "already in the file", "one of the two"]),
    ],
)
def test_refusals_name_line_key_and_mend(folder, old, new, parts):
    message = refused(folder, swap(old, new))
    for part in parts:
        assert part in message, message


def test_an_input_that_is_needed(folder):
    text = swap('[channels.command]\ncolumn = "u"\nunit = "V"', "")
    text = text.replace('["actuator_lag"]', "[]").replace(
        "actuator_lag.time_constant = { value = 0.2 }", ""
    )
    text = text.replace("unsigned = true\nnoise = 3.0", 'role = "measured"')
    assert "'command'" in refused(folder, text)
    text = GOOD[: GOOD.index("[channels.speed]")]
    assert "nothing is measured" in refused(folder, text)


def test_horizons(folder):
    def horizon(value: str) -> object:
        text = swap("[parameters]", f"[fit]\nhorizon = {value}\n[parameters]")
        return load(folder, text).file.fit.horizon

    assert horizon('"auto"') == "auto"
    assert horizon('"whole"') is None
    assert horizon("20") == 20.0
    assert horizon('[5, 10, "whole"]') == (5.0, 10.0, None)


def test_files_that_are_no_specs(folder):
    with pytest.raises(InputError, match="cannot be read"):
        load_spec(folder / "none.toml")
    with pytest.raises(InputError, match="found only logs"):
        load_spec(folder)
    (folder / "spec.toml").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be read"):
        load_spec(folder)
    (folder / "spec.toml").write_bytes(b"model = '\xff'")
    with pytest.raises(InputError, match="UTF-8"):
        load_spec(folder / "spec.toml")
    (folder / "spec.toml").write_text("\ufeff" + GOOD, encoding="utf-8")
    assert load_spec(folder / "spec.toml").model.name == "thruster"


def test_a_wrong_column_or_unit_is_told_with_the_line_of_the_spec(folder):
    for old, new, key in (('column = "rpm"', 'column = "rmp"', "column"),
                          ('unit = "rpm"', 'unit = "N"', "unit")):  # fmt: skip
        spec = load(folder, swap(old, new))
        line = 1 + spec.text.splitlines().index(new)
        with pytest.raises(InputError, match=rf"line {line}, channels\.speed\.{key}"):
            spec.train_logs()


def cell(folder):
    path = folder / "run1.csv"
    path.write_text(path.read_text().replace("\n80,2,20,", "\n80,2,fast,"))


def stamp(folder):
    path = folder / "run1.csv"
    path.write_text(path.read_text().replace("\n80,2,", "\nnoon,2,"))


def double(folder):
    path = folder / "run1.csv"
    path.write_text(path.read_text().replace("thrust", "rpm"))


def lengths(folder):
    savemat(folder / "run1.mat", {"t": np.arange(9.0), "u": np.arange(9.0), "rpm": np.arange(8.0)})


def dataflash(folder):
    pytest.importorskip("pymavlink")
    rows = [("RCOU", (40_000 * k, k)) for k in range(30)]
    write_dataflash(folder / "run1.bin", {"RCOU": ("QH", ["TimeUS", "C1"])}, rows)


@pytest.mark.parametrize(
    ("spoil", "swaps", "key", "words"),
    [
        (cell, {}, "channels.speed.column", "line 4, column 'rpm': expected a number"),
        (stamp, {}, "logs.time.column", "line 4, column 't': expected a number"),
        (double, {}, "channels.speed.column", "expected one column 'rpm', found several"),
        (None, {'"rpm"\nunit': '"rmp"\nunit'}, "channels.speed.column", "a column 'rmp', found"),
        (None, {'column = "t"': 'column = "T"'}, "logs.time.column", "a column 'T', found"),
        (None, {'unit = "rpm"': 'unit = "rmp"'}, "channels.speed.column", "not a known unit"),
        (None, {'unit = "rpm"': 'unit = "Hz"'}, "channels.speed.column", "'Hz' is ambiguous"),
        (None, {'unit = "rpm"': 'unit = "N"'}, "channels.speed.unit", "agrees with 'rad/s'"),
        (None, {'unit = "ms"': 'unit = "V"'}, "logs.time.unit", "agrees with 's'"),
        (None, {"noise = 3.0": "scale = 0"}, "channels.speed.column", "a scale other than zero"),
        (lengths, {"run1.csv": "run1.mat"}, "channels.speed.column", "samples as in 't', found 8"),
        (lengths, {"run1.csv": "run1.mat", '"rpm"\nunit': '"rmp"\nunit'},
         "channels.speed.column", "expected a variable 'rmp'"),
        (
            dataflash,
            {"run1.csv": "run1.bin", 'time = { column = "t", unit = "ms" }': 'base = "messages"',
             '"u"': '"RCOU.C1"', '"rpm"\nunit': '"RCOU.C3"\nunit'},
            "channels.speed.column",
            "column 'RCOU.C3': expected the field 'C3'",
        ),
    ],
)  # fmt: skip
def test_a_defect_of_a_log_is_told_with_the_line_that_names_its_column(
    folder, spoil, swaps, key, words
):
    text = GOOD.replace('holdout = ["run2.csv"]\n', "")
    for old, new in swaps.items():
        assert old in text
        text = text.replace(old, new)
    if spoil:
        spoil(folder)
    spec = load(folder, text)
    with pytest.raises(InputError) as caught:
        spec.train_logs()
    assert words in caught.value.problem
    table, name = key.rsplit(".", 1)
    rows = text.splitlines()
    header = rows.index("[logs]" if table == "logs.time" else f"[{table}]")
    start = "time" if table == "logs.time" else name
    line = 1 + next(k for k in range(header, len(rows)) if rows[k].startswith(f"{start} ="))
    assert caught.value.problem.endswith(f" It is named in {spec.path}, line {line}, {key}.")


EDITED = GOOD.replace(
    'holdout = ["run2.csv"]',
    'holdout = ["run2.csv"]\nleave_out = [{ log = "run2.csv", start = 0.2, stop = 0.4, '
    'note = "weed" }]',
).replace('unit = "rpm"', 'unit = "rpm"\nshift = 0.08', 1)


def test_a_spec_moves_channels_and_leaves_stretches_out(folder):
    (folder / "plain.toml").write_text(GOOD)
    (folder / "edited.toml").write_text(EDITED)
    plain, edited = load_spec(folder / "plain.toml"), load_spec(folder / "edited.toml")
    (train,), (unseen,) = edited.train_logs(), edited.holdout_logs()
    assert train.notes == ("'speed' moved by +0.08 s.",)
    assert unseen.notes[-1] == "0.2 to 0.4 s are left out: weed."
    before = plain.train_logs()[0].measured["speed"]
    np.testing.assert_allclose(train.measured["speed"][2:], before[:-2])
    assert np.isnan(unseen.measured["speed"][5:11]).all()
    assert np.isfinite(unseen.measured["speed"][[4, 11]]).all()
    assert plain.sha256 != edited.sha256


def test_a_stretch_of_a_log_that_is_not_in_the_spec_is_refused(folder):
    (folder / "fit.toml").write_text(EDITED.replace('log = "run2.csv"', 'log = "run22.csv"'))
    with pytest.raises(InputError, match=r"line 7, logs.leave_out: .* has no log 'run22.csv'"):
        load_spec(folder)
    (folder / "fit.toml").write_text(
        EDITED.replace("start = 0.2", "start = 20").replace("0.4", "30")
    )
    with pytest.raises(InputError, match=r"line 7.*expected samples from 20 to 30 s"):
        load_spec(folder).holdout_logs()
