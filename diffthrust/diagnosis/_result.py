"""The result of a diagnosis: what a model lacks, how sure that is, and what would make it surer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust._support.saved_file import write_saved
from diffthrust.diagnosis._findings import Findings
from diffthrust.estimation._estimate import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Diagnosis(Result, Findings):
    """What is missing from a model, how sure that is, and what would make it surer.

    Example:
        >>> diag.verdict, diag.added
        ('effects_found', ('command_deadband',))
        >>> [stage.effects for stage in diag.stages]
        [(), ('command_deadband',)]
        >>> diag.after.errors.nrmse < diag.before.errors.nrmse
        True
        >>> print(diag.improved)
        thruster + command_deadband
    """

    @property
    def summary(self) -> str:
        """The answer: what is wrong with the logs, what is missing, what is left, what to do next.

        In lines of at most sixty words and four figures together; all else is in `details` and in
        the report.

        Example:
            >>> print(diag.summary.splitlines()[1])
            Found: commands within ±0.40 V do nothing.
        """
        from diffthrust.diagnosis._report.summary import summary

        return summary(self)

    @property
    def details(self) -> str:
        """The whole outcome in plain sentences, with all errors, shares and their intervals.

        Example:
            >>> print(diag.details[:60])
            The basic thruster lacks a command dead band of ±0.40 V: wit
        """
        from diffthrust.diagnosis._report.details import details

        return details(self)

    def _line(self) -> str:
        from diffthrust.diagnosis._report.error_text import gain_words
        from diffthrust.diagnosis._report.text import model_words, verdict_words

        added = f" ({', '.join(self.added)}); {gain_words(self)}" if self.added else ""
        return f"{model_words(self.model)}: {verdict_words(self)}{added}"

    def _report(self) -> Report:
        from diffthrust.diagnosis._report.sections import diagnosis_report

        return diagnosis_report(self)

    @showing
    def plot(self) -> Figure:
        """The stages: training and holdout error falling, and the last model on the logs.

        Example:
            >>> figure = diag.plot()
        """
        from diffthrust.diagnosis._report.figures import stages_figure

        return stages_figure(self)

    @showing
    def plot_learned(self) -> Figure:
        """The learned curves with their bands, the forms tried, and the samples below.

        Raises:
            InputError: nothing was learned.

        Example:
            >>> diag.learned  # nothing is left to learn: the effect explains it
            ()
        """
        from diffthrust.diagnosis._report.figures import learned_figure

        if not self.laws:
            raise InputError(
                f"This diagnosis learned no law: {_why_none(self)}.",
                "Draw what it found: diag.plot().",
            )
        return learned_figure(self)

    def save(self, path: Path | str, *, title: str = "", spec: str = "") -> None:
        """Write the report as a page to read, or the diagnosis itself, to `load` it again.

        Args:
            path: the file to write: ``.html`` for one page that can be read without the library,
                ``.json`` for all findings, with the logs that the model was compared with.
            title: heading of the page; by default it names the model.
            spec: text of a spec file, shown at the end of the page.

        Raises:
            InputError: a file of another ending, or one that cannot be written.

        Example:
            >>> diag.save("diagnosis.json")
            >>> again = dft.load("diagnosis.json")
            >>> again.verdict
            'effects_found'
        """
        from diffthrust._support.files import ending, write_page
        from diffthrust.diagnosis._report.sections import diagnosis_page

        path = Path(path)
        if ending(path, ".html", ".htm", ".json") == ".json":
            write_saved(path, "diagnosis", self.origin, self)
        else:
            write_page(path, diagnosis_page(self, title=title, spec=spec))

    def to_json(self) -> dict[str, Any]:
        """The diagnosis as plain data, in the form that ``diffthrust diagnose --json`` writes.

        Example:
            >>> list(diag.to_json())[:4]
            ['schema', 'verdict', 'sought', 'doubts']
        """
        remaining, headroom = self.remaining, self.headroom
        return {
            "schema": 1,
            "verdict": self.verdict,
            "sought": self.sought,
            "doubts": [
                doubt.to_json() | {"mends": [mend.to_json() for mend in self.mends_of(doubt)]}
                for doubt in self.doubts
            ],
            "added": list(self.added),
            "detectable": list(self.detectable),
            "detectable_groups": [list(group) for group in self.detectable_groups],
            "worth": _by_name(self.worth),
            "possible": _by_name(self.possible),
            "groups": [list(group) for group in self.groups],
            "stages": [
                {
                    "effects": [n for n in stage.effects if n not in self.held],
                    "parameters": _by_name(stage.fit.parameters),
                    "train": stage.train.to_json(),
                    "holdout": stage.holdout and stage.holdout.to_json(),
                }
                for stage in self.stages
            ],
            "ranking": [
                {
                    "stage": c.stage,
                    "effect": c.effect,
                    "parameters": {n: _size(e) for n, e in c.parameters.items()},
                    "delta_bic": c.delta_bic,
                    "p_value": c.p_value,
                    "train_nrmse": c.train_nrmse,
                    "holdout_nrmse": c.holdout_nrmse,
                }
                for c in self.ranking
            ],
            "remaining": remaining
            and {n: getattr(remaining, n) for n in ("port", "depends_on", "share")},
            "changed": self.changed and self.changed.to_json(),
            "learned": [law.to_json() for law in self.laws],
            "odd_logs": [asdict(odd) for odd in self.odd_logs],
            "held": {name: asdict(value) for name, value in self.held.items()},
            "exchanged": dict(self.exchanged),
            "idle_bounds": list(self.idle_bounds),
            "untestable": dict(self.untestable),
            "other_models": [other.to_json() for other in self.other_models],
            "unused": dict(self.unused),
            "recurring": _by_name(self.recurring),
            "headroom": headroom
            and {"before": headroom[0].to_json(), "after": headroom[1].to_json()},
        }


def _why_none(diag: Findings) -> str:
    """Why a diagnosis has no learned law."""
    if not diag.sought:
        return "the logs are to be mended first"
    if diag.changed:
        return "the size of an added effect changes"
    if diag.verdict == "unexplained":
        return "structure remains, but no function of one signal surely explains it"
    if diag.verdict == "undecided":
        return "these logs cannot tell a disturbance from missing physics"
    return "what it names, or noise, explains these logs"


def _size(estimate: Estimate) -> dict[str, Any]:
    value, _, unit = estimate.shown
    written = {"value": value, "unit": unit}
    return {"value": estimate.value, "unit": estimate.unit, "written": written}


def _by_name(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value.to_json() for name, value in values.items()}
