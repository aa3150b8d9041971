"""By what a log is known again: the bits of what it says, and the file it came from."""

from __future__ import annotations

import hashlib
import pickle
from dataclasses import replace

import numpy as np
import pytest
from places import FITS

import diffthrust as dft
from diffthrust import Column

TIME = np.arange(50) * 0.1
SPEED = np.sin(TIME)


def made(**changes):
    arguments = {
        "time": TIME,
        "inputs": {"command": np.cos(TIME)},
        "measured": {"speed": SPEED, "thrust": SPEED**2},
        "units": {"command": "V", "speed": "rad/s", "thrust": "N"},
    }
    return dft.Log(**{**arguments, **changes})


def nudged(samples):
    """The same samples but for the last bit of one."""
    out = samples.copy()
    out[7] = np.nextafter(out[7], 2.0)
    return out


def read(path):
    return dft.read_log(
        path,
        time="t",
        inputs={"command": Column("u", unit="V")},
        measured={"speed": Column("rpm", unit="rpm"), "thrust": Column("thrust", unit="N")},
    )


def test_logs_that_say_the_same_have_one_hash():
    measured = {"thrust": SPEED**2, "speed": SPEED}  # in another order
    same = made(name="other", notes=["a note"], measured=measured)
    assert same.sha256 == made().sha256
    assert len(same.sha256) == 64
    assert pickle.loads(pickle.dumps(same)).sha256 == same.sha256
    assert replace(same, name="third").sha256 == same.sha256


@pytest.mark.parametrize(
    "changes",
    [
        {"time": nudged(TIME)},
        {"inputs": {"command": nudged(np.cos(TIME))}},
        {"measured": {"speed": nudged(SPEED), "thrust": SPEED**2}},
        {"measured": {"speed": SPEED**2, "thrust": SPEED}},
        {"units": {"command": "V", "speed": "rpm", "thrust": "N"}},
        {"units": {"command": "V", "speed": "rad/s"}},
        {"unsigned": ("speed",)},
        {"noise": {"speed": 0.1}},
        {"hold": "linear"},
    ],
)
def test_what_a_fit_would_feel_changes_the_hash(changes):
    assert made(**changes).sha256 != made().sha256


def test_missing_samples_are_alike_whatever_their_bits():
    gap = SPEED.copy()
    gap[3] = np.nan
    other = gap.copy()
    other.view(np.uint64)[3] = 0x7FF8000000000123
    one, two = (made(measured={"speed": s, "thrust": s}) for s in (gap, other))
    assert one.sha256 == two.sha256


def test_a_log_knows_its_file():
    path = FITS / "jason_thruster" / "train.csv"
    log, again = read(path), read(path)
    assert log.sha256 == again.sha256
    assert log.file.name == path.as_posix()
    assert log.file.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    cut = log.slice(1, 2)
    assert cut.file == log.file
    assert cut.sha256 != log.sha256
    told = log.identity
    assert (told.name, told.samples, told.duration) == ("train.csv", 1201, 60.0)
    assert (told.sha256, told.file) == (log.sha256, log.file)
    assert made().identity.file is None
