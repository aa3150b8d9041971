"""Depth sensor, steady map and transfer function
==============================================

Aras et al. 2013, followed from what it prints: sensor, steady map, G(s) and black-box models.

Out come a table "figure, paper, ours, ratio, remark" of every printed figure that can be checked,
what the F tests say of the datasheet's line, the steady map of the thruster with the friction that
equation 7 leaves out, the depth loop at the paper's gain, black-box models of a simulated record of
its printed G(s) with the order chosen by unseen data, and four figures. The open-loop record and
the depth loop in time are those of ``papers_aras_depth.py``.

    python examples/papers_aras.py [FOLDER FOR THE FIGURES]
"""

import numpy as np
from _data import output_folder
from printed.aras import printed_figures
from printed.printed import printed_table
from printed.table_4 import table_4
from printed.transfer import gain_limit, linear_loop, plot_responses, step_response

import diffthrust as dft
from diffthrust.papers import aras


def record(seed: int, seconds: float = 40.0, step: float = 0.02) -> dft.Log:
    """Steps of up to 13 V into the printed G(s), and 20 mV of noise in the sensor."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, step)
    levels = rng.uniform(-aras.SUPPLY, aras.SUPPLY, 20)
    command = levels[(time * 20 / seconds).astype(int)]
    answer, single = np.zeros(time.size), step_response(aras.plant(), time)
    for start in np.flatnonzero(np.diff(command, prepend=0.0)):
        answer[start:] += (command[start] - (command[start - 1] if start else 0.0)) * single[
            : time.size - start
        ]
    measured = answer + 0.02 * rng.standard_normal(time.size)
    return dft.Log(time=time, inputs={"command": command}, measured={"depth": measured},
                   units={"command": "V", "depth": "V"}, name=f"record {seed}")  # fmt: skip


calibration = aras.calibrate(*table_4())
print(printed_table(printed_figures()))
print(calibration.sentence)
for name, line in calibration.lines.items():
    slope = f"{line.slope:.4f} ± {line.slope_error:.4f} V/m"
    offset = f"{line.intercept:.4f} ± {line.intercept_error:.4f} V"
    print(f"{name}: {slope}, {offset}; 3 V would be {(3 - line.intercept) / line.slope:.2f} m")

motor = aras.thruster(load=aras.load_from(280.4))
steady = aras.steady_map(motor, np.linspace(0.0, 1e-4 * 280.4**2, 50))
print(f"At 280.4 rad/s equation 7 gives {steady.printed[-1]:.2f} V; with the friction of table 1 "
      f"it takes {steady.own[-1]:.2f} V.")  # fmt: skip
swing = step_response(linear_loop(), np.linspace(0.0, 3.0, 3001))
print(f"Depth loop, gain 1: first {-swing.min():.2f} set points the wrong way, then to "
      f"{swing[-1]:.3f} of it; unstable from a gain of {gain_limit():.2f} on.")  # fmt: skip

train, unseen = [record(1), record(2)], record(3)
chosen = dft.blackbox.select(train, input="command", output="depth", orders=(1, 2, 3),
                             by="unseen", holdout=unseen)  # fmt: skip
print("\nBlack-box models of two simulated records of G(s)\n" + chosen.report())
model = dft.blackbox.output_error(train, input="command", output="depth", orders=(2, 2, 1))
print(f"Output error of order 2: G(s) = {model.transfer()}; printed: {aras.plant()}")
states = dft.blackbox.state_space(train, input="command", output="depth", order=2)
print(f"State space of order 2: G(s) = {states.transfer()}")

figures = {
    "calibration": calibration.plot(),
    "steady_map": steady.plot(),
    "transfer": plot_responses(),
    "blackbox": model.plot(unseen),
}
for name, figure in figures.items():
    figure.savefig(output_folder() / f"aras_{name}.png", dpi=80)
