"""A thruster in the sizes of its duct
===================================

A thruster in the sizes of its duct: torque in, thrust and outflow out.

Yoerger, Cooke & Slotine (1990, section II) drive the model with a torque; figure 6 shows its steps
of 2, 1/3 and 1/4 N m as shares of where they end. Their rig (section III, figure 7) measured the
speed of the propeller, the thrust, and the velocity of the water that leaves the duct. Speed and
outflow tell the propeller's efficiency without a load cell: here a simulated rig with noise is
fitted to torque, speed and outflow alone, and its thrust is foretold. With the efficiency of 0.22
that the paper prints the foretold ct is 0.026 N s^2, not the 0.022 and 0.019 of its two tests.

    python examples/papers_yoerger_duct.py [FOLDER FOR THE FIGURE]
"""

import numpy as np
from _data import output_folder
from matplotlib.figure import Figure

import diffthrust as dft
from diffthrust.papers import lowpass_noise

STEP = 0.02
RIG = dft.DuctedThruster(efficiency=0.2, volume=0.016)
UNITS = {"command": "N m", "speed": "rad/s", "flow": "m/s"}
NOISE = {"speed": 0.5, "flow": 0.02}

figure, time = Figure(figsize=(6.5, 3.6), layout="constrained"), np.arange(0.0, 5.5, STEP)
axes = figure.subplots()
for torque, name in ((2.0, "2"), (1 / 3, "1/3"), (1 / 4, "1/4")):
    step = dft.Log(time, {"command": np.full(time.size, torque)}, units={"command": "N m"})
    end = 2.0 * torque / (RIG.efficiency * RIG.pitch)  # thrust at rest
    share = dft.simulate(RIG, step)["thrust"] / end
    axes.plot(time, share, label=f"{name} N m, to {end:.0f} N")
    print(f"Step of {name} N m: 63 % of {end:.1f} N after {np.interp(0.632, share, time):.2f} s")
axes.set(xlabel="time [s]", ylabel="thrust / steady thrust", ylim=(0.0, 1.05))
axes.set_title("Figure 6: the smaller the step, the slower", loc="left", fontsize=10)
axes.legend(frameon=False)
figure.savefig(output_folder() / "yoerger_figure_6.png", dpi=100)

time, torque = lowpass_noise(40.0, STEP, peak=2.0, seed=1)
true = dft.simulate(RIG, dft.Log(time, {"command": torque}, units={"command": "N m"}))
rng = np.random.default_rng(2)
measured = {n: true[n] + size * rng.standard_normal(time.size) for n, size in NOISE.items()}
log = dft.Log(time, {"command": torque}, measured, UNITS, name="torque, speed and outflow")
fit = dft.fit(dft.DuctedThruster(), log)
print(fit.report())
thrust = dft.simulate(fit.model, log)["thrust"]
off = np.sqrt(np.mean((thrust - true["thrust"]) ** 2)) / np.std(true["thrust"])
efficiency = fit.parameters["efficiency"]
ct = [RIG.density * RIG.area * (eta * RIG.pitch) ** 2 for eta in (efficiency.value, 0.22)]
print(f"Without a load cell: thrust within {100 * off:.2f} %; ct = {ct[0]:.4f} N s^2 "
      f"(true: {RIG.density * RIG.area * (RIG.efficiency * RIG.pitch) ** 2:.4f}). "
      f"The paper's efficiency of 0.22 would stand for {ct[1]:.4f}.")  # fmt: skip
