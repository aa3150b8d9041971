"""Each model's equations against the formulas of its docstring, written in NumPy.

What passes a port is changed there by a factor of that port, so that the formulas say where each
port stands, too. Points, inputs and parameters are generic: no zeros, no ones, both directions.
"""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust.models import MODELS, Relaxing, Signals

COUNT = 40


class Factors:
    """Ports that multiply what passes, each by a number of its own, and note what is told."""

    def __init__(self, names):
        self.of = {name: 1.3 + 0.17 * i for i, name in enumerate(sorted(names))}
        self.told = {}

    def __call__(self, port, value):
        return self.of[port] * value

    def tell(self, **signals):
        self.told |= signals


def drawn(model, seed=5):
    """The model at other values, signals of both directions, and what its equations give."""
    rng = np.random.default_rng(seed)
    model = model.replace(
        {name: p.value * rng.uniform(0.6, 1.5) for name, p in model.parameters.items() if p.value}
    )
    names = dict.fromkeys([*model.inputs, *model.states])
    values = {name: rng.normal(scale=1.7, size=COUNT) for name in names}
    s, port = Signals(values), Factors(model.ports)
    rates, outputs = model.equations(s, port)
    return model, s, port, rates, outputs


def agree(found, expected):
    assert set(found) == set(expected)
    for name, value in expected.items():
        given = found[name].rate if isinstance(found[name], Relaxing) else found[name]
        np.testing.assert_allclose(given, value, rtol=1e-12, err_msg=name)


def sized(x, exponent):
    return np.sign(x) * np.abs(x) ** exponent


def test_an_axis_vehicle():
    m, s, port, rates, outputs = drawn(dft.AxisVehicle())
    hull = port.of["hull"] * -m.drag * sized(s.velocity, 2)
    force = port.of["force"] * (s.thrust + hull)
    agree(rates, {"position": s.velocity, "velocity": force / m.mass})
    agree(outputs, {"position": s.position, "velocity": s.velocity})


def test_a_thruster():
    m, s, port, rates, outputs = drawn(dft.Thruster())
    drive = port.of["drive"] * m.beta * s.command
    load = port.of["load"] * m.alpha * sized(s.speed, 2)
    agree(rates, {"speed": port.of["shaft"] * (drive - load)})
    agree(outputs, {"speed": s.speed, "thrust": port.of["propeller"] * m.ct * sized(s.speed, 2)})


def test_a_ducted_thruster():
    m, s, port, rates, outputs = drawn(dft.models.DuctedThruster())
    beta = 1.0 / (m.density * m.volume * (m.efficiency * m.pitch) ** 2)
    alpha = m.area * m.efficiency * m.pitch / (2.0 * m.volume)
    ct = m.density * m.area * (m.efficiency * m.pitch) ** 2
    drive, load = port.of["drive"] * beta * s.command, port.of["load"] * alpha * sized(s.speed, 2)
    thrust, flow = port.of["propeller"] * ct * sized(s.speed, 2), m.efficiency * m.pitch * s.speed
    agree(rates, {"speed": port.of["shaft"] * (drive - load)})
    agree(outputs, {"speed": s.speed, "thrust": thrust, "flow": flow})


def test_a_speed_loop():
    m, s, port, rates, outputs = drawn(dft.SpeedLoopThruster())
    target = port.of["target"] * m.gain * sized(s.command, m.exponent)
    lag = port.of["loop"] * (target - s.speed) / m.time_constant
    agree(rates, {"speed": lag})
    assert rates["speed"].decay == pytest.approx(1.0 / m.time_constant, rel=1e-14)
    agree(outputs, {"speed": s.speed, "thrust": port.of["propeller"] * m.ct * sized(s.speed, 2)})


def test_a_motor():
    m, s, port, rates, outputs = drawn(dft.DCMotorThruster().replace(thrust_linear=0.0123))
    s = Signals({**s, "speed": 0.1 * s.speed})  # where dry friction bends
    rates, outputs = m.equations(s, port)
    drive = port.of["drive"] * m.torque_constant * s.current
    load = port.of["load"] * m.load * sized(s.speed, 2)
    friction = m.viscous * s.speed + m.coulomb * np.tanh(10.0 * s.speed)
    torque = port.of["shaft"] * (drive - friction - load)
    voltage = s.command - m.resistance * s.current - m.back_emf * s.speed
    thrust = m.thrust_linear * s.speed + m.thrust_quadratic * sized(s.speed, 2)
    agree(rates, {"current": voltage / m.inductance, "speed": torque / m.inertia})
    assert rates["current"].decay == pytest.approx(m.resistance / m.inductance, rel=1e-14)
    agree(
        outputs,
        {"speed": s.speed, "thrust": port.of["propeller"] * thrust, "current": s.current},
    )
    assert m.initial(s) == {}  # a motor at rest has no current: V / R would be 5 A at once


def test_a_linear_sensor():
    m, s, port, rates, outputs = drawn(dft.LinearSensor())
    assert rates == {}
    agree(outputs, {"reading": port.of["line"] * (m.slope * s.depth + m.offset)})


def driven_by(m, s, port):
    """Forces of a vessel's drive: ahead, aside, and the moment."""
    if m.drive == "propeller":
        n, angle = (port.of[k] * s[v] for k, v in PROPELLER)
        thrust = port.of["propulsion"] * sized(n, m.exponent)
        side = port.of["steering"] * thrust * np.sin(angle)
        return thrust * np.cos(angle), side, -m.lever_arm * side, thrust
    power = m.exponent if m.command == "effort" else 1.0
    left, right = sized(s.left_force, power), sized(s.right_force, power)
    return port.of["propulsion"] * (left + right), 0.0, m.lever_arm * (left - right), None


PROPELLER = (("revolutions", "propeller_speed"), ("rudder", "rudder_angle"))
VESSELS = {
    "propeller": dft.Vessel(),
    "jet by effort": dft.Vessel(command="effort"),
    "forces": dft.Vessel("twin"),
    "efforts": dft.Vessel("twin", command="effort", exponent=1.4),
}


@pytest.mark.parametrize("vessel", VESSELS.values(), ids=VESSELS)
def test_a_vessel(vessel):
    m, s, port, rates, outputs = drawn(vessel)
    f = port.of
    u, v, r = f["surge_through_water"] * s.surge, f["sway_through_water"] * s.sway, s.yaw_rate
    ahead, aside, moment, thrust = driven_by(m, s, port)
    surge = f["surge_force"] * (ahead + m.m22 * v * r - m.d11 * u)
    sway = f["sway_force"] * (aside - m.m11 * u * r - m.d22 * v)
    yaw = f["yaw_moment"] * (moment - (m.m22 - m.m11) * u * v - m.d33 * r)
    agree(
        rates,
        {
            "surge": f["surge_acceleration"] * surge / m.m11,
            "sway": f["sway_acceleration"] * sway / m.m22,
            "yaw_rate": f["yaw_acceleration"] * yaw / m.i33,
            "north": s.surge * np.cos(s.heading) - s.sway * np.sin(s.heading),
            "east": s.surge * np.sin(s.heading) + s.sway * np.cos(s.heading),
            "heading": r,
        },
    )
    agree(outputs, {name: s[name] for name in m.states})
    told = {
        "surge_through_water": u,
        "sway_through_water": v,
        "m22": m.m22,
        "i33": m.i33,
        "sway_alone": sway / m.m22,
        "yaw_alone": yaw / m.i33,
    }
    agree(port.told, told if thrust is None else {**told, "propulsion": thrust})


@pytest.mark.parametrize("model", [dft.SpeedLoopThruster(exponent=0.6), dft.Vessel()], ids=str)
def test_no_command_is_no_drive(model):
    rest = dict.fromkeys([*model.inputs, *model.states], np.zeros(3))
    rates, _ = model.equations(Signals(rest), Factors(model.ports))
    agree(rates, dict.fromkeys(model.states, np.zeros(3)))


@pytest.mark.parametrize("name", ["thruster", "ducted_thruster", "speed_loop_thruster"])
def test_where_the_log_gives_the_speed_nothing_is_integrated(name):
    model = MODELS[name]()
    full = model.equations(
        Signals({"speed": np.array([-2.3, 1.7]), "command": np.ones(2)}), Factors(model.ports)
    )
    rates, outputs = model.equations(
        Signals({"speed": np.array([-2.3, 1.7])}), Factors(model.ports)
    )
    assert rates == {}
    agree(outputs, full[1])
