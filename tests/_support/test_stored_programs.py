"""Traced programs on disk: read back to the last bit, and never the wrong one."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import ROOT
from processes import NoDigest, ProgramStore, digest, digests, environment, programs

import diffthrust as dft

SCRIPT = """
import sys
import numpy as np
import diffthrust as dft
from diffthrust._support._running import programs

class Sled(dft.Model):
    name = "sled"
    inputs = {"force": "N"}
    states = {"speed": "m/s"}
    outputs = states
    ports = {"drag": "force against the motion [N]"}
    mass: float = dft.parameter(10.0, "kg", bounds=(0.1, None), fixed=True)
    drag: float = dft.parameter(5.0, "N s/m", bounds=(0, None))

    def equations(self, s, port):
        drag = port("drag", DRAG * self.drag * s.speed)
        return {"speed": (s.force - drag) / self.mass}, {"speed": s.speed}

made = programs.Programs.__call__
seen = set()
def counted(self, *arguments):
    seen.add(self)
    return made(self, *arguments)
programs.Programs.__call__ = counted
time = np.arange(400) * 0.05
force = 10.0 * np.sign(np.sin(time))
true = dft.simulate(Sled(drag=8.0 / DRAG), dft.Log(time, {"force": force}, {"speed": 0 * time}))
log = dft.Log(time, {"force": force}, {"speed": true["speed"]})
fit = dft.fit(Sled(), [log])
drag = fit.parameters["drag"]
print(sum(p.traces for p in seen), drag.value.hex(), drag.std_error.hex())
"""


def started(path: Path, cache: Path | None) -> subprocess.Popen[str]:
    """A script in a process of its own, which keeps compiled code in a folder if one is given."""
    others = ("JAX_COMPILATION_CACHE_DIR", "DIFFTHRUST_CACHE")
    env = {k: v for k, v in os.environ.items() if k not in others} | {"PYTHONPATH": str(ROOT)}
    env |= {"DIFFTHRUST_CACHE": str(cache)} if cache else {}
    return subprocess.Popen([sys.executable, path], env=env, stdout=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen[str]) -> list[str]:
    """The words that a script has printed."""
    words = process.communicate(timeout=300)[0].split()
    assert process.returncode == 0
    return words


def run(script: str, cache: Path | None, path: Path) -> list[str]:
    path.write_text(script)
    return ended(started(path, cache))


@pytest.mark.thorough
def test_a_second_script_compiles_nothing(tmp_path: Path) -> None:
    cache, path = tmp_path / "cache", tmp_path / "sled.py"
    kept = []
    for _ in range(2):
        run("DRAG = 1.0\n" + SCRIPT, cache, path)
        kept.append({entry.name for entry in cache.iterdir() if entry.name.endswith("-cache")})
    assert kept[0]
    assert kept[1] == kept[0]


@pytest.mark.thorough
def test_a_folder_that_a_script_has_chosen_stays(tmp_path: Path) -> None:
    chosen = f"import jax\njax.config.update('jax_compilation_cache_dir', {str(tmp_path)!r})\n"
    check = f"\nassert jax.config.jax_compilation_cache_dir == {str(tmp_path)!r}\n"
    run(f"{chosen}DRAG = 1.0\n{SCRIPT}{check}", None, tmp_path / "sled.py")


@pytest.mark.thorough
def test_a_users_own_model_is_traced_once_until_its_source_changes(tmp_path: Path) -> None:
    cache, path = tmp_path / "cache", tmp_path / "sled.py"
    first = run("DRAG = 1.0\n" + SCRIPT, cache, path)
    assert int(first[0]) > 0
    again = run("DRAG = 1.0\n" + SCRIPT, cache, path)
    assert again == ["0", *first[1:]]  # to the last bit
    other = run("DRAG = 2.0\n" + SCRIPT, cache, path)
    assert int(other[0]) > 0
    assert float.fromhex(other[1]) == pytest.approx(float.fromhex(first[1]) / 2.0, rel=1e-6)


@pytest.mark.thorough
def test_two_processes_that_write_at_once(tmp_path: Path) -> None:
    cache, path = tmp_path / "cache", tmp_path / "sled.py"
    path.write_text("DRAG = 1.0\n" + SCRIPT)
    both = [started(path, cache) for _ in range(2)]
    told = [ended(process)[1:] for process in both]
    assert told[0] == told[1]
    assert ended(started(path, cache)) == ["0", *told[0]]
    names = {path.suffix for path in (tmp_path / "cache" / "programs").iterdir()}
    assert names == {".program"}  # nothing half-written is left


@pytest.fixture
def store(tmp_path, monkeypatch) -> ProgramStore:
    made = ProgramStore(tmp_path)
    monkeypatch.setattr(programs, "program_store", lambda: made)
    return made


class Pair(NamedTuple):
    low: jax.Array
    high: jax.Array


def squares(exponent, numbers):
    return {"sum": jnp.sum(numbers["x"] ** exponent), "all": [numbers["x"] * numbers["by"]]}


def fresh(function=squares):
    """Programs as another process would have them: nothing is kept in memory."""
    programs._kept.cache_clear()
    return programs.Programs(function, 1)


def only(store: ProgramStore) -> Path:
    (path,) = store.folder.rglob("*.program")
    return path


def test_what_is_read_back_is_the_same(store):
    numbers = {"x": np.linspace(0.1, 3.0, 17), "by": 0.3}
    first = fresh()
    result = first(3, numbers)
    second = fresh()
    again = second(3, numbers)
    assert (first.traces, second.traces) == (1, 0)
    assert float(result["sum"]) == float(again["sum"])
    np.testing.assert_array_equal(result["all"][0], again["all"][0])
    third = fresh()
    assert float(third(2, numbers)["sum"]) == pytest.approx(float(np.sum(numbers["x"] ** 2)))
    assert third.traces == 1  # another exponent is another program


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[: len(content) // 2],
        lambda content: b"",
        lambda content: content[:-1] + bytes([content[-1] ^ 1]),
        lambda content: content.replace(b'"classes": []', b'"classes": ["os:stat_result"]'),
        lambda content: content.replace(b'"classes": []', b'"classes": 3'),
        lambda content: b"[1]\n" + content,
    ],
)
def test_a_damaged_file_counts_as_absent_and_is_replaced(store, damage):
    numbers = {"x": np.ones(3), "by": 2.0}
    fresh()(2, numbers)
    sound = only(store).read_bytes()
    only(store).write_bytes(damage(sound))
    again = fresh()
    assert float(again(2, numbers)["sum"]) == 3.0
    assert again.traces == 1
    assert only(store).read_bytes() != damage(sound)
    last = fresh()
    last(2, numbers)
    assert last.traces == 0


def test_another_version_of_jax_is_another_program(store, monkeypatch):
    numbers = {"x": np.ones(3), "by": 2.0}
    fresh()(2, numbers)
    versions = dict.fromkeys(digests._COMPILING, "99.0")
    monkeypatch.setattr(digests, "version", versions.__getitem__)
    environment.cache_clear()
    try:
        other = fresh()
        other(2, numbers)
    finally:
        environment.cache_clear()
    assert other.traces == 1
    assert len(list(store.folder.rglob("*.program"))) == 2


def test_what_calls_back_into_python_stays_in_memory(store):
    def told(exponent, x):
        return jax.pure_callback(lambda x: x**exponent, jax.ShapeDtypeStruct((), x.dtype), x)

    assert float(fresh(told)(2, np.float64(3.0))) == 9.0
    assert not list(store.folder.rglob("*.program"))


def test_what_calls_foreign_code_is_not_stored(store):
    def foreign(x):
        return jax.ffi.ffi_call("of_no_library", jax.ShapeDtypeStruct((), x.dtype))(x)

    kept = store.save("key", foreign, [np.float64(3.0)])
    assert "of_no_library" in kept.lower(np.float64(3.0)).as_text()
    assert not list(store.folder.rglob("*.program"))


def test_a_result_of_another_package_stays_in_memory(store):
    def pair(exponent, x):
        return Pair(x, x**exponent)

    for _ in range(2):
        made = fresh(pair)
        assert float(made(2, np.float64(3.0)).high) == 9.0
        assert made.traces == 1


def test_a_full_disk_is_no_failure(store, monkeypatch):
    store.folder.joinpath("programs").write_text("a file where the folder should be")
    made = fresh()
    assert float(made(2, {"x": np.ones(3), "by": 2.0})["sum"]) == 3.0
    assert made.traces == 1


def test_those_used_longest_ago_go_first(tmp_path):
    store = ProgramStore(tmp_path)
    (tmp_path / "programs").mkdir()
    for age, name in enumerate(("new.program", "middle.program", "old.program")):
        path = tmp_path / "programs" / name
        path.write_bytes(b"x" * 100)
        os.utime(path, (1e9 - age, 1e9 - age))
    (tmp_path / "notes.txt").write_text("not ours")
    (tmp_path / "jit_step-cache").write_text("compiled by JAX, of another project perhaps")
    store.shrink(250)
    kept = sorted(path.name for path in (tmp_path / "programs").iterdir())
    assert kept == ["middle.program", "new.program"]
    assert sum(size for _, _, size in store.files()) == 200
    store.shrink()
    assert not list((tmp_path / "programs").iterdir())
    assert (tmp_path / "notes.txt").exists()
    assert (tmp_path / "jit_step-cache").exists()


def power(exponent):
    return lambda x: x**exponent


def twice(x):
    return 2.0 * x


def with_helper(x):
    return helper(x) + 1.0


def helper(x):
    return x


class Box:
    __slots__ = ("item",)


def test_what_a_user_defines_goes_in_by_its_code(monkeypatch):
    assert digest(power(2)) == digest(power(2)) != digest(power(3))
    assert digest(partial(twice, 1)) != digest(partial(twice, 2))
    before = digest(with_helper)
    monkeypatch.setitem(globals(), "helper", twice)
    assert digest(with_helper) != before
    assert digest(np.arange(3.0)) != digest(np.arange(3)) != digest(np.arange(4))
    assert digest({"a": 1, "b": 2}) != digest({"b": 2, "a": 1})  # sums follow the order
    assert digest(frozenset("ab")) == digest(frozenset("ba"))
    assert digest(1) != digest(1.0) != digest(True) != digest("1")
    assert digest(("a", "b")) != digest(("ab",)) != digest((("a",), "b"))


def test_a_name_that_leads_elsewhere_does_not_stand_for_the_code():
    """A class that a function of the package makes, for each port another, and two lambdas."""
    made = [type("Push", (dft.Effect,), {"name": "p", "port": port}) for port in ("a", "a", "b")]
    for cls in made:
        cls.__module__ = "diffthrust.models"
    assert digest(made[0]) == digest(made[1]) != digest(made[2])
    names = {"__name__": "diffthrust.models"}
    first, second = (eval(text, names) for text in ("lambda x: x + 1", "lambda x: x + 2"))
    assert digest(first) != digest(second)


def test_what_cannot_be_followed_has_no_digest():
    loop = []
    loop.append(loop)
    for thing in (Box(), object(), np.array([Box()], dtype=object), loop):
        with pytest.raises(NoDigest):
            digest(thing)


def test_a_program_is_traced_without_collections_which_go_on_afterwards(tmp_path):
    """Collections took a third of the time, with all that a trace has made to look through."""
    seen = []

    def looking(x):
        seen.append(gc.isenabled())
        return 2.0 * x

    def failing(x):
        raise ArithmeticError

    assert gc.isenabled()
    store = ProgramStore(tmp_path)
    assert store.save("a", looking, [jax.ShapeDtypeStruct((3,), float)])(np.ones(3)).sum() == 6.0
    with pytest.raises(ArithmeticError):
        store.save("b", failing, [jax.ShapeDtypeStruct((3,), float)])
    assert seen == [False]
    assert gc.isenabled()
