"""Step by step or all at once, on measured runs
=============================================

The identification of a vessel step by step and all at once, on measured runs of two vessels.

Siramdasu & Fahimi (2013) read one ratio after the other from planned runs: straight at several
propeller speeds, then circles. Nobody planned the runs of these two vessels so. `manoeuvres` sorts
them into straight portions, steady or accelerating, and turns, and where the paper's lines cannot
be drawn through them the same steps are made by fits: surge alone on the straight portions, then
the yaw rate alone in the turns, as if the hull had no moment of its own (m22 = m11), then the sway,
each with the earlier values held. Against it stands one `dft.fit` of all runs. Both are simulated
over whole unseen runs. The BlueBoat's left and right forces are exchanged here: as they are, it
turns against them (`dft.compare` says so in `blueboat.py`). What comes out: the tanker is foreseen
better by the one fit in every channel; of the boat the one fit foresees the turning better and the
surge worse, and neither its sway. The standard errors allow for residuals that last (`sandwich`):
they are wide, most for the tanker, whose ratios all share the scale of n^exponent. Takes two
minutes. Data: Miyauchi et al. 2022, doi 10.1007/s00773-022-00889-3, Wakita et al. 2022, doi
10.1007/s00773-021-00867-1, and J. Kristiansen, BlueBoatSystemIdentification.

    python examples/papers_on_measured.py
"""

from _data import runs_of
from rich.console import Console
from rich.table import Table

import diffthrust as dft
from diffthrust.papers import manoeuvres, siramdasu

LATERAL = ("i33", "d33"), ("m22", "d22")


def only(log: dft.Log, channel: str, **inputs: object) -> dft.Log:
    """One measured channel of a log, with some inputs put in place of its own."""
    inputs = {**log.inputs, **inputs}
    units = {name: log.units[name] for name in (channel, *inputs)}
    return dft.Log(log.time, inputs, {channel: log.measured[channel]}, units, hold=log.hold)


def straight_on(log: dft.Log) -> dft.Log:
    """Surge alone, and nothing that steers."""
    if "rudder_angle" in log.inputs:
        return only(log, "surge", rudder_angle=0.0 * log.time)
    mean = (log.inputs["left_force"] + log.inputs["right_force"]) / 2.0
    return only(log, "surge", left_force=mean, right_force=mean)


def exchanged(log: dft.Log) -> dft.Log:
    inputs = {"left_force": log.inputs["right_force"], "right_force": log.inputs["left_force"]}
    return dft.Log(log.time, inputs, log.measured, log.units, name=log.name)


def step_by_step(vessel: dft.Model, parts: dft.papers.Manoeuvres) -> dft.Model:
    free = [name for name, p in vessel.parameters.items() if not p.fixed]

    def step(present: dft.Model, names: tuple[str, ...], logs: list[dft.Log]) -> dft.Model:
        held = present.fix(*free).free(*names)
        return dft.fit(held, logs, initial="measured", starts=4).model.free(*free)

    along = tuple(name for name in ("m11", "d11", "exponent") if name in free)
    fitted = step(vessel, along, [straight_on(log) for log in parts.steady + parts.accelerating])
    m11, d11 = (fitted.parameters[name].value for name in ("m11", "d11"))
    fitted = fitted.replace(m22=m11, d22=5.0 * d11)
    fitted = step(fitted, LATERAL[0], [only(log, "yaw_rate") for log in parts.turning])
    return step(fitted, LATERAL[1], list(parts.turning))


def told(name: str, vessel: dft.Vessel, train: list, unseen: list, **how: float) -> None:
    parts, console = manoeuvres(train, **how), Console(width=100)
    print(f"{name}, portions of the training runs: {parts.summary}.")
    if vessel.drive == "propeller":  # the paper's vessel; twin thrusters it does not treat
        try:
            siramdasu.sequential(parts.steady, parts.turning)
        except dft.InputError as error:
            print(f"The paper's lines cannot be drawn: {error.problem}")
    sequence = step_by_step(vessel, parts)
    fit = dft.fit(vessel, train, starts=4)
    errors = dft.uncertainty.sandwich(fit, train).std_errors
    table = Table(name, "step by step", "all at once", "std error", "unit")
    for key in fit.free:
        value = fit.parameters[key]
        table.add_row(key, f"{sequence.parameters[key].value:.4g}", f"{value.value:.4g}",
                      f"{errors[key]:.2g}", value.unit)  # fmt: skip
    before, after = (dft.compare(model, unseen).errors for model in (sequence, fit.model))
    for channel, e in after.channels.items():
        table.add_row(f"unseen NRMSE, {channel}", f"{before.channels[channel].nrmse:.3f}",
                      f"{e.nrmse:.3f}")  # fmt: skip
    table.add_row("unseen NRMSE, all", f"{before.nrmse:.3f}", f"{after.nrmse:.3f}")
    console.print(table)


tanker = runs_of(dft.datasets.esso_osaka, "zigzag*", "turn*")
train, unseen = ([log.averaged(5) for log in logs] for logs in (tanker.train, tanker.unseen))
told("esso_osaka", dft.Vessel(lever_arm=1.5), train, unseen,
     least=10.0, smoothing=5.0, steady=0.02)  # fmt: skip

boat = runs_of(dft.datasets.blueboat)
train, unseen = ([exchanged(log).averaged(2) for log in logs] for logs in (boat.train, boat.unseen))
vessel = dft.Vessel(drive="twin", lever_arm=0.285)
vessel = vessel.replace(m11=20.0, m22=20.0, i33=1.7, d11=30.0, d22=30.0, d33=5.0)
told("blueboat", vessel, train, unseen, least=3.0, straight=0.05, steady=0.05)
