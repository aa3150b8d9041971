"""Ready layouts: every number has a source and a mark, and they move as they should."""

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError
from diffthrust.layouts import Fact, Layout, layout_named

READY = ("bluerov2", "bluerov2_heavy", "blueboat", "otter", "twin_azimuth_ferry", "jason_jr")


@pytest.mark.parametrize("name", READY)
def test_every_number_has_a_source_and_a_mark(name):
    layout = layout_named(name)
    craft = layout.craft()
    told = {n for fact in layout.facts for n in fact.values}
    assert "places" in told
    owner = next(iter(craft.actuators))
    for parameter, value in layout.values.items():
        full = parameter if parameter in craft.parameters else f"{owner}.{parameter}"
        assert craft.parameters[full].value == value
    free = {n.rpartition(".")[2] for n, p in craft.parameters.items() if not p.fixed}
    assert free <= told, free - told  # a number that a fit would move is of a source
    report = " ".join(layout.report().split())
    assert all(fact.mark in report for fact in layout.facts)


@pytest.mark.parametrize(
    ("name", "pushing", "moved"),
    [
        ("bluerov2_heavy", "<<11----", "north"),
        ("bluerov2", "----++", "depth"),
        ("blueboat", "+0", "yaw_rate"),
        ("otter", "++", "north"),
    ],
)
def test_crafts_of_layouts_move_where_their_thrusters_push(name, pushing, moved):
    craft = layout_named(name).craft()
    time = 0.05 * np.arange(41)
    full = 60.0 if craft.command == "rad/s" else 0.3
    strength = {"+": full, "1": full, "<": -full, "0": 0.0, "-": 0.0}
    inputs = {n: np.full(41, strength[c]) for n, c in zip(craft.inputs, pushing, strict=True)}
    out = dft.simulate(craft, dft.Log(time, inputs, units=dict(craft.inputs)))
    assert out[moved][-1] > 0.01


def test_an_otter_has_the_equations_of_its_source():
    """Its centre of mass stood at that of the hull alone, as if the added mass were there, too."""
    hull, ahead, (u, v, r) = 55.0, 0.2, (0.8, -0.3, 0.4)
    about_origin = hull * (0.5**2 + ahead**2)
    m11, m22, m26 = hull + 5.3, hull + 1.5 * hull, hull * ahead
    m66 = about_origin + hull * ahead**2 + 1.7 * about_origin
    mass = np.array([[m11, 0.0, 0.0], [0.0, m22, m26], [0.0, m26, m66]])
    across = m22 * v + m26 * r
    turning = np.array([-across * r, m11 * u * r, across * u - m11 * u * v])
    damping = np.array([24.4 * 9.81 / 3.086 * u, m22 * v, m66 * r])
    port, starboard = 0.01108 * 80.0**2, -0.006445 * 50.0**2
    pushed = np.array([port + starboard, 0.0, 0.395 * (port - starboard)])
    craft = layout_named("otter").craft()
    motion = {"surge": u, "sway": v, "yaw_rate": r}
    commands = {"port.command": 80.0, "starboard.command": -50.0}
    s = dft.models.Signals({**dict.fromkeys(craft.states, 0.0), **motion, **commands, "time": 0.0})
    rates, _ = craft.equations(s, dft.models.Ports((), s))
    expected = np.linalg.solve(mass, pushed - turning - damping)
    np.testing.assert_allclose([rates[name] for name in motion], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "frame"), [("bluerov2", "vectored"), ("bluerov2_heavy", "vectored_6dof")]
)
def test_the_factors_of_the_autopilot_are_the_senses_of_a_layout(name, frame):
    """Each motor's force and moment have the sign of each factor of its frame."""
    layout, mixer = layout_named(name), dft.layouts.ardusub_mixer(frame)
    for (place, direction), factors in zip(
        layout.places.values(), mixer.factors.values(), strict=True
    ):
        wrench = np.array([*direction, *np.cross(place, direction)])
        asked = np.array(factors) != 0
        np.testing.assert_array_equal(np.sign(wrench[asked]), np.sign(np.array(factors)[asked]))


def test_names_and_models_of_the_thrusters_can_be_others():
    craft = dft.layouts.BLUEBOAT.craft(dft.SpeedLoopThruster(), names=("left", "right"))
    assert list(craft.inputs) == ["left.command", "right.command"]
    assert "left.time_constant" in craft.parameters
    assert craft.actuators["left"].place == (-0.35, -0.285, 0.0)


def test_what_is_no_layout_is_refused():
    with pytest.raises(InputError, match=r"'bluerov' is not known.*bluerov2"):
        layout_named("bluerov")
    with pytest.raises(InputError, match="names of 2 thrusters, found 3"):
        dft.layouts.OTTER.craft(names=("a", "b", "c"))
    with pytest.raises(InputError, match="expected a mark"):
        Fact({"m11": 3.0}, "guessed", "nobody")  # pyright: ignore[reportArgumentType]


def test_a_drawing_shows_every_thruster_from_two_sides():
    figure = dft.layouts.BLUEROV2_HEAVY.craft().plot()
    for panel in figure.axes:
        words = ", ".join(text.get_text() for text in panel.texts)
        assert all(f"t{k}" in words for k in range(1, 9))
        assert "CG" in words
    assert isinstance(dft.layouts.FERRY, Layout)
