"""BlueROV2 and BlueROV2 Heavy of Blue Robotics."""

import math

from diffthrust.actuators import StaticThruster
from diffthrust.bodies import SixDegrees
from diffthrust.layouts._layout import Fact, Layout

_C = math.sqrt(0.5)
_WU = "Wu 2018, 6-DoF modelling and control of a remotely operated vehicle, Flinders University"
_BENZON = (
    "von Benzon et al. 2022, J. Mar. Sci. Eng. 10, 1898, as given in AndreasKing-Goks/0_THESIS, "
    "BlueROV2_param.m"
)
_ARDUSUB = "ArduPilot, AP_Motors6DOF.cpp, with MOT_n_DIRECTION 1: try each on the vehicle"
_T200 = "Blue Robotics, T200 performance charts at 16 V: 5.25 kgf ahead, 4.07 kgf astern"
_LAW = (
    Fact({"gain": 51.5, "reverse": 0.776}, "measured", _T200),
    Fact({"exponent": 1.6}, "rule of thumb", "a power law through the same charts"),
)

# masses are those of the rigid body and of the water together, as the body takes them
BLUEROV2_HEAVY = Layout(
    name="bluerov2_heavy",
    title="BlueROV2 Heavy, eight T200 thrusters",
    body=SixDegrees,
    actuator=StaticThruster(),
    places={
        "t1": ((0.156, 0.111, 0.085), (-_C, _C, 0.0)),
        "t2": ((0.156, -0.111, 0.085), (-_C, -_C, 0.0)),
        "t3": ((-0.156, 0.111, 0.085), (_C, _C, 0.0)),
        "t4": ((-0.156, -0.111, 0.085), (_C, -_C, 0.0)),
        "t5": ((0.120, 0.218, 0.0), (0.0, 0.0, 1.0)),
        "t6": ((0.120, -0.218, 0.0), (0.0, 0.0, 1.0)),
        "t7": ((-0.120, 0.218, 0.0), (0.0, 0.0, 1.0)),
        "t8": ((-0.120, -0.218, 0.0), (0.0, 0.0, 1.0)),
    },
    facts=(
        Fact({"places": "of the eight thrusters"}, "published", _BENZON),
        Fact({"directions": "signs of t1 to t8"}, "published", _ARDUSUB),
        Fact(
            {"m11": 13.5 + 6.3567, "m22": 13.5 + 7.1206, "m33": 13.5 + 18.6863},
            "published",
            _BENZON,
        ),
        Fact(
            {"i44": 0.26 + 0.1858, "i55": 0.23 + 0.1348, "i66": 0.37 + 0.2215}, "published", _BENZON
        ),
        Fact({"d11": 13.7, "d22": 0.0, "d33": 33.0}, "published", _BENZON),
        Fact({"d44": 0.0, "d55": 0.8, "d66": 0.0}, "published", _BENZON),
        Fact({"q11": 141.0, "q22": 217.0, "q33": 190.0}, "published", _BENZON),
        Fact({"q44": 1.192, "q55": 0.47, "q66": 1.5}, "published", _BENZON),
        Fact({"weight": 13.5 * 9.81, "buoyancy": 999.7 * 0.0134 * 9.81}, "published", _BENZON),
        Fact({"z_g": 0.0, "z_b": -0.01}, "published", _BENZON),
        *_LAW,
    ),
)

BLUEROV2 = Layout(
    name="bluerov2",
    title="BlueROV2, six T200 thrusters, four of them vectored",
    body=SixDegrees,
    actuator=StaticThruster(),
    places={
        "t1": ((0.14, 0.10, 0.0), (-_C, _C, 0.0)),
        "t2": ((0.14, -0.10, 0.0), (-_C, -_C, 0.0)),
        "t3": ((-0.14, 0.10, 0.0), (_C, _C, 0.0)),
        "t4": ((-0.14, -0.10, 0.0), (_C, -_C, 0.0)),
        "t5": ((0.0, 0.11, 0.0), (0.0, 0.0, 1.0)),
        "t6": ((0.0, -0.11, 0.0), (0.0, 0.0, 1.0)),
    },
    facts=(
        Fact(
            {"places": "t1 to t4"},
            "published",
            "HippoCampusRobotics, hippo_sim, thrusters of the BlueROV2",
        ),
        Fact({"places": "t5, t6"}, "rule of thumb", "of the frame's width of 0.338 m"),
        Fact({"directions": "signs of t1 to t6"}, "published", _ARDUSUB),
        Fact({"m11": 11.5 + 5.5, "m22": 11.5 + 12.7, "m33": 11.5 + 14.57}, "published", _WU),
        Fact({"i44": 0.16 + 0.12, "i55": 0.16 + 0.12, "i66": 0.16 + 0.12}, "published", _WU),
        Fact({"d11": 4.03, "d22": 6.22, "d33": 5.18}, "published", _WU),
        Fact({"d44": 0.07, "d55": 0.07, "d66": 0.07}, "published", _WU),
        Fact({"q11": 18.18, "q22": 21.66, "q33": 36.99}, "published", _WU),
        Fact({"q44": 1.55, "q55": 1.55, "q66": 1.55}, "published", _WU),
        Fact({"weight": 112.8, "buoyancy": 114.8, "z_g": 0.02, "z_b": 0.0}, "published", _WU),
        *_LAW,
    ),
)
