"""Load saved results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.files import oddity
from diffthrust._support.lossless import Decoder
from diffthrust._support.names import listing
from diffthrust._support.saved_file import read_saved, version_of
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.estimation._result import Fit
from diffthrust.experiments._result import Experiment
from diffthrust.logs._log import Log
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.saved._components import restore_component, restore_model
from diffthrust.specs._scripts import own_class

Classes = type[Component] | str | Sequence[type[Component] | str]
_KINDS: dict[str, type] = {"fit": Fit, "diagnosis": Diagnosis}


def load(
    path: str | PathLike[str], *, classes: Classes = (), trust: Iterable[Path | str] = ()
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
        trust: folders whose scripts may be run, where the file names one there that defines a
            model or an effect of your own.

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
    words += _trusted(document["result"], tuple(trust))
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
