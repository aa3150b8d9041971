"""The spec file of a saved fit: what compares and diagnoses it without fitting again."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.saved_file import read_saved
from diffthrust.estimation._result import Fit
from diffthrust.saved._load import load
from diffthrust.specs._spec import Spec, load_spec


def fitted_spec(path: Path, trust: Iterable[Path | str] = ()) -> tuple[Spec, Fit | None]:
    """A spec with its fit, where ``path`` is what ``fit --save`` has written; else without one."""
    if path.suffix.lower() != ".json":
        return load_spec(path, trust=trust), None
    document = read_saved(path)
    origin = document["origin"] or {}
    if document["kind"] != "fit" or not origin.get("spec_file"):
        raise InputError(
            f"{path}: expected the fit of a spec file, found a saved {document['kind']}"
            f"{'' if document['kind'] != 'fit' else ' that says nothing of one'}.",
            f"Name the spec, or save its fit: diffthrust fit SPEC --save {path.name}.",
        )
    named = Path(origin["spec_file"])
    # A folder that was moved or sent takes its spec along.
    place = next((p for p in (named, path.parent / named.name) if p.is_file()), None)
    if place is None:
        raise InputError(
            f"{path}: its spec {named} is not there, nor beside it.",
            f"Put the spec beside {path.name}, with its logs.",
        )
    spec = load_spec(place, trust=trust)
    if spec.sha256 != origin["spec"]:
        raise InputError(
            f"{place} is not as it was when {path.name} was fitted.",
            f"Fit again: diffthrust fit {place} --save {path}.",
        )
    components = (spec.model, *spec.model.effects)
    return spec, load(path, classes=[type(component) for component in components])
