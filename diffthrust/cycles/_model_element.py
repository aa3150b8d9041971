"""A fitted model as the nonlinear element of a loop, and the loop around it.

Its describing function is one of two arguments. The states take part in the loop's harmonic balance
and in its full simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float
from numpy.typing import ArrayLike
from scipy.optimize import root

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import (
    BEYOND,
    STEPS_A_PERIOD,
    CycleSeries,
    LoopCourse,
    Nonlinearity,
    NotSimulated,
)
from diffthrust.describing._periodic.harmonic_balance import HarmonicBalance
from diffthrust.describing._periodic.period import Cycle, Lane
from diffthrust.describing._periodic.respond import Reason, respond, some
from diffthrust.describing._periodic.shooting import Shooting
from diffthrust.effects import CommandDelay
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Relaxing, Signals
from diffthrust.simulation._integrate import integrate, plain_rate
from diffthrust.simulation._trajectory import bare, equations_of

_STEPS = (256, 3072)
"""Steps per period while a describing function is mapped, then those for a model that is too fast
for them. They are fixed: a search that follows slopes must not see them change."""


class ModelElement(Nonlinearity):
    """From a model's input to one of its outputs, with all its effects but those of the sensors.

    Its describing function is the fundamental of the settled answer to a sine, found by shooting:
    Newton's method on the states after one period. It reads the true output that acts on the
    vehicle, not what a sensor makes of it.

    Args:
        model: the model, with its effects and at its parameter values.
        input: the input that the loop drives; others the model cannot have.
        output: what goes on to the linear part.

    A `CommandDelay` is taken out and kept as ``delay`` [s]: a loop counts it with the dead time of
    its linear part, which is the same, for whatever else acts on the command does not care when it
    comes.

    Raises:
        InputError: an input or output that the model does not have, a model without states, or an
            effect that reads earlier samples of the input.

    Example:
        >>> element = dft.cycles.ModelElement(fit.model)
        >>> list(element.states), list(element.values)
        (['speed'], ['alpha', 'beta', 'ct'])
        >>> bool(abs(element.describing(1.0, 0.5)) > abs(element.describing(1.0, 5.0)))
        True
    """

    odd = False  # effects may tell forward from reverse

    def __init__(self, model: Any, *, input: str = "command", output: str = "thrust") -> None:
        direct = checked_model(model)
        delays = [e for e in direct.effects if isinstance(e, CommandDelay) and input in e.ports]
        for effect in delays:
            direct = direct - effect.name
        self.model: Model = direct
        self.delay: float = float(sum(effect.delay for effect in delays))
        self.input: str = input
        self.output: str = output
        channels = {"input": (input, direct.inputs), "output": (output, direct.outputs)}
        for what, (name, names) in channels.items():
            if name not in names:
                raise InputError(
                    f"The model '{self.model}' has no {what} '{name}'; it has {listing(names)}.",
                    f"Name one of them: {what}='{next(iter(names), '')}'.",
                )
        further = [name for name in self.model.inputs if name != input]
        if further:
            raise InputError(
                f"The model '{self.model}' needs {listing(further)} besides '{input}'; a loop "
                "with one nonlinear element drives one input only.",
                "Use a model with one input.",
            )
        if not self.model.all_states:
            raise InputError(
                f"The model '{self.model}' has no states.",
                "Give its curve as a dft.cycles.StaticNonlinearity.",
            )
        self.unit: str = self.model.inputs[input]
        late = [e.name for e in self.model.effects if e.memory and input in e.ports]
        if late:
            raise InputError(
                f"The effect {listing(late)} reads earlier samples of '{input}', which a loop in "
                "continuous time does not have.",
                f'Take it out (model - "{late[0]}") and let an effect with a state stand for it, '
                "such as dft.effects.ActuatorLag; or simulate the loop with its samples: "
                "dft.control.",
            )

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states that are integrated."""
        return tuple(self.model.all_states)

    @property
    def values(self) -> dict[str, Array]:
        """The parameter values, by full name."""
        return {name: jnp.asarray(p.value, float) for name, p in self.model.parameters.items()}

    @property
    def structure(self) -> tuple[Any, ...]:
        """What fixes the compiled code."""
        return (type(self), self.model.structure, self.input, self.output)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ModelElement) and self.structure == other.structure

    def __hash__(self) -> int:
        return hash(self.structure)

    def evaluate(
        self, values: Mapping[str, Array], states: Mapping[str, Array], command: Array, time: Array
    ) -> tuple[dict[str, Array | Relaxing], Array]:
        """Rates of the states and the output; traceable, elementwise, in the model's units."""
        model = self.model.bind(values)
        outer = Ports(model.effects, Signals({self.input: command, "time": time}))
        s = Signals({**states, self.input: outer(self.input, command), "time": time})
        port = Ports(model.effects, s)
        rates, outputs = equations_of(model, s, port)
        return {**rates, **port.rates}, outputs[self.output]

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """The describing function by shooting; NaN where no settled answer was found."""
        a, w = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))
        model, cycle, lanes = self._driven(a.reshape(-1), w.reshape(-1))
        solver = Shooting(model, len(cycle.states))
        n = np.full(a.size, np.nan + 0j)
        for steps in _STEPS:
            # few points need the fine steps, which are twelve times the work
            unsettled = np.flatnonzero(np.isnan(n))
            if unsettled.size:
                answers = respond(solver, cycle, some(lanes, unsettled), samples=steps)
                n[unsettled] = np.where(answers.reason == Reason.SETTLED, answers.first, np.nan)
        return n.reshape(a.shape)

    def answer(self, amplitude: float, frequency: float, harmonics: int) -> np.ndarray:
        """The states' answer to a sine: coefficients, complex ``(states, harmonics + 1)``.

        The real part of sum c_k exp(j k w t); NaN where none was found.
        """
        model, cycle, lanes = self._driven(np.array([amplitude]), np.array([frequency]))
        settled = respond(HarmonicBalance(model, len(cycle.states), harmonics), cycle, lanes)
        x = np.where(settled.reason[0] == Reason.SETTLED, settled.x[0], np.nan)
        # cosine and sine coefficients (a, b) are a - j b in the real part of c exp(j k w t)
        return np.concatenate([x[:, :1], x[:, 1::2] - 1j * x[:, 2::2]], axis=1)

    def balanced(
        self, transfer: Transfer, amplitude: float, frequency: float, harmonics: int
    ) -> CycleSeries | None:
        """The cycle near a solution of the describing function; the states take part."""
        answer = self.answer(amplitude, frequency, harmonics)
        if not np.isfinite(answer).all():
            return None
        order = np.arange(harmonics + 1)
        # the answer to a sine, moved by a quarter turn: the phase is held to that of a cosine
        sine = np.zeros((1, harmonics + 1), complex)
        sine[0, 1] = amplitude
        c = np.concatenate([sine, answer * 1j**order])
        # each signal is scaled by its own size: a command of 1 V beside a speed of 100 rad/s would
        # leave Newton's matrix badly conditioned
        sizes = np.maximum(np.abs(c).max(axis=1), 1e-300)
        c = c / sizes[:, None]
        z = np.stack([c.real, c.imag], axis=1).reshape(-1)
        width = max(9, transfer.den.size)  # one compilation for all loops of usual order
        num, den = (np.pad(p, (width - p.size, 0)) for p in (transfer.num, transfer.den))
        loop = [jnp.asarray(x) for x in (num, den, transfer.delay, frequency, sizes)]

        def missed(z: np.ndarray) -> list[np.ndarray]:
            results = _missed(self, harmonics, self.values, *loop, jnp.asarray(z))
            return [np.asarray(x) for x in results]

        if not np.isfinite(missed(z)[0]).all():
            return None
        # Unknowns are shares of their sizes and the frequency a logarithm: a first step beyond 0.3
        # leaves the neighbourhood in which the linearization says anything.
        options = {"xtol": 1e-12, "factor": 0.3}
        r, _, series, w = missed(root(lambda z: missed(z)[:2], z, jac=True, options=options).x)
        # a balance may converge to another cycle, or to rest, which always solves it: only one near
        # the describing function's counts
        cycle = CycleSeries(float(w), order, series[0], series[-1], series[1:-1])
        return cycle if np.abs(r).max() < 1e-7 and cycle.near(amplitude, frequency) else None

    def courses(
        self, transfer: Transfer, cycle: CycleSeries, factors: tuple[float, ...], periods: int
    ) -> list[LoopCourse]:
        """Simulate the loop from starts on a cycle whose states are known.

        A dead time of the linear part is replaced by an all-pass of sixth order.

        Raises:
            NotSimulated: the states are not known.
            InputError: both the linear part and the model pass a step at once.
        """
        if cycle.states is None:
            raise NotSimulated("the balance of harmonics did not converge")
        plain = transfer.rational()
        if plain.direct and self._passes_at_once():
            raise InputError(
                "Both the linear part and the model pass a step of their input at once: the loop "
                "has no states at that instant to be simulated from.",
                "Add the fastest lag of the plant to the linear part.",
            )
        on = np.concatenate([cycle.linear_states(plain), cycle.states.sum(axis=1).real])
        period = cycle.oscillation.period
        limit = BEYOND * cycle.oscillation.peak
        starts = np.array(factors)[:, None] * on[None, :]
        return self._courses(plain, starts, period, periods, limit)

    def course(
        self, transfer: Transfer, output: float, period: float, duration: float
    ) -> LoopCourse:
        """Simulate the loop from the model's states at zero and an output of the linear part.

        The period of an oscillation [s] sets the step.
        """
        plain = transfer.rational()
        a, b, c, _ = plain.state_space()
        rows = np.vstack([a, c[None, :]])
        # a state at rest (A z = 0) with this output; an integrator has one, others come nearest
        z = np.linalg.lstsq(rows, np.append(0.0 * b, output), rcond=None)[0]
        start = np.concatenate([z, np.zeros(len(self.states))])
        limit = 1e12 * max(1.0, abs(output))
        return self._courses(plain, start[None, :], period, math.ceil(duration / period), limit)[0]

    def _courses(
        self, plain: Transfer, starts: np.ndarray, period: float, periods: int, limit: float
    ) -> list[LoopCourse]:
        """From states of the linear part and the model, ``(starts, states)``, up to a limit."""
        step, count = period / STEPS_A_PERIOD, periods * STEPS_A_PERIOD
        matrices = zip("abcd", plain.state_space(), strict=True)
        linear = {name: jnp.asarray(value) for name, value in matrices}
        signals = _marched(self, count, self.values, linear, step, jnp.asarray(starts))
        time = step * np.arange(count + 1)
        courses = []
        for e, y in zip(*map(np.asarray, signals), strict=True):
            outside = np.flatnonzero(~(np.abs(e) <= limit))  # NaN counts as outside
            end = int(outside[0]) if outside.size else e.size
            courses.append(LoopCourse(time[:end], e[:end], y[:end], bool(outside.size)))
        return courses

    def _passes_at_once(self) -> bool:
        """Whether a step at the model's input shows at once at its output."""
        # no special values: at zero a slope may vanish by chance, as that of speed |speed| does
        states = {name: jnp.asarray(0.7 + 0.1 * i) for i, name in enumerate(self.states)}

        def output(command: Array) -> Array:
            return jnp.sum(self.evaluate(self.values, states, command, jnp.asarray(0.0))[1])

        return bool(jnp.any(jax.grad(output)(jnp.asarray(0.5)) != 0.0))

    def _driven(self, a: np.ndarray, w: np.ndarray) -> tuple[Model, Cycle, Lane]:
        """The model without its sensors' effects (what acts is the true output), under sines."""
        model = bare(self.model)
        values = {n: np.full(a.size, p.value) for n, p in model.parameters.items()}
        cycle = Cycle(self.input, self.output, 1, states=tuple(self.model.all_states))
        return model, cycle, Lane(a, w, values, np.zeros(a.size), {}, np.zeros(a.size))

    def quasi_linear(
        self, n: complex, amplitude: float, frequency: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """A gain with a first-order lag, as in Yoerger et al. 1990, where the phase allows it."""
        # a phase between 0 and -90 degrees is what a first-order lag can have
        if not (n.real > 0 > n.imag):
            return super().quasi_linear(n, amplitude, frequency)
        pole = frequency * n.real / -n.imag
        gain = abs(n) * math.hypot(1.0, frequency / pole)
        return np.array([gain * pole]), np.array([1.0, pole])

    def __str__(self) -> str:
        return str(self.model)


@program(2)
def _missed(
    element: ModelElement,
    harmonics: int,
    values: Mapping[str, Array],
    num: Float[Array, " n"],
    den: Float[Array, " n"],
    delay: Float[Array, ""],
    frequency: Float[Array, ""],
    sizes: Float[Array, " signals"],
    z: Float[Array, " unknowns"],
) -> tuple[Array, Array, Array, Array]:
    """What is missed, its slopes, the coefficients of input, states and output, the frequency."""
    names, count = element.states, harmonics + 1
    # eight samples per harmonic: a product such as speed |speed| has harmonics beyond those that
    # are kept, which must not fold back onto them
    points = 8 * count
    angle = 2.0 * math.pi * jnp.arange(1.0 * points) / points
    order = jnp.arange(1.0 * count)
    jay = jax.lax.complex(jnp.zeros(count), order)  # j k
    turns = angle[:, None] * order[None, :]
    turn = jax.lax.complex(jnp.cos(turns), jnp.sin(turns))
    share = jnp.where(order == 0, 1.0, 2.0).astype(complex) / points

    def analysed(signal: Float[Array, " points"]) -> Complex[Array, " count"]:
        return share * (jnp.conj(turn).T @ signal.astype(complex))

    def residual(z: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        rows = z.reshape(1 + len(names), 2, count)
        log_w = rows[0, 1, 1]  # the input's fundamental has no imaginary part: its phase is held
        imaginary = rows[:, 1].at[0, 1].set(0.0).at[:, 0].set(0.0)
        c, w = jax.lax.complex(rows[:, 0], imaginary), frequency * jnp.exp(log_w)
        signals = (turn @ c.T).real * sizes[None, :]
        states = {name: signals[:, 1 + i] for i, name in enumerate(names)}
        rates, y = element.evaluate(values, states, signals[:, 0], angle / w)
        y = jnp.broadcast_to(y, angle.shape)
        s = w.astype(complex) * jay
        g_num, g_den = (jnp.polyval(c.astype(complex), s) for c in (num, den))
        out = analysed(y / sizes[0]) * jnp.exp(-s * delay.astype(complex))
        # at a pole of G (k = 0 with an integrator) the output itself must vanish
        size = jnp.where(jnp.abs(g_den) > 1e-12 * jnp.abs(g_num), jnp.abs(g_den), jnp.abs(g_num))
        loop = (g_den * c[0] + g_num * out) / size.astype(complex)
        state_errors = [
            jay * c[1 + i]
            - analysed(jnp.broadcast_to(plain_rate(rates[name]), angle.shape) / w / sizes[1 + i])
            for i, name in enumerate(names)
        ]
        missed = jnp.stack([loop, *state_errors])
        # the imaginary part of a mean is always zero: its unknown is held at zero instead
        held = missed.imag.at[:, 0].set(rows[:, 1, 0])
        series = jnp.concatenate([c * sizes[:, None].astype(complex), analysed(y)[None]])
        flat = jnp.stack([missed.real, held], axis=1).reshape(-1)
        return flat, (flat, series, w)

    # as many residuals as unknowns: forward mode stores no intermediate values
    slopes, (r, series, w) = jax.jacfwd(residual, has_aux=True)(z)
    return r, slopes, series, w


@program(2)
def _marched(
    element: ModelElement,
    count: int,
    values: Mapping[str, Array],
    linear: Mapping[str, Array],
    step: float,
    starts: Float[Array, "starts states"],
) -> tuple[Float[Array, "starts time"], Float[Array, "starts time"]]:
    """The element's input and output, from states of the linear part and of the element."""
    names = element.states
    order = linear["b"].shape[0]
    lengths = jnp.full(count, 1.0) * step
    clock = step * jnp.arange(count + 1.0)

    def loop(
        x: Mapping[str, Array], time: Array
    ) -> tuple[dict[str, Array | Relaxing], Array, Array]:
        z = [x[f"linear.{i}"] for i in range(order)]
        instants = {name: x[name] for name in names}
        passed = sum((linear["c"][i] * z[i] for i in range(order)), 0.0 * time)
        # where the linear part passes its input at once, the output does not read the command
        _, ahead = element.evaluate(values, instants, -passed, time)
        command = -(passed + linear["d"] * ahead)
        rates, y = element.evaluate(values, instants, command, time)
        for i in range(order):
            row = sum((linear["a"][i, k] * z[k] for k in range(order)), linear["b"][i] * y)
            rates[f"linear.{i}"] = row
        return rates, command, y

    def simulated(start: Float[Array, " states"]) -> tuple[Array, Array]:
        begin = {f"linear.{i}": start[i] for i in range(order)}
        begin |= {name: start[order + i] for i, name in enumerate(names)}
        ends = {"time": (clock[:-1], clock[1:])}
        path = integrate(lambda x, u: loop(x, u["time"])[0], begin, ends, lengths, {}, uniform=True)
        _, command, y = loop(path, clock)
        return command, jnp.broadcast_to(y, clock.shape)

    return jax.vmap(simulated)(starts)


def checked_model(model: Any) -> Model:
    """A model, or the model of a fit."""
    bare_model = getattr(model, "model", model)
    if not isinstance(bare_model, Model):
        raise InputError(
            f"Expected a model or a fit, found {model!r}.", "Give dft.Thruster() or a fit."
        )
    return bare_model
