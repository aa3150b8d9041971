"""What holds for any body and any numbers: energy, frames, dissipation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import craft as reference
from scipy.spatial.transform import Rotation

import diffthrust as dft
from diffthrust.bodies import Axis, FourDegrees, Heave, Planar, Six, SixDegrees
from diffthrust.models import Ports, Signals
from diffthrust.models._craft import attitude  # private: the frames alone

BODIES = (Axis, Heave, Planar, FourDegrees, SixDegrees)
VELOCITIES = {
    "axis": ("velocity",),
    "heave": ("heave",),
    "planar": ("surge", "sway", "yaw_rate"),
    "four_degrees": ("surge", "sway", "heave", "yaw_rate"),
    "six_degrees": reference.AXES,
}
RNG = np.random.default_rng(5)


def undamped(body: dft.bodies.Body, **centre: float) -> dft.Craft:
    """A craft that nothing slows down or holds upright."""
    craft = neutral(dft.Craft(body))
    damping = [n for n in craft.parameters if n == "drag" or (n[0] in "dq" and n[1:].isdigit())]
    still = {"value": 0.0, "transform": "linear"}
    return craft.replace({**dict.fromkeys(damping, still), **centre})


def neutral(craft: dft.Craft) -> dft.Craft:
    """Without weight and buoyancy."""
    return craft.replace({n: 0.0 for n in ("weight", "buoyancy") if n in craft.parameters})


def random_state(craft: dft.Craft) -> dict[str, float]:
    return {name: float(RNG.normal()) for name in craft.states}


def accelerations(craft: dft.Craft, state: dict) -> np.ndarray:
    s = Signals({"time": 0.0, **state})
    rates, _ = craft.equations(s, Ports((), s))
    return np.array([float(rates[name]) for name in VELOCITIES[craft.body.name]])


def inertia(craft: dft.Craft, state: dict) -> np.ndarray:
    """The mass matrix: what force along each axis gives accelerations of one, by its inverse."""
    names = VELOCITIES[craft.body.name]
    axes = [n.removesuffix("_rate").replace("velocity", "surge") for n in names]

    def pushed(forces: jax.Array) -> jax.Array:
        s = Signals({"time": 0.0, **state})
        port = Ports((), s)
        body = craft.body._bound({k: getattr(craft, k) for k in craft.body._parameters})
        six = Six(**{axis: forces[k] for k, axis in enumerate(axes)})
        rates, _ = body.equations(s, port, body.motion(s, port), six)
        return jnp.stack([jnp.asarray(rates[name], float) for name in names])

    return np.linalg.inv(np.asarray(jax.jacfwd(pushed)(jnp.zeros(len(names)))))


def draws(craft: dft.Craft, count: int = 20):
    """The craft at wild values of its parameters, within their bounds."""
    for _ in range(count):
        values = {}
        for name, p in craft.parameters.items():
            size = abs(p.value) or 1.0
            value = size * np.exp(RNG.normal()) if p.limits[0] >= 0 else RNG.normal()
            values[name] = {"value": float(value)}
        yield craft.replace(values)


@pytest.mark.parametrize("cls", BODIES)
def test_mass_is_symmetric_and_positive_definite_whatever_the_search_does(cls):
    for craft in draws(dft.Craft(cls())):
        mass = inertia(craft, random_state(craft))
        np.testing.assert_allclose(mass, mass.T, atol=1e-9 * np.abs(mass).max())
        assert np.linalg.eigvalsh(0.5 * (mass + mass.T)).min() > 0


@pytest.mark.parametrize("cls", BODIES)
def test_coriolis_forces_do_no_work(cls):
    for craft in draws(undamped(cls())):
        craft = undamped(cls(), **{n: getattr(craft, n) for n in craft.parameters if n[0] in "mix"})
        state = random_state(craft)
        v = np.array([state[name] for name in VELOCITIES[craft.body.name]])
        power = v @ inertia(craft, state) @ accelerations(craft, state)
        scale = v @ inertia(craft, state) @ v * np.abs(v).max()
        assert abs(power) < 1e-11 * scale


@pytest.mark.parametrize("cls", BODIES)
def test_damping_takes_energy_whatever_the_search_does(cls):
    for craft in draws(dft.Craft(cls())):
        craft = neutral(craft)
        state = random_state(craft)
        v = np.array([state[name] for name in VELOCITIES[craft.body.name]])
        assert v @ inertia(craft, state) @ accelerations(craft, state) < 0


@pytest.mark.parametrize("cls", [Planar, FourDegrees, SixDegrees])
def test_without_damping_the_energy_stays(cls):
    centre = {"x_g": 0.1} if cls is not SixDegrees else {"x_g": 0.05, "y_g": -0.03, "z_g": 0.1}
    craft = undamped(cls(), **centre)
    names = VELOCITIES[craft.body.name]
    start = {name: 0.4 * (-1) ** k for k, name in enumerate(names)}
    time = 0.1 * np.arange(201)
    out = dft.simulate(craft, dft.Log(time, {}), initial=start, substeps=16)
    v = np.array([out[name] for name in names])
    energy = 0.5 * np.einsum("it,ij,jt->t", v, inertia(craft, random_state(craft)), v)
    assert np.ptp(v[-1]) > 1e-3  # it tumbles
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


@pytest.mark.parametrize("cls", BODIES)
def test_without_thrust_the_energy_falls_all_the_time(cls):
    craft = neutral(dft.Craft(cls()))
    names = VELOCITIES[craft.body.name]
    time = 0.1 * np.arange(101)
    start = {name: 0.5 * (-1) ** k for k, name in enumerate(names)}
    out = dft.simulate(craft, dft.Log(time, {}), initial=start)
    v = np.array([out[name] for name in names])
    energy = 0.5 * np.einsum("it,ij,jt->t", v, inertia(craft, random_state(craft)), v)
    assert np.all(np.diff(energy) < 0)


def test_a_vehicle_is_held_upright_by_its_metacentric_height():
    craft = dft.Craft(SixDegrees(z_g=0.05, weight=100.0, buoyancy=100.0))
    time = 0.1 * np.arange(301)
    upright = craft.start_from({"roll": 0.5, "pitch": 0.3})
    out = dft.simulate(craft, dft.Log(time, {}), initial=dict(upright))
    assert abs(out["roll"][-1]) < 0.02 > abs(out["pitch"][-1])
    turned = craft.replace(z_g=-0.05)
    out = dft.simulate(turned, dft.Log(time, {}), initial=dict(upright))
    assert abs(out["roll"][-1]) > 2.0


def test_frames_there_and_back():
    for roll, pitch, heading in RNG.uniform(-1.5, 1.5, (30, 3)):
        q = attitude.from_angles(roll, pitch, heading)
        np.testing.assert_allclose(attitude.angles(q), (roll, pitch, heading), atol=1e-12)
        w, *xyz = q
        rotation = Rotation.from_quat([*xyz, w]).as_matrix()
        np.testing.assert_allclose(
            rotation, reference.rotation_of(roll, pitch, heading), atol=1e-12
        )
        vector = tuple(RNG.normal(size=3))
        np.testing.assert_allclose(attitude.to_world(q, vector), rotation @ vector, atol=1e-12)
        np.testing.assert_allclose(attitude.down(q), rotation.T @ [0, 0, 1], atol=1e-12)


def test_a_pitch_of_a_right_angle_is_no_place_of_failure():
    q = attitude.from_angles(0.0, np.pi / 2, 0.0)
    assert np.isfinite(attitude.angles(q)).all()
    time = 0.05 * np.arange(101)
    looping = undamped(SixDegrees()).replace(z_g=0.0)
    out = dft.simulate(looping, dft.Log(time, {}), initial={"pitch_rate": 2.0}, substeps=8)
    assert np.isfinite(out["pitch"]).all()
    np.testing.assert_allclose(out["pitch_rate"], 2.0, rtol=1e-9)
