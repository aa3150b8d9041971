"""The audit of allocation against mechanics written anew, and its corrected factors."""

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError
from diffthrust.actuators import StaticThruster
from diffthrust.control import allocation
from diffthrust.layouts import AXES, Mixer, ardupilot_layout, ardusub_mixer, px4_layout
from tests.reference.allocation import mixed_forces, wrench

SIDES = ("port", "starboard")


def vehicle(frame=2.0, *, body=None, exponent=1.6, reverse=0.78, reaction=0.02, seed=1):
    """A ROV whose thrusters all differ, and what the reference needs of it."""
    rng = np.random.default_rng(seed)
    layout = ardupilot_layout({"FRAME_CONFIG": frame, "MOT_2_DIRECTION": -1.0})
    body = body or dft.bodies.SixDegrees(x_g=0.02, y_g=-0.01, z_g=0.03)
    names = list(layout.thrusters)
    places = {n: np.array(t.place) + rng.normal(0, 0.01, 3) for n, t in layout.thrusters.items()}
    mounts = {
        n: StaticThruster(reverse=reverse).at(places[n], t.pointing, reaction=reaction)
        for n, t in layout.thrusters.items()
    }
    strengths = rng.uniform(0.7, 1.2, len(names))
    craft = dft.Craft(body, share=[names], **mounts).replace(
        {"m1.gain": 50.0, "m1.exponent": exponent}
        | {f"{n}.strength": s for n, s in zip(names, strengths, strict=True)}
    )
    centre = [getattr(craft, n, 0.0) for n in ("x_g", "y_g", "z_g")]
    pointing = {n: np.array(t.pointing) for n, t in layout.thrusters.items()}
    wrenches = [
        wrench(places[n], pointing[n] / np.linalg.norm(pointing[n]), reaction, centre)
        for n in names
    ]
    wrenches = np.stack(wrenches, axis=1)
    same = np.ones(len(names))
    return craft, layout.mixer, wrenches, (50.0 * strengths, exponent * same, reverse * same)


def test_forces_are_those_of_the_mechanics():
    craft, mixer, wrenches, laws = vehicle()
    audit = allocation(craft, mixer, level=0.4)
    odd, even = mixed_forces(wrenches, laws, mixer.matrix, 0.4)
    assert audit.axes == AXES
    np.testing.assert_allclose(audit.forces, odd, atol=1e-9)
    np.testing.assert_allclose(audit.common, even, atol=1e-9)
    shares = audit.coupling()
    np.testing.assert_allclose(np.diag(shares), 1.0, atol=1e-12)
    np.testing.assert_allclose(shares[5, 0], odd[5, 0] / odd[5, 5], rtol=1e-9)
    # what is told is what is largest, and nothing is told that is below 2 %
    off = np.abs(shares - np.eye(6))
    row, column = np.unravel_index(np.argmax(off), off.shape)
    assert audit.findings[0].startswith(f"A {AXES[column]} command of 1 gives ")
    assert f"of {AXES[row]}" in audit.findings[0]
    assert len(audit.findings) == 9  # eight, and how many more
    assert f"And {int(np.sum(off > 0.02)) - 8} more." == audit.findings[-1]


def test_corrected_factors_of_linear_thrusters_are_the_nearest_that_do_it():
    craft, mixer, wrenches, laws = vehicle(exponent=1.0, reverse=1.0)
    audit = allocation(craft, mixer, level=0.7)
    acting = wrenches * laws[0]
    wanted = np.diag(np.diag(acting @ mixer.matrix))
    nearest = mixer.matrix + np.linalg.pinv(acting) @ (wanted - acting @ mixer.matrix)
    np.testing.assert_allclose(audit.corrected.matrix, nearest, atol=1e-8)
    np.testing.assert_allclose(audit.remaining, 0.7 * wanted, atol=1e-7)
    assert not allocation(craft, audit.corrected, level=0.3).findings


@pytest.mark.parametrize("exponent", [1.6, 2.0])
def test_corrected_factors_of_curved_thrusters_do_it_at_their_level(exponent):
    craft, mixer, wrenches, laws = vehicle(exponent=exponent)
    audit = allocation(craft, mixer, level=0.5)
    begin, _ = mixed_forces(wrenches, laws, mixer.matrix, 0.5)
    odd, _ = mixed_forces(wrenches, laws, audit.corrected.matrix, 0.5)
    np.testing.assert_allclose(odd, np.diag(np.abs(np.diag(begin))), atol=1e-6)
    assert "no factors remove it" in " ".join(audit.report().split())


def test_axes_without_a_command_are_freed_where_thrusters_are_left():
    craft, mixer, _, _ = vehicle(exponent=1.0, reverse=1.0, reaction=0.0)
    fewer = Mixer(AXES[:3], {n: row[:3] for n, row in mixer.factors.items()}, "translation")
    audit = allocation(craft, fewer)
    np.testing.assert_allclose(audit.remaining[3:], 0.0, atol=1e-8)
    assert any("has no command" in words for words in audit.findings)
    # the vectored frame has nothing that pitches: surge keeps its force and its pitch
    layout = ardupilot_layout({"FRAME_CONFIG": 1.0})
    below = {f"m{k}.z": 0.05 for k in range(1, 5)} | {"m3.strength": 0.7}
    audit = allocation(layout.craft().replace(below), layout.mixer)
    np.testing.assert_allclose(audit.remaining[4, 0], audit.forces[4, 0], rtol=1e-9)
    commanded = [k for k in range(6) if k != 4]
    inside = audit.remaining[np.ix_(commanded, commanded)]
    np.testing.assert_allclose(inside, np.diag(np.diag(audit.forces)[commanded]), atol=1e-8)
    assert "cannot free surge" in " ".join(audit.report().split())


def test_effects_and_dynamics_of_thrusters_count():
    law = dft.SpeedLoopThruster(gain=100.0, exponent=1.0, time_constant=0.2, ct=0.003)
    boat = dft.Craft(
        dft.bodies.Planar(),
        port=law.at((0, -0.3, 0)),
        starboard=law.at((0, 0.3, 0)),
        share=[("port", "starboard")],
    )
    mixer = Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
    dead = dft.effects.CommandDeadband(half_width=0.1)
    audit = allocation(boat + ("starboard", dead) + "wind", mixer, level=0.5)
    full, less = 0.003 * 50.0**2, 0.003 * 40.0**2
    np.testing.assert_allclose(
        audit.forces,
        [[full + less, full - less], [0, 0], [0.3 * (full - less), 0.3 * (full + less)]],
        rtol=1e-6,
        atol=1e-9,
    )
    np.testing.assert_allclose(audit.remaining[2, 0], 0.0, atol=1e-6)


def test_standard_errors_follow_from_the_covariance_of_a_fit():
    craft, mixer, wrenches, laws = vehicle()
    free = ("m11", "m3.strength", "m4.x", "m1.gain")
    rng = np.random.default_rng(4)
    root = rng.normal(size=(4, 4)) * np.array([1.0, 0.02, 0.005, 1.0])[:, None]
    fit = SimpleNamespace(model=craft, free=free, covariance=root @ root.T)
    audit = allocation(fit, mixer, level=0.4)
    slopes = []
    for name, step in (("strength", 1e-6), ("x", 1e-6), ("gain", 1e-5)):
        sides = []
        for sign in (1.0, -1.0):
            changed, law = wrenches.copy(), [each.copy() for each in laws]
            if name == "strength":
                law[0][2] += 50.0 * sign * step
            elif name == "x":
                changed[3:, 3] += np.cross([sign * step, 0, 0], wrenches[:3, 3])
            else:
                law[0] *= 1 + sign * step / 50.0
            sides.append(mixed_forces(changed, tuple(law), mixer.matrix, 0.4)[0])
        slopes.append((sides[0] - sides[1]) / (2 * step))
    jacobian = np.stack(slopes, axis=-1)
    inner = fit.covariance[1:, 1:]
    errors = np.sqrt(np.einsum("acp,pq,acq->ac", jacobian, inner, jacobian))
    np.testing.assert_allclose(audit.std_errors, errors, rtol=1e-4, atol=1e-9)
    assert " ± " in audit.findings[0]
    # what is not certain is not told
    vague = SimpleNamespace(model=craft, free=("m1.gain",), covariance=np.array([[1e6]]))
    assert not allocation(vague, mixer).findings


def test_commands_that_are_reversed_or_dead_are_told():
    boat = dft.layouts.BLUEBOAT.craft()
    crossed = Mixer(("surge", "yaw"), {"port": (1, -1), "starboard": (1, 1)})
    audit = allocation(boat, crossed)
    assert audit.findings == ("A yaw command pushes counter-clockwise: it should push clockwise.",)
    assert audit.corrected.matrix[0, 1] > 0 > audit.corrected.matrix[1, 1]
    dead = Mixer(("surge", "yaw", "heave"), {"port": (1, 1, 1), "starboard": (1, 1, 0)})
    audit = allocation(boat, dead)
    assert audit.findings[0].startswith("A yaw command hardly does anything: ")
    np.testing.assert_allclose(audit.corrected.matrix[:, 1], 1.0)
    assert "does not move in heave" in " ".join(audit.report().split())


def test_what_a_mixer_leaves_out_is_told():
    boat = dft.layouts.BLUEBOAT.craft()
    lame = Mixer(("surge", "sway", "yaw"), {"port": (1, 0, 1), "starboard": (0, 0, 0)})
    audit = allocation(boat, lame)
    assert "A sway command sends nothing to any thruster." in audit.findings
    assert "Starboard is sent nothing." in audit.findings
    audit = allocation(boat, Mixer(("sway",), {"port": (1,), "starboard": (1,)}))
    assert audit.findings[0] == "A sway command gives no sway: no thruster can."
    silent = allocation(boat, Mixer(("surge",), {"port": (0,), "starboard": (0,)}))
    assert silent.findings == (
        "A surge command sends nothing to any thruster.",
        "Port and starboard are sent nothing.",
    )
    # a boat does not heave: nothing is looked at, so nothing is praised
    unseen = allocation(boat, Mixer(("heave",), {"port": (1,), "starboard": (1,)}))
    assert "does what it should" not in unseen.report()
    assert "does not move in heave" in " ".join(unseen.report().split())


def test_commands_that_no_factors_correct_keep_theirs_and_are_told(tmp_path):
    mixer = Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
    dead = dft.layouts.BLUEBOAT.craft().replace({"starboard.strength": 1e-6})
    audit = allocation(dead, mixer)
    # of two thrusters that are to push alike, one has half of the force: surge and yaw are one
    force = audit.forces[0, 0]
    told = f"it falls from {force:.1f} to {force / 2:.2f} N, as starboard gives nothing."
    assert audit.findings[0].startswith("The factors of surge stay as they are: ")
    assert audit.findings[0].endswith(told)
    assert audit.findings[1].startswith("The factors of yaw stay as they are: ")
    np.testing.assert_array_equal(audit.corrected.matrix, mixer.matrix)
    np.testing.assert_array_equal(audit.remaining, audit.forces)
    weak = dft.layouts.BLUEBOAT.craft().replace({"starboard.strength": 1e-3})
    audit = allocation(weak, mixer)
    assert "at 0.5 starboard would be sent 19.4, it takes 1." in audit.findings[0]
    saved = tomllib.loads(audit.save(tmp_path / "mixer.toml").read_text())
    assert saved["thrusters"]["starboard"] == [1.0, -1.0]


def test_what_is_saved_is_read_back(tmp_path):
    craft, mixer, _, _ = vehicle()
    audit = allocation(craft, mixer)
    rows = np.genfromtxt(audit.save(tmp_path / "mixer.csv"), delimiter=",", skip_header=1)
    np.testing.assert_array_equal(rows[:, 1:], audit.corrected.matrix)
    tables = tomllib.loads(audit.save(tmp_path / "mixer.toml").read_text())
    assert tuple(tables["commands"]) == AXES
    assert {n: tuple(v) for n, v in tables["thrusters"].items()} == audit.corrected.factors
    with pytest.raises(InputError, match=r"\.csv"):
        audit.save(tmp_path / "mixer.xlsx")
    assert len(audit.plot().axes) == 6


def test_px4_lines_describe_the_thrusters_that_were_identified():
    craft, mixer, wrenches, laws = vehicle(reverse=1.0)
    audit = allocation(craft, mixer, level=0.5)
    words = [line.split()[2:] for line in audit.px4().splitlines()]
    settings = {name: float(value) for name, value in words} | {"CA_AIRFRAME": 7.0}
    layout = px4_layout(settings)
    # the chord at the largest command of the mixer, in the ratios of CT
    acting = wrenches * laws[0]
    strengths = np.array([t.strength for t in layout.thrusters.values()])
    np.testing.assert_allclose(strengths, laws[0] / laws[0][0], rtol=1e-4)
    told = [t.strength * wrench(t.place, t.pointing, t.reaction) for t in layout.thrusters.values()]
    np.testing.assert_allclose(np.stack(told, axis=1), acting / laws[0][0], atol=1e-4)


def test_what_is_no_audit_is_refused():
    boat = dft.layouts.BLUEBOAT.craft()
    mixer = Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
    with pytest.raises(InputError, match="expected a craft or a fit of one"):
        allocation(dft.Vessel(), mixer)
    with pytest.raises(InputError, match="expected a mixer"):
        allocation(boat, "vectored")
    with pytest.raises(InputError, match=r"sends to 'm1'[\s\S]*mixer\.named\(\['port'"):
        allocation(boat, ardusub_mixer("simplerov_3"))
    for level in (0.0, 1.5, "half"):
        with pytest.raises(InputError, match="level: expected a number above 0, at most 1"):
            allocation(boat, mixer, level=level)
    with pytest.raises(InputError, match=r"\(none\), found 'voltage'"):
        allocation(boat, mixer, inputs={"voltage": 15.0})
    with pytest.raises(InputError, match=r"found 'port\.command'[\s\S]*the mixer sends"):
        allocation(boat, mixer, inputs={"port.command": 1.0})
    with pytest.raises(InputError, match="'bow', 'stern' turn"):
        allocation(dft.layouts.FERRY.craft(), mixer.named(["bow", "stern"]))
    law = dft.Thruster(command="effort")
    sagging = dft.Craft(
        dft.bodies.Planar(), port=law.at((0, -1, 0)), starboard=law.at((0, 1, 0)), share=[SIDES]
    )
    sagging += "supply_voltage_sag"
    with pytest.raises(InputError, match=r'inputs=\{"supply_voltage"'):
        allocation(sagging, mixer)
    assert allocation(sagging, mixer, inputs={"supply_voltage": 14.0}).forces[0, 0] > 0
    with pytest.raises(InputError, match="supply_voltage: expected a finite number, found nan"):
        allocation(sagging, mixer, inputs={"supply_voltage": float("nan")})


def test_a_thruster_that_differs_by_log_is_said_to_be_the_mean():
    boat = dft.layouts.BLUEBOAT.craft()
    mixer = Mixer(("surge", "yaw"), {"port": (1, 1), "starboard": (1, -1)})
    said = "By log: 'starboard.strength'. What stands here is the mean of all logs."
    assert said not in allocation(boat, mixer).report()
    differing = boat.replace({"starboard.strength": {"per_log": True}, "m11": {"per_log": True}})
    assert said in " ".join(allocation(differing, mixer).report().split())
