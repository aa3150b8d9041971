"""Intervals, posterior and predictions
====================================

How well does a log determine a thruster, and what follows from it with which uncertainty?

The thruster of the vehicle Jason: its parameters are sampled, and the efficiency, the involved
volume of water and the step response are worked out with the same draws. Beside the intervals
stand the figures that Yoerger, Cooke & Slotine (1990) print. The log under ``fits/jason_thruster``
is simulated, with alpha and beta of the paper's dynamic test and a ct between its two, so what the
intervals show is how much such a test can tell: far more than the printed figures agree among
themselves. The paper's text has an efficiency of 0.22, but the efficiency follows from ct, and its
own ct, 0.019 to 0.022 N s^2, gives 0.19 to 0.20. Its volume, 0.016 m^3, goes with the 0.22. Takes
half a minute.

    python examples/uncertainty.py [FOLDER FOR FIGURES]
"""

from pathlib import Path

from _data import output_folder

import diffthrust as dft
from diffthrust import Column

FOLDER = Path(__file__).resolve().parents[1] / "fits" / "jason_thruster"
PITCH, AREA, DENSITY = 0.101, 0.0527, 1000.0  # [m/rad], [m^2], [kg/m^3], section II of the paper
PAPER = {
    "alpha": "0.037 (dynamic test)",
    "beta": "42 (dynamic test)",
    "ct": "0.019 (dynamic test), 0.022 (static test)",
    "efficiency": "0.22",
    "volume": "0.016",
}


def read(name: str) -> dft.Log:
    return dft.read_log(
        FOLDER / name,
        time="t",
        inputs={"command": Column("u", unit="V")},
        measured={"speed": Column("rpm", unit="rpm"), "thrust": Column("thrust", unit="N")},
    )


train, unseen = read("train.csv"), read("holdout.csv")
fit = dft.fit(dft.Thruster(), train)
post = dft.sample(fit, train, draws=500, warmup=200)
print(post.attrs["message"])

parameters = {name: lambda p, name=name: p[name] for name in fit.free}
units = {name: estimate.unit for name, estimate in fit.parameters.items()}
found = dft.uncertainty.quantities(
    post, fit, pitch=PITCH, area=AREA, density=DENSITY, functions=parameters, units=units,
    commands=[0.5, 1, 2, 4, 8], steps=[0.5, 1, 2, 4, 8], amplitudes=[10, 20, 40], draws=2000,
)  # fmt: skip
print(found.report())

print(f"{'':12}{'95 % interval':26}paper")
for name, printed in PAPER.items():
    q = found[name]
    print(f"{name:12}{q.low:.5g} to {q.high:.5g} {q.unit}".ljust(46), printed)

for test, ct in {"dynamic": 0.019, "static": 0.022}.items():
    implied = (ct / (DENSITY * AREA * PITCH**2)) ** 0.5
    volume = AREA * implied * PITCH / (2 * 0.037)
    print(
        f"The paper's ct of its {test} test, {ct} N s^2, gives an efficiency of {implied:.3f}\n"
        f"and a volume of {volume:.4f} m^3; its text says 0.22 and 0.016."
    )

band = dft.predict(post, fit, unseen)
print(band.sentence)
published = {"paper, dynamic test": {"alpha": 0.037, "beta": 42.0, "ct": 0.019}}
dft.uncertainty.plot_corner(post, fit, published).savefig(
    output_folder() / "jason_corner.png", dpi=90
)
dft.uncertainty.plot_trace(post).savefig(output_folder() / "jason_trace.png", dpi=90)
found.plot().savefig(output_folder() / "jason_quantities.png", dpi=90)
band.plot().savefig(output_folder() / "jason_band.png", dpi=90)
print(f"Figures: {output_folder()}")
