"""The file of a result: one JSON text, whole or refused."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import ending, write_whole
from diffthrust._support.lossless import encoded

SCHEMAS = {"fit": 1, "diagnosis": 2}
"""The layout that files of each kind are written in.

It is raised where a field is renamed, moved or changes its meaning, not where one with a default is
added: so a change of diagnoses does not make saved fits unreadable.
"""
_AGAIN = {
    "fit": "Fit the logs again, and save the result: dft.fit(model, logs).save(path).",
    "diagnosis": "Diagnose the logs again, and save the result: dft.diagnose(model, logs)"
    ".save(path). Saved fits still load.",
}
"""How a result is made again whose file has an earlier layout."""


def write_saved(path: Path | str, kind: str, origin: Any, result: Any) -> None:
    """Write a result of some kind ("fit") so that it can be read back to the last digit.

    The origin comes first, where a person looks; long arrays come last, each once and on one line;
    a hash of everything else reveals changes. The result's own field ``origin`` is left out.
    """
    path = Path(path)
    ending(path, ".json")
    arrays: dict[str, Any] = {}
    fields = encoded(result, arrays)
    fields.pop("origin", None)
    head = encoded(origin, arrays)
    document = {"schema": SCHEMAS.get(kind, 1), "kind": kind, "origin": head, "result": fields}
    document["sha256"] = _hash({**document, "arrays": arrays})
    lines = (f'  "{name}": {json.dumps(array)}' for name, array in arrays.items())
    table = ",\n".join(lines)
    # The arrays are appended as text, one line each: a generic indenter puts every number on a
    # line.
    text = f'{_text(document)[:-2]},\n "arrays": {{\n{table}\n }}\n}}\n'
    write_whole(path, text.encode())


def _text(data: Any, depth: int = 0) -> str:
    """JSON with a line for each field; numbers and words of a list stand on one line."""
    inner = data.values() if isinstance(data, dict) else data
    if (
        not isinstance(data, dict | list)
        or not data
        or (isinstance(data, list) and not any(isinstance(each, dict | list) for each in inner))
    ):
        return json.dumps(data, allow_nan=False)
    parts = [_text(each, depth + 1) for each in inner]
    if isinstance(data, dict):
        parts = [f"{json.dumps(key)}: {piece}" for key, piece in zip(data, parts, strict=True)]
    opening, closing = "{}" if isinstance(data, dict) else "[]"
    line = "\n" + " " * depth
    return f"{opening}{line} {f',{line} '.join(parts)}{line}{closing}"


def read_saved(path: Path | str) -> dict[str, Any]:
    """The document in a file that `write_saved` has written, or `InputError`."""
    path = Path(path)
    mend = "Save the result again, or take a copy of the file as it was written."
    try:
        data = json.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path}: expected a saved result, found no such file.", "Correct the name."
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be read ({error.strerror or error}).", "Name a file."
        ) from None
    except (ValueError, RecursionError) as error:  # JSON or UTF-8
        raise InputError(
            f"{path}: expected a saved result, found a file that is cut off, damaged or of "
            f"another kind ({error}).",
            mend,
        ) from None
    if not isinstance(data, dict) or not {"schema", "kind"} <= set(data):
        raise InputError(
            f"{path}: expected a saved result, found other JSON. What --json writes are figures "
            "for other programs; a fit cannot be made of them.",
            "Save with fit.save(path), diag.save(path) or --save.",
        )
    _check_schema(path, data)
    # Hashed as data with sorted keys, not as bytes: a reformatted file is still the same result.
    mark = data.pop("sha256", None)
    if mark != _hash(data):
        raise InputError(
            f"{path}: its content is not what was saved: it does not agree with its hash. The "
            "file was edited or damaged.",
            mend,
        )
    return data


def _check_schema(path: Path, data: Mapping[str, Any]) -> None:
    """Raise `InputError` for a file in another layout than this version reads."""
    schema, kind = data["schema"], str(data["kind"])
    current = SCHEMAS.get(kind, 1)
    if schema == current:
        return
    written = f"{path}: a {kind} in layout {schema!r}, saved by diffthrust {version_of(data)}"
    if isinstance(schema, int) and schema < current:
        raise InputError(
            f"{written}: an earlier layout. This version reads layout {current} of a {kind}, and "
            "does not convert earlier ones.",
            _AGAIN[kind],
        )
    raise InputError(
        f"{written}; expected layout {current}, or an earlier one that this version reads.",
        "Update diffthrust, or save the result with this version.",
    )


def version_of(document: Mapping[str, Any]) -> str:
    """The version of the library that wrote a document, as far as that can be read."""
    library = (document.get("origin") or {}).get("library") or {}
    return str(library.get("diffthrust", "unknown"))


def _hash(document: Mapping[str, Any]) -> str:
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return sha256(text.encode()).hexdigest()
