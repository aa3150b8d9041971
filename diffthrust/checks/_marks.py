"""Fingerprints of a stored fit (data, spec, library), to report what has changed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from diffthrust._support.visible import visible
from diffthrust._support.words import joined
from diffthrust.estimation._origin import versions
from diffthrust.specs._parts import ExpectedPart

if TYPE_CHECKING:
    from diffthrust.estimation._result import Fit
    from diffthrust.specs._spec import Spec

_DIGITS = 16
"""Digits of a hash that are written: enough to identify a file."""


@dataclass(frozen=True)
class Marks:
    """Fingerprints of a fit.

    Args:
        library: versions, such as "diffthrust 0.1.0, jax 0.10.2, numpy 2.4.6".
        spec: hash of the spec without [expected].
        data: hash of each log file, by its path relative to the spec.
    """

    library: str
    spec: str
    data: dict[str, str]

    def since(self, expected: ExpectedPart | None) -> str:
        """A sentence on what changed since a block was written; "" without a block."""
        if expected is None:
            return ""
        if not (expected.library and expected.spec and expected.data):
            return (
                "Its [expected] block does not name the data, spec and library that it belongs to: "
                "diffthrust check --update adds them."
            )
        files = [f for f in {**expected.data, **self.data} if self._moved(expected, f)]
        moved = [f"the data ({', '.join(files)})"] * bool(files)
        moved += ["the spec"] * (expected.spec != self.spec)
        if expected.library != self.library:
            moved.append(f"the library (it was {expected.library}; now {self.library})")
        if not moved:
            return (
                "Data, spec and versions are as stored: the code of diffthrust or the machine has "
                "moved it."
            )
        same = [name for name in ("data", "spec", "library") if f"the {name}" not in "".join(moved)]
        unchanged = f"; {joined(same)} {'is' if len(same) == 1 else 'are'} the same" if same else ""
        return f"Since it was stored {joined(moved)} changed{unchanged}."

    def data_since(self, expected: ExpectedPart) -> str:
        """A sentence on data that changed though no result did; "" where none has.

        A heading off by five degrees in one sample stays within every tolerance, and is no less
        another file.
        """
        if not expected.data:
            return ""
        files = [f for f in {**expected.data, **self.data} if self._moved(expected, f)]
        if not files:
            return ""
        return (
            f"The data ({', '.join(files)}) changed since it was stored; the results stay within "
            "their tolerances. Restore the data, or accept them: diffthrust check --update."
        )

    def _moved(self, expected: ExpectedPart, file: str) -> bool:
        return expected.data.get(file) != self.data.get(file)

    def of(self, expected: ExpectedPart) -> bool:
        """Whether a block has the same data and spec, whatever the library."""
        return bool(expected.library) and (expected.spec, expected.data) == (self.spec, self.data)


def marks_of(spec: Spec, fit: Fit) -> Marks:
    """The fingerprints of a spec's fit."""
    assert fit.origin is not None
    logs = (*fit.origin.train, *fit.origin.holdout)
    files = (*spec.train, *spec.holdout)
    return Marks(
        library=", ".join(f"{name} {version}" for name, version in versions().items()),
        spec=spec.sha256[:_DIGITS],
        data={
            visible(os.path.relpath(file, spec.path.parent)).replace(os.sep, "/"): log.file.sha256[
                :_DIGITS
            ]
            for file, log in zip(files, logs, strict=True)
            if log.file is not None
        },
    )
