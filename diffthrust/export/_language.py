"""Elementary operations written as lines of a programming language."""

from __future__ import annotations

import math
import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

from diffthrust.export._trace import MEMORY, Constant, Operation, Operations

_LONGEST = 56
"""An expression longer than this gets a name of its own, rather than a place in the next."""
LINE = 92
"""Lines are broken after this many characters."""


class Term(NamedTuple):
    """An expression, and how strongly it holds together (`ATOM` needs no brackets anywhere)."""

    text: str
    rank: int


CHOICE, LOGIC, COMPARISON, SUM, PRODUCT, SIGN, ATOM = range(7)
_INFIX = {
    **{"add": ("+", SUM), "add_any": ("+", SUM), "sub": ("-", SUM), "mul": ("*", PRODUCT)},
    **{"lt": ("<", COMPARISON), "le": ("<=", COMPARISON), "gt": (">", COMPARISON)},
    **{"ge": (">=", COMPARISON), "eq": ("==", COMPARISON), "ne": ("!=", COMPARISON)},
    **{"xor": ("!=", COMPARISON)},
}
_REPEATED = ("integer_pow", "square")
"""Operations that write their operand several times, so that it must have a name."""


class Language(ABC):
    """How operations are written; one object writes one file and remembers what it has used."""

    template: ClassVar[str]
    """The file in which the lines are put."""
    calls: ClassVar[Mapping[str, str]]
    """Functions by the names of operations, where they differ from these."""
    reserved: ClassVar[frozenset[str]]
    """Words that cannot be names."""
    guarded: ClassVar[tuple[str, ...]] = ()
    """Functions that a file brings along, since the language's own raise errors."""
    logic: ClassVar[Mapping[str, str]]
    """The words for "and", "or" and "not"."""
    choice: ClassVar[str]
    """One of two values: the condition, the value where it holds, the other."""
    constants: ClassVar[tuple[str, str, str, str]]
    """False, true, infinity, and what is no number."""

    def __init__(self, prefix: str = "") -> None:
        self.prefix = prefix
        """With it the names of what a file brings along begin."""
        self.used: set[str] = set()
        """Operations that have been written: what helpers a file must bring along."""
        self.memories: dict[str, str] = {}
        """What must be kept from sample to sample, and how: name to kind, of `MEMORY`."""

    @abstractmethod
    def parameter(self, name: str) -> str:
        """How a parameter is read."""

    @abstractmethod
    def remembered(self, kind: str, name: str, arguments: str) -> str:
        """The call that hands a value on to the memory of that name, and gives what comes out."""

    @abstractmethod
    def fetched(self, name: str, kind: str, number: int) -> str:
        """A line that reads a signal of kind "input" or "state", the one of this ``number``."""

    @abstractmethod
    def definition(self, name: str, text: str, truth: bool, remark: str) -> str:
        """A line that names a value."""

    def constant(self, value: float | bool) -> str:
        """A truth, or a number with all its digits."""
        *truths, infinite, undefined = self.constants
        if isinstance(value, bool):
            return truths[value]
        if math.isnan(value):
            return undefined
        if math.isinf(value):
            return infinite if value > 0 else f"-{infinite}"
        return repr(float(value))

    def remember(self, operation: Operation, terms: list[Term]) -> Term:
        """The call that hands a value on to what remembers it, for an operation of `MEMORY`."""
        self.used.add(operation.name)
        name = f"{operation.name}_{1 + len(self.memories)}"
        self.memories[name] = operation.name
        arguments = ", ".join(term.text for term in terms[1:])
        return Term(self.remembered(operation.name, name, arguments), ATOM)

    def divided(self, top: Term, bottom: Term, safe: bool) -> Term:
        """A quotient; ``safe`` where the divisor cannot be zero."""
        return Term(f"{_within(top, PRODUCT)} / {_within(bottom, SIGN)}", PRODUCT)

    def name(self, words: str) -> str:
        """A name in this language."""
        name = re.sub(r"\W", "_", words)
        return f"{name}_" if name in self.reserved else name

    def expression(self, operation: Operation, terms: list[Term], safe: bool) -> Term:
        """One operation on expressions."""
        self.used.add(operation.name)
        if operation.name in _INFIX:
            sign, rank = _INFIX[operation.name]
            # a - (b - c) needs its brackets, a + (b + c) does not
            bound = rank + (operation.name in ("sub", "lt", "le", "gt", "ge", "eq", "ne", "xor"))
            first_operand = _within(terms[0], rank + (rank == COMPARISON))
            return Term(f"{first_operand} {sign} {_within(terms[1], bound)}", rank)
        if operation.name == "div":
            return self.divided(terms[0], terms[1], safe)
        if operation.name == "neg":
            return Term(f"-{_within(terms[0], ATOM)}", SIGN)
        if operation.name in ("and", "or"):
            # comparisons within logic stay in brackets: Python would chain a < b == c
            word = self.logic[operation.name]
            return Term(f"{_within(terms[0], ATOM)} {word} {_within(terms[1], ATOM)}", LOGIC)
        if operation.name == "not":
            return Term(f"{self.logic['not']}{_within(terms[0], ATOM)}", LOGIC)
        if operation.name == "select_n":
            # select_n lists the value for false first
            condition, otherwise, then = (_within(term, LOGIC) for term in terms)
            return Term(self.choice.format(condition, then, otherwise), CHOICE)
        if operation.name in _REPEATED:
            power = 2 if operation.name == "square" else operation.power
            return self._power(terms[0].text, power)
        if operation.name == "clamp":  # lowest, value, highest
            low, value, high = terms
            return self._call("min", [self._call("max", [value, low]), high])
        return self._call(operation.name, terms)

    def _call(self, name: str, terms: list[Term]) -> Term:
        function = self.calls.get(name, name).replace("NAME", self.prefix)
        self.used |= {name, function}
        return Term(f"{function}({', '.join(t.text for t in terms)})", ATOM)

    def _power(self, text: str, power: int) -> Term:
        if power < 0:
            return Term(f"1.0 / {_within(self._power(text, -power), SIGN)}", PRODUCT)
        # products round alike in every language; pow() may differ in the last digit
        if power > 4:
            return self._call("pow", [Term(text, ATOM), Term(self.constant(float(power)), ATOM)])
        return Term(" * ".join([text] * power), ATOM if power == 1 else PRODUCT)


def _within(term: Term, rank: int) -> str:
    """The expression, in brackets where what it stands in holds together more strongly."""
    return term.text if term.rank >= rank else f"({term.text})"


def lines_of(
    operations: Operations,
    language: Language,
    names: Mapping[str, str],
    values: Mapping[str, float],
    remarks: Mapping[str, str],
) -> tuple[list[str], dict[str, str], set[str]]:
    """Write operations as lines, with a name for what is read more than once.

    ``names`` says how signals and parameters are written in the language; where a divisor is made
    of ``values`` of parameters alone, it is known. Remarks are on the names that the equations give
    to operations. Returns the lines, the expression of each result, and the names that are read.
    """
    uses, lines, terms = operations.needed(), [], {}
    constants: dict[Any, float] = dict(values)
    taken, read = {language.name(name) for name in names}, set()
    repeated = {
        operation.operands[0] for operation in operations.listed if operation.name in _REPEATED
    }

    def term(operand: Any) -> Term:
        if isinstance(operand, Constant):
            text = language.constant(operand.value)
            return Term(text, SIGN if text.startswith("-") else ATOM)
        if isinstance(operand, str):
            read.add(operand)
            return Term(names[operand], ATOM)
        return terms[operand]

    for number, operation in enumerate(operations.listed):
        if not uses[number]:
            continue
        value = _worked_out(operation, constants)
        if value is not None:
            constants[number] = value
        parts = [term(operand) for operand in operation.operands]
        if operation.name in MEMORY:
            made = language.remember(operation, parts)
        else:
            # a divisor made of parameters alone is known not to be zero: no guard is written for it
            safe = operation.name == "div" and bool(_value(operation.operands[1], constants))
            made = language.expression(operation, parts, safe)
        called = operations.called.get(number)
        if called or uses[number] > 1 or number in repeated or len(made.text) > _LONGEST:
            name = _free(language.name(called or f"t{len(lines) + 1}"), taken)
            remark = remarks.get(called or "", "")
            lines.append(language.definition(name, made.text, operation.truth, remark))
            made = Term(name, ATOM)
        terms[number] = made
    return lines, {name: term(operand).text for name, operand in operations.results.items()}, read


def _free(name: str, taken: set[str]) -> str:
    """The name, with a number where it is taken; taken from now on."""
    free, number = name, 1
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free


_ARITHMETIC: Mapping[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": lambda a, b: a / b if b else math.nan,
    "integer_pow": operator.pos,
    "neg": operator.neg,
}


def _value(operand: Any, constants: Mapping[Any, float]) -> float | None:
    return operand.value if isinstance(operand, Constant) else constants.get(operand)


def _worked_out(operation: Operation, constants: Mapping[Any, float]) -> float | None:
    """What an operation gives where it reads parameters alone: to see whether that is zero."""
    values = [_value(operand, constants) for operand in operation.operands]
    numbers = [value for value in values if value is not None]
    if operation.name not in _ARITHMETIC or len(numbers) < len(values):
        return None
    return _ARITHMETIC[operation.name](*numbers)
