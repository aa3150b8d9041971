"""Aras et al. 2013: a DC-motor thruster, its steady map, a depth sensor and a printed G(s).

The methods of the paper that can be followed from what it prints. What it calls system
identification (ARX, ARMAX of orders 2, 2, 2, 1, state space of order 2) is `diffthrust.blackbox`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.figures import Figure, showing
from diffthrust._support.results import Brief
from diffthrust._support.transfer import Transfer, transfer_of
from diffthrust.control import PID, Loop
from diffthrust.models import DCMotorThruster
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals
from diffthrust.papers._depth_sensor import Calibration as Calibration
from diffthrust.papers._depth_sensor import Datasheet as Datasheet
from diffthrust.papers._depth_sensor import calibrate as calibrate
from diffthrust.papers._line import numbers

__all__ = [
    "SUPPLY",
    "Calibration",
    "Datasheet",
    "DepthPlant",
    "SensorRange",
    "SteadyMap",
    "calibrate",
    "depth_loop",
    "load_from",
    "plant",
    "speed_loop",
    "steady_map",
    "thruster",
]


SUPPLY = 13.0
"""Voltage of the open-loop record [V]."""
_SAMPLING = 1000.0
"""Of the paper's controller [Hz], section 4.2."""


def plant() -> Transfer:
    """G(s) = (-28.77 s + 16.28) / (s^2 + 45.09 s + 16.33), from a voltage to the depth sensor's.

    Its zero at 0.57 1/s lies in the right half plane: the answer to a step begins in the wrong
    direction. The paper writes G = X / Y and calls X the input; as a plant only the reverse makes
    sense, for 1 / G has more zeros than poles and an unstable pole.

    Source: Aras et al. 2013, equation 12.

    Example:
        >>> dft.papers.aras.plant().poles.round(2)
        array([-44.72,  -0.37])
    """
    return transfer_of(((-28.77, 16.28), (1.0, 45.09, 16.33)))


def thruster(*, load: float = 1e-6, thrust: float = 1e-4) -> DCMotorThruster:
    """The DC-motor thruster with the parameters of table 1, with all printed digits.

    The paper does not print the torque and the thrust coefficient of the propeller (its KT, KT0
    and "modified motor constant" Km), so both are arguments; KT0 is zero, as in its equation 5.
    `load_from` gives the torque coefficient that a known speed stands for.

    Args:
        load: torque of the propeller over speed squared [N m s^2/rad^2], not printed.
        thrust: thrust over speed squared, KT [N s^2/rad^2], not printed.

    Example:
        >>> round(dft.papers.aras.thruster().parameters["resistance"].value, 3)
        2.56
    """
    return DCMotorThruster(
        inductance=0.004690891710127,
        back_emf=0.018259462399963,
        resistance=2.560403088365053,
        coulomb=0.000331085454438,
        inertia=0.000072019412423,
        viscous=0.000091357863014,
        torque_constant=0.018259462399963,  # table 1: equal to the back-emf constant
        load=load,
        thrust_quadratic=thrust,
    )


def speed_loop(motor: DCMotorThruster | None = None, *, limit: float = SUPPLY) -> Loop:
    """The speed loop of section 3.1: PI control with kp = 5 and ki = 15, the voltage limited.

    Args:
        motor: `thruster()` where not given.
        limit: largest voltage [V]; the supply's, as the paper prints none.

    Example:
        >>> run = dft.papers.aras.speed_loop().simulate(dft.control.Step(180.0), 5.0)
        >>> round(float(run["speed"][-1]))
        180
    """
    # the paper prints no anti-windup: the time constant is the usual kp / ki
    controller = PID(kp=5.0, ki=15.0, limit=limit, unwinding=5.0 / 15.0)
    return Loop(thruster=motor or thruster(), controller=controller, rate=200.0)


@dataclass(frozen=True, repr=False)
class SteadyMap(Brief):
    """Terminal voltages of steady thrusts.

    Args:
        thrust: [N], ``(n,)``.
        speed: of the propeller [rad/s].
        printed: by equation 7 of the paper, V = R T / Km + Ke sqrt(T / KT) [V].
        own: of the model's steady state, with its friction [V].

    Example:
        >>> result = dft.papers.aras.steady_map(dft.papers.aras.thruster(), [1.0, 5.0, 10.0])
        >>> result.printed.round(2), result.friction.round(2)
        (array([ 3.23, 11.09, 19.8 ]), array([1.33, 2.91, 4.1 ]))
        >>> figure = result.plot()
    """

    thrust: np.ndarray
    speed: np.ndarray
    printed: np.ndarray
    own: np.ndarray

    @property
    def friction(self) -> np.ndarray:
        """What friction adds, which equation 7 leaves out [V]."""
        return self.own - self.printed

    @showing
    def plot(self) -> Figure:
        """Voltage against thrust, by equation 7 and of the model."""
        from diffthrust.papers._figures import steady_map_figure

        return steady_map_figure(self.thrust, self.printed, self.own)


def steady_map(motor: DCMotorThruster, thrust: ArrayLike) -> SteadyMap:
    """The voltage that a steady thrust takes: by equation 7 of the paper, and of the model.

    The paper sets the motor's torque in proportion to the thrust (equation 4, T = Km I): its Km is
    torque_constant thrust_quadratic / load, and friction has no part in it. So the two are the
    same for a model without viscous and dry friction.

    Args:
        motor: with its propeller's coefficients.
        thrust: [N], of any sign, ``(n,)``.

    Raises:
        InputError: a motor with effects, or thrusts that are not numbers.

    Source: Aras et al. 2013, equations 2 to 7.

    Example:
        >>> dft.papers.aras.steady_map(dft.papers.aras.thruster(), [1.0, 5.0, 10.0]).own.shape
        (3,)
    """
    thrust = np.atleast_1d(numbers("steady_map, thrust", thrust))
    if not np.isfinite(thrust).all():
        raise InputError("steady_map, thrust: expected finite numbers.", "Leave the others out.")
    v = _values(motor, "steady_map")
    size = np.abs(thrust)
    modified = v["torque_constant"] * v["thrust_quadratic"] / v["load"]  # Km [N/A]
    printed = v["resistance"] * size / modified + v["back_emf"] * np.sqrt(
        size / v["thrust_quadratic"]
    )
    # the positive root of KT w^2 + linear w = thrust
    half = 0.5 * v["thrust_linear"] / v["thrust_quadratic"]
    speed = np.sqrt(half**2 + size / v["thrust_quadratic"]) - half
    torque = v["load"] * speed**2 + v["viscous"] * speed + v["coulomb"] * np.tanh(speed / 0.1)
    computed = v["resistance"] * torque / v["torque_constant"] + v["back_emf"] * speed
    sign = np.sign(thrust)
    return SteadyMap(thrust, sign * speed, sign * printed, sign * computed)


def load_from(speed: float, voltage: float = SUPPLY) -> float:
    """The propeller's torque coefficient with which the motor of table 1 turns so fast.

    Args:
        speed: steady [rad/s], above zero.
        voltage: at the terminals [V].

    Returns:
        Torque over speed squared [N m s^2/rad^2].

    Raises:
        InputError: a speed that the motor does not reach at this voltage without any load.

    Example:
        >>> dft.papers.aras.load_from(280.4) > 0
        True
    """
    v = _values(thruster(), "load_from")
    current = (voltage - v["back_emf"] * speed) / v["resistance"]
    load = v["torque_constant"] * current - v["viscous"] * speed - v["coulomb"]
    if not (speed > 0 and load > 0):
        raise InputError(
            f"load_from: expected a speed between zero and that of the motor without load, found "
            f"{speed:g} rad/s at {voltage:g} V.",
            "Check the units; the encoder's speed is printed as 280.4 rad/s.",
        )
    return float(load / speed**2)


def _values(motor: DCMotorThruster, what: str) -> dict[str, float]:
    if not isinstance(motor, DCMotorThruster) or motor.effects:
        raise InputError(
            f"{what}: expected a DCMotorThruster without effects, found {motor}.",
            "Take the effects off: model - 'name'; with effects, simulate a held voltage.",
        )
    return {name: float(p.value) for name, p in motor.parameters.items()}


class DepthPlant(Model):
    """From the thruster's voltage to the depth sensor's: a transfer function of the second order.

        reading = surface + (s1 s + s0) / (s^2 + p1 s + p0) command

    The defaults are the printed G(s), and 1.848 V, the printed reading in air. It is a model like
    any other: the open-loop record can be fitted, and a loop closed around it.

    Source: Aras et al. 2013, equation 12 and section 4.2.

    Example:
        >>> plant = dft.papers.aras.DepthPlant()
        >>> plant.inputs, plant.outputs
        ({'command': 'V'}, {'reading': 'V'})
    """

    name = "depth_plant"
    inputs: ClassVar[Mapping[str, str]] = {"command": "V"}
    states: ClassVar[Mapping[str, str]] = {"slow": "V s^2", "fast": "V s"}
    outputs: ClassVar[Mapping[str, str]] = {"reading": "V"}
    ports: ClassVar[Mapping[str, str]] = {"drive": "voltage at the thruster [V]"}
    # poles at 0.37 and 44.7 1/s: the fast one sets the step
    time_scales: ClassVar[tuple[float, float]] = (0.005, 10.0)

    s1: float = parameter(-28.77, "1/s", size=10.0)
    s0: float = parameter(16.28, "1/s^2", size=10.0)
    p1: float = parameter(45.09, "1/s", bounds=(0, None))
    p0: float = parameter(16.33, "1/s^2", bounds=(0, None))
    surface: float = parameter(1.848, "V", size=1.0, doc="at the surface")

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Equation 12 in its controllable form."""
        drive = port("drive", s.command)
        rates = {"slow": s.fast, "fast": drive - self.p1 * s.fast - self.p0 * s.slow}
        return rates, {"reading": self.surface + self.s0 * s.slow + self.s1 * s.fast}


class SensorRange(Effect):
    """The depth sensor ends where its range does.

    Acts on the reported reading [V], which stays within low and high. Null: low and high infinite.
    Source: Aras et al. 2013, table 2: 0.2 V at 20 kPa to 4.9 V at 250 kPa.

    Example:
        >>> model = dft.papers.aras.DepthPlant() + dft.papers.aras.SensorRange()
        >>> print(model)
        depth_plant + sensor_range
    """

    name = "sensor_range"
    port = "reading"
    low: float = parameter(0.2, "V", null=-math.inf, size=1.0, fixed=True)
    high: float = parameter(4.9, "V", null=math.inf, size=1.0, fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        """The reading within the range."""
        return jnp.clip(value, self.low, self.high)


def depth_loop(gain: float = 1.0, *, limit: float = SUPPLY) -> Loop:
    """The depth loop of section 6.2 in time: proportional, with the ranges of sensor and motor.

    The set point is a reading of the sensor [V]; the thruster turns both ways. At rest a gain of
    1 leaves half of the way from the surface, and a set point beyond the sensor's range leaves the
    loop blind: the reading stays at its end, whatever the depth.

    Args:
        gain: volts at the thruster by volts of the sensor.
        limit: largest voltage [V]; the supply's, as the paper prints none.

    Example:
        >>> run = dft.papers.aras.depth_loop().simulate(dft.control.Step(3.0), 10.0)
        >>> round(float(run["measured.reading"][-1]), 2)
        2.42
    """
    controller = PID(of="reading", kp=gain, limit=limit)
    return Loop(thruster=DepthPlant() + SensorRange(), controller=controller, rate=_SAMPLING)
