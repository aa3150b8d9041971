"""Effects between what the thruster does and what its sensors report, on the whole series."""

from collections.abc import Collection

from diffthrust._support.words import number
from diffthrust.effects._forms import Delay, Offset, Scale, from_zero, lagged
from diffthrust.models._base.component import Component, registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Signal, Signals


@registered
class SpeedSensorScale(Scale):
    """The speed sensor's factor is off.

    Acts on the reported speed [rad/s]: (1 + change) * speed. Without a thrust sensor this cannot be
    separated from other values of the model's own parameters. Null: change = 0. Source: sensitivity
    error of Doebelin 2004, chapter 3.

    Example:
        >>> model = dft.Thruster() + dft.effects.SpeedSensorScale(change=0.05)
        >>> model.parameters["speed_sensor_scale.change"].range_text()
        '[-1, inf)'
    """

    name = "speed_sensor_scale"
    in_words = "the speed sensor reads {change:more}"
    port = "speed"


@registered
class SpeedSensorOffset(Offset):
    """The speed sensor's zero is off.

    Acts on the reported speed [rad/s]: speed + offset. Null: offset = 0. Source: zero error of
    Doebelin 2004, chapter 3.

    Example:
        >>> model = dft.Thruster() + dft.effects.SpeedSensorOffset(offset=1)
        >>> model.parameters["speed_sensor_offset.offset"].range_text()
        '(-inf, inf) rad/s'
    """

    name = "speed_sensor_offset"
    in_words = "the speed sensor's zero is off by {offset}"
    port = "speed"
    offset: float = parameter(
        1.0, "{speed}", null=0.0, size=2.0, probes=relative_to("speed", -0.05, 0.05)
    )


@registered
class ThrustSensorScale(Scale):
    """The thrust sensor's factor is off.

    Acts on the reported thrust [N]: (1 + change) * thrust, which is the same as another thrust
    coefficient of the model: hold one of the two. Null: change = 0. Source: sensitivity error of
    Doebelin 2004, chapter 3; Aras et al. 2013, table 4, a sensor that does not follow its data
    sheet.

    Example:
        >>> model = dft.Thruster() + dft.effects.ThrustSensorScale(change=0.05)
        >>> model.parameters["thrust_sensor_scale.change"].range_text()
        '[-1, inf)'
    """

    name = "thrust_sensor_scale"
    in_words = "the thrust sensor reads {change:more}"
    port = "thrust"


@registered
class ThrustSensorOffset(Offset):
    """The thrust sensor's tare is off.

    Acts on the reported thrust [N]: thrust + offset. Null: offset = 0. Source: zero error of
    Doebelin 2004, chapter 3; Aras et al. 2013, table 4.

    Example:
        >>> model = dft.Thruster() + dft.effects.ThrustSensorOffset(offset=1)
        >>> model.parameters["thrust_sensor_offset.offset"].range_text()
        '(-inf, inf) N'
    """

    name = "thrust_sensor_offset"
    in_words = "the thrust sensor's zero is off by {offset}"
    port = "thrust"
    offset: float = parameter(
        1.0, "{thrust}", null=0.0, size=2.0, probes=relative_to("thrust", -0.05, 0.05)
    )


@registered
class ThrustSensorLag(Effect):
    """The thrust sensor follows as a first-order lag: a load cell with its filter.

    Acts on the reported thrust [N]: time_constant * d(reading)/dt = thrust - reading, settled when
    the log begins, exact for a thrust that is linear between samples. Null: time_constant = 0.
    Source: first-order instrument of Doebelin 2004, chapter 3.

    Example:
        >>> model = dft.Thruster() + dft.effects.ThrustSensorLag(time_constant=0.1)
        >>> model.parameters["thrust_sensor_lag.time_constant"].range_text()
        '[0, inf) s'
    """

    name = "thrust_sensor_lag"
    in_words = "the thrust sensor lags by {time_constant}"
    port = "thrust"
    memory = True
    time_constant: float = from_zero(0.1, "s", size=0.1, probes=(0.03, 0.1, 0.3))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return lagged(s.time, value, self.time_constant)

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        return _acting_late(model, f"lags by {number(self.time_constant, 2)} s behind")


@registered
class ThrustSensorDelay(Delay):
    """The thrust is reported late.

    Acts on the reported thrust [N]: thrust(time - delay), linear between samples; before the log
    the first thrust. Null: delay = 0. Source: dead-time element of Doebelin 2004, chapter 3.

    Example:
        >>> model = dft.Thruster() + dft.effects.ThrustSensorDelay(delay=0.05)
        >>> model.parameters["thrust_sensor_delay.delay"].range_text()
        '[0, inf) s'
    """

    name = "thrust_sensor_delay"
    in_words = "the thrust is reported {delay} late"
    port = "thrust"
    delay: float = from_zero(0.05, "s", size=0.1, probes=(0.02, 0.08, 0.25))

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        return _acting_late(model, f"acts {number(self.delay, 2)} s after")


def _acting_late(model: Component, how: str) -> str:
    """How the thrust that a model takes from the log comes after the logged one; "" for others.

    Of the axis of EMPS "the thrust is reported 0.0056 s late" stood where it acts as much later.
    """
    inputs = {*getattr(model, "inputs", ()), *getattr(model, "optional_inputs", ())}
    return f"the thrust {how} what is logged" if "thrust" in inputs else ""
