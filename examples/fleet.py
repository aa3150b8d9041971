"""Outliers and drift in a fleet
=============================

A fleet of eight thrusters: which one is fouled, which drifts, and what two short logs can say.

All logs are simulated, four dives of most vehicles over a season. The propeller of "auv3" is
fouled, the load of "auv5" grows from dive to dive, and the command of "auv2" has a dead band that
the model lacks. Of "auv6" and "auv7" there are a few seconds at small commands, from which the
parameters can hardly be told; pooled with the others, they can. Takes a minute or two.

    python examples/fleet.py [FOLDER FOR FIGURES]
"""

import numpy as np
from _data import output_folder

import diffthrust as dft
from diffthrust.effects import CommandDeadband

DATES = ["2026-04-10", "2026-05-22", "2026-07-03", "2026-08-14"]
NOISE = {"speed": 2.0, "thrust": 3.0}
rng = np.random.default_rng(12)


def dive(model: dft.Model, name: str, samples: int, size: float) -> dft.Log:
    """A log under steps of the command, every two seconds another."""
    time = 0.05 * np.arange(samples)
    command = np.repeat(rng.uniform(-size, size, samples // 40 + 1), 40)[:samples]
    clean = dft.simulate(model, dft.Log(time, {"command": command}), initial={"speed": 0.0})
    measured = {n: clean[n] + s * rng.standard_normal(samples) for n, s in NOISE.items()}
    return dft.Log(time, {"command": command}, measured, name=name)


logs, vehicles, dates, truth = [], [], [], {}
for i in range(8):
    vehicle = f"auv{i}"
    own = {"alpha": 0.037, "beta": 42.0, "ct": 0.019}
    own = {name: value * np.exp(0.08 * rng.standard_normal()) for name, value in own.items()}
    if vehicle == "auv3":  # growth on the blades: more load, less thrust
        own["alpha"], own["ct"] = 0.037 * 1.6, 0.019 * 0.8
    truth[vehicle] = own
    little = vehicle in ("auv6", "auv7")
    for k, date in enumerate(DATES[-1:] if little else DATES):
        grown = 1.0 + (0.06 * k if vehicle == "auv5" else 0.0)
        model = dft.Thruster().replace({**own, "alpha": own["alpha"] * grown})
        if vehicle == "auv2":
            model = model + CommandDeadband(half_width=0.3)
        size, samples = (0.5, 100) if little else (3.0, 1200)
        logs.append(dive(model, f"{vehicle}/{date}", samples, size))
        vehicles.append(vehicle)
        dates.append(date)

# Each dive twice, with the dead band and without; the better one by Schwarz's criterion is kept.
plain = dft.many.fit(dft.Thruster(), logs)
banded = dft.many.fit(dft.Thruster() + "command_deadband", logs)
fits = {}
for log, vehicle, one, other in zip(logs, vehicles, plain, banded, strict=True):
    price = 0.5 * np.log(2 * len(log)) * (len(other.free) - len(one.free))
    better = other if other.log_likelihood - one.log_likelihood > price else one
    fits.setdefault(vehicle, []).append(better)

fleet = dft.many.fleet(fits, time=dates)
print(fleet.report())
print(fleet.drift().query("drifts").to_string())
fleet.plot_spread().savefig(output_folder() / "fleet_spread.png", dpi=90)
fleet.plot_drift().savefig(output_folder() / "fleet_drift.png", dpi=90)
fleet.plot_effects().savefig(output_folder() / "fleet_effects.png", dpi=90)

short = {log.name.split("/")[0]: log for log in logs if len(log) < 1000}
pooled = fleet.pool(["alpha", "beta", "ct"], logs=short)
print(pooled.report())
pooled.plot().savefig(output_folder() / "fleet_pooled.png", dpi=90)

print(f"{'':16}{'truth':>10}{'by itself':>12}{'pooled':>10}")
for row in pooled.table.query("likelihood == 'exact'").itertuples():
    true = truth[row.vehicle][row.parameter]
    print(f"{row.vehicle} {row.parameter:11}{true:10.4g}{row.separate:12.4g}{row.median:10.4g}")

print("\nPriors for the next vehicle:")
for name, prior in pooled.predict_new().items():
    print(f"{name:6} {prior.mean:.4g} +- {prior.std:.2g}")
print(f"Figures: {output_folder()}")
