"""One limit cycle in numbers, and its verdict."""

from __future__ import annotations

from dataclasses import dataclass, field

from diffthrust._support.results import Brief
from diffthrust.cycles._oscillation import CycleSeries, Oscillation


@dataclass(frozen=True, repr=False)
class LimitCycle(Brief):
    """One limit cycle.

    Args:
        amplitude: of the fundamental at the element's input, by the describing function.
        frequency: [rad/s], by the describing function.
        stable: whether it lasts by the quasi-static criterion; ``None``: undecided.
        growth: how fast a relative deviation of the amplitude grows [1/s] by that criterion.
        at_edge: it lies at the edge of the range that was searched.
        refined: the same by a balance of more harmonics; ``None`` where that was not asked for or
            did not converge near it.
        simulated: the same as measured in a full simulation; of an unstable one its first turns.
        lasts: whether simulations from 10 % below and above come back; ``None``: undecided.
        simulation: what they did, in words.
        harmonics: Fourier coefficients of the refined cycle.

    Example:
        >>> found = dft.cycles.limit_cycles(
        ...     ([6.0], [1, 3, 2, 0]), dft.cycles.Relay(1.0), verify=False
        ... )
        >>> cycle = found.cycles[0]
        >>> round(cycle.amplitude, 2), round(cycle.frequency, 3), cycle.stable
        (1.27, 1.414, True)
        >>> cycle.verdict, round(cycle.best.frequency, 3), round(cycle.described.frequency, 3)
        ('stable', 1.414, 1.414)
    """

    amplitude: float
    frequency: float
    stable: bool | None
    growth: float
    at_edge: bool
    refined: Oscillation | None
    simulated: Oscillation | None
    lasts: bool | None
    simulation: str
    harmonics: CycleSeries | None = field(repr=False, default=None)

    @property
    def described(self) -> Oscillation:
        """What the describing function says of it."""
        return Oscillation(self.amplitude, self.amplitude, self.frequency, 0.0)

    @property
    def best(self) -> Oscillation:
        """The most faithful numbers there are: refined, simulated, or the describing function's."""
        return self.refined or self.simulated or self.described

    @property
    def verdict(self) -> str:
        """``"stable"``, ``"unstable"`` or ``"undecided"``: the simulation's word before others."""
        # the quasi-static criterion is first order in the deviation: a full simulation overrules it
        word = self.lasts if self.lasts is not None else self.stable
        return "undecided" if word is None else "stable" if word else "unstable"
