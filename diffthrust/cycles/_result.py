"""The limit cycles of a loop, in numbers and in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from diffthrust._support.figures import Figure, showing
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import LimitCycle, Nonlinearity


@dataclass(frozen=True, repr=False)
class LimitCycles(Result):
    """All limit cycles found in a range.

    Args:
        transfer: the linear part.
        element: the nonlinear element.
        cycles: from small to large amplitude.
        amplitudes: the range that was searched.
        frequencies: the same [rad/s].
        nearest: smallest |1 + N G| on the grid, and its amplitude and frequency.
        nearest_at_edge: that place lies at the edge of the range.
        ends: largest real part [1/s] of the quasi-linear loop's poles at the smallest and the
            largest amplitude.
        unknown: share of the grid without a describing function.
        verified: refinement and simulation were asked for.

    Example:
        >>> result = dft.cycles.limit_cycles(
        ...     ([6.0], [1, 3, 2, 0]), dft.cycles.Relay(1.0), verify=False
        ... )
        >>> len(result.cycles), result.unit, result.notes
        (1, '', [])
        >>> "stable" in result.sentence
        True
        >>> figure = result.plot()
    """

    transfer: Transfer
    element: Nonlinearity
    cycles: tuple[LimitCycle, ...]
    amplitudes: tuple[float, float]
    frequencies: tuple[float, float]
    nearest: tuple[float, float, float]
    nearest_at_edge: bool
    ends: tuple[float, float]
    unknown: float
    verified: bool

    def __len__(self) -> int:
        return len(self.cycles)

    def __iter__(self) -> Iterator[LimitCycle]:
        return iter(self.cycles)

    def __getitem__(self, index: int) -> LimitCycle:
        return self.cycles[index]

    @property
    def unit(self) -> str:
        """Unit of the amplitudes, with a space in front; empty where there is none."""
        return f" {self.element.unit}" if self.element.unit else ""

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        ranges = (
            f"amplitudes of {self.amplitudes[0]:.3g} to {self.amplitudes[1]:.3g}{self.unit} and "
            f"{self.frequencies[0]:.3g} to {self.frequencies[1]:.3g} rad/s"
        )
        if not self.cycles:
            return f"No limit cycle for {ranges}: {self._without()}"
        each = "; ".join(
            f"{c.verdict}, amplitude {c.best.amplitude:.4g}{self.unit}, {c.best.frequency:.4g} "
            f"rad/s (period {c.best.period:.4g} s)"
            for c in self.cycles
        )
        count = "One limit cycle" if len(self) == 1 else f"{len(self)} limit cycles"
        return f"{count} for {ranges}: {each}."

    def _without(self) -> str:
        small, large = self.ends
        if small < 0 and large < 0:
            return "the loop is stable at both ends of the amplitudes, oscillations die out."
        if small > 0 and large > 0:
            return "the loop is unstable at both ends of the amplitudes, oscillations grow."
        if small > 0 > large or small < 0 < large:
            calm = "large" if large < 0 else "small"
            return (
                f"the loop is stable at {calm} amplitudes only; between, its poles cross the "
                "imaginary axis at a frequency outside the range, or at rest."
            )
        return "the loop is at the limit of stability at an end of the amplitudes."

    @property
    def notes(self) -> list[str]:
        """What should be known besides."""
        sentences = []
        poles = self.transfer.poles
        # an integrator's pole comes out of the roots at some 1e-16: not to the right
        right = poles[np.real(poles) > 1e-9 * max(1e-300, np.abs(poles).max(initial=0.0))]
        if right.size:
            worst = complex(right[int(np.argmax(np.real(right)))])
            sentences.append(
                f"The linear part by itself is unstable (a pole at {worst.real:.4g} 1/s): where "
                "the element gives little, the loop is not held."
            )
        if not self.cycles and _lossless(self.transfer):
            sentences.append(
                "G(jw) is real at all frequencies: with a real N every amplitude may oscillate, "
                "and none is singled out."
            )
        elif not self.cycles and self.nearest_at_edge:
            sentences.append(
                f"1 + N G is smallest ({self.nearest[0]:.3g}) at the edge of the range, at "
                f"{self.nearest[1]:.3g}{self.unit} and {self.nearest[2]:.3g} rad/s: widen the "
                "range to see whether one lies beyond."
            )
        if any(c.at_edge for c in self.cycles):
            sentences.append(
                "A cycle lies at the edge of the range: widen it to see its neighbours."
            )
        if self.unknown > 0:
            sentences.append(
                f"There is no settled answer to a sine in {100 * self.unknown:.2g} % of the range; "
                "nothing can be found there."
            )
        if self.element.delay:
            sentences.append(
                f"The delay of the command, {self.element.delay:.4g} s, is counted with G: the "
                "element's input is the command that arrives."
            )
        if self.transfer.delay:
            sentences.append(
                "A dead time turns G round and round: cycles of higher frequencies than the range "
                "may exist; they are found by asking for their frequencies."
            )
        return sentences

    def _line(self) -> str:
        return self.sentence

    def _report(self) -> Report:
        """The answer, a table of the cycles with what simulation made of each, and notes."""
        head = Section("", f"G = {self.transfer}", f"N: {self.element}")
        cycles = (self._cycle_section(i, cycle) for i, cycle in enumerate(self.cycles, 1))
        return Report(head, Section("", self.sentence), *cycles, Section("", *self.notes))

    def _cycle_section(self, index: int, cycle: LimitCycle) -> Section:
        remarks = []
        if cycle.lasts is not None and cycle.stable is not None and cycle.lasts != cycle.stable:
            word = "stable" if cycle.stable else "unstable"
            remarks.append(f"The quasi-static criterion says {word}: trust the simulation.")
        if self.verified and cycle.refined is None:
            remarks.append("The balance of harmonics did not converge near it.")
        methods = {
            "describing function": cycle.described,
            "balance of harmonics": cycle.refined,
            "simulation": cycle.simulated,
        }
        rows = []
        for method, o in methods.items():
            if o is not None:
                offset = 0.0 if abs(o.offset) < 1e-4 * o.amplitude else o.offset
                sizes = (o.amplitude, o.peak, o.frequency, offset)
                rows.append((method, *(f"{size:.5g}" for size in sizes)))
        headings = ("Method", "Fundamental", "Peak", "rad/s", "Offset")
        return Section(
            "",
            f"{index}. {cycle.verdict}: {cycle.simulation}",
            *remarks,
            Rows.of(headings, rows, numbers=range(1, 5)),
        )

    @showing
    def plot(self) -> Figure:
        """G(jw) and -1/N(A, w) in the complex plane, with the cycles at their intersections."""
        from diffthrust.cycles._figures import nyquist_figure

        return nyquist_figure(
            self.transfer,
            self.element,
            self.cycles,
            amplitudes=self.amplitudes,
            frequencies=self.frequencies,
            nearest=self.nearest,
            unit=self.unit,
        )


def _lossless(transfer: Transfer) -> bool:
    if transfer.delay:
        return False
    g = transfer(1j * np.geomspace(0.1, 10.0, 9) * transfer.corners[0])
    return bool(np.all(np.abs(np.imag(g)) <= 1e-12 * np.abs(g)))
