"""Effects in a static map of a T200
=================================

A static map of a thruster over six supply voltages: which effects does it take?

The maker of the T200 gives speed and thrust over the pulse width of the command at 10 to 20 V. The
basic thruster knows no supply; effects are added one at a time, in the order in which a diagnosis
of these tables asks for them. Each model is fitted to four voltages and tried on two that it has
not seen, 14 V inside their range and 20 V outside it. The tables go in as staircases whose steps
last until the thruster has settled; they tell nothing of how fast it does, so ``alpha`` is held.
Out come the errors of thrust and speed, and a figure of the maps. Takes half a minute. Data: Blue
Robotics, T200 public performance data 10-20 V, September 2019.

    python examples/t200_map.py [FOLDER FOR THE FIGURE]
"""

from functools import partial

import numpy as np
from _data import output_folder, runs_of
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

import diffthrust as dft

UNSEEN = "14V", "20V"
RPM = 60.0 / (2.0 * np.pi)
PARTS = (
    dft.effects.LinearDamping(rate=40.0),  # back-EMF: the term that a speed law of V needs
    dft.effects.SupplyVoltageSag(nominal=16.0),  # a command of 16 V is full drive
    dft.effects.CommandDeadband(),
    dft.effects.ReverseThrustAsymmetry(),
)

sheets = runs_of(partial(dft.datasets.t200, held=0.25)).logs
train = [log for name, log in sheets.items() if name not in UNSEEN]
unseen = [sheets[name] for name in UNSEEN]
model = dft.Thruster(alpha=0.1, beta=600.0, ct=3.5e-4).fix("alpha")
fits = [dft.fit(model, train, starts=2, substeps=16)]
for effect in PARTS:
    model = fits[-1].model + effect
    fits.append(dft.fit(model, train, starts=2, substeps=16))

heads = [f"{name}, {unit}" for name in ("fitted", *UNSEEN) for unit in ("N", "rpm")]
table = Table("RMSE of thrust and speed", *heads)
for fit in fits:
    row = [dft.compare(fit, logs).errors.channels for logs in (train, *unseen)]
    cells = [x for e in row for x in (f"{e['thrust'].rmse:.2f}", f"{e['speed'].rmse * RPM:.0f}")]
    added = fit.model.effects
    table.add_row(f"+ {added[-1].name}" if added else "basic thruster", *cells)
Console(width=120).print(table)
print(fits[-1].report())
low, high = (sheets[name].measured["speed"][1:] for name in ("18V", "20V"))
slower = np.abs(high) < np.abs(low)
print(f"At {slower.sum()} of {slower.size} points the table of 20 V shows a lower speed than that "
      "of 18 V: no law of the supply makes that, and no model here follows it.")  # fmt: skip

figure = Figure(figsize=(11.0, 7.0), layout="constrained")
panels = figure.subplots(1, 2, sharey=True)
for axes, fit, title in zip(panels, (fits[0], fits[-1]), ("basic", "with effects"), strict=True):
    for k, (name, log) in enumerate(sheets.items()):
        command, drive = log.inputs["command"][:-1], 400.0 / 16.0
        colour = f"C{k}"
        axes.plot(1500 + drive * command[::6], log.measured["thrust"][1::6], "o", ms=3.5,
                  color=colour, mfc="none" if name in UNSEEN else colour)  # fmt: skip
        label = f"{name}, unseen" if name in UNSEEN else name
        axes.plot(1500 + drive * command, dft.simulate(fit.model, log)["thrust"][1:],
                  color=colour, lw=1.0, label=label)  # fmt: skip
    axes.set(title=f"Thruster, {title} (points: table)", xlabel="pulse width [µs]")
panels[0].set_ylabel("thrust [N]")
panels[1].legend(frameon=False)
figure.savefig(output_folder() / "t200_map.png", dpi=100)
print(f"Figure: {output_folder() / 't200_map.png'}")
