"""Which states an output can feel."""

from typing import ClassVar

import pytest

import diffthrust as dft
from diffthrust.simulation._dependence import states_behind  # private: told by no result


class Cascade(dft.Model):
    """Three tanks in a row, written down from the last one to the first."""

    name = "cascade"
    inputs: ClassVar = {"flow": "m"}
    states: ClassVar = {"last": "m", "middle": "m", "first": "m"}
    outputs: ClassVar = {"lowest": "m", "between": "m", "highest": "m", "poured": "m"}
    rate: float = dft.parameter(0.5, "1/s", bounds=(0, None))

    def equations(self, s, port):
        rates = {
            "last": self.rate * (s.middle - s.last),
            "middle": self.rate * (s.first - s.middle),
            "first": self.rate * (s.flow - s.first),
        }
        told = {"lowest": s.last, "between": s.middle, "highest": s.first, "poured": s.flow}
        return rates, told


@pytest.mark.parametrize(
    ("output", "behind"),
    [
        ("lowest", ("last", "middle", "first")),
        ("between", ("middle", "first")),
        ("highest", ("first",)),
        ("poured", ()),
    ],
)
def test_an_output_feels_the_states_upstream_of_it(output, behind):
    signals = {"time": 0.0, "flow": 1.0}
    assert states_behind(Cascade(), output, ("last", "middle", "first"), signals) == behind
