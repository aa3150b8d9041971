"""Two hundred fits at once
========================

Two hundred thrusters fitted at once, one of them with a log that cannot be used.

Each thruster has parameters and a log of its own, of its own length. They are fitted one by one,
with several starts and all checks, while their simulations run side by side in one compiled
program. Out come a row for each, the spread of the fleet beside that of its truth, and the error
of the one log that is no log of a thruster. Takes about ten seconds.

    python examples/many_logs.py
"""

import numpy as np

import diffthrust as dft

rng = np.random.default_rng(0)


def record(i: int) -> tuple[dft.Log, float]:
    """A log of a thruster whose damping is its own, and that damping."""
    time = 0.05 * np.arange(1000)
    command = 1.5 * np.sin(np.cumsum(0.15 * rng.normal(size=time.size)))
    alpha = 0.03 * rng.lognormal(0.0, 0.1)
    plain = dft.Log(time, {"command": command})
    clean = dft.simulate(dft.Thruster(alpha=alpha, beta=40.0, ct=0.02), plain, substeps=2)
    measured = {
        "speed": clean["speed"] + 0.3 * rng.normal(size=time.size),
        "thrust": clean["thrust"] + 0.5 * rng.normal(size=time.size),
    }
    log = dft.Log(time, {"command": command}, measured, name=f"thruster {i}")
    return log.slice(0.0, rng.uniform(40.0, 50.0)), alpha


made = [record(i) for i in range(200)]
logs, truth = [log for log, _ in made], np.array([alpha for _, alpha in made])
wrong = logs[17]
logs[17] = dft.Log(
    wrong.time, {"current": wrong.inputs["command"]}, wrong.measured, name=wrong.name
)

fits = dft.many.fit(dft.Thruster(alpha=0.02, beta=30.0, ct=0.01), logs)
table = fits.table()
print(table[["name", "fit_status", "alpha", "alpha_std_error", "train_nrmse"]].head(5))
print(f"{len(fits)} members in {fits.wall:.1f} s, {len(fits.failed)} without a result:")
for name, error in fits.failed.items():
    print(f"- {name}: {error}")

away = (table["alpha"] - truth) / table["alpha_std_error"]
print(f"Spread of alpha over the fleet: {table['alpha'].std() / table['alpha'].mean():.1%}, "
      f"of the truth {truth.std() / truth.mean():.1%}.")  # fmt: skip
print(f"Errors in standard errors: root mean square {np.sqrt((away**2).mean()):.2f} (1 expected).")
