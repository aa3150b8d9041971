"""A model written as a program of another language."""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from textwrap import wrap

from diffthrust.export._language import ATOM, LINE, Language, Term, exact, lines_of
from diffthrust.export._operations import Operation, Operations
from diffthrust.export._source import ExportSource, filled_in
from diffthrust.export._trace import Traced, traced_model
from diffthrust.simulation._runge_kutta import SERIES, TURN

HISTORY = 256
"""Samples that a delay remembers."""


@dataclass
class Program:
    """A model as functions of another language; a template puts them into a file.

    Args:
        source: what is exported.
        language: that of the file.
    """

    source: ExportSource
    language: Language
    traced: Traced = field(init=False)
    memories: dict[str, str] = field(init=False, default_factory=dict)
    """What must be remembered from sample to sample, and how: name to kind, of `MEMORY`."""

    def __post_init__(self) -> None:
        self.traced = traced_model(self.source.model, self.source.inputs)

    def text(self) -> str:
        """The file."""
        traced, model = self.traced, self.source.model
        inputs, outputs = list(traced.inputs), list(model.outputs)
        functions = {
            "arrive": self._function(traced.arrive, inputs),
            "start": self._function(traced.start, list(traced.states)),
            "rates": self._function(traced.rates, list(traced.states)),
            "decays": self._function(traced.decays, list(traced.decays.results)),
            "read": self._function(traced.read, outputs),
        }
        return filled_in(
            self.language.template,
            source=self.source,
            model=model,
            states=traced.states,
            language=self.language,
            prefix=self.language.prefix,
            name=self.language.name,
            linear=[self.language.name(name) for name in self.source.linear],
            words=[self.language.name(name) for name in inputs],
            title=wrap(str(model), 90),
            head_lines=[line for text in self.source.head for line in wrap(text, 90)],
            remark=remark,
            parameters=list(self._parameters()),
            relaxing=list(traced.decays.results),
            memories=self.memories,
            kinds=sorted(set(self.memories.values())),
            used=self.language.used,
            guarded=self.language.guarded,
            history=HISTORY,
            pulses={n: p for n in traced.inputs if (p := self.source.pulses(n)) is not None},
            series=SERIES,
            turn=TURN,
            **functions,
        )

    def _parameters(self) -> Iterable[tuple[str, str, str]]:
        """Each parameter as it is written: name, value, remark."""
        for name, p in self.source.model.parameters.items():
            error = self.source.errors.get(name)
            more = [p.doc] if p.doc else []
            more += [f"standard error {error:.2g}"] if error is not None else []
            value = self.language.constant(float(p.value))
            yield self.language.parameter(name), value, remark(p.unit, ", ".join(more))

    def _function(self, operations: Operations, wanted: Iterable[str]) -> Mapping[str, object]:
        """The lines of one function, its results in order, and the words that it reads."""
        language, traced = self.language, self.traced
        values = {name: float(p.value) for name, p in self.source.model.parameters.items()}
        names_of = {name: language.parameter(name) for name in values} | {"time": "time"}
        names_of |= {name: language.name(name) for name in (*traced.inputs, *traced.states)}
        lines, results, read = lines_of(
            operations, language, names_of, values, self.source.model.ports, self._remember
        )
        fetched = [
            language.fetched(name, of, number)
            for of, names in (("input", traced.inputs), ("state", traced.states))
            for number, name in enumerate(names)
            if name in read
        ]
        every, asked = [*fetched, *lines], {name: results[name] for name in wanted}
        # what is not read is not declared: C compilers warn of unused variables
        words = set(re.findall(r"\w+", " ".join([*every, *asked.values()])))
        return {"lines": every, "results": asked, "words": words}

    def _remember(self, operation: Operation, terms: list[Term]) -> str:
        name = f"{operation.name}_{1 + len(self.memories)}"
        self.memories[name] = operation.name
        arguments = ", ".join(term.text for term in terms[1:])
        return self.language.remembered(operation.name, name, arguments)


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

    def constant(self, value: float | bool) -> str:
        """With all digits."""
        return str(int(value)) if isinstance(value, bool) else exact(value, "INFINITY", "NAN")

    def choice(self, condition: str, then: str, otherwise: str) -> str:
        """The conditional operator."""
        return f"{condition} ? {then} : {otherwise}"

    def logic(self, name: str) -> str:
        """The operators."""
        return {"and": "&&", "or": "||", "not": "!"}[name]

    def parameter(self, name: str) -> str:
        """A constant of the file."""
        return self.name(f"{self.prefix}_{name}")

    def remembered(self, kind: str, name: str, arguments: str) -> str:
        """A function of the file."""
        return f"{self.prefix}_{kind}(&m->{name}, m, dt, {arguments})"

    def fetched(self, name: str, kind: str, number: int) -> str:
        """From the inputs ``u`` or the states ``x``."""
        place = f"u->{self.name(name)}" if kind == "input" else f"x[{self.slot(name)}]"
        return f"const double {self.name(name)} = {place};"

    def slot(self, name: str) -> str:
        """The name of a state's place among the states."""
        return self.name(f"{self.prefix}_{name}").upper()

    def definition(self, name: str, text: str, truth: bool, remark: str) -> str:
        """A constant of the function."""
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
        [
            *guarded,
            *keyword.kwlist,
            *keyword.softkwlist,
            *dir(builtins),
            *_OWN.split(),
        ]
    )

    def constant(self, value: float | bool) -> str:
        """With all digits."""
        return str(value) if isinstance(value, bool) else exact(value, "math.inf", "math.nan")

    def choice(self, condition: str, then: str, otherwise: str) -> str:
        """The conditional expression."""
        return f"{then} if {condition} else {otherwise}"

    def logic(self, name: str) -> str:
        """The words."""
        return "not " if name == "not" else name

    def divided(self, top: Term, bottom: Term, safe: bool) -> Term:
        """Python raises where the divisor is zero."""
        if safe:
            return super().divided(top, bottom, safe)
        self.used.add("divided")
        return Term(f"divided({top.text}, {bottom.text})", ATOM)

    def parameter(self, name: str) -> str:
        """An attribute, which may be changed."""
        return f"self.{self.name(name)}"

    def remembered(self, kind: str, name: str, arguments: str) -> str:
        """A method of the memory."""
        return f"self.{name}.{kind}(dt, {arguments})"

    def fetched(self, name: str, kind: str, number: int) -> str:
        """From the inputs ``u`` or the states ``x``."""
        return f"{self.name(name)} = {'u' if kind == 'input' else 'x'}[{number}]"

    def definition(self, name: str, text: str, truth: bool, remark: str) -> str:
        """A local name."""
        line = f"{name} = {text}"
        if len(line) > LINE - 4:
            parts = wrap(text, LINE - 8, break_long_words=False)
            line = "\n    ".join([f"{name} = (", *parts]) + "\n)"
        elif remark and len(line) + len(remark) + 4 > LINE - 4:
            return f"# {remark}\n{line}"
        return f"{line}  # {remark}" if remark else line
