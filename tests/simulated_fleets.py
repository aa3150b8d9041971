"""Fleets of simulated thrusters, drawn from a known law; some have little data, and gentle."""

import numpy as np

import diffthrust as dft

MEDIAN = {"alpha": 0.037, "beta": 42.0, "ct": 0.019}
SPREAD = 0.12
NOISE = {"speed": 3.0, "thrust": 4.0}
STEP = 0.05
RICH, SPARSE = 2000, 100


def drawn_fleet(seed, vehicles=10, sparse=3, spread=SPREAD):
    """True parameters and a log of each vehicle; the last ones have a twentieth of the data."""
    rng = np.random.default_rng([271, seed])
    truth, logs = [], []
    for i in range(vehicles):
        own = {n: v * np.exp(spread * rng.standard_normal()) for n, v in MEDIAN.items()}
        truth.append(own)
        logs.append(record(rng, own, f"auv{i}", little=i >= vehicles - sparse))
    return truth, logs


def record(rng, values, name, little=False):
    """Steps of the command every two seconds; those of a short log are small."""
    samples, size = (SPARSE, 0.4) if little else (RICH, 3.0)
    time = STEP * np.arange(samples)
    command = np.repeat(rng.uniform(-size, size, samples // 40 + 1), 40)[:samples]
    bare = dft.Log(time, {"command": command})
    clean = dft.simulate(dft.Thruster().replace(values), bare, initial={"speed": 0.0}, substeps=2)
    measured = {n: clean[n] + s * rng.standard_normal(samples) for n, s in NOISE.items()}
    return dft.Log(time, {"command": command}, measured, name=name)
