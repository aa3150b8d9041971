"""The page of what `--json` writes, from the schemas in ``docs/schemas``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from generated import table

SCHEMAS = Path(__file__).resolve().parents[1] / "schemas"


def json_page() -> str:
    """Each contract as a table, and as a JSON schema."""
    lines = [
        "# JSON",
        "What commands write with `--json`, and results give by `to_json()`. Numbers that are not "
        "finite are `null`. `schema` changes with what may break a reader; keys may be added "
        "without. The tests hold these schemas against what is written.",
    ]
    for path in sorted(SCHEMAS.glob("*.schema.json")):
        schema = json.loads(path.read_text(encoding="utf-8"))
        rows = list(_rows(schema, schema))
        lines += [
            f"## {schema['title']}",
            schema["description"],
            table(("key", "type", "what it is"), rows),
            f"::::{{dropdown}} JSON schema\n```{{literalinclude}} ../schemas/{path.name}\n"
            ":language: json\n```\n::::",
        ]
    return "\n\n".join(lines)


def _rows(
    part: dict[str, Any], whole: dict[str, Any], above: str = ""
) -> Iterator[tuple[str, str, str]]:
    for key, value in part.get("properties", {}).items():
        name = f"{above}{key}"
        yield f"`{name}`", _kind(value), value.get("description", "")
        yield from _inner(_resolved(value, whole), whole, name)


def _inner(value: dict[str, Any], whole: dict[str, Any], name: str) -> Iterator[Any]:
    yield from _rows(value, whole, f"{name}.")
    for key, mark in (("additionalProperties", ".NAME."), ("items", "[]. ")):
        if isinstance(value.get(key), dict):
            yield from _rows(_resolved(value[key], whole), whole, name + mark.strip())


def _resolved(value: dict[str, Any], whole: dict[str, Any]) -> dict[str, Any]:
    options = value.get("anyOf", [value])
    value = next((one for one in options if one.get("type") != "null"), value)
    if "$ref" in value:
        return whole["$defs"][value["$ref"].rpartition("/")[2]]
    return value


def _kind(value: dict[str, Any]) -> str:
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    if "enum" in value:
        return " or ".join(f"`{json.dumps(one)}`" for one in value["enum"])
    if "$ref" in value:
        return value["$ref"].rpartition("/")[2].replace("_", " ")
    if "anyOf" in value:
        return " or ".join(_kind(one) for one in value["anyOf"])
    kind = value.get("type", "any")
    kind = " or ".join(kind) if isinstance(kind, list) else kind
    if kind == "array" and isinstance(value.get("items"), dict):
        return f"array of {_kind(value['items'])}"
    if kind == "object" and isinstance(value.get("additionalProperties"), dict):
        return f"object of {_kind(value['additionalProperties'])}"
    return kind
