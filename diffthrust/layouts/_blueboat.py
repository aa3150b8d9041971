"""BlueBoat of Blue Robotics."""

from diffthrust.actuators import StaticThruster
from diffthrust.bodies import Planar
from diffthrust.layouts._layout import Fact, Layout

_KRISTIANSEN = "BlueBoatSystemIdentification (jankristia), its readme"

BLUEBOAT = Layout(
    name="blueboat",
    title="BlueBoat, 1.2 m, two M200 thrusters",
    body=Planar,
    actuator=StaticThruster(),
    places={
        "port": ((-0.35, -0.285, 0.0), (1.0, 0.0, 0.0)),
        "starboard": ((-0.35, 0.285, 0.0), (1.0, 0.0, 0.0)),
    },
    facts=(
        Fact({"places": "0.285 m to either side"}, "published", _KRISTIANSEN),
        Fact({"places": "0.35 m aft"}, "rule of thumb", "of its length; it has no influence"),
        Fact({"m11": 1.1 * 15.0, "m22": 1.9 * 15.0}, "rule of thumb",
             "its mass of 15 kg with 10 % and 90 % of added mass, as of slender hulls"),
        Fact({"i33": 1.7 * 1.5}, "rule of thumb",
             "its inertia of 1.7 kg m^2 by the same readme, with half of added inertia"),
        Fact({"d11": 15.0, "d22": 60.0, "d33": 6.0}, "unknown", "to be estimated from logs"),
        Fact({"gain": 45.0, "exponent": 1.7, "reverse": 0.8}, "rule of thumb",
             "as of a T200 of the same size; the M200 has no published chart"),
    ),
)  # fmt: skip
