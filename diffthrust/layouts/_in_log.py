"""The layout of a craft from the log of its autopilot."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike

from diffthrust._support.errors import InputError
from diffthrust.layouts._ardupilot import ardupilot_layout
from diffthrust.layouts._layout import RecordedLayout
from diffthrust.layouts._px4 import px4_layout
from diffthrust.logs._contents import parameters_in


def layout_in(path: str | PathLike[str]) -> RecordedLayout:
    r"""The layout of a craft by the settings of its autopilot.

    PX4's geometry (``CA_ROTORn_PX``, ``AX``, ``KM``, ``CT``, ...) has places, directions, torques
    and strengths. ArduSub's frame (``FRAME_CONFIG``) has what its motors are for, from which their
    directions follow (``MOT_n_DIRECTION`` turns them), and no places: those of the BlueROV2 stand
    in where it is one of its frames. A boat of ArduPilot has its two thrusters in
    ``SERVOn_FUNCTION``.

    Args:
        path: a log (.bin, .tlog, .ulg), or a file of parameters (.param, .params, .parm).

    Raises:
        InputError: the file cannot be read, or its settings describe no craft in the water.

    Example:
        >>> with open("boat.param", "w") as file:
        ...     _ = file.write("FRAME_CLASS,2\nSERVO1_FUNCTION,74\nSERVO3_FUNCTION,73\n")
        >>> print(dft.layouts.layout_in("boat.param").craft())
        craft
    """
    parameters = parameters_in(path)
    try:
        layout = recorded_layout(parameters)
    except InputError as error:
        raise InputError.at(str(path), error.problem, error.mend) from None
    if layout is None:
        frame = {k: v for k, v in parameters.items() if k in _TELLING}
        present = ", ".join(f"{name} {value:g}" for name, value in frame.items()) or "none of them"
        raise InputError(
            f"{path}: expected the settings of a craft (FRAME_CONFIG of ArduSub, FRAME_CLASS 2 "
            "with throttles left and right, or CA_AIRFRAME 7 with CA_ROTOR_COUNT of PX4), found "
            f"{present} among {len(parameters)} parameters.",
            "Place the thrusters in a spec file: [thrusters.NAME] with at = [x, y, z].",
        )
    return layout


def recorded_layout(parameters: Mapping[str, float]) -> RecordedLayout | None:
    """The layout that an autopilot's parameters describe; None where they describe none."""
    return px4_layout(parameters) or ardupilot_layout(parameters)


_TELLING = ("FRAME_CONFIG", "FRAME_CLASS", "CA_AIRFRAME", "CA_ROTOR_COUNT")
