"""Which specs share compiled code, as seen from the outside."""

from __future__ import annotations

from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.specs._file import parse_spec, read_spec_text


def compile_key(file: Path) -> str:
    """The same text for specs that share code: model, channels, options, lengths of logs.

    A guess, which costs a compilation where it is wrong and nothing else.
    """
    try:
        spec = parse_spec(read_spec_text(file), file)
    except InputError:
        return ""
    channels = {name: bool(part.noise) for name, part in sorted(spec.channels.items())}
    fixed = {name: part.fixed for name, part in spec.parameters.items() if part.fixed is not None}
    lengths = [_lines(file.parent / name) for name in (*spec.logs.train, *spec.logs.holdout)]
    return repr((spec.model, spec.effects, spec.options, channels, fixed, spec.fit, lengths))


def _lines(file: Path) -> int:
    try:
        return file.read_bytes().count(b"\n")
    except OSError:
        return 0
