"""One axis of Jason Jr."""

from diffthrust.bodies import Axis
from diffthrust.layouts._layout import Fact, Layout
from diffthrust.models._thruster import Thruster

_YOERGER = "Yoerger, Cooke & Slotine 1990"

JASON_JR = Layout(
    name="jason_jr",
    title="One axis of Jason Jr, a thruster in a duct",
    body=Axis,
    actuator=Thruster(),
    places={"thruster": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))},
    facts=(
        Fact({"mass": 340.0, "drag": 67.0}, "published", f"{_YOERGER}, section IV"),
        Fact({"alpha": 0.037, "beta": 42.0, "ct": 0.019}, "measured",
             f"{_YOERGER}, figure 10, of the Jason thruster"),
        Fact({"places": "on the axis"}, "published", f"{_YOERGER}, section IV"),
    ),
)  # fmt: skip
