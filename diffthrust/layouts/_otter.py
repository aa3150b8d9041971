"""Otter of Maritime Robotics."""

from diffthrust.actuators import StaticThruster
from diffthrust.bodies import Planar
from diffthrust.layouts._layout import Fact, Layout

_MSS = "Fossen, Marine Systems Simulator, VESSELS/otter.m"

OTTER = Layout(
    name="otter",
    title="Maritime Robotics Otter, 2 m, two thrusters",
    body=Planar,
    actuator=StaticThruster(command="rad/s"),
    places={
        "port": ((-0.8, -0.395, 0.0), (1.0, 0.0, 0.0)),
        "starboard": ((-0.8, 0.395, 0.0), (1.0, 0.0, 0.0)),
    },
    facts=(
        Fact({"places": "0.395 m to either side"}, "published", _MSS),
        Fact({"places": "0.8 m aft"}, "rule of thumb", "of its length; it has no influence"),
        Fact({"m11": 55.0 + 5.3}, "rule of thumb", f"{_MSS}: 55 kg, and a tenth of added mass"),
        Fact({"m22": 55.0 * 2.5}, "rule of thumb", f"{_MSS}: 1.5 of the mass are added"),
        Fact({"i33": 55.0 * 0.5**2 * 2.7}, "rule of thumb",
             f"{_MSS}: a radius of gyration of a quarter of the length, 1.7 of it added"),
        Fact({"x_g": 0.2}, "published", _MSS),
        Fact({"d11": 24.4 * 9.81 / 3.086}, "rule of thumb", f"{_MSS}: by its speed of 6 knots"),
        Fact({"d22": 137.5, "d33": 37.1}, "rule of thumb", f"{_MSS}: time constants of 1 s"),
        Fact({"gain": 0.02216 / 2, "reverse": 0.01289 / 0.02216}, "measured",
             f"{_MSS}: bollard pull by the speed of the propellers"),
    ),
)  # fmt: skip
