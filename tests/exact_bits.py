"""Values in which numbers are their bits, so that NaN, -0.0, types and the last digit count."""

import math
import struct
from dataclasses import fields, is_dataclass
from enum import Enum

import numpy as np

import diffthrust as dft
from diffthrust._support.later import Later  # private: doubts that nobody has looked at


def bits(value):
    """A value, or a result without what is not saved, to be compared exactly."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("<d", value)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, [bits(x) for x in value.ravel().tolist()]
    if isinstance(value, dft.Model | dft.Effect):
        own = {k: bits(v) for k, v in vars(value).items() if k != "effects"}
        return type(value), own, [bits(effect) for effect in getattr(value, "effects", ())]
    if is_dataclass(value):
        kept = [f.name for f in fields(value) if f.metadata.get("saved", True)]
        return type(value), {name: bits(getattr(value, name)) for name in kept}
    if hasattr(value, "items"):
        return {key: bits(each) for key, each in value.items()}
    value = tuple(value) if isinstance(value, Later) else value
    if isinstance(value, tuple | list) and not isinstance(value, Enum):
        return type(value), [bits(each) for each in value]
    return type(value), value
