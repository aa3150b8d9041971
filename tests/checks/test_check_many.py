"""Two hundred stored fits: repeats of the same data pass, and one moved parameter is found."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import run
from made_fits import made_fits

from diffthrust.checks import Checked, check
from diffthrust.specs import load_spec

pytestmark = pytest.mark.usefixtures("no_cache")

COUNT = 200
REPEATS = 20


def timed(work: Callable[[], Checked], what: str) -> Checked:
    begin = time.perf_counter()
    checked = work()
    moves = [abs(row.difference) for row in checked.rows if row.difference is not None]
    print(f"{what}: {time.perf_counter() - begin:.1f} s, largest move {max(moves):.1e} std errors")
    return checked


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fits with what they gave once as what is expected."""
    folder = made_fits(tmp_path_factory.mktemp("many") / "fits", COUNT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DIFFTHRUST_CACHE", "off")
        first = timed(lambda: check(folder, update=True, jobs=1), "written, one process")
    assert first.ok
    assert len(first.updated) == COUNT
    return folder


@pytest.mark.slow
def test_clean_repeats_pass(many):
    """Half of them in processes that are started anew, which compile anew."""
    for i in range(REPEATS):
        jobs = 1 + i % 2
        checked = timed(lambda n=jobs: check(many, jobs=n), f"repeat {i + 1}, {jobs} at a time")
        assert len(checked.rows) == COUNT * 5  # a status, an error and three parameters each
        assert [row for row in checked.rows if not row.ok] == []


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="names instructions of x86-64")
def test_a_processor_without_wide_instructions_agrees(many, monkeypatch):
    """Sums are then taken in another order: the rounding of another machine."""
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_max_isa=SSE4_2")  # read by the new processes alone
    assert timed(lambda: check(many, jobs=2), "SSE 4.2").ok


@pytest.mark.slow
@pytest.mark.parametrize(("number", "key", "sign"), [(137, "alpha", 1), (42, "ct", -1)])
def test_one_parameter_moved_by_four_standard_errors_is_found(many, number, key, sign):
    (spec,) = many.glob(f"*/fit_{number:03}/fit.toml")
    expected = load_spec(spec).file.expected
    assert expected is not None
    old, text = expected.parameters[key], spec.read_text()
    assert old.std_error is not None
    line = f"\n{key} = {{ value = "
    moved = f"{line}{old.value + sign * 4 * old.std_error:.10g},"
    assert f"{line}{old.value:.10g}," in text
    spec.write_text(text.replace(f"{line}{old.value:.10g},", moved))
    try:
        checked = timed(lambda: check(many), "moved, as many at a time as processors")
        told = run("check", many, "--jobs", 1, status=None)
    finally:
        spec.write_text(text)
    (row,) = [row for row in checked.rows if not row.ok]
    assert (row.fit, row.quantity) == (spec.parent.relative_to(many).as_posix(), key)
    assert row.difference == pytest.approx(-4 * sign, abs=0.01)
    assert told.exit_code == 1
    (words,) = [line for line in told.stdout.splitlines() if "std errors" in line]
    assert f"{-4 * sign:+.1f} std errors" in words
    assert row.fit in words
    assert "1 of 200 fits failed" in told.stdout
    assert "199 fits unchanged." in told.stdout
