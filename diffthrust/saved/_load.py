"""Load saved results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from diffthrust._support.errors import InputError
from diffthrust._support.files import PathLike, oddity
from diffthrust._support.names import listing
from diffthrust._support.saved_file import Decoder, read_saved, version_of
from diffthrust.actuators import ACTUATORS
from diffthrust.bodies import BODIES
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.estimation._result import Fit
from diffthrust.experiments._result import Experiment
from diffthrust.logs._log import Log
from diffthrust.models import MODELS
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Effect, catalogue
from diffthrust.models._base.made_effect import MADE_EFFECTS
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._craft.craft import Craft
from diffthrust.sensors import SENSORS
from diffthrust.specs._scripts import own_class, trusted_folders
from diffthrust.specs._spec import Spec, load_spec

Classes = type[Component] | str | Sequence[type[Component] | str]
_KINDS: dict[str, type] = {"fit": Fit, "diagnosis": Diagnosis}


def load(
    path: PathLike, *, classes: Classes = (), trust: PathLike | Iterable[PathLike] = ()
) -> Any:
    """Load a saved fit, diagnosis or posterior.

    A loaded fit equals the saved fit to the last digit and can be used everywhere: in `compare`,
    `intervals`, `sample`, `predict`, `diagnose`. Loading runs no code from the file: your own
    models and effects are restored only from classes that you pass.

    Args:
        path: a file written by ``fit.save`` or ``diag.save`` (``.json``), or a posterior written by
            ArviZ, ``post.to_netcdf("posterior.nc")``.
        classes: your own models and effects: classes, or ``"script.py:Class"``, whose script is
            then run.
        trust: a folder or several whose scripts may be run, where the file names one there that
            defines a model or an effect of your own.

    Returns:
        `Fit`, `Diagnosis`, or `arviz.InferenceData`.

    Raises:
        InputError: there is no such file; it is damaged, of a newer version or another kind; or a
            class of your own is missing or has changed.

    Example:
        >>> fit.save("run1.fit.json")
        >>> again = dft.load("run1.fit.json")
        >>> again.parameters["alpha"].value == fit.parameters["alpha"].value
        True
    """
    file = Path(path)
    if what := oddity(file):
        raise InputError(
            f"{file}: expected a saved result, found {what}.", "Name the file of a result."
        )
    if file.suffix.lower() == ".nc":
        from diffthrust.uncertainty._sampling.arviz import read_posterior

        return read_posterior(file)
    _check_suffix(file)
    document = read_saved(file)
    kind = document["kind"]
    if kind not in _KINDS:
        raise InputError(
            f"{file}: expected a saved {listing(_KINDS)}, found the kind {kind!r}.",
            "Load it with the version of diffthrust that wrote it.",
        )
    words = [classes] if isinstance(classes, str | type) else [*classes]
    words += _trusted(document["result"], trusted_folders(trust))
    resolved = tuple(own_class(w, Path()) if isinstance(w, str) else w for w in words)
    decoder = Decoder(
        arrays=document["arrays"],
        makers={
            Model: lambda d, plain: restore_model(d, plain, resolved),
            Effect: lambda d, plain: restore_component(Effect, d, plain, resolved),
            Log: lambda d, plain: Log.of_checked(d.fields_of(Log, plain)),
        },
        names={"Fit": Fit, "Experiment": Experiment},
    )
    try:
        result = {**document["result"], "origin": document["origin"]}
        return decoder.decoded(_KINDS[kind], result)
    except InputError as error:
        raise InputError(f"{file}: {error.problem}", error.mend) from None
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"{file}: this version of diffthrust cannot make a {kind} of it ({error}); it was "
            f"written by version {version_of(document)}.",
            "Load it with that version, or save the result again with this one.",
        ) from None


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


def _trusted(plain: Any, trust: Sequence[Path | str]) -> list[str]:
    """The user's own classes that a document names by scripts in trusted folders."""
    if isinstance(plain, dict):
        own = plain.get("own")
        if isinstance(own, dict) and own.get("file"):
            real = Path(own["file"]).resolve()
            if any(real.is_relative_to(Path(place).resolve()) for place in trust):
                return [f"{real}:{own['class']}"]
        plain = plain.values()
    elif not isinstance(plain, list):
        return []
    return list(dict.fromkeys(word for each in plain for word in _trusted(each, trust)))


def _check_suffix(file: Path) -> None:
    """Raise `InputError` for files with the suffix of another kind."""
    mends = {
        ".html": "Load the file that diag.save('NAME.json') writes beside the page.",
        ".h5": "A chain is read by dft.sample(fit, logs, file=...), which goes on where it ended; "
        "save its posterior by post.to_netcdf('posterior.nc').",
        ".toml": "Read a spec file by dft.load_spec(path), and fit it by .fit().",
    }
    mends |= {".htm": mends[".html"], ".hdf5": mends[".h5"]}
    if file.suffix.lower() in mends:
        raise InputError(
            f"{file}: expected a saved result (.json, or .nc for a posterior), found "
            f"{file.suffix.lower()}.",
            mends[file.suffix.lower()],
        )


_C = TypeVar("_C", bound=Component)


def restore_model(decoder: Decoder, plain: dict[str, Any], classes: Sequence[type]) -> Model:
    """Restore a model with its effects from `Model.as_plain`; ``classes`` are those of the user."""
    model = restore_component(Model, decoder, plain, classes)
    for described in plain["effects"]:
        effect = restore_component(Effect, decoder, described, classes)
        if isinstance(model, Craft) and "members" in described:
            effect = model.placed(effect, *described["members"])
        model = model + effect
    return model


def restore_component(
    base: type[_C], decoder: Decoder, plain: dict[str, Any], classes: Sequence[type]
) -> _C:
    """Restore a model without effects, or an effect, from the output of `Component.as_plain`."""
    name, what = plain["name"], base.__name__.lower()
    cls = _class_of(base, plain, classes)
    # Arguments shape a class (its options, its formula), parameters have their saved values: both
    # are needed to restore it.
    arguments = {key: _restored(value) for key, value in plain["arguments"].items()}
    parts = plain.get("parts", {}).items()
    component = cls.made_of(
        arguments, {k: restore_component(Component, decoder, p, classes) for k, p in parts}
    )
    saved = {
        key: decoder.decoded(Parameter, described) for key, described in plain["parameters"].items()
    }
    differing = sorted(set(saved) ^ set(component._parameters))
    if differing:
        raise InputError(
            f"The {what} '{name}' was saved with the parameters {listing(saved)}; its "
            f"class {cls.__name__} has {listing(component._parameters)} now.",
            "Fit again with the current class, or load with the class as it was saved.",
        )
    return component._copy(_parameters=saved, **{key: p.value for key, p in saved.items()})


def _class_of(base: type, plain: dict[str, Any], classes: Sequence[type]) -> Any:
    name, origin = plain["name"], plain["own"]
    parts = {**BODIES, **ACTUATORS, **SENSORS}
    by_name: Mapping[str, Any] = (
        {**catalogue(), **MADE_EFFECTS} if base is Effect else {**MODELS, **parts, "craft": Craft}
    )
    candidates: list[Any] = [*classes, *by_name.values()]  # also of installed packages
    if origin is None:
        if name in by_name:
            return by_name[name]
        raise InputError(
            f"The {base.__name__.lower()} '{name}' is not known to this version of diffthrust.",
            "Load it with the version that it was saved with; the file names that.",
        )
    for cls in candidates:
        # A class that the user passes counts by its name alone: scripts are loaded under a module
        # name with a hash of their text, which differs from that of the saving process.
        named = issubclass(cls, base) and cls.__qualname__ == origin["class"]
        if named and (cls in classes or cls.__module__ == origin["module"]):
            return cls
    where = f" ({origin['file']})" if origin["file"] else ""
    word = f"'{origin['file'] or 'script.py'}:{origin['class']}'"
    raise InputError(
        f"The {base.__name__.lower()} '{name}' is of a class of your own, {origin['class']} in "
        f"{origin['module']}{where}; loading runs no code that you did not ask for.",
        f"Give the class, or the script that defines it: dft.load(path, "
        f"classes=[{origin['class']}]) or classes=[{word}]; on the command line trust its folder, "
        f"--trust {Path(origin['file']).parent if origin['file'] else 'DIR'}.",
    )


def _restored(value: Any, described: bool = False) -> Any:
    """Undo JSON: lists become tuples, and "inf" in a parameter becomes a number."""
    if isinstance(value, dict):
        return {key: _restored(each, True) for key, each in value.items()}
    if isinstance(value, list):
        return tuple(_restored(each, described) for each in value)
    return float(value) if described and value in ("inf", "-inf") else value
