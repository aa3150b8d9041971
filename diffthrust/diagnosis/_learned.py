"""A law that no known effect expresses: what was learned of it, as data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from diffthrust._support.results import Brief
from diffthrust.diagnosis._explained_share import Worth, matters
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.effects._curve import Curve
from diffthrust.effects._formula import Formula
from diffthrust.estimation._result import Fit
from diffthrust.logs._written import ShownUnits, Size
from diffthrust.models._base.made_effect import ARRIVING

_POINTS = 121
"""Numerics: values of the signal over which a curve is drawn."""


@dataclass(frozen=True, repr=False)
class TriedForm(Brief):
    """A closed form that was tried in the place of a learned curve.

    Args:
        name: of the form: "linear", "dead zone", "hump", ...
        formula: the effect at its estimated parameters.
        fit: the model with it, fitted to the logs.
        bic: Bayesian information criterion less that of the model without it; negative is better.
        one_step: the same criterion by one-step errors, but for a constant.
        times: the factor of the form; it may differ from the curve's.
        reference: typical size of the signal, to which its powers are related.
        companion: what stands beside it: "constant", "even part", or "" for nothing.
    """

    name: str
    formula: Formula
    fit: Fit
    bic: float
    one_step: float
    times: str = ""
    reference: float = 1.0
    companion: str = ""

    @property
    def title(self) -> str:
        """Its name with what stands beside it: "dry and constant"."""
        return f"{self.name} and {self.companion}" if self.companion else self.name


@dataclass(frozen=True, repr=False)
class LearnedLaw(Brief):
    """A law that no known effect expresses, learned from the logs.

    Args:
        curve: the effect, at its estimated coefficients.
        fit: the last stage's model with it, fitted to the logs.
        worth: share of the squared whole-run error left without it that it removes; of its closed
            form if that names it.
        evidence: logarithm of the likelihood ratio by which one-step errors support it, with its
            coefficients integrated out.
        forms: closed forms that were tried in its place, first the one that is reported, the others
            by their likelihood.
        named: whether the first of them fits as well as the curve, and names the law.
        superfluous: effects that were found without it, and do nothing that matters beside it.
        samples: values of the signal in the training logs, ``(N,)``.
        factors: values of the curve's factor there; ``None`` for none.
        signal_unit: the unit of the signal; "" where it is not known.
        channel: the channel of the model in whose unit the signal is; "" for none.
        port_unit: the unit of the signal at the port.
        driven: the measured channel that the port drives, or whose rate; "" if that is not
            measured.
        together: whether its closed form was fitted in the place of a curve, with those of the
            other laws: worth and evidence are those of all of them, and the curve only draws it.
    """

    curve: Curve
    fit: Fit
    worth: Worth
    evidence: float
    forms: tuple[TriedForm, ...] = ()
    named: bool = False
    superfluous: tuple[str, ...] = ()
    samples: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    factors: np.ndarray | None = field(default=None, repr=False)
    signal_unit: str = ""
    channel: str = ""
    port_unit: str = ""
    driven: str = ""
    together: bool = False

    @property
    def effect(self) -> Curve | Formula:
        """The law as an effect, as it was fitted."""
        return self.form.formula if self.form and self.together else self.curve

    @property
    def form(self) -> TriedForm | None:
        """The closed form that names the law; ``None`` if none is as good as the curve."""
        return self.forms[0] if self.named else None

    @property
    def helps(self) -> bool:
        """Whether whole runs surely err less with it, in all or in one channel, and none more."""
        return matters(self.worth, self.driven)

    @property
    def alike(self) -> tuple[TriedForm, ...]:
        """Other closed forms with no more parameters that these logs cannot tell from it."""
        if self.form is None:
            return ()
        first = self.form
        apart = SETTINGS.closed_form.most_bic_apart
        return tuple(
            form
            for form in self.forms[1:]
            if form.bic <= first.bic + apart
            and form.one_step <= first.one_step + apart
            and len(form.formula.declared) <= len(first.formula.declared)
        )

    @property
    def reported(self) -> Fit:
        """The model with the law as it is reported: in its closed form, or as a curve."""
        return self.form.fit if self.form else self.fit

    @property
    def shown(self) -> Size:
        """One unit of the signal in the unit in which the logs were written."""
        return self._units.size(self.channel, 1.0, self.signal_unit)

    @property
    def place_unit(self) -> str:
        """The unit of a place on the curve, for people: widths of pulses count from the stop."""
        way = self._units.written.get(self.channel)
        counted = way is not None and way.pwm is not None and "play(" not in self.curve.signal
        return f"{self.shown.unit} from the stop" if counted else self.shown.unit

    @property
    def _units(self) -> ShownUnits:
        return ShownUnits((self.fit.written,))

    @property
    def manner(self) -> Literal["adds", "scales"]:
        """Whether it adds to the signal at its port, or scales that, as it is told."""
        return "scales" if self.times == ARRIVING else "adds"

    @property
    def times(self) -> str:
        """By what it is multiplied as it is told: a form may have another factor than its curve."""
        return self.form.times if self.form and not self.together else self.curve.times

    @property
    def signals(self) -> tuple[str, ...]:
        """What the curve is a function of, and what it is multiplied by."""
        return tuple(filter(None, (self.curve.signal, self.curve.times)))

    def drawn(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The curve over the range of the logs, and its standard error; ``(K,)`` each."""
        x = np.linspace(self.curve.low, self.curve.high, _POINTS)
        which, covariance = self.coefficients()
        basis = self.curve.basis(x)[which]
        spread = np.einsum("kx,kl,lx->x", basis, covariance, basis)
        return x, np.asarray(self.curve.at_signal(x)), np.sqrt(np.maximum(spread, 0.0))

    def coefficients(self) -> tuple[list[int], np.ndarray]:
        """Which coefficients of the curve are estimated, and their covariance."""
        names = [f"{self.curve.name}.{n}" for n in self.curve.coefficients]
        which = [i for i, name in enumerate(names) if name in self.fit.free]
        at = [self.fit.free.index(names[i]) for i in which]
        return which, self.fit.covariance[np.ix_(at, at)]

    def to_json(self) -> dict[str, Any]:
        """The law as plain data."""
        return {
            "port": self.curve.port,
            "signals": list(self.signals),
            "form": self.form.title if self.form else None,
            "alike": [form.title for form in self.alike],
            "worth": self.worth.to_json(),
            "holdout": self.reported.holdout and self.reported.holdout.to_json(),
        }
