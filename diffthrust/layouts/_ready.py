"""Ready vehicles: ROVs, boats and one axis, every number with its source."""

import math

from diffthrust.actuators import Azimuth, StaticThruster
from diffthrust.bodies import Axis, Planar, SixDegrees
from diffthrust.layouts._layout import Fact, Layout
from diffthrust.models._thrusters import Thruster

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
        Fact({"places": "0.35 m aft"}, "rule of thumb",
             "of its length; without influence while both push straight ahead"),
        Fact({"m11": 1.1 * 15.0, "m22": 1.9 * 15.0}, "rule of thumb",
             "its mass of 15 kg with 10 % and 90 % of added mass, as of slender hulls"),
        Fact({"i33": 1.7 * 1.5}, "rule of thumb",
             "its inertia of 1.7 kg m^2 by the same readme, with half of added inertia"),
        Fact({"d11": 15.0, "d22": 60.0, "d33": 6.0}, "unknown", "to be estimated from logs"),
        Fact({"gain": 45.0, "exponent": 1.7, "reverse": 0.8}, "rule of thumb",
             "as of a T200 of the same size; the M200 has no published chart"),
    ),
)  # fmt: skip

_MSS = "Fossen, Marine Systems Simulator, VESSELS/otter.m"
# Its mass matrix about the origin, without payload: m22 = 55 + 1.5 * 55 = 137.5 kg, of which the
# hull alone, its centre 0.2 m ahead, makes m26 = 55 * 0.2 = 11 kg m: the added mass is diagonal. In
# a `Planar` m26 = m22 * x_g, hence x_g = 11 / 137.5 = 0.08 m (with a payload of 25 kg at 0.05 m:
# 12.25 / 162.5 = 0.075 m). m66 = i33 + m22 * x_g^2; the source moves the hull's inertia to the
# origin twice, m66 = 2.7 * 55 * (0.5^2 + 0.2^2) + 55 * 0.2^2 = 45.3 kg m^2.
_OTTER_M22, _OTTER_M26 = 55.0 * 2.5, 55.0 * 0.2
_OTTER_M66 = 2.7 * 55.0 * (0.5**2 + 0.2**2) + 55.0 * 0.2**2

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
        Fact({"places": "0.8 m aft"}, "rule of thumb",
             "of its length; without influence while both push straight ahead"),
        Fact({"m11": 55.0 + 5.3}, "rule of thumb", f"{_MSS}: 55 kg, and a tenth of added mass"),
        Fact({"m22": _OTTER_M22}, "rule of thumb", f"{_MSS}: 1.5 of the mass are added"),
        Fact({"i33": _OTTER_M66 - _OTTER_M26**2 / _OTTER_M22}, "rule of thumb",
             f"{_MSS}: a radius of gyration of a quarter of the length, 1.7 of it added"),
        Fact({"x_g": _OTTER_M26 / _OTTER_M22}, "rule of thumb",
             f"{_MSS}: 0.2 m of the hull's 55 kg; the mass added in sway is about the origin"),
        Fact({"d11": 24.4 * 9.81 / 3.086}, "rule of thumb", f"{_MSS}: by its speed of 6 knots"),
        Fact({"d22": _OTTER_M22, "d33": _OTTER_M66}, "rule of thumb",
             f"{_MSS}: time constants of 1 s"),
        Fact({"gain": 0.02216 / 2, "reverse": 0.01289 / 0.02216}, "measured",
             f"{_MSS}: bollard pull by the speed of the propellers"),
    ),
)  # fmt: skip

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
