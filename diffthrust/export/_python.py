"""Plain Python: what the lines of a module without dependencies look like."""

from __future__ import annotations

import builtins
import keyword
from textwrap import wrap

from diffthrust.export._language import ATOM, LINE, Language, Term, exact


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
            *(*guarded, *keyword.kwlist, *keyword.softkwlist, *dir(builtins)),
            *(
                "self",
                "x",
                "u",
                "h",
                "dt",
                "math",
                "divided",
                "sign",
                "logistic",
                "rsqrt",
                "series",
            ),
            *("step", "reset", "substeps", "held", "decay", "weights", "time"),
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
