"""The paper's vessel under predictive control, and its equations written out."""

import math

import numpy as np

import diffthrust as dft
from diffthrust import control
from diffthrust.control import MPC, StraightPath, VesselLoop

RUDDER = math.radians(24.0)
LIMITS = {"propeller_speed": (0.0, 150.0), "rudder_angle": (-RUDDER, RUDDER)}
EAST = StraightPath(0.8, course=math.pi / 2)
CALM = dft.Vessel()
PAPER = {"north": -0.75, "east": -0.2, "surge": 0.7}
"""Errors at the start as in figure 17; how fast the vessel was then is not printed."""
AT_SEA = ("surge", "sway", "yaw_rate", "north", "east", "heading")


def mpc(**more):
    return MPC(**{"model": CALM, "limits": LIMITS, **more})


def tracked(path: control.Path = EAST, duration=60.0, initial=PAPER, vessel=CALM, noise=None,
            **more):  # fmt: skip
    loop = VesselLoop(vessel=vessel, controller=mpc(**more), noise=noise or {})
    return loop.simulate(path, duration, initial=initial, seed=3)


def rates(_, x, n, a):
    """Of `AT_SEA` at a propeller speed and a rudder angle: the equations of the paper."""
    u, v, r, _, _, psi = x
    push = n**0.27
    return [
        (push * np.cos(a) + 5.93 * v * r - 4.03 * u) / 5.23,
        (push * np.sin(a) - 5.23 * u * r - 5.48 * v) / 5.93,
        (-0.5 * push * np.sin(a) - (5.93 - 5.23) * u * v - 1.13 * r) / 1.25,
        u * np.cos(psi) - v * np.sin(psi),
        u * np.sin(psi) + v * np.cos(psi),
        r,
    ]
