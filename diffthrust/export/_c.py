"""C99: what the lines of a C header look like."""

from __future__ import annotations

from textwrap import wrap

from diffthrust.export._language import LINE, Language, exact

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
