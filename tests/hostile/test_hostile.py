"""Hostile specs, logs and names: a result or one clear error, and never anything else."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from posterior_cases import chain_file

from diffthrust import Column, InputError, read_log
from diffthrust.specs import load_spec
from diffthrust.specs._file import parse_spec  # private: the text alone, without its logs

from . import run
from .logs import FORMATS, hostile_log
from .specs import CHANGES, FULL, hostile_text, write_hostile_spec

NIGHT = float(os.environ.get("DIFFTHRUST_NIGHT", "240"))
"""Seconds of a nightly test; a few of them make ten minutes."""
common = settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
needs_workers = pytest.mark.skipif(sys.platform != "linux", reason="memory is read as of Linux")


def bad(cases) -> list[str]:
    return [f"{c.kind} {c.seed} ({c.done}): {c.ended}: {c.said}" for c in cases if not c.good]


@needs_workers
def test_some_hostile_specs_and_logs_end_well(tmp_path):
    found = list(run.cases(8, seed=5, jobs=1, root=tmp_path))
    assert len(found) == 8
    assert bad(found) == []


@needs_workers
@pytest.mark.nightly
def test_hostile_specs_and_logs_of_a_night_end_well(tmp_path):
    seed, begun, found = int(time.time()), time.monotonic(), []
    while time.monotonic() - begun < NIGHT:
        found += run.cases(60, seed=seed + len(found), jobs=1, root=tmp_path)
    assert bad(found) == []


def test_the_draws_are_hostile_in_every_way():
    done = {hostile_text(np.random.default_rng([seed, 1]))[1] for seed in range(300)}
    assert {word for words in done for word in words.split(", ")} == set(CHANGES)
    assert {hostile_log(np.random.default_rng([seed, 2]))[1] for seed in range(80)} == set(FORMATS)
    texts = [hostile_text(np.random.default_rng([7, 1])) for _ in range(2)]
    assert texts[0] == texts[1]


WORDS = ["fit", "spec", "--json", "out.json"]


@pytest.mark.parametrize(
    ("said", "how"),
    [
        ((0, "", "", ""), "silent zero"),
        ((1, "", "", "Traceback (most recent call last)\nKeyError: 1"), "traceback"),
        ((3, "", "A defect of diffthrust, not of your input: ...", ""), "defect"),
        ((2, "", "", ""), "unclear error"),
        ((2, "", "Error: spec: expected text.\nMend: write it.", ""), "clear error"),
    ],
)
def test_how_a_command_ended_is_told(said, how):
    assert run.ended(WORDS, *said) == how


def test_a_result_without_parameters_is_a_silent_zero(tmp_path):
    out = tmp_path / "out.json"
    words = ["fit", "spec", "--json", str(out)]
    for text, how in (
        ('{"parameters": {}}', "silent zero"),
        ('{"parameters": {"a": 1}}', "result"),
    ):
        out.write_text(text)
        assert run.ended(words, 0, "a table", "", "") == how


def refusal(problem) -> InputError | None:
    """What a call raises, which may be an InputError with both its parts, or nothing."""
    try:
        problem()
        return None
    except InputError as error:
        told = error
    assert told.problem.strip()
    assert told.mend.strip()
    return told


@settings(common, max_examples=300)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_changed_spec_is_read_or_refused(seed):
    text, _ = hostile_text(np.random.default_rng(seed))
    refusal(lambda: parse_spec(text, "fit.toml"))


@common
@given(text=st.text(max_size=300))
def test_any_text_is_no_spec(text):
    assert refusal(lambda: parse_spec(text, "fit.toml")) is not None


keys = st.one_of(
    st.sampled_from(["model", "logs", "channels", "parameters", "fit", "value", "train", "column"]),
    st.text(max_size=4),
)
values = st.recursive(
    st.one_of(st.text(max_size=5), st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats()),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(keys, inner, max_size=3)),
    max_leaves=8,
)


@common
@given(tables=st.dictionaries(keys, values, max_size=5))
def test_any_table_is_read_or_refused(tables):
    import tomlkit

    text = tomlkit.dumps(tables)
    refusal(lambda: parse_spec(text, "fit.toml"))
    refusal(lambda: parse_spec(f"{FULL}\n[options]\n{text}", "fit.toml"))


@settings(common, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_hostile_folder_is_read_or_refused(seed):
    with tempfile.TemporaryDirectory() as root:
        folder = Path(root) / "case"
        write_hostile_spec(folder, seed)

        def read():
            spec = load_spec(folder)
            return spec.train_logs(), spec.holdout_logs()

        refusal(read)


@pytest.mark.thorough
@settings(common, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_hostile_log_is_read_or_refused(seed):
    data, ending, _ = hostile_log(np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{ending}"
        path.write_bytes(data)
        refusal(lambda: read_log(path, time="t", inputs={"u": "u"}, measured={"n": "n"}))


names = st.one_of(
    st.text(max_size=20),
    st.sampled_from(["", " ", "t", "time", "nan", "speed", "command", "a.b", "a/b", "__init__"]),
)


@common
@given(column=names, channel=names, other=names, header=names)
def test_any_names_are_read_or_refused(column, channel, other, header):
    quoted = header.replace('"', '""')
    text = f't,"{quoted}",n\n' + "".join(f"{k / 10},{k % 3},{k}\n" for k in range(8))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        given_ = {channel: Column(column)} if column else {channel: column}
        refusal(lambda: read_log(path, time="t", inputs=given_, measured={other: header}))


@pytest.fixture(scope="module")
def chain() -> bytes:
    """The bytes of a small sound chain."""
    rng = np.random.RandomState(1)
    steps, log_prob = rng.normal(size=(70, 4, 2)), rng.normal(size=(70, 4))
    stored = chain_file.Chain(4, np.zeros(2), np.eye(2), rng.get_state())
    mark = np.ones(4), chain_file.packed(rng.get_state())
    stored.filled(steps, log_prob, np.ones((70, 4, 1)), np.ones(4), [mark])
    return chain_file.chain_bytes(stored, {}, ("a", "b"))


@pytest.mark.parametrize("byte", [0x00, 0x01, 0xFF])
def test_a_chain_does_not_hang_on_a_damaged_heap(chain, byte, tmp_path):
    """HDF5 read the text of a problem from a damaged heap of strings for ever."""
    path, at = tmp_path / "chain.h5", chain.index(b"GCOL")
    path.write_bytes(chain)
    expected = chain_file.read(path, {})
    for begin in range(0, 64, 4):
        data = bytearray(chain)
        data[at + begin : at + begin + 16] = bytes([byte]) * 16
        path.write_bytes(data)
        read: list = []
        refusal(lambda read=read: read.append(chain_file.read(path, {})))
        for stored in read:
            np.testing.assert_array_equal(stored.chain, expected.chain)


@common
@given(
    changes=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=40)), max_size=3),
    cut=st.one_of(st.none(), st.floats(0, 1)),
)
def test_a_damaged_chain_is_whole_or_refused(chain, changes, cut):
    data = bytearray(chain)
    for where, piece in changes:
        at = int(where * (len(data) - len(piece)))
        data[at : at + len(piece)] = piece
    if cut is not None:
        del data[int(cut * len(data)) :]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.h5"
        path.write_bytes(data)
        read: list = []
        refusal(lambda: read.append(chain_file.read(path, {})))
        if read:
            sound = Path(folder) / "sound.h5"
            sound.write_bytes(chain)
            expected = chain_file.read(sound, {})
            np.testing.assert_array_equal(read[0].chain, expected.chain)
            np.testing.assert_array_equal(read[0].log_prob, expected.log_prob)
        assert path.read_bytes() == data
