"""Where a result comes from: when it was made, with what, and of which logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from diffthrust.estimation._model_lines import spec_lines
from diffthrust.logs._identity import LogIdentity
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model

_SHORT = 8
"""Digits of a hash that people compare."""
_LISTED = 6
"""Logs that are named; of more the number is told."""


@dataclass(frozen=True)
class Origin:
    """Where a result comes from.

    Args:
        created: when it was made, in UTC, such as ``2026-11-22T16:05:00+00:00``.
        library: versions of diffthrust, and of the libraries that its numbers depend on.
        train: the logs that it was made of, in their order.
        holdout: the unseen logs that it was held against.
        spec: sha256 of the spec file without its [expected] block, where there was one.
        spec_file: its path.

    Example:
        >>> fit.origin.created, [log.sha256[:8] for log in fit.origin.train]
        ('2026-11-22T16:05:00+00:00', ['3f2a9c01'])
    """

    created: str
    library: Mapping[str, str]
    train: tuple[LogIdentity, ...]
    holdout: tuple[LogIdentity, ...] = ()
    spec: str | None = None
    spec_file: str | None = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """Date, versions and hashes, for the end of a report."""
        packages = ", ".join(f"{n} {v}" for n, v in self.library.items() if n != "diffthrust")
        day, _, moment = self.created.partition("T")
        made = (
            f"Made {day} {moment[:5]} UTC by diffthrust {self.library['diffthrust']} ({packages})."
        )
        logs = [f"Logs: {_listed(self.train)}"] if self.train else []
        logs += [f"unseen: {_listed(self.holdout)}"] if self.holdout else []
        spec = [f"Spec {self.spec[:_SHORT]}."] if self.spec else []
        origin = " ".join([f"{'; '.join(logs)}."] * bool(logs) + spec)
        return (made, origin) if origin else (made,)


def origin_of(logs: Sequence[Log], holdout: Sequence[Log] = (), spec: str | None = None) -> Origin:
    """The origin of a result that is made here and now."""
    return Origin(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        library=versions(),
        train=tuple(log.identity for log in logs),
        holdout=tuple(log.identity for log in holdout),
        spec=spec,
    )


def versions() -> dict[str, str]:
    """The versions of the libraries that the numbers of a result depend on."""
    import jax
    import numpy as np

    from diffthrust import __version__

    return {"diffthrust": __version__, "jax": jax.__version__, "numpy": np.__version__}


def closing(origin: Origin | None, model: Model) -> tuple[str, ...]:
    """The last lines of a report: where it comes from, and what was given, to copy."""
    lines = spec_lines(model, estimates=False)
    said = model.effects or "\n" in lines
    return (*(origin.sentences if origin else ()), *[lines] * bool(said))


def same_logs(first: Sequence[LogIdentity], second: Sequence[LogIdentity]) -> bool:
    """Whether logs say the same, in the same order."""
    return [log.sha256 for log in first] == [log.sha256 for log in second]


def taken_part(origin: Origin, logs: Sequence[LogIdentity]) -> str:
    """Whether logs took part in a fit, in a sentence."""
    theirs = {log.sha256 for log in origin.train}
    shared = [log.name for log in logs if log.sha256 in theirs]
    sentence = f"The fit was made of {_listed(origin.train)}"
    if len(shared) == len(logs):
        return f"{sentence}: these logs took part in it."
    return f"{sentence}: {', '.join(shared) or 'none of these logs'} took part in it."


def _listed(logs: Iterable[LogIdentity]) -> str:
    marked = [f"{log.name} {log.sha256[:_SHORT]}" for log in logs]
    more = len(marked) - _LISTED
    return ", ".join(marked[:_LISTED]) + (f" and {more} more" if more > 0 else "")
