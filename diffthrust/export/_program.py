"""A model written as a program of another language."""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterable, Mapping
from textwrap import wrap

from diffthrust.export._language import ATOM, LINE, Language, Term, lines_of
from diffthrust.export._source import ExportSource, filled_in
from diffthrust.export._trace import Operations, traced_model
from diffthrust.simulation._integrate import SERIES, TURN

HISTORY = 256
"""Samples that a delay remembers."""


def program_text(source: ExportSource, language: Language) -> str:
    """A model as functions of another language, which a template puts into a file."""
    model = source.model
    inputs = list(source.inputs)
    states, traced = traced_model(model, source.inputs)
    relaxing = list(traced["decays"].results)
    results = {
        "arrive": inputs,
        "start": list(states),
        "rates": list(states),
        "decays": relaxing,
        "read": list(model.outputs),
    }
    functions = {
        name: _function(source, language, states, traced[name], wanted)
        for name, wanted in results.items()
    }
    return filled_in(
        language.template,
        source=source,
        model=model,
        states=states,
        language=language,
        prefix=language.prefix,
        name=language.name,
        linear=[language.name(name) for name in source.linear],
        words=[language.name(name) for name in inputs],
        title=wrap(str(model), 90),
        head_lines=[line for text in source.head for line in wrap(text, 90)],
        remark=remark,
        parameters=list(_parameters(source, language)),
        relaxing=relaxing,
        memories=language.memories,
        kinds=sorted(set(language.memories.values())),
        used=language.used,
        guarded=language.guarded,
        history=HISTORY,
        pulses={n: p for n in inputs if (p := source.pulses(n)) is not None},
        series=SERIES,
        turn=TURN,
        **functions,
    )


def _parameters(source: ExportSource, language: Language) -> Iterable[tuple[str, str, str]]:
    """Each parameter as it is written: name, value, remark."""
    for name, p in source.model.parameters.items():
        error = source.errors.get(name)
        more = [p.doc] if p.doc else []
        more += [f"standard error {error:.2g}"] if error is not None else []
        value = language.constant(float(p.value))
        yield language.parameter(name), value, remark(p.unit, ", ".join(more))


def _function(
    source: ExportSource,
    language: Language,
    states: Iterable[str],
    operations: Operations,
    wanted: Iterable[str],
) -> Mapping[str, object]:
    """The lines of one function, its results in order, and the words that it reads."""
    values = {name: float(p.value) for name, p in source.model.parameters.items()}
    names_of = {name: language.parameter(name) for name in values} | {"time": "time"}
    names_of |= {name: language.name(name) for name in (*source.inputs, *states)}
    lines, results, read = lines_of(operations, language, names_of, values, source.model.ports)
    fetched = [
        language.fetched(name, of, number)
        for of, names in (("input", source.inputs), ("state", states))
        for number, name in enumerate(names)
        if name in read
    ]
    every = [*fetched, *lines]
    asked = {name: results[name] for name in wanted}
    # what is not read is not declared: C compilers warn of unused variables
    words = set(re.findall(r"\w+", " ".join([*every, *asked.values()])))
    return {"lines": every, "results": asked, "words": words}


def remark(unit: str, more: str = "") -> str:
    """A unit, and what else a comment says."""
    return f"[{unit or '1'}] {more}".strip()


_RESERVED = (
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while m u x h dt i now rate decay start out time_ bool true "
    "false class new delete this template operator private public protected namespace using"
)


class C99(Language):
    """C99 that is C++ as well."""

    template = "model.h"
    calls = {
        **{"abs": "fabs", "max": "fmax", "min": "fmin", "rem": "fmod", "is_nan": "isnan"},
        **{"is_finite": "isfinite", "sign": "NAME_sign", "logistic": "NAME_logistic"},
        **{"rsqrt": "NAME_rsqrt"},
    }
    reserved = frozenset(_RESERVED.split())
    logic = {"and": "&&", "or": "||", "not": "!"}
    choice = "{} ? {} : {}"
    constants = ("0", "1", "INFINITY", "NAN")

    def parameter(self, name: str) -> str:
        return self.name(f"{self.prefix}_{name}")

    def remembered(self, kind: str, name: str, arguments: str) -> str:
        return f"{self.prefix}_{kind}(&m->{name}, m, dt, {arguments})"

    def fetched(self, name: str, kind: str, number: int) -> str:
        place = f"u->{self.name(name)}" if kind == "input" else f"x[{self.slot(name)}]"
        return f"const double {self.name(name)} = {place};"

    def slot(self, name: str) -> str:
        """The name of a state's place among the states."""
        return self.name(f"{self.prefix}_{name}").upper()

    def definition(self, name: str, text: str, truth: bool, remark: str) -> str:
        line = f"const {'int' if truth else 'double'} {name} = {text};"
        if remark and len(line) + len(remark) + 7 > LINE:
            return f"/* {remark} */\n{line}"
        line = "\n".join(wrap(line, LINE, subsequent_indent="    ", break_long_words=False))
        return f"{line} /* {remark} */" if remark else line


_OWN = (
    "self x u h dt math divided sign logistic rsqrt series step reset substeps held decay weights "
    "time"
)
"""Words of the module itself."""


class Python(Language):
    """Python 3 with nothing but ``math``.

    Its functions raise where those of C and JAX give an infinity or no number; the module brings
    its own where that may happen, so that a branch which is not taken does no harm.
    """

    template = "model.py"
    calls = {
        **{name: f"math.{name}" for name in ("atan", "atan2", "tanh", "asinh", "erf")},
        **{"rem": "fmod", "is_nan": "math.isnan", "is_finite": "math.isfinite"},
    }
    guarded = (
        *("exp", "expm1", "log", "log1p", "sqrt", "pow", "sinh", "cosh", "acosh", "atanh", "asin"),
        *("acos", "exp2", "cbrt", "sin", "cos", "tan", "floor", "ceil", "fmod"),
    )
    reserved = frozenset(
        [*guarded, *keyword.kwlist, *keyword.softkwlist, *dir(builtins), *_OWN.split()]
    )
    logic = {"and": "and", "or": "or", "not": "not "}
    choice = "{1} if {0} else {2}"
    constants = ("False", "True", "math.inf", "math.nan")

    def divided(self, top: Term, bottom: Term, safe: bool) -> Term:
        """Python raises where the divisor is zero."""
        if safe:
            return super().divided(top, bottom, safe)
        self.used.add("divided")
        return Term(f"divided({top.text}, {bottom.text})", ATOM)

    def parameter(self, name: str) -> str:
        return f"self.{self.name(name)}"

    def remembered(self, kind: str, name: str, arguments: str) -> str:
        return f"self.{name}.{kind}(dt, {arguments})"

    def fetched(self, name: str, kind: str, number: int) -> str:
        return f"{self.name(name)} = {'u' if kind == 'input' else 'x'}[{number}]"

    def definition(self, name: str, text: str, truth: bool, remark: str) -> str:
        line = f"{name} = {text}"
        if len(line) > LINE - 4:
            parts = wrap(text, LINE - 8, break_long_words=False)
            line = "\n    ".join([f"{name} = (", *parts]) + "\n)"
        elif remark and len(line) + len(remark) + 4 > LINE - 4:
            return f"# {remark}\n{line}"
        return f"{line}  # {remark}" if remark else line
