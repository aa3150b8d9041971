"""The JSON schemas of the reference hold for what results write."""

import json
from pathlib import Path

import example_names
import pytest
from jsonschema import Draft202012Validator
from places import ROOT

import diffthrust as dft

SCHEMAS = ROOT / "docs" / "schemas"


def schema(name):
    told = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(told)
    return Draft202012Validator(told)


def closed(part):
    """The schema with no further keys allowed, to see that every key is told."""
    if isinstance(part, list):
        return [closed(one) for one in part]
    if not isinstance(part, dict):
        return part
    kept = {key: closed(value) for key, value in part.items()}
    if "properties" in kept and isinstance(kept["properties"], dict) and "type" in kept:
        kept.setdefault("additionalProperties", False)
    return kept


def test_a_fit_and_a_comparison():
    fit = example_names.fit()
    schema("fit").validate(fit.to_json())
    schema("fit").validate(dft.fit(dft.Thruster(), example_names.log(), starts=1).to_json())
    schema("compare").validate(dft.compare(fit, example_names.unseen()).to_json())


def test_every_key_of_a_fit_is_told():
    told = json.loads((SCHEMAS / "fit.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator(closed(told)).validate(example_names.fit().to_json())


def test_a_check(tmp_path):
    example_names.write_files(tmp_path)
    schema("check").validate(dft.checks.check(tmp_path, update=True).to_json())


def test_a_diagnosis():
    schema("diagnose").validate(example_names.diag().to_json())


@pytest.mark.parametrize("path", sorted(SCHEMAS.glob("*.json")), ids=lambda path: path.name)
def test_a_schema_is_one_and_says_what_it_is(path: Path):
    told = json.loads(path.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(told)
    assert told["title"]
    assert told["description"]
