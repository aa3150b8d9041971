"""A sensor that reads along a straight line."""

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signals


@registered
class LinearSensor(Model):
    """A depth sensor with a straight calibration line: reading = slope * depth + offset.

    A static model: its log may be a table without time. Source: Aras et al. 2013; the defaults
    are the datasheet line of that paper, which its own table 4 contradicts.

    Example:
        >>> depth = np.array([0.0, 1.0, 2.0, 3.0])
        >>> record = dft.Log(depth, {"depth": depth}, {"reading": 0.2 * depth + 0.5})
        >>> sensor = dft.LinearSensor(slope=0.2, offset=0.5)
        >>> dft.simulate(sensor, record)["reading"]
        array([0.5, 0.7, 0.9, 1.1])
    """

    name = "linear_sensor"
    inputs = {"depth": "m"}
    outputs = {"reading": "V"}
    ports = {"line": "reading of the sensor [V]"}

    slope: float = parameter(0.1901, "V/m", size=0.1)
    offset: float = parameter(-0.0973, "V", size=1.0)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        return {}, {"reading": port("line", self.slope * s.depth + self.offset)}
