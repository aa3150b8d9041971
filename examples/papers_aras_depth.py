"""A depth loop with the ranges of its sensor
==========================================

Aras et al. 2013: the open-loop record fitted, and the depth loop in time.

The paper switches 13 V on, records the depth sensor (figure 30), identifies G(s) from that, and
closes a proportional loop of gain 1 around it, with the ranges of sensor and motor (section 6.2).
The record is not printed; here it is what the printed G(s) answers, with 5 mV of noise. It is
fitted twice: as a sensor without end would have read it, and as the paper's own sensor does, from
0.2 to 4.9 V. That one misses the first swing the other way and where G(s) comes to rest, 14.8 V:
of the coefficients only ratios are left. With this sensor G(s) cannot have been read at 13 V.

The loop is run to readings of 3 V (the paper's 6.082 m) and of 13 V (its set point in real time),
and with a gain of 5, at which it swings between the ends of sensor and motor.

    python examples/papers_aras_depth.py [FOLDER FOR THE FIGURES]
"""

import numpy as np
from _data import output_folder
from matplotlib.figure import Figure
from printed.table_4 import table_4
from printed.transfer import step_response

import diffthrust as dft
from diffthrust.control import Step
from diffthrust.papers import aras

LOW, HIGH, SURFACE = 0.2, 4.9, 1.848


def ratios(p: dict) -> dict:
    return {"gain at rest": p["s0"] / p["p0"], "zero": -p["s0"] / p["s1"]}


time = np.arange(0.0, 15.0, 0.01)
since = time[time >= 1.0] - 1.0
answer = np.concatenate([np.zeros(100), step_response(aras.plant(), since, aras.SUPPLY)])
wide = SURFACE + answer + 0.005 * np.random.default_rng(0).standard_normal(time.size)
command, units = {"command": aras.SUPPLY * (time >= 1.0)}, {"command": "V", "reading": "V"}
records = {
    "without end": dft.Log(time, command, {"reading": wide}, units),
    "to 4.9 V": dft.Log(time, command, {"reading": np.clip(wide, LOW, HIGH)}, units,
                        rails={"reading": (LOW, HIGH)}),
}  # fmt: skip
for name, record in records.items():
    fit = dft.fit(aras.DepthPlant(), record)
    told = ", ".join(f"{n} {e.value:.4g} ± {e.std_error:.2g}" for n, e in fit.parameters.items())
    print(f"Open loop, sensor {name}: {told}")
    for what, ratio in dft.uncertainty.derived(fit, ratios, {"zero": "1/s"}).items():
        print(f"  {what} {ratio}")
print(
    f"Of the record the sensor to 4.9 V sees {100 * np.mean((wide > LOW) & (wide < HIGH)):.0f} %."
)

figure = Figure(figsize=(8.5, 3.4), layout="constrained")
axes = figure.subplots()
for (name, record), style in zip(records.items(), ("-", "--"), strict=True):
    axes.plot(time, record.measured["reading"], style, label=f"sensor {name}")
axes.set(xlabel="time [s]", ylabel="reading [V]")
axes.set_title("13 V from 1 s on: what G(s) answers, and what the sensor tells of it", loc="left",
               fontsize=10)  # fmt: skip
axes.legend(frameon=False)
figure.savefig(output_folder() / "aras_open_loop.png", dpi=100)

calibration = aras.calibrate(*table_4())
figure = Figure(figsize=(8.5, 6.0), layout="constrained")
for row, (gain, wanted) in zip(figure.subplots(3, 2, sharex=True), ((1, 3), (1, 13), (5, 3)),
                               strict=True):  # fmt: skip
    run = aras.depth_loop(float(gain)).simulate(Step(float(wanted)), 8.0)
    read, sent, late = run["measured.reading"], run["command"], run.time > 5.0
    ends = [f"{x[late].min():.2f} to {x[late].max():.2f} V" for x in (read, sent)]
    print(f"Gain {gain}, set point {wanted} V: reads {ends[0]}, voltage {ends[1]}")
    if gain == 1 and wanted == 3:
        there, meant = calibration.depth(read[-1]), calibration.depth(3.0)
        print(f"  by table 4 that is {there:.1f} m, where 3 V would be {meant:.1f} m")
    row[0].plot(run.time, run["reading"], color="0.6", label="depth, in volts")
    row[0].plot(run.time, read, label="sensor")
    row[0].axhline(wanted, color="black", linestyle="--", linewidth=0.9, label="set point")
    row[0].set(ylabel="reading [V]", title=f"gain {gain}, set point {wanted} V")
    row[1].plot(run.time, sent, color="#D55E00")
    for limit in (-aras.SUPPLY, aras.SUPPLY):
        row[1].axhline(limit, color="0.4", linestyle=":", linewidth=0.9)
    row[1].set(ylabel="thruster [V]", ylim=(-14.0, 14.0))
figure.axes[0].legend(frameon=False, fontsize=8)
for axes in figure.axes[4:]:
    axes.set_xlabel("time [s]")
figure.savefig(output_folder() / "aras_depth_loop.png", dpi=100)
