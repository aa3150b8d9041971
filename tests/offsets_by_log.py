"""Logs of a straight line, each with an offset of its own, and fits of them."""

import numpy as np

import diffthrust as dft

NOISE = 0.1


def readings(rng, offsets, samples=40, noise=NOISE, known=True):
    """Logs of a slope of 0.2, of several lengths."""
    logs = []
    for k, offset in enumerate(offsets):
        depth = rng.uniform(0.0, 2.0, samples + 5 * k)
        reading = 0.2 * depth + offset + rng.normal(0.0, noise, depth.size)
        stated = {"noise": {"reading": noise}} if known else {}
        time = np.arange(float(depth.size))
        logs.append(dft.Log(time, {"depth": depth}, {"reading": reading}, name=f"run{k}", **stated))
    return logs


def fitted(logs, model=None, **options):
    return dft.fit(model or dft.LinearSensor(), logs, per_log=["offset"], starts=1, **options)
