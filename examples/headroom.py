"""How much is there to find
=========================

How much is there to find? The headroom of the basic physics on five measured data sets.

`dft.diagnosis.headroom` asks what any model of moderate flexibility could explain of the errors
that the basic physics leaves on unseen runs: structure that repeats, whatever its form. Here each
basic model (no effects) is fitted to the training runs of a public data set, and a ladder of
black-box corrections, from a straight line to curves with memory, is learned on the same runs and
judged on the unseen ones. Out comes one table, and the words for each channel. Takes some 75 s of
processor time; records are averaged to a few samples a second where the vessel is slow. Sources:
see `dft.datasets.list()`.

    python examples/headroom.py
"""

from collections.abc import Sequence
from functools import partial

from _data import runs_of
from rich.console import Console
from rich.table import Table

import diffthrust as dft


def as_thrust(log: dft.Log) -> dft.Log:
    """The motor's force on the carriage is what drives the axis."""
    thrust = {"thrust": log.inputs["force"]}
    return dft.Log(log.time, thrust, log.measured, hold="linear", name=log.name).averaged(10)


def exchanged(log: dft.Log) -> dft.Log:
    """Left and right changed over: as they are, the boat turns against its forces."""
    inputs = {"left_force": log.inputs["right_force"], "right_force": log.inputs["left_force"]}
    return dft.Log(log.time, inputs, log.measured, name=log.name).averaged(5)


Case = tuple[str, dft.Model, Sequence[dft.Log], Sequence[dft.Log]]


def cases() -> list[Case]:
    found: list[Case] = []

    def add(name, model, train, unseen, prepared=lambda log: log):
        found.append((name, model, [prepared(g) for g in train], [prepared(g) for g in unseen]))

    bench = runs_of(dft.datasets.ngs_thruster, "CL*")
    add("ngs_thruster", dft.Thruster(), bench.train, bench.unseen)
    boat, vessel = runs_of(dft.datasets.blueboat), dft.Vessel(drive="twin", lever_arm=0.285)
    vessel = vessel.replace(m11=30.0, m22=50.0, i33=10.0, d11=30.0, d22=100.0, d33=30.0)
    add("blueboat", vessel, boat.train, boat.unseen, exchanged)
    tanker = runs_of(dft.datasets.esso_osaka, "zigzag*", "turn*")
    add("esso_osaka", dft.Vessel(lever_arm=1.5), tanker.train, tanker.unseen,
        lambda log: log.averaged(5))  # fmt: skip
    rail = runs_of(dft.datasets.emps)
    add("emps", dft.AxisVehicle(mass=100.0, drag=1000.0), rail.train, rail.unseen, as_thrust)
    # a static map as a staircase: what a correction remembers of it is the point before
    sheets = dict(runs_of(partial(dft.datasets.t200, held=0.25)).logs)
    unseen = [sheets.pop(name) for name in ("14V", "20V")]
    static = dft.Thruster(alpha=0.1, beta=600.0, ct=3.5e-4).fix("alpha")
    add("t200 (static)", static, list(sheets.values()), unseen)
    return found


heads = ["Physics, unseen NRMSE", "Flexible", "Share", "90 % interval", "Form"]
table = Table("Data set", "Channel", *heads, title="What a flexible model explains")
for name, model, train, unseen in cases():
    fit = dft.fit(model, train, starts=2)
    found = dft.diagnosis.headroom(fit, train, holdout=unseen)
    for channel, c in found.channels.items():
        table.add_row(name, channel, f"{c.physics:.3f}", f"{c.corrected:.3f}", f"{c.share:.0%}",
                      f"{c.low:.0%} to {c.high:.0%}", c.rung)  # fmt: skip
    print(f"{name} (fit: {fit.status.value}): {found.summary}")
Console(width=120).print(table)
