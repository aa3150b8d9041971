"""Open-loop verification of a boat
================================

Open-loop verification without gusts, and a table of a boat's parameters against its speed.

Siramdasu & Fahimi (2013, section 5) judge their model on those portions of open-loop records in
which no gust shows: straight runs that are straight, and arcs of constant radius. They also say
(section 3) that the parameters hold near one speed and have to be tabulated against it.

First, a simulated boat with their values runs straight and in an arc while gusts come and go that
nobody measures; out come the model's errors on the whole records and on the portions that
`undisturbed` cuts out. Then a boat whose drag grows with its speed is identified near four speeds;
out come the errors of each of the four and of their table on an unseen run from the slowest to the
fastest, and figures of both.

    python examples/papers_open_loop.py [FOLDER FOR THE FIGURES]
"""

import numpy as np
from _data import output_folder
from matplotlib.figure import Figure

import diffthrust as dft
from diffthrust import effects, papers

BOAT = dft.Vessel()
GUSTY = BOAT + effects.Wind(along=0.02, across=0.04, turning=0.02, direction=0.0)
DRAGGED = BOAT.replace(d11=1.5) + effects.QuadraticSurgeDrag(drag=3.0)
SPEEDS, STEP = (5.0, 20.0, 80.0, 320.0), 0.1
UNITS = {"propeller_speed": "rev/s", "rudder_angle": "rad"}
MEASURED = {"surge": "m/s", "sway": "m/s", "yaw_rate": "rad/s"}


def record(boat: dft.Model, n: np.ndarray, angle: np.ndarray, seed: int, **wind) -> dft.Log:
    """A run from rest with 0.01 m/s and rad/s of noise; wind is not in its log."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(n.size)
    inputs = {"propeller_speed": n, "rudder_angle": angle}
    found = dft.simulate(boat, dft.Log(time, {**inputs, **wind}, units=UNITS))
    measured = {c: found[c] + 0.01 * rng.standard_normal(n.size) for c in MEASURED}
    name = "turning" if angle.any() else "straight"
    return dft.Log(time, inputs, measured, {**UNITS, **MEASURED}, name=name)


def zigzag(samples: int, period: float, degrees: float = 6.0) -> np.ndarray:
    time = STEP * np.arange(samples)
    return np.radians(degrees) * np.sign(np.sin(2.0 * np.pi * time / period))


def gusts() -> list[dft.Log]:
    """90 s straight and 90 s in an arc; two gusts of 8 s each."""
    time = STEP * np.arange(900)
    blowing = sum(np.exp(-(((time - t) / 3.0) ** 2)) for t in (30.0, 65.0))
    wind = {"wind_speed": 4.0 * blowing, "wind_direction": np.full(900, 1.2)}
    return [record(GUSTY, np.full(900, 98.0), np.full(900, np.radians(a)), i, **wind)
            for i, a in enumerate((0.0, 12.0))]  # fmt: skip


def main() -> None:
    folder, logs = output_folder(), gusts()
    parts = papers.undisturbed(logs)
    for name, those in (("whole records", logs), ("portions without gusts", parts)):
        found = dft.compare(BOAT, those).errors.channels
        errors = ", ".join(f"{c} {e.rmse:.3f} {MEASURED[c]}" for c, e in found.items())
        print(f"{name}, {sum(log.duration for log in those):.0f} s: RMSE {errors}")
    dft.compare(BOAT, parts).plot().savefig(folder / "siramdasu_portions.png", dpi=80)

    near = {}
    for seed, n in enumerate(SPEEDS):
        around = n * (1.0 + zigzag(800, 13.0, 11.5))
        log = record(DRAGGED, around, zigzag(800, 9.0), seed).slice(15.0, None)
        speed = float(np.mean(log.measured["surge"]))
        near[speed] = dft.fit(BOAT.fix("exponent"), log).model
        print(f"near {speed:.2f} m/s (n = {n:g} rev/s): d11 = {near[speed].d11:.2f}")
    table = papers.TabulatedVessel(list(near), list(near.values()))
    course = np.interp(np.arange(1200), [0, 200, 600, 1000, 1200], [5, 5, 320, 20, 80])
    unseen = record(DRAGGED, course, zigzag(1200, 11.0), seed=9)
    models = {**{f"identified near {u:.2f} m/s": v for u, v in near.items()}, "table": table}
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(unseen.time, unseen.measured["surge"], color="0.7", label="measured")
    for name, model in models.items():
        print(f"{name}: NRMSE {dft.compare(model, unseen).errors.nrmse:.3f} on the unseen run")
        axes.plot(unseen.time, dft.simulate(model, unseen)["surge"], linewidth=1.0, label=name)
    axes.set(xlabel="time [s]", ylabel="surge [m/s]")
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(folder / "siramdasu_table.png", dpi=80)


if __name__ == "__main__":
    main()
