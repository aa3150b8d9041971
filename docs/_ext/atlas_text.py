"""What the pages of the atlas say, in Markdown."""

from __future__ import annotations

import inspect
import math
import re
import textwrap
from typing import TYPE_CHECKING

import numpy as np
from atlas_figures import Shown
from atlas_logs import Answer, Bench, benches, distance, likeness
from atlas_path import drawn
from generated import table

import diffthrust as dft

if TYPE_CHECKING:
    from atlas_pages import Entry

PLACES = {
    "_command": "The command, before the motor",
    "_shaft": "The motor and the shaft",
    "_curves": "Curves of load and thrust",
    "_propeller": "The propeller and its thrust",
    "_drive": "The drive of a vessel",
    "_hull": "The hull",
    "_environment": "Wind and current",
    "_sensor": "The sensors",
}
ALIKE, LITTLE = 0.9, 1.0


def spoken(name: str) -> str:
    """A name for people."""
    return name.replace("_", " ").replace("deadband", "dead band").capitalize()


def units_of(bench: Bench) -> dict[str, str]:
    """Units of channels, states, ports and their rates."""
    units = {"time": "s", **bench.model.states, **bench.model.channel_units}
    for port, text in bench.model.ports.items():
        unit = re.search(r"\[([^\]]+)\]", text)
        units.setdefault(port, unit[1] if unit else "")
    return {**units, **{f"rate of {n}": f"{u}/s" if u else "1/s" for n, u in units.items()}}


def parts(cls: type[dft.Effect]) -> dict[str, str]:
    """A docstring by its parts: what it is, the equation, the null, the source."""
    text = (inspect.getdoc(cls) or "").partition("\nExample:")[0]
    first, _, rest = text.partition("\n\n")
    rest, _, source = rest.partition("Source:")
    body, _, null = rest.partition("Null:")
    if "\n\n" in source:  # a paragraph behind it
        source, _, more = source.partition("\n\n")
        body += "\n\n" + more
    null = null.strip().removesuffix(".")
    return {"first": first, "body": body.strip(), "null": null, "source": source.strip()}


def page(
    name: str,
    entry: Entry,
    one: Shown,
    alike: list[tuple[str, Answer, dict[str, Answer]]],
) -> str:
    """The page of an effect."""
    cls, bench, effect = type(entry.effect), entry.bench, entry.effect
    described = parts(cls)
    answer = entry.found[entry.record]
    units = units_of(bench)
    port_texts = "\n".join(
        f"- `{port}`: {bench.model.ports.get(port, 'the recorded channel')}" for port in cls.ports
    )
    ends = {*bench.model.inputs, *bench.model.outputs}
    drawing = drawn(bench.code, cls.ports, ends, dict(bench.model.ports))
    call = f"dft.effects.{cls.__name__}()"
    rival = alike[0][0] if alike else ""
    rival_call = f"dft.effects.{type(_entry(rival).effect).__name__}()" if rival else ""
    also = ", ".join(f"`{other}`" for other in entry.others)
    return "\n\n".join(
        filter(
            None,
            [
                f"# {spoken(name)}",
                f"{described['first']} In spec files `{name}`, in Python "
                f"{{py:class}}`dft.effects.{cls.__name__} <diffthrust.effects.{cls.__name__}>`.",
                "## Equation",
                described["body"],
                f"It does nothing where {described['null']}." if described["null"] else "",
                f"```python\n{_code(cls)}\n```",
                "## Where it acts",
                port_texts,
                f'```{{raw}} html\n<div style="overflow-x:auto">\n{drawing}\n</div>\n```',
                f"The signal path of `{bench.code}`, with the place marked."
                + (f" It also acts in {also}." if also else ""),
                _needs(cls),
                "## What it does to a record",
                f"```{{figure}} figures/{name}.png\n:alt: {_alt(name, one)}\n\n"
                f"{_caption(one)}\n```",
                _taken(answer, effect, units),
                "## What looks alike",
                _alike(entry, answer, alike),
                _experiment(bench, call, rival_call) if rival else "",
                "## Parameters",
                _parameters(effect),
                "## Source",
                described["source"],
                "## Use it",
                f"```python\nmodel = {bench.code} + {call}\nfit = dft.fit(model, logs, "
                f"holdout=unseen)\n```",
                f'In a spec file: `effects = ["{name}"]`. A diagnosis tries it wherever the logs '
                "can show it.",
            ],
        )
    )


def _code(cls: type[dft.Effect]) -> str:
    """What leaves the port, and the rates of the effect's own states, as they are written."""
    found = []
    for name in ("__call__", "at", "rates"):
        owner = next(c for c in cls.__mro__ if name in vars(c))
        if owner is not dft.Effect:
            text = textwrap.dedent(inspect.getsource(vars(owner)[name]))
            found.append(re.sub(r'\n\s+"""[^"]*"""', "", text).strip())
    return "\n\n".join(found)


def _entry(name: str) -> Entry:
    from atlas_pages import entries

    return entries()[name]


def _needs(cls: type[dft.Effect]) -> str:
    if not cls.needs:
        return ""
    channels = " and ".join(f"`{name}`" for name in cls.needs)
    return f"The log must have {channels} as an input."


def _alt(name: str, one: Shown) -> str:
    return f"{spoken(name)}: {one.channel} measured and modelled, and the residual."


def _caption(one: Shown) -> str:
    signal = one.signal.replace("_", " ")
    if one.share < 0.05:
        return (
            "A simulated record with this effect, and the model that does not know of it, fitted: "
            "nothing of the residual goes with a signal."
        )
    return (
        f"A simulated record with this effect, and the model that does not know of it, fitted. "
        f"Of the residual of {one.channel.replace('_', ' ')} {one.share:.0%} goes with {signal}."
    )


def _taken(answer: Answer, effect: dft.Effect, units: dict[str, str]) -> str:
    values = ", ".join(
        f"`{name}` = {getattr(effect, name):.3g} {p.in_units(units).unit}".rstrip()
        for name, p in effect.declared.items()
        if not p.fixed
    )
    drawn = f"Drawn with {values}." if values else ""
    moves = {n: v for n, v in answer.taken.items() if abs(v) > 0.02}
    raw = float(np.sum(answer.raw**2))
    share = 1.0 - float(np.sum(answer.left**2)) / raw if raw else 0.0
    listed = ", ".join(f"`{n}` by {100 * v:+.0f} %" for n, v in moves.items())
    moving = f" They would move to first order: {listed}." if listed else ""
    if answer.absorbed:
        return (
            f"{drawn} The model's own parameters take it up as a whole: no log of this kind can "
            f"distinguish them from it.{moving} Fix those that you know."
        )
    return (
        f"{drawn} Of the squared change of this record the model's own parameters can take up "
        f"{share:.0%}.{moving} The remainder is what a fit sees: {answer.size:.2g} times the noise "
        "of the sensors."
    )


def _alike(entry: Entry, answer: Answer, alike: list[tuple[str, Answer, dict[str, Answer]]]) -> str:
    rows = []
    for name, other, found in alike:
        near = likeness(answer, other)
        if near < 0.3:
            continue
        apart = {r: distance(entry.found[r], found[r]) for r in entry.found}
        best = max(apart, key=lambda r: apart[r])
        rows.append(
            (
                f"[{spoken(name).lower()}]({name}.md)",
                f"{near:.2f}",
                f"{apart[entry.record]:.2g}",
                best,
                f"{apart[best]:.2g}",
            )
        )
    if answer.absorbed:
        return "Nothing but the model's own parameters."
    if not rows:
        return "No other effect of the catalogue looks like it on this record."
    headings = ("effect", "likeness here", "left here", "separated best by", "left there")
    return table(headings, rows) + (
        "\n\nLikeness is the cosine between what two effects leave, 0 to 1. Left is the rms of "
        "what stays when the other imitates this one at its best size, over the noise of the "
        "sensors. In a record of this length white noise hides what is below some 0.1; errors "
        "that last, as those of measured logs do, hide more."
    )


def _experiment(bench: Bench, call: str, rival: str) -> str:
    limits = {
        name: (round(float(v.min()), 2), round(float(v.max()), 2))
        for name, v in bench.standard.inputs.items()
        if name in bench.model.inputs
    }
    return (
        "The test for your own limits, which begins from what your logs say:\n\n"
        f"```python\none, other = ({bench.code} + e for e in ({call}, {rival}))\n"
        "fits = [dft.fit(model, logs) for model in (one, other)]\n"
        f"test = dft.suggest_experiment(fits, limits={limits}, duration=30.0, step=0.05)\n"
        'test.to_csv("test.csv")\n```'
    )


def _parameters(effect: dft.Effect) -> str:
    if not effect.declared:
        return "It has none."
    rows = []
    for name, p in effect.declared.items():
        tried = p.probes
        if isinstance(tried, tuple):
            typical = ", ".join(f"{v:g}" for v in tried)
        else:
            power = "" if tried.power == 1 else f"^{tried.power:g}"
            typical = ", ".join(f"{v:g}" for v in tried.factors) + f" times {tried.signal}{power}"
        low, high = p.limits
        bounds = f"{low:g} to {high:g}".replace("-inf", "any").replace("inf", "any")
        null = "" if p.null is None else ("infinite" if math.isinf(p.null) else f"{p.null:g}")
        unit = re.sub(r"\{(\w+)\}", r"unit of \1", p.unit)
        held = "held" if p.fixed else "estimated"
        rows.append((f"`{name}`", f"{p.value:g}", unit, bounds, null, typical, held))
    headings = ("parameter", "default", "unit", "bounds", "null", "typical (tried)", "")
    return table(headings, rows) + (
        "\n\nTypical values are those from which a diagnosis begins; those with a signal are "
        "multiples of its size in the logs (the 90th percentile of its absolute value)."
    )


def index(entries: dict[str, Entry], maps: list[tuple[Bench, str]]) -> str:
    """The first page: all effects by place, and which are alike."""
    lines = [
        "# Atlas of effects",
        "An effect is a small physical term that plugs into a port of a model: "
        "`model + dft.effects.ActuatorLag()`. Each page shows the equation, the place on the "
        "signal path, what the effect does to a standard record, which effects look alike and "
        "which record tells them apart. All figures are simulated, and made when this site is "
        "built.",
    ]
    for file, heading in PLACES.items():
        named = [n for n, e in entries.items() if type(e.effect).__module__.endswith(file)]
        rows = []
        for name in named:
            cls = type(entries[name].effect)
            ports = ", ".join(f"`{port}`" for port in cls.ports)
            rows.append((f"[{spoken(name)}]({name}.md)", parts(cls)["first"], ports))
        lines += [f"## {heading}", table(("effect", "what it is", "acts at"), rows)]
    lines += [
        "## Effects of your own",
        "A law of one line is {py:class}`dft.effects.Formula <diffthrust.effects.Formula>`, one of "
        "unknown form {py:class}`dft.effects.Curve <diffthrust.effects.Curve>`; a law that lasts "
        "is a class, {py:class}`dft.Effect <diffthrust.Effect>`.",
        "## What looks alike",
        "Each effect changes the outputs of the standard record of its model. What the model's "
        "own parameters can take up is taken out; the likeness of two effects is the cosine "
        "between what they leave. Near 1 a log like this cannot tell them apart, whatever its "
        "noise; a group of a diagnosis will then name both.",
    ]
    for bench, file in maps:
        alt = f"Map of how alike effects are: {bench.title}"
        lines.append(f"```{{figure}} figures/{file}\n:alt: {alt}\n\n`{bench.code}`\n```")
    lines += ["## The standard records", _records()]
    names = "\n".join(entries)
    lines.append(f"```{{toctree}}\n:hidden:\n:maxdepth: 1\n\n{names}\n```")
    return "\n\n".join(lines)


def _records() -> str:
    rows = []
    for bench in benches():
        names = "; ".join(bench.records)
        noise = ", ".join(f"{n} {s:g}" for n, s in bench.noise.items())
        log = bench.standard
        rows.append(
            (f"`{bench.code}`", names, f"{log.duration:.0f} s at {1 / log.step:.0f} Hz", noise)
        )
    return table(("model", "records, the standard one first", "length", "noise (SI)"), rows)
