"""Spec files as nobody should write them: valid ones, of which something was changed."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import campaign_specs
import numpy as np

Rng = np.random.Generator
Change = Callable[[str, Rng], str]

FULL = """
model = "thruster"
effects = ["command_deadband"]
[logs]
train = ["train.csv"]
holdout = ["unseen.csv"]
time = { column = "t", unit = "s" }
missing_values = ["n/a"]
interpolate_inputs = false
start = 0.0
stop = 100.0
[channels.command]
column = "u"
unit = "V"
hold = "zero"
[channels.speed]
column = "n"
unit = "rad/s"
noise = 0.2
scale = 1.0
[parameters]
alpha = { value = 0.03, bounds = [0.001, 1.0] }
beta = { value = 50.0, prior = { mean = 40.0, std = 10.0 } }
ct = { value = 0.02, fixed = true }
"command_deadband.half_width" = 0.1
[fit]
starts = 2
seed = 1
loss = "gaussian"
horizon = "auto"
[expected]
status = "converged"
train_nrmse = 0.1
[expected.parameters]
alpha = { value = 0.03, std_error = 0.001 }
"""
"""A spec with most keys; those of `campaign_specs` are the others."""
ODD = (
    *('""', '" "', '"\\u0000"', '"ä∂😀"', '"../.."', '"/"', '"*"', '"**"', '"~"', '"."', '"nan"'),
    *("true", "false", "0", "-1", "3", "99999999999999999999", "-9223372036854775808", "1e308"),
    *("-1e308", "1e-308", "nan", "inf", "-inf", "-0.0", "[]", "[[]]", "{}", '["", ""]', "[1, [2]]"),
    *("{ value = {} }", "{ a = 1 }", "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", "'''\n'''"),
    *('"command_deadband"', '"thruster"', '"train.csv"', '"white"', '"estimate"', '["train.csv"]'),
    *(
        "[0.0, 0.0]",
        "[1.0, -1.0]",
        "[nan, inf]",
        "[-inf, inf]",
        f'"{"x" * 5000}"',
        '"\\n\\r\\t\\u001b[31m"',
    ),
    *('"rad/s/s"', '"m^99999"', '"1/0"', '"(((("', '"rpm**rpm"', '"kelvin"', '"10 V"', '"V V V"'),
)
"""Values that a key of a spec is given, as TOML has them."""
GONE = ("no.csv", "no*.csv", ".", "/dev/null", "/dev/zero", "fit.toml")
"""Files that are no logs."""
SCRIPTS = (
    "raise RuntimeError('no')",
    "raise SystemExit(0)",
    "import sys; sys.exit('left')",
    "1 / 0",
    "def (:",
    "\x00",
    "print('x' * 100000)",
    "import nowhere_to_be_found",
    "Own = 3",
    "class Own: pass",
    "import diffthrust as dft\nOwn = dft.Model",
    "import diffthrust as dft\nOwn = dft.Thruster()",
    "import diffthrust as dft\nclass Own(dft.Thruster): name = 'thruster'",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  def __init__(self): 1 / 0",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = 'own'\n"
    "  def equations(self, s, port): return {}, {}",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = 'own'\n"
    "  def equations(self, s, port): raise KeyError('x')",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = 'own'\n"
    "  def equations(self, s, port):\n"
    "    rates, out = super().equations(s, port)\n"
    "    return {k: v / 0.0 for k, v in rates.items()}, out",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = 'own'\n"
    "  def equations(self, s, port):\n"
    "    rates, out = super().equations(s, port)\n"
    "    return rates, {k: [v, v] for k, v in out.items()}",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = 'own'\n"
    "  def equations(self, s, port): return self.equations(s, port)",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = 'own'\n  alpha = 'text'",
    "import diffthrust as dft\nclass Own(dft.Thruster):\n  name = ''\n  inputs = {'': ''}",
    "import os; os.chdir('/')\nclass Own: name = 'own'",
    "def __getattr__(name): raise RuntimeError(name)",
    "class Own(BaseException): pass\nraise Own()",
    "raise KeyboardInterrupt.__base__('x')",
)
"""Scripts that name no model, or one that fails; the class is called Own."""


def pick(rng: Rng, options: Sequence[Any]) -> Any:
    """One of several; NumPy's own choice would take the NUL from a text."""
    return options[int(rng.integers(len(options)))]


def _lines(change: Callable[[list[str], int, Rng], None]) -> Change:
    """A change of one line with something in it."""

    def changed(text: str, rng: Rng) -> str:
        lines = text.split("\n")
        full = [i for i, line in enumerate(lines) if line.strip()]
        if full:
            change(lines, pick(rng, full), rng)
        return "\n".join(lines)

    return changed


def _moved(lines: list[str], at: int, rng: Rng) -> None:
    lines.insert(int(rng.integers(len(lines))), lines.pop(at))


def _value(lines: list[str], at: int, rng: Rng) -> None:
    odd = str(pick(rng, ODD))
    values = list(re.finditer(r'(?<==)\s*("[^"]*"|[^\s{}\[\],=]+|\[[^\]]*\])', lines[at]))
    if values:
        found = values[int(rng.integers(len(values)))]
        lines[at] = f"{lines[at][: found.start()]} {odd}{lines[at][found.end() :]}"


def _whole_value(lines: list[str], at: int, rng: Rng) -> None:
    key, equals, _ = lines[at].partition("=")
    if equals:
        lines[at] = f"{key}= {pick(rng, ODD)}"


def _key(lines: list[str], at: int, rng: Rng) -> None:
    words = list(re.finditer(r"\w+", lines[at]))
    if words:
        word = words[int(rng.integers(len(words)))]
        k = int(rng.integers(word.start(), word.end()))
        letter = str(pick(rng, list("aeßэ_.-x \"'=")))
        lines[at] = lines[at][:k] + letter + lines[at][k + int(rng.integers(2)) :]


def _character(text: str, rng: Rng) -> str:
    at = int(rng.integers(len(text) + 1))
    odd = ("\x00", "\x1b", "\x07", "\u202e", "\ufeff", "\ud800", "😀", "\x85", '"', "]")
    return text[:at] + pick(rng, odd) + text[at:]


def _nested(text: str, rng: Rng) -> str:
    depth = int(pick(rng, [2, 20, 99]))
    nested = (
        f"{text}\ndeep = {'[' * depth}{']' * depth}\n",
        f"options = {'{ a = ' * depth}1{' }' * depth}\n{text}",
        f"{text}\n[parameters.{'.'.join('a' * depth)}]\nvalue = 1\n",
    )
    return pick(rng, nested)


def _scripted(text: str, rng: Rng) -> str:
    name = str(pick(rng, ["own.py:Own", "own.py", "own.py:", ":Own", "own.py:no", "gone.py:Own"]))
    if rng.random() < 0.3:
        return re.sub(r"(?m)^effects = .*$", f'effects = ["{name}"]', text)
    name = name if rng.random() < 0.3 else "own.py:Own"
    return re.sub(r"(?m)^model = .*$", f'model = "{name}"', text)


def _number(text: str, rng: Rng) -> str:
    """A number made very large, very small, negative, or of another kind."""
    numbers = list(re.finditer(r"(?<![\w.])-?\d+(\.\d+)?", text))
    if not numbers:
        return text
    found = numbers[int(rng.integers(len(numbers)))]
    odd = str(pick(rng, ["1e300", "-1e300", "0", "-7", "1e-300", "nan", "inf", "5e-324", "1e15"]))
    return text[: found.start()] + odd + text[found.end() :]


CHANGES: dict[str, Change] = {
    "deleted": _lines(lambda lines, at, rng: lines.pop(at) and None),
    "doubled": _lines(lambda lines, at, rng: lines.insert(at, lines[at])),
    "moved": _lines(_moved),
    "mistyped": _lines(_key),
    "value": _lines(_value),
    "other type": _lines(_whole_value),
    "number": _number,
    "nested": _nested,
    "character": _character,
    "script": _scripted,
    "CRLF": lambda text, rng: text.replace("\n", "\r\n" if rng.random() < 0.5 else "\r"),
    "BOM": lambda text, rng: "\ufeff" * int(rng.integers(1, 3)) + text,
    "cut": lambda text, rng: text[: int(rng.integers(len(text) + 1))],
    "file gone": lambda text, rng: text.replace("train.csv", pick(rng, GONE)),
    "many": lambda text, rng: text.replace(
        '["train.csv"]', repr(["train.csv"] * pick(rng, [2, 30]))
    ),
}


def hostile_text(rng: Rng) -> tuple[str, str]:
    """A spec's text, and what was done to it: mostly one change, up to four."""
    text = str(pick(rng, [FULL, FULL, campaign_specs.THRUSTER, campaign_specs.SENSOR]))
    done = [pick(rng, list(CHANGES)) for _ in range(int(pick(rng, [1, 1, 1, 2, 4])))]
    for name in done:
        text = CHANGES[name](text, rng)
    return text, ", ".join(done)


def write_hostile_spec(folder: Path, seed: int) -> str:
    """A folder with a hostile ``fit.toml`` beside sound logs, and what is hostile about it."""
    rng = np.random.default_rng([seed, 1])
    text, done = hostile_text(rng)
    folder.mkdir(parents=True)
    if "depth_m" in text:
        campaign_specs.sensor_log(folder / "train.csv", 0.1, 1.0)
    else:
        campaign_specs.thruster_log(folder / "train.csv", 1, 0.25)
        campaign_specs.thruster_log(folder / "unseen.csv", 2, 0.25)
    script = str(pick(rng, SCRIPTS))
    (folder / "own.py").write_text(script)
    (folder / "fit.toml").write_bytes(text.encode("utf-8", "surrogatepass"))
    return f"{done}: {script!r}" if "own.py" in text else done
