"""ArduPilot's vehicles in the water, by the parameters of their frame and motors.

Sources, read for their meaning: ArduPilot, libraries/AP_Motors/AP_Motors6DOF.cpp (ArduSub's
factors; a motor's output is its direction times the sum of factor times command, and 400 us of
pulse width), libraries/SRV_Channel (functions of outputs, and how trim, ends and reversal make a
width of pulses), libraries/AR_Motors (left is throttle plus steering).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust._support.words import counted
from diffthrust.bodies import Planar, SixDegrees
from diffthrust.layouts._layout import (
    CommandColumn,
    Fact,
    Layout,
    RecordedLayout,
    RecordedThruster,
    vector,
)
from diffthrust.layouts._mixer import AXES, Mixer
from diffthrust.layouts._ready import BLUEROV2, BLUEROV2_HEAVY
from diffthrust.logs._written import PWM

ARM = 0.2
"""Lever arm of a thruster of which ArduSub knows the sense of its moments alone [m]: half of the
width of small ROVs. A fit of a place that is wrong by a factor of two takes inertias that are."""
_SOURCE = "ArduPilot, AP_Motors6DOF.cpp"
_PWM = PWM(1500.0, 1900.0, 1100.0)
"""ArduSub sends 1500 us and 400 us for each 1 of thrust, whatever the ends of the outputs are."""

# roll, pitch, yaw, throttle (up), forward, lateral (to starboard) of each motor
_FRAMES: Mapping[str, tuple[tuple[float, ...], ...]] = {
    "bluerov1": (
        (0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (-0.5, 0.5, 0, 0.45, 0, 0),
        (0.5, 0.5, 0, 0.45, 0, 0), (0, -1, 0, 1, 0, 0), (-0.25, 0, 0, 0, 0, 1),
    ),
    "vectored": (
        (0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1), (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0),
    ),
    "vectored_6dof": (
        (0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1),
        (1, -1, 0, -1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0), (-1, 1, 0, -1, 0, 0),
    ),
    "vectored_6dof_90deg": (
        (1, 1, 0, 1, 0, 0), (0, 0, 1, 0, 1, 0), (1, -1, 0, 1, 0, 0), (0, 0, 0, 0, 0, 1),
        (0, 0, 0, 0, 0, 1), (-1, 1, 0, 1, 0, 0), (0, 0, -1, 0, 1, 0), (-1, -1, 0, 1, 0, 0),
    ),
    "simplerov_3": ((0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (0, 0, 0, -1, 0, 0)),
    "simplerov_4": (
        (0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0),
    ),
    "simplerov_5": (
        (0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0),
        (0, 0, 0, 0, 0, 1),
    ),
}  # fmt: skip
ARDUSUB_FRAMES = tuple(_FRAMES)
"""ArduSub's frames by name, in the order of ``FRAME_CONFIG``."""
_PLACES: Mapping[str, Layout] = {"vectored": BLUEROV2, "vectored_6dof": BLUEROV2_HEAVY}
_OWN = 7
"""``FRAME_CONFIG`` of a frame of the user's own code."""
_LEFT, _RIGHT = 73, 74
"""Functions of outputs of a boat with two thrusters: throttle left and throttle right."""


def ardusub_mixer(frame: str, directions: Sequence[float] = ()) -> Mixer:
    """ArduSub's factors of a frame, with axes of this library: a heave command pushes down.

    Args:
        frame: one of `ARDUSUB_FRAMES`.
        directions: ``MOT_n_DIRECTION`` of each motor, 1 or -1; 1 where left out.

    Raises:
        InputError: there is no such frame, or a direction is neither 1 nor -1.

    Example:
        >>> dft.layouts.ardusub_mixer("vectored").factors["m1"]
        (-1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    """
    if frame not in _FRAMES:
        raise InputError(
            f"the frame {frame!r} is not known; {nearby(frame, _FRAMES)}.",
            "Name one of dft.layouts.ARDUSUB_FRAMES, or give factors: dft.layouts.Mixer.",
        )
    for k, direction in enumerate(directions, 1):
        if direction not in (1, -1):
            raise InputError(
                f"MOT_{k}_DIRECTION: expected 1 or -1, found {direction}.",
                "Set -1 where the motor is to turn the other way, else 1.",
            )
    rows = {}
    for k, (roll, pitch, yaw, throttle, forward, lateral) in enumerate(_FRAMES[frame]):
        direction = directions[k] if k < len(directions) else 1.0
        frd = np.array((forward, lateral, -throttle, roll, pitch, yaw), float)
        rows[f"m{k + 1}"] = tuple(direction * frd + 0.0)
    return Mixer(AXES, rows, f"ArduSub's factors of {frame}")


def ardupilot_layout(parameters: Mapping[str, float]) -> RecordedLayout | None:
    """The craft of ArduPilot's parameters; None where they describe no craft in the water.

    Args:
        parameters: values by name, as of `diffthrust.logs.parameters_in`.

    Raises:
        InputError: a frame that ArduSub does not have or whose factors are the user's own, a
            direction that is none, or pulses whose stop is not between their ends.

    Example:
        >>> print(dft.layouts.ardupilot_layout({"FRAME_CLASS": 1.0}))
        None
    """
    if "FRAME_CONFIG" in parameters:
        return _sub(parameters)
    outputs = _outputs(parameters)
    # a rover on wheels has the same outputs: only the class 2 is a boat
    if parameters.get("FRAME_CLASS") == 2 and {_LEFT, _RIGHT} <= set(outputs):
        return _boat(parameters, outputs)
    return None


def _sub(parameters: Mapping[str, float]) -> RecordedLayout:
    number = parameters["FRAME_CONFIG"]
    if number not in range(len(ARDUSUB_FRAMES)):
        custom = ", a frame of your own code, which no parameter describes" * (number == _OWN)
        raise InputError(
            f"FRAME_CONFIG: expected a whole number from 0 to {len(ARDUSUB_FRAMES) - 1}, found "
            f"{number:g}{custom}.",
            "Place the thrusters in a spec file: [thrusters.NAME] with at = [x, y, z].",
        )
    frame = ARDUSUB_FRAMES[int(number)]
    plain = ardusub_mixer(frame)
    directions = [
        parameters.get(f"MOT_{k}_DIRECTION", 1.0) for k in range(1, 1 + len(plain.factors))
    ]
    mixer = ardusub_mixer(frame, directions)
    outputs = _outputs(parameters)
    template = _PLACES.get(frame)
    places = [*template.places.values()] if template else None
    thrusters = {}
    for k, (name, factors) in enumerate(plain.factors.items(), 1):
        force, moment = np.array(factors[:3]), np.array(factors[3:])
        ahead = force / np.linalg.norm(force)
        place = places[k - 1][0] if places else ARM * np.cross(ahead, moment)
        # motors 1 to 8 are the functions 33 to 40, 9 to 12 are 82 to 85
        output = outputs.get(32 + k if k <= 8 else 73 + k, k)
        thrusters[name] = RecordedThruster(
            vector(place), vector(directions[k - 1] * ahead), _widths(output, _PWM)
        )
    placed = (
        Fact({"places": f"of the {template.title}"}, "rule of thumb",
             f"ArduSub has none, measure them on a frame of your own; {template.facts[0].source}")
        if template
        else Fact({"places": f"{ARM} m to the side of their moments"}, "rule of thumb",
                  "ArduSub's factors have no places: measure them")
    )  # fmt: skip
    turned = [f"MOT_{k}" for k, sign in enumerate(directions, 1) if sign < 0]
    facts = (
        placed,
        Fact({"directions": f"by the factors of {frame}, and MOT_n_DIRECTION"}, "published",
             f"{_SOURCE}; {', '.join(turned) or 'none'} turned by the log's parameters"),
        Fact({"stop": 1500, "full": 1900}, "published", f"{_SOURCE}: 400 us for each 1"),
    )  # fmt: skip
    count = counted(len(thrusters), "thruster")
    return RecordedLayout(
        f"ArduSub, FRAME_CONFIG {number:g} ({frame}), {count}",
        SixDegrees,
        thrusters,
        mixer,
        facts,
    )


def _boat(parameters: Mapping[str, float], outputs: Mapping[int, int]) -> RecordedLayout:
    """A boat with a thruster to either side."""
    thrusters = {}
    for name, function, side in (("port", _LEFT, -1.0), ("starboard", _RIGHT, 1.0)):
        output = outputs[function]
        stop, low, high = (
            parameters.get(f"SERVO{output}_{what}", default)
            for what, default in (("TRIM", 1500.0), ("MIN", 1100.0), ("MAX", 1900.0))
        )
        settings = (
            f"SERVO{output}_MIN {low:g}, SERVO{output}_TRIM {stop:g}, SERVO{output}_MAX {high:g}"
        )
        if parameters.get(f"SERVO{output}_REVERSED"):
            low, high = high, low
        place = (0.0, side * 1.5 * ARM, 0.0)
        # a motor that does not turn back has its stop at its end
        widths = PWM.of(PWM(stop, high, None if low == stop else low), f"the parameters {settings}")
        thrusters[name] = RecordedThruster(place, (1.0, 0.0, 0.0), _widths(output, widths))
    facts = (
        Fact({"places": f"{1.5 * ARM:.2g} m to either side"}, "rule of thumb",
             "no parameter has them: measure the distance of the thrusters"),
        Fact({"outputs": f"{outputs[_LEFT]} port, {outputs[_RIGHT]} starboard"}, "published",
             "SERVOn_FUNCTION, _TRIM, _MIN, _MAX and _REVERSED of the log"),
    )  # fmt: skip
    mixer = Mixer(
        ("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)}, "ArduPilot's skid steering"
    )
    return RecordedLayout(
        "ArduPilot, a boat with two thrusters (FRAME_CLASS 2)", Planar, thrusters, mixer, facts
    )


def _outputs(parameters: Mapping[str, float]) -> dict[int, int]:
    """The first output of each function."""
    outputs: dict[int, int] = {}
    for k in range(1, 33):
        outputs.setdefault(int(parameters.get(f"SERVO{k}_FUNCTION", 0)), k)
    return outputs


def _widths(output: int, pwm: PWM) -> tuple[CommandColumn, ...]:
    """Fields with the pulse widths of an output: of a DataFlash log, of a telemetry log."""
    names = (f"RCOU.C{output}", f"SERVO_OUTPUT_RAW.servo{output}_raw")
    return tuple(CommandColumn(name, pwm) for name in names)
