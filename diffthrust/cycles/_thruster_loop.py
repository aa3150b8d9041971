"""The limit cycle of a vehicle under position control that does not know of its thruster."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust.cycles._element import LimitCycle, LoopCourse, positive
from diffthrust.cycles._find import limit_cycles
from diffthrust.cycles._model_element import ModelElement, checked_model
from diffthrust.cycles._result import LimitCycles
from diffthrust.models._base.model import Model
from diffthrust.models._base.quadratic_load import SQUARED_SINE, QuadraticLoad
from diffthrust.models._base.signals import Relaxing

PAPER = {"simulated": 15.6, "predicted": 15.7}
"""Amplitude of the command [N] in Yoerger et al. 1990, section IV and figure 14."""


class PropelledAxis(ModelElement):
    """From a thruster's command to the velocity of the vehicle that it drives.

        mass * d(velocity)/dt = thrust - drag * velocity |velocity|

    The mass [kg] is with the water that moves along, the drag [N s^2/m^2] above zero. The
    describing function is that of the thruster times the quasi-linear vehicle, whose drag
    coefficient is 8/(3 pi) drag times the amplitude of the velocity; the balance of harmonics and
    the simulation take the drag as it is. Source: Yoerger, Cooke & Slotine 1990, section IV.
    """

    def __init__(self, model: Any, *, mass: float, drag: float) -> None:
        super().__init__(model)
        self.mass, self.drag = positive("mass", mass), positive("drag", drag)

    @property
    def states(self) -> tuple[str, ...]:
        """The thruster's states and the velocity."""
        return (*super().states, "vehicle.velocity")

    @property
    def values(self) -> dict[str, Array]:
        """The thruster's parameters, mass and drag."""
        vehicle = {"vehicle.mass": self.mass, "vehicle.drag": self.drag}
        return {**super().values, **{name: jnp.asarray(value) for name, value in vehicle.items()}}

    def evaluate(
        self, values: Mapping[str, Array], states: Mapping[str, Array], command: Array, time: Array
    ) -> tuple[dict[str, Array | Relaxing], Array]:
        """Rates of the states, and the velocity."""
        thruster_states = {**states}
        v = thruster_states.pop("vehicle.velocity")
        rates, thrust = super().evaluate(values, thruster_states, command, time)
        force = thrust - values["vehicle.drag"] * v * jnp.abs(v)
        return {**rates, "vehicle.velocity": force / values["vehicle.mass"]}, v

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """That of the thruster times that of the vehicle, one after the other."""
        n = super().describing(amplitude, frequency)
        w = np.asarray(frequency, float)
        with np.errstate(invalid="ignore"):  # where the thruster has no settled answer
            return n / (1j * w * self.mass + self._damping(np.abs(n) * amplitude, w))

    def answer(self, amplitude: float, frequency: float, harmonics: int) -> np.ndarray:
        """Coefficients of the thruster's states, and of the velocity by its describing function."""
        thruster = super().answer(amplitude, frequency, harmonics)
        velocity = np.zeros((1, harmonics + 1), complex)
        # the answers are to a sine, whose coefficient is -j
        velocity[0, 1] = -1j * amplitude * complex(self.describing(amplitude, frequency))
        return np.concatenate([thruster, velocity])

    def quasi_linear(
        self, n: complex, amplitude: float, frequency: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The thruster's lag and the vehicle's."""
        vehicle = [self.mass, SQUARED_SINE * self.drag * abs(n) * amplitude]
        thrust = n * complex(vehicle[1], frequency * vehicle[0])
        num, den = super().quasi_linear(thrust, amplitude, frequency)
        return num, np.polymul(den, vehicle)

    def _damping(self, force: np.ndarray, w: np.ndarray) -> np.ndarray:
        """8/(3 pi) drag V for the velocity V that solves |j w M + 8/(3 pi) drag V| V = force."""
        inertia = (w * self.mass) ** 2
        squared = 2.0 * (SQUARED_SINE * self.drag * force) ** 2
        # (-b + sqrt(b^2 + 4 c)) / 2 without the loss of digits at small drag
        return np.sqrt(squared / (inertia + np.sqrt(inertia**2 + 2.0 * squared)))

    def __str__(self) -> str:
        return f"{self.model} on a vehicle of {self.mass:.4g} kg with drag {self.drag:.4g} N s2/m2"


@dataclass(frozen=True, repr=False)
class ThrusterLoop(Result):
    """The limit cycle of a thruster loop, by two formulas, by balance, and by simulation.

    Args:
        model: the thruster.
        mass: of the vehicle [kg].
        drag: [N s^2/m^2].
        natural_frequency: that the position controller was designed for [rad/s].
        damping: the same, of critical.
        found: the limit cycles, with the command in the model's unit.
        newton: steady thrust for a unit of the command [N/V, where this is a voltage].

    Example:
        >>> thruster_loop = dft.cycles.thruster_loop_cycle(
        ...     dft.Thruster(alpha=0.037, ct=0.022), verify=False
        ... )
        >>> round(thruster_loop.break_frequency, 2)
        0.71
        >>> len(thruster_loop.found.cycles)
        1
        >>> thruster_loop.printed > thruster_loop.consistent, thruster_loop.as_in_paper
        (True, True)
        >>> figure = thruster_loop.plot_poles()
        >>> course = thruster_loop.course(displacement=0.02, duration=10.0)
    """

    model: Model
    mass: float
    drag: float
    natural_frequency: float
    damping: float
    found: LimitCycles
    newton: float

    @property
    def break_frequency(self) -> float:
        """The thruster's lag on the cycle of a pure inertia: wn / (2 zeta) [rad/s]."""
        return self.natural_frequency / (2.0 * self.damping)

    @property
    def printed(self) -> float:
        """Amplitude of the command [N] by the paper's printed formula, for a pure inertia.

        Like `consistent` it counts load and thrust of the thruster only, no effects.
        """
        thruster = self._thruster
        return self.consistent * thruster.load / thruster.sine_load

    @property
    def consistent(self) -> float:
        """The same with the fundamental of the thrust taken consistently."""
        return _of_inertia(self._thruster, self.natural_frequency, self.damping)

    @property
    def _thruster(self) -> QuadraticLoad:
        thruster = self.model.quadratic_load
        assert thruster is not None  # `thruster_loop_cycle` has refused other models
        return thruster

    @property
    def cycle(self) -> LimitCycle:
        """The limit cycle; the stable one if there are several.

        Raises:
            InputError: there is none.
        """
        if not len(self.found):
            raise InputError(self.found.sentence, "Look at .found for where it was sought.")
        lasting = [c for c in self.found if c.verdict == "stable"]
        return (lasting or [*self.found])[0]

    @property
    def as_in_paper(self) -> bool:
        """Whether thruster, vehicle and design are those of the paper's figure 14.

        The thruster has no effects, and its ct is that of the paper's static or dynamic test.
        """
        thruster = self._thruster
        design = (self.mass, self.drag, self.natural_frequency, self.damping)
        values = np.array([*design, thruster.load, thruster.drive_gain])
        near = np.isclose(values, [340.0, 67.0, 1.0, 0.707, 0.037, 42.0], rtol=2e-3, atol=0.0)
        tests = [0.022, 0.019]  # ct of the static and of the dynamic test
        tested = np.isclose(thruster.thrust_gain, tests, rtol=2e-3, atol=0.0)
        return bool(near.all() and tested.any() and not self.model.effects)

    def _line(self) -> str:
        return self.found.sentence

    def _report(self) -> Report:
        """All predictions beside the simulation, the paper's figures where they apply, in words."""
        rows = [
            _row("printed formula, pure inertia", self.printed, None, self.natural_frequency),
            _row("consistent formula, pure inertia", self.consistent, None, self.natural_frequency),
        ]
        sentences = [self.found.sentence]
        if len(self.found):
            c, k = self.cycle, self.newton
            sentences = [f"The cycle is {c.verdict}: {c.simulation}."]
            rows.append(_row("describing function", k * c.amplitude, None, c.frequency))
            for name, o in {"balance of harmonics": c.refined, "simulation": c.simulated}.items():
                if o is not None:
                    rows.append(_row(name, k * o.amplitude, k * o.peak, o.frequency))
        if self.as_in_paper:
            rows.append(_row("paper, predicted", PAPER["predicted"], None, 1.0))
            rows.append(_row("paper, simulated", None, PAPER["simulated"], 1.0))
        headings = ("Command on the limit cycle", "Fundamental N", "Peak N", "rad/s")
        return Report(
            Section(
                "",
                f"Vehicle of {self.mass:.4g} kg, drag {self.drag:.4g} N s^2/m^2; controller "
                f"designed for {self.natural_frequency:.4g} rad/s, damping {self.damping:.4g}",
                f"Thruster: {self.model}, {self.newton:.4g} N of thrust for a command of 1 "
                f"{self.model.inputs['command']}",
            ),
            Section("", Rows.of(headings, rows, numbers=(1, 2, 3))),
            Section("", *sentences, *self._paper_words(), *self.found.notes),
        )

    def _paper_words(self) -> list[str]:
        simulated_cycle = self.cycle.simulated if self.as_in_paper and len(self.found) else None
        if simulated_cycle is None:
            return []
        off = self.newton * simulated_cycle.peak / PAPER["simulated"] - 1.0
        away, also = (x / PAPER["predicted"] - 1.0 for x in (self.printed, self.consistent))
        words = ["is reproduced" if abs(x) <= 0.01 else "is not reproduced" for x in (off, away)]
        return [
            f"The paper's simulation {words[0]} within 1 % (peak {100 * off:+.1f} %).",
            f"Its printed prediction {words[1]}: its formula with these parameters gives "
            f"{100 * away:+.0f} %, the consistent one {100 * also:+.1f} %.",
        ]

    def course(self, displacement: float = 0.02, duration: float = 60.0) -> LoopCourse:
        """Simulate the loop from rest beside its set point.

        Args:
            displacement: at the start [m].
            duration: [s].

        Returns:
            Time [s], command and thrust [N], ``(n,)`` each.

        Raises:
            InputError: something that is no positive number.
        """
        x, end = positive("displacement", displacement), positive("duration", duration)
        element, k = _element(self.model, self.mass, self.drag), self.newton
        force = self.mass * self.natural_frequency**2 * x
        period = 2.0 * math.pi / self.natural_frequency
        run = element.course(self.found.transfer, force / k, period, end)
        thrust = run.output
        if self.drag:  # the element's output is the velocity
            rise = np.gradient(thrust, run.time)
            thrust = self.mass * rise + self.drag * thrust * np.abs(thrust)
        return LoopCourse(run.time, k * run.input, thrust, run.fled)

    @showing
    def plot(self, displacement: float = 0.02, duration: float = 60.0) -> Figure:
        """Command and thrust from rest beside the set point (the paper's figure 14)."""
        from diffthrust.cycles._figures import course_figure

        levels = {"printed formula": self.printed, "consistent formula": self.consistent}
        if len(self.found):
            levels["balance of harmonics"] = self.newton * self.cycle.best.peak
        title = (
            f"{self.model} on a vehicle of {self.mass:.4g} kg, drag {self.drag:.4g} N s2/m2\n"
            f"position control for {self.natural_frequency:.4g} rad/s, damping {self.damping:.4g}"
        )
        return course_figure(self.course(displacement, duration), levels, title)

    @showing
    def plot_poles(self) -> Figure:
        """How the closed loop's poles move as the command grows (the paper's figure 13)."""
        from diffthrust.cycles._figures import pole_figure

        f = self.found
        top = 8.0 * max([c.amplitude for c in f], default=self.consistent / self.newton)
        return pole_figure(
            f.transfer, f.element, (2e-3 * top, top), factor=self.newton, label="command [N]"
        )


def thruster_loop_cycle(
    model: Any,
    *,
    mass: float = 340.0,
    drag: float = 67.0,
    natural_frequency: float = 1.0,
    damping: float = 0.707,
    amplitudes: ArrayLike | None = None,
    frequencies: ArrayLike | None = None,
    verify: bool = True,
) -> ThrusterLoop:
    """The limit cycle that a thruster causes in a vehicle's position control.

    The controller is proportional and derivative, designed for a pure inertia with an ideal
    thruster: command = (ct beta / alpha)^-1 M (-2 zeta wn x' - wn^2 x).

    Args:
        model: a thruster whose torque follows the command, like `Thruster`, with its effects, or
            a fit of one.
        mass: of the vehicle, with the water that moves along [kg]; Jason Jr. by default.
        drag: quadratic drag [N s^2/m^2]; zero for a pure inertia.
        natural_frequency: that the controller is designed for [rad/s].
        damping: the same, of critical.
        amplitudes: range of the command to search, in the model's unit; see `limit_cycles`.
        frequencies: range to search [rad/s].
        verify: refine and simulate.

    Raises:
        InputError: a number that is not positive, or a model that is no such thruster.

    Source: Yoerger, Cooke & Slotine 1990, section IV and figures 13 and 14.

    Example:
        >>> thruster_loop = dft.cycles.thruster_loop_cycle(
        ...     dft.Thruster(alpha=0.037, ct=0.022), verify=False
        ... )
        >>> round(thruster_loop.cycle.amplitude, 3)
        0.618
    """
    thruster = checked_model(model)
    plain = thruster.quadratic_load
    if plain is None or thruster.inputs.keys() != {"command"} or "thrust" not in thruster.outputs:
        raise InputError(
            f"The loop needs a thruster whose torque follows the command, with the parameters "
            f"alpha, beta and ct, from command to thrust; found '{thruster}'.",
            "Give a dft.Thruster, or use dft.cycles.limit_cycles for the loop of another model.",
        )
    mass, wn = positive("mass", mass), positive("natural_frequency", natural_frequency)
    zeta, drag = positive("damping", damping), positive("drag", drag, zero=True)
    for name, value in vars(plain).items():
        positive(f"{name} of the thruster", value)
    newton = plain.thrust_per_command
    gains = [2.0 * zeta * wn * mass / newton, wn**2 * mass / newton]
    element = _element(thruster, mass, drag)
    linear = (gains, [1.0, 0.0] if drag else [mass, 0.0, 0.0])
    if frequencies is None:
        frequencies = (0.1 * wn, 10.0 * wn)
    if amplitudes is None:  # around what the formula says for a pure inertia
        size = _of_inertia(plain, wn, zeta) / newton
        amplitudes = (0.02 * size, 20.0 * size)
    cycles = limit_cycles(
        linear, element, amplitudes=amplitudes, frequencies=frequencies, verify=verify
    )
    return ThrusterLoop(thruster, mass, drag, wn, zeta, cycles, newton)


def _of_inertia(thruster: QuadraticLoad, w: float, damping: float) -> float:
    """Amplitude of the command [N] on the cycle of a pure inertia, its lag being w / (2 damping).

    lambda^2 = (-w^2 + sqrt(w^4 + 4 (gamma alpha F / ct)^2)) / 2, solved for F.
    """
    lag = w / (2.0 * damping)
    return thruster.thrust_gain * lag * math.hypot(lag, w) / (thruster.sine_load * thruster.load)


def _element(thruster: Model, mass: float, drag: float) -> ModelElement:
    """With drag it ends at the velocity, so that what is left of the loop is linear."""
    return PropelledAxis(thruster, mass=mass, drag=drag) if drag else ModelElement(thruster)


def _row(
    name: str, fundamental: float | None, peak: float | None, frequency: float
) -> tuple[str, ...]:
    amplitudes = ("" if size is None else f"{size:.2f}" for size in (fundamental, peak))
    return name, *amplitudes, f"{frequency:.4f}"
