"""Effects between the recorded command and the motor.

All act on the recorded samples of the command, before any interpolation between them.
"""

import jax.numpy as jnp

from diffthrust.effects._forms import Delay, Offset, RateLimit, ceiling, from_zero
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Signal, Signals


@registered
class CommandDeadband(Effect):
    """The motor controller ignores small commands.

    Acts on the recorded command: zero while |command| < half_width, and beyond it
    command - (1 - restored) * half_width * sign(command). Controllers differ in whether they
    subtract the half-width (``restored = 0``, the default) or jump to the full command
    (``restored = 1``); a diagnosis tries both. What is restored comes back over a tenth of the
    half-width about its edge, so that a fit can feel it. The band is applied to the recorded
    samples, before any interpolation between them.
    Null: half_width = 0. Source: the dead-zone of Slotine & Li 1991, section 5.2; common in motor
    controllers.

    Example:
        >>> model = dft.Thruster() + dft.effects.CommandDeadband(half_width=0.05)
        >>> model.parameters["command_deadband.half_width"].range_text()
        '[0, inf) V'
    """

    name = "command_deadband"
    in_words = "commands within ±{half_width} do nothing"
    port = "command"
    half_width: float = from_zero(
        0.05, "{command}", size=0.2, probes=relative_to("command", 0.05, 0.2)
    )
    restored: float = parameter(0.0, bounds=(0, 1), fixed=True, probes=(0.0, 1.0))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        beyond = jnp.abs(value) - self.half_width
        # a jump has no slope by the half-width: the ramp over a tenth of it gives one
        edge = jnp.clip(0.5 + beyond / (0.1 * self.half_width + 1e-12), 0.0, 1.0)
        passed = jnp.maximum(beyond, 0.0) + self.restored * self.half_width * edge
        return jnp.sign(value) * passed


@registered
class CommandSaturation(Effect):
    """The amplifier gives no more than a largest voltage.

    Acts on the recorded command: held within -limit and limit. Null: limit infinite.
    Source: the saturation of Slotine & Li 1991, section 5.2.

    Example:
        >>> model = dft.Thruster() + dft.effects.CommandSaturation(limit=2)
        >>> model.parameters["command_saturation.limit"].range_text()
        '[0, inf) V'
    """

    name = "command_saturation"
    in_words = "commands beyond ±{limit} do no more"
    port = "command"
    limit: float = ceiling(2.0, "{command}", probes=relative_to("command", 0.5, 0.8))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return jnp.clip(value, -self.limit, self.limit)


@registered
class CommandRateLimit(RateLimit):
    """The motor controller ramps its command.

    Acts on the recorded command: the command that arrives follows the recorded one by at most
    rate, updated at each sample. Null: rate infinite. Source: the slew rate limit of Goodwin,
    Graebe & Salgado 2001, chapter 11.

    Example:
        >>> model = dft.Thruster() + dft.effects.CommandRateLimit(rate=10)
        >>> model.parameters["command_rate_limit.rate"].range_text()
        '[0, inf) V/s'
    """

    name = "command_rate_limit"
    in_words = "the command ramps, at most {rate}"
    port = "command"
    rate: float = ceiling(10.0, "{command}/s", probes=relative_to("command", 1.0, 4.0, 12.0))


@registered
class CommandDelay(Delay):
    """The command arrives late.

    Acts on the recorded command: command(time - delay), linear between the samples; before
    the log the first command. It counts from the log's samples: a log that samples a command
    which changes between two of them shows the change at the second, half a step late on average,
    and the delay comes out shorter by that. Null: delay = 0. Source: Åström & Wittenmark 1997,
    chapter 2 (sampling of systems with a time delay).

    Example:
        >>> model = dft.Thruster() + dft.effects.CommandDelay(delay=0.05)
        >>> model.parameters["command_delay.delay"].range_text()
        '[0, inf) s'
    """

    name = "command_delay"
    in_words = "the command arrives {delay} late"
    port = "command"
    # commands step: one 0.4 s late gains 1570 at a trial value of 0.4 s, and loses 100 at 0.25 s
    delay: float = from_zero(0.05, "s", size=0.1, probes=(0.02, 0.08, 0.25, 0.4))

    def of_sampling(self, step: float) -> str:
        if self.delay == 0:
            return ""
        return (
            f"command_delay.delay counts from the samples of the command, {step:.3g} s apart. If "
            "the log samples a command that changes between them, the true delay is longer by half "
            f"of that on average, {0.5 * step:.2g} s, which its standard error does not hold."
        )


@registered
class CommandOffset(Offset):
    """The zero of the motor controller is off.

    Acts on the recorded command: command + offset. Null: offset = 0. Source: Ljung 1999,
    section 14.1 (offsets of recorded signals).

    Example:
        >>> model = dft.Thruster() + dft.effects.CommandOffset(offset=0.1)
        >>> model.parameters["command_offset.offset"].range_text()
        '(-inf, inf) V'
    """

    name = "command_offset"
    in_words = "the command's zero is off by {offset}"
    port = "command"
    offset: float = parameter(
        0.1, "{command}", null=0.0, size=0.2, probes=relative_to("command", -0.1, 0.1)
    )
