"""Vehicles of PX4 by the parameters of their control allocation.

Sources, read for their meaning: PX4-Autopilot, src/modules/control_allocator, module.yaml (the
parameters), ActuatorEffectivenessRotors.cpp (force CT axis, moment CT place x axis - CT KM axis),
ControlAllocationPseudoInverse.cpp (the pseudo-inverse and its normalization),
ActuatorEffectivenessUUV.hpp (that it is normalized in all axes); src/lib/mixer_module (a motor
that may turn back is at rest halfway between the ends of its pulses).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.words import counted
from diffthrust.bodies import SixDegrees
from diffthrust.layouts._layout import CommandColumn, Fact, RecordedLayout, RecordedThruster, vector
from diffthrust.layouts._mixer import Mixer
from diffthrust.logs._written import PWM

_MOTORS_6DOF = 7
"""``CA_AIRFRAME`` of motors that push in any direction, as on underwater vehicles."""
_MOST = 12
_DEFAULTS = {
    **dict.fromkeys(("PX", "PY", "PZ", "AX", "AY"), 0.0),
    "AZ": -1.0,
    "CT": 6.5,
    "KM": 0.05,
}
_SMALL = 1e-3
"""PX4 takes smaller entries of the pseudo-inverse as zero."""
_EPSILON = float(np.finfo(np.float32).eps)
"""PX4 divides by no scale below this (its FLT_EPSILON)."""


def px4_layout(parameters: Mapping[str, float]) -> RecordedLayout | None:
    """The craft of PX4's parameters; None where they describe no motors in six degrees.

    Args:
        parameters: values by name, as of `diffthrust.logs.parameters_in`.

    Raises:
        InputError: a number of motors or a thrust that PX4 does not have, or pulses of one width.

    Example:
        >>> rov = {"CA_AIRFRAME": 7, "CA_ROTOR_COUNT": 1, "CA_ROTOR0_AX": 1, "CA_ROTOR0_AZ": 0}
        >>> dft.layouts.px4_layout(rov).thrusters["m1"].reaction
        -0.05
    """
    count = parameters.get("CA_ROTOR_COUNT", 0)
    if parameters.get("CA_AIRFRAME") != _MOTORS_6DOF or count == 0:
        return None
    if count not in range(_MOST + 1):
        raise InputError(
            f"CA_ROTOR_COUNT: expected a whole number up to {_MOST}, found {count:g}.",
            "Set it to the number of motors.",
        )
    each = [
        {key: parameters.get(f"CA_ROTOR{k}_{key}", default) for key, default in _DEFAULTS.items()}
        for k in range(int(count))
    ]
    for k, p in enumerate(each):
        if p["CT"] < 0:
            raise InputError(
                f"CA_ROTOR{k}_CT: expected a thrust of 0 or more, found {p['CT']:g}.",
                f"Set it to {-p['CT']:g} and turn its axis round: CA_ROTOR{k}_AX, AY, AZ.",
            )
    # PX4 takes no notice of a rotor without a direction or without thrust
    pushing = {k: p for k, p in enumerate(each) if p["CT"] and any(p[f"A{x}"] for x in "XYZ")}
    if not pushing:
        return None
    strongest = next(iter(pushing.values()))["CT"]
    thrusters, effectiveness = {}, {}
    for k, p in pushing.items():
        place, axis = np.array([p["PX"], p["PY"], p["PZ"]]), np.array([p["AX"], p["AY"], p["AZ"]])
        axis = axis / np.linalg.norm(axis)
        force, moment = p["CT"] * axis, p["CT"] * (np.cross(place, axis) - p["KM"] * axis)
        name = f"m{k + 1}"
        effectiveness[name] = (*force, *moment)
        thrusters[name] = RecordedThruster(
            vector(place),
            vector(axis),
            _columns(k, parameters),
            round(p["CT"] / strongest, 6),
            -p["KM"] if p["KM"] else None,
        )
    facts = (*_geometry(parameters, pushing), *_one_point(thrusters))
    title = f"PX4, CA_AIRFRAME {_MOTORS_6DOF}, {counted(len(thrusters), 'thruster')}"
    return RecordedLayout(title, SixDegrees, thrusters, px4_mixer(effectiveness), facts)


def _geometry(parameters: Mapping[str, float], motors: Iterable[int]) -> Iterator[Fact]:
    """Where places, directions, strengths and reactions are from: the log, or PX4's defaults."""
    groups = {"places": "PX PY PZ", "directions": "AX AY AZ", "strengths": "CT"}
    for what, keys in groups.items():
        names = [f"CA_ROTOR{k}_{key}" for k in motors for key in keys.split()]
        missing = [name for name in names if name not in parameters]
        group = f"CA_ROTORn_{', '.join(keys.split())}"
        if len(missing) < len(names):
            yield Fact({what: group}, "published", "the log's parameters")
        if missing:
            values = " ".join(f"{_DEFAULTS[key]:g}" for key in keys.split())
            lacks = f"PX4's default, the log has no {', '.join(missing[:3])}"
            more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
            yield Fact({what: f"{group} of {values}"}, "unknown", lacks + more)
    turns = "the log's parameters; KM is positive where the propeller turns counter-clockwise"
    yield Fact({"reactions": "-CA_ROTORn_KM, whose default is 0.05"}, "unknown", turns)


def _one_point(thrusters: Mapping[str, RecordedThruster]) -> Iterator[Fact]:
    """That no thruster has a lever arm, by parameters that nobody has set."""
    if len(thrusters) > 1 and len({t.place for t in thrusters.values()}) == 1:
        source = "no thruster turns the craft by its place: set CA_ROTORn_PX, PY, PZ"
        yield Fact({"places": "all at one point"}, "unknown", source)


def px4_mixer(effectiveness: Mapping[str, Sequence[float]]) -> Mixer:
    """What PX4 sends to its motors: the pseudo-inverse of their effectiveness, normalized.

    A force command of 1 sends 1 to those that push along it, in the mean; a yaw command of 1 sends
    1 to the motor that is sent most ahead, and is as the pseudo-inverse has it where none is sent
    ahead; roll and pitch have one scale, so that the squares of what is sent for one of them have
    the sum of half the motors.

    Args:
        effectiveness: for each motor its force and moment, in the order of `AXES`, per CT u.

    Example:
        >>> boat = {"left": (5, 0, 0, 0, 0, 1), "right": (5, 0, 0, 0, 0, -1)}
        >>> dft.layouts.px4_mixer(boat).matrix.round(6).tolist()
        [[1.0, 1.0], [1.0, -1.0]]
    """
    plain = Mixer.inverse(effectiveness)
    mix = {axis: plain.matrix[:, k] for k, axis in enumerate(plain.commands)}
    moving = {axis: np.abs(column) > _SMALL for axis, column in mix.items()}
    scales = {axis: float(np.mean(np.abs(c[np.abs(c) > _EPSILON]))) for axis, c in mix.items()}
    tilts = [
        float(np.sqrt(np.sum(mix[axis] ** 2) / (np.sum(moving[axis]) / 2)))
        for axis in ("roll", "pitch")
        if axis in mix and np.any(moving[axis])
    ]
    scales |= dict.fromkeys(("roll", "pitch"), max(tilts, default=1.0))
    if "yaw" in mix:
        # PX4 takes the largest with its sign, and does not divide where that is not above zero: a
        # lateral thruster at the stern is sent nothing ahead for a yaw to starboard
        most = float(np.max(mix["yaw"]))
        scales["yaw"] = most if most > _EPSILON else 1.0
    rows = np.stack([mix[axis] / scales[axis] for axis in mix], axis=1)
    rows = np.where(np.abs(rows) < _SMALL, 0.0, rows)
    factors = dict(zip(plain.thrusters, rows.tolist(), strict=True))
    return Mixer(tuple(mix), factors, "PX4's allocation of its geometry")


def _columns(motor: int, parameters: Mapping[str, float]) -> tuple[CommandColumn, ...]:
    """Fields with the command of a motor: what it is sent, or its pulses."""
    columns = [CommandColumn(f"actuator_motors.control[{motor}]", None)]
    for output in range(1, 17):
        # functions of outputs: 101 is motor 1
        if parameters.get(f"PWM_MAIN_FUNC{output}") == 101 + motor:
            low = parameters.get(f"PWM_MAIN_MIN{output}", 1000.0)
            high = parameters.get(f"PWM_MAIN_MAX{output}", 2000.0)
            both_ways = int(parameters.get("CA_R_REV", 0)) >> motor & 1
            stop = (low + high) / 2 if both_ways else low
            settings = f"PWM_MAIN_MIN{output} {low:g}, PWM_MAIN_MAX{output} {high:g}"
            pwm = PWM.of(PWM(stop, high, low if both_ways else None), f"the parameters {settings}")
            columns.append(CommandColumn(f"actuator_outputs.output[{output - 1}]", pwm))
    return tuple(columns)
