"""A small ferry with an azimuth thruster at either end."""

from diffthrust.actuators import Azimuth, StaticThruster
from diffthrust.bodies import Planar
from diffthrust.layouts._layout import Fact, Layout

_PEDERSEN = (
    "Pedersen 2019, Optimization based system identification for the milliAmpere ferry, NTNU, as "
    "given in the parameters of IDLab's simulator of it"
)

FERRY = Layout(
    name="twin_azimuth_ferry",
    title="Passenger ferry of 5 m, an azimuth thruster fore and aft (milliAmpere)",
    body=Planar,
    actuator=Azimuth(StaticThruster(command="effort")),
    places={
        "bow": ((1.8, 0.0, 0.0), (1.0, 0.0, 0.0)),
        "stern": ((-1.8, 0.0, 0.0), (1.0, 0.0, 0.0)),
    },
    facts=(
        Fact({"places": "1.8 m fore and aft"}, "rule of thumb", "of a hull of 5 m"),
        Fact({"m11": 2400.0, "m22": 2400.0, "i33": 5068.9}, "published", _PEDERSEN),
        Fact({"d11": 27.6, "d22": 52.9, "d33": 122.9}, "published",
             f"{_PEDERSEN}; the linear terms alone, add quadratic_surge_drag and its like"),
        Fact({"gain": 500.0, "exponent": 2.0, "reverse": 1.0, "slew_time": 1.0}, "unknown",
             "thrusters of this size give some 500 N; how fast they turn is not printed"),
    ),
)  # fmt: skip
