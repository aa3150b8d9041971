"""The command line's page, from the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import typer
from generated import table

from diffthrust.cli._app import app


def command_line() -> str:
    """Every command: what it does, how it is called, its arguments and options."""
    group: Any = typer.main.get_command(app)
    names = list(group.commands)
    lines = [
        "# Command line",
        group.help,
        "Exit status: 0 done, 1 a stored fit has moved, 2 bad input, with one message that names "
        "the file, the line or column, and the mend, 130 stopped by Ctrl-C.",
        table(
            ("command", "what it does"),
            [(f"[`diffthrust {n}`](#diffthrust-{n})", _first(group.commands[n])) for n in names],
        ),
    ]
    for name in names:
        command = group.commands[name]
        lines += [f"(diffthrust-{name})=\n## diffthrust {name}", _text(command.help or "")]
        lines.append(f"```console\n$ {_usage(name, command)}\n```")
        kinds = get_type_hints(command.callback, include_extras=True)
        rows = [_row(one, kinds) for one in command.params if one.name != "help"]
        if rows:
            lines.append(table(("argument or option", "takes", "default", "meaning"), rows))
    return "\n\n".join(filter(None, lines))


def _first(command: Any) -> str:
    return _text(command.help or "").split("\n\n")[0]


def _text(source: str) -> str:
    return re.sub(r"[\b\f]", "", source).strip()


def _usage(name: str, command: Any) -> str:
    words = ["diffthrust", name]
    for one in command.params:
        if one.param_type_name == "argument":
            word = (one.metavar or one.name or "").upper() + (
                "..." if one.nargs == -1 and not (one.metavar or "").endswith("...") else ""
            )
            words.append(word if one.required else f"[{word}]")
    return " ".join([*words, "[OPTIONS]"])


def _row(one: Any, kinds: Mapping[str, Any]) -> tuple[str, str, str, str]:
    argument = one.param_type_name == "argument"
    shown = (one.metavar or one.name or "").upper() if argument else ""
    name = f"`{shown}`" if argument else ", ".join(f"`{o}`" for o in one.opts + one.secondary_opts)
    default = one.default
    shown = "" if default in (None, False, ()) or callable(default) else f"`{default}`"
    shown = "must be given" if one.required else shown
    takes = _kind(kinds.get(one.name), one.metavar or "")
    return name, takes, shown, _text(getattr(one, "help", None) or "")


def _kind(kind: Any, metavar: str) -> str:
    """What an option takes, in words."""
    inner = get_args(kind)
    if get_origin(kind) is Annotated:
        return _kind(inner[0], metavar)
    if get_origin(kind) is Literal:
        return " or ".join(f"`{one}`" for one in inner)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return " or ".join(f"`{one.value}`" for one in kind)
    if kind is bool:
        return ""
    if inner and get_origin(kind) in (Union, UnionType):
        return _kind(next(one for one in inner if one is not type(None)), metavar)
    if metavar:
        return metavar
    words = {str: "text", float: "number", int: "whole number", Path: "path"}
    return words.get(kind, "")
