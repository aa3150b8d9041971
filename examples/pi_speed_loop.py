"""A PI speed loop with a limited voltage
======================================

A speed loop around a DC-motor thruster: PI control of a propeller, with a limited voltage.

The motor and the gains kp = 5, ki = 15 are those of Aras et al. 2013, section 3.1; the supply of
13 V is that of their open-loop record. Out come the rise and the overshoot with the integral drawn
back while the voltage is at its limit, and without, and a figure.

    python examples/pi_speed_loop.py [FOLDER FOR THE FIGURE]
"""

import math

import numpy as np
from _data import output_folder

import diffthrust as dft
from diffthrust import control as dc

loop = dc.Loop(
    thruster=dft.DCMotorThruster(),
    controller=dc.PID(kp=5.0, ki=15.0, limit=13.0, unwinding=5.0 / 15.0),
    rate=200.0,
    noise={"speed": 0.05},
)
step = dc.Step(180.0, time=0.5)
for name, unwinding in (("drawn back", 5.0 / 15.0), ("wound up", math.inf)):
    run = loop.replace({"controller.unwinding": unwinding}).simulate(step, 5.0)
    speed = run["speed"]
    rise = run.time[np.argmax(speed > 162.0)] - step.time
    print(f"Integral {name}: 90 % after {rise:.2f} s, overshoot {speed.max() / 1.8 - 100:.1f} %, "
          f"error from 4 s on {run.tracking(start=4.0).rms:.2f} rad/s.")  # fmt: skip
    run.plot().savefig(output_folder() / f"pi_{name.replace(' ', '_')}.png", dpi=80)
