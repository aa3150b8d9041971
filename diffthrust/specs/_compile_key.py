"""Guess which specs share compiled code, without reading logs or running scripts."""

from __future__ import annotations

from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.specs._file import parse_spec, read_spec_text


def compile_key(file: Path) -> str:
    """A key that is equal for specs that share code: model, channels, options, lengths of logs.

    A wrong guess only costs a compilation.
    """
    try:
        spec = parse_spec(read_spec_text(file), file)
    except InputError:
        return ""
    channels = {name: bool(entry.noise) for name, entry in sorted(spec.channels.items())}
    fixed = {
        name: entry.fixed for name, entry in spec.parameters.items() if entry.fixed is not None
    }
    # Lines, not samples: no log is parsed only to sort the tasks of a campaign.
    lengths = [_lines(file.parent / name) for name in (*spec.logs.train, *spec.logs.holdout)]
    return repr((spec.model, spec.effects, spec.options, channels, fixed, spec.fit, lengths))


def _lines(file: Path) -> int:
    try:
        return file.read_bytes().count(b"\n")
    except OSError:
        return 0
