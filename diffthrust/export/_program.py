"""A model written as a program of another language."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from textwrap import wrap

from diffthrust.export._language import Language, Term, lines_of
from diffthrust.export._operations import Operation, Operations
from diffthrust.export._rendered import filled_in
from diffthrust.export._source import ExportSource
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
