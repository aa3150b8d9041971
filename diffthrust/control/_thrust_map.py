"""Forces and moments of the thrusters of a craft at rest in the water, by their commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust.export._steady import steady_outputs
from diffthrust.layouts._mixer import AXES
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.signals import RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.placed import Placed
from diffthrust.models._craft.six import Six


class _HeldStill(Body):
    """A body that does not move, and reports the forces on it."""

    name = "held_still"
    outputs: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(AXES[:3], "N"),
        **dict.fromkeys(AXES[3:], "N m"),
    }

    def motion(self, s: Signals, port: Ports) -> Six:
        """None."""
        return Six()

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """The forces of all actuators about the origin."""
        return {}, {n: 0.0 * s["time"] + f for n, f in zip(AXES, forces, strict=True)}


class ThrustMap:
    """What each thruster of a craft does to it where it has settled at a command.

    The craft is held at rest in still water: places, strengths, torques and the effects on the
    thrusters are its own, what acts on its body is left out.

    Args:
        craft: the craft.
        inputs: what the thrusters read besides their commands, held at these values.

    Raises:
        InputError: a thruster that turns, an input without a value, or one that none reads.
    """

    def __init__(self, craft: Craft, inputs: Mapping[str, float]) -> None:
        turning = [n for n, m in craft.actuators.items() if "side_thrust" in m.model.outputs]
        if turning:
            raise InputError(
                f"allocation: {listing(turning)} turn; a mixer's factors are of thrusters that do "
                "not.",
                "Audit the craft with thrusters that point where yours stand.",
            )
        held = Craft(_HeldStill(), share=craft.share, command=craft.command, **craft.actuators)
        placed = tuple(effect for effect in craft.effects if isinstance(effect, Placed))
        self._craft = held._copy(effects=placed)
        self._commands = [f"{n}.{next(iter(m.model.inputs))}" for n, m in craft.actuators.items()]
        needed = {name for effect in placed for name in effect.needs} | {*held.inputs}
        needed -= {*self._commands}
        for name, value in inputs.items():
            if name not in needed:
                raise InputError(
                    f"allocation, inputs: expected what the thrusters read besides their commands "
                    f"({listing(sorted(needed))}), found {name!r}.",
                    "Leave it out: the mixer sends the commands."
                    if name in self._commands
                    else "Correct the name, or leave it out.",
                )
            finite(f"allocation, inputs, {name}", value, lambda _: True, "a finite number")
        missing = sorted(needed - {*inputs})
        if missing:
            raise InputError(
                f"allocation: the thrusters read {listing(missing)}, of which no value is given.",
                f'Give it: inputs={{"{missing[0]}": 16.0}}.',
            )
        self._inputs = {name: float(v) for name, v in inputs.items()}
        self._craft_values = {n: p.value for n, p in craft.parameters.items()}

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of the craft that matter: all but the body's."""
        return (*self._craft.parameters, *(n for n in _CENTRE if n in self._craft_values))

    def __call__(self, commands: np.ndarray, values: Mapping[str, float] = {}) -> np.ndarray:
        """Forces and moments of each thruster about the centre of mass, beyond those at rest.

        Of commands ``(..., thrusters)`` and parameters that are not the craft's own: ``(...,
        thrusters, 6)`` in N and N m, in the order of `AXES`.
        """
        now = {**self._craft_values, **values}
        craft = self._craft.bind({n: now[n] for n in self._craft.parameters})
        count = len(self._commands)
        flat = np.reshape(commands, (-1, count))
        # each thruster by itself, and none: the last row
        alone = np.concatenate([np.diag(row) for row in flat] + [np.zeros((1, count))])
        inputs = {name: alone[:, k] for k, name in enumerate(self._commands)}
        inputs |= {n: np.full(len(alone), v) for n, v in self._inputs.items()}
        forces = steady_outputs(craft, inputs, AXES).T
        forces = (forces[:-1] - forces[-1]).reshape(*np.shape(commands), 6)
        centre = np.array([now.get(n, 0.0) for n in _CENTRE])
        forces[..., 3:] -= np.cross(centre, forces[..., :3])
        return forces


_CENTRE = ("x_g", "y_g", "z_g")


def moving_axes(craft: Craft) -> tuple[str, ...]:
    """The axes in which a craft moves."""
    s = Signals({name: jnp.zeros(()) for name in ("time", *craft.body.states)})
    body = craft.body._bound({n: getattr(craft, n) for n in craft.body._parameters})
    motion = body.motion(s, Ports((), s))
    # what a body does not have is the plain number 0.0
    return tuple(n for n, v in zip(AXES, motion, strict=True) if not isinstance(v, float))
