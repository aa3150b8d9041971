"""A campaign over a fleet
=======================

A campaign: the thrusters of a fleet, fitted in one command; which of them differs?

Eight thrusters were run through the same steps. Their logs are simulated here, with the noise of a
speed sensor; one propeller is fouled, and one log has a line that got damaged. Each thruster
has a folder with a log and a spec, as recorded data would. The campaign fits them all on two
processes, puts a row for each into a table, the broken log among them, and goes on where it was if
it is stopped: run a second time, it has one spec left to try.

The same from a shell: ``diffthrust campaign FOLDER --output RESULTS``; on a Dask cluster:
``--cluster tcp://ADDRESS:8786``.

    python examples/campaign.py [FOLDER FOR FIGURE, LOGS AND RESULTS]
"""

import numpy as np
import pandas as pd
from _data import output_folder
from matplotlib.figure import Figure

import diffthrust as dft

SPEC = """
model = "thruster"
[logs]
train = ["steps.csv"]
time = "t"
[channels]
command = { column = "u", unit = "V" }
speed = { column = "n", unit = "rad/s" }
[parameters]
alpha = 0.03
beta = 50.0
ct = { value = 0.02, fixed = true }
"""

folder = output_folder()
fleet, results = folder / "fleet", folder / "fleet_results"
rng = np.random.default_rng(1)
time = np.arange(600) * 0.05
steps = np.repeat([0.8, -0.8, 1.5, -1.5, 0.4, -0.4], 100)
for number in range(1, 9):
    alpha = 0.037 * rng.normal(1, 0.01) * (1.3 if number == 6 else 1.0)
    plant = dft.Thruster(alpha=alpha, beta=42.0 * rng.normal(1, 0.01))
    log = dft.Log(time=time, inputs={"command": steps}, measured={"speed": 0 * time})
    speed = dft.simulate(plant, log)["speed"] + rng.normal(0, 0.3, time.size)
    place = fleet / f"thruster{number}"
    place.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame({"t": time, "u": steps, "n": speed}).to_csv(index=False)
    (place / "steps.csv").write_text(table.replace("\n15.0,", "\n15.0,?") if number == 3 else table)
    (place / "fit.toml").write_text(SPEC)

done = dft.many.campaign(fleet, output=results, jobs=2, time_limit=300)
print(done.report())

good = done.table.query("status == 'ok'")
typical = good["alpha"].median()
odd = good[(good["alpha"] / typical - 1).abs() > 0.1]
print(f"Out of line: {', '.join(odd['name'])}, its drag {odd['alpha'].iloc[0] / typical:.2f} times")

again = dft.many.campaign(fleet, output=results, jobs=2, time_limit=300)
print(f"Run again: {again.kept} of {len(again.rows)} were done before.")

figure = Figure(figsize=(7, 3.2), layout="constrained")
axes = figure.subplots()
axes.errorbar(good["name"], good["alpha"], 1.96 * good["alpha_std_error"], fmt="o", capsize=4)
axes.set_ylabel("alpha [1/rad], with 95 % interval")
axes.grid(axis="y", alpha=0.3)
figure.savefig(folder / "fleet.png", dpi=70)
print(f"Figure: {folder / 'fleet.png'}")
