"""The table of force and command: read in both directions, and against simulations."""

from __future__ import annotations

import csv
import subprocess

import numpy as np
import pytest
from exported_programs import compiled, needs_compiler

import diffthrust as dft
from diffthrust.effects import (
    CommandDeadband,
    CommandOffset,
    CommandSaturation,
    ReverseThrustAsymmetry,
)
from diffthrust.export import export_model


class Mirrored(dft.Effect):
    """A propeller that is mounted the other way round."""

    name = "mirrored"
    port = "propeller"
    factor: float = dft.parameter(-0.8, null=1.0)

    def __call__(self, value, s):
        return self.factor * value


SEEN = {
    "plain": dft.Thruster(),
    "dead band, asymmetry, saturation": dft.Thruster()
    + CommandDeadband(half_width=0.2)
    + ReverseThrustAsymmetry(change=-0.3)
    + CommandSaturation(limit=1.5),
    "jump": dft.Thruster() + CommandDeadband(half_width=0.2, restored=1.0),
    "bent": dft.Thruster() + "cavitation" + "axial_flow" + "linear_damping",
    "sticking": dft.Thruster() + "static_friction" + "coulomb_friction",
    "late": dft.Thruster() + "command_delay" + "command_rate_limit" + "actuator_lag",
    "motor": dft.DCMotorThruster(),
    "loop": dft.SpeedLoopThruster(exponent=0.7),
    "backwards": dft.Thruster() + Mirrored(),
}


def rows_of(exported) -> np.ndarray:
    """Forces and commands, ``(n, 2)``."""
    return np.array(list(csv.reader(exported.text.splitlines()))[1:], float)


def held(model, command: float) -> float:
    """The force after a minute under one command."""
    time = 0.01 * np.arange(6001)
    log = dft.Log(time, {"command": np.full(time.shape, command)}, {})
    return float(dft.simulate(model, log)["thrust"][-1])


@pytest.mark.thorough
@pytest.mark.parametrize("name", SEEN)
def test_the_table_says_what_a_simulation_settles_at(name):
    model = SEEN[name]
    rows = rows_of(export_model(model, "lut", limits=(-2.0, 2.0)))
    forces, commands = rows.T
    assert np.all(np.diff(forces) > 0)
    ahead = -1 if name == "backwards" else 1
    assert np.all(ahead * np.diff(commands) > 0)
    span, rng = np.ptp(forces), np.random.default_rng(7)
    jumps = np.diff(forces) > 0.01 * span * np.maximum(1.0, np.abs(np.diff(commands)) / 1e-3)
    for force in rng.uniform(forces[0], forces[-1], 12):
        row = np.searchsorted(forces, force) - 1
        if jumps[row]:  # between two rows that are next to each other nothing is held
            continue
        command = float(np.interp(force, forces, commands))
        assert held(model, command) == pytest.approx(force, abs=3e-3 * span)
    forces, commands, jumps = forces[::ahead], commands[::ahead], jumps[::ahead]
    for command in rng.uniform(commands[0], commands[-1], 12):
        force = float(np.interp(command, commands, forces))
        if not jumps[np.searchsorted(commands, command) - 1]:
            assert held(model, command) == pytest.approx(force, abs=3e-3 * span)


def test_small_forces_at_the_edge_of_a_dead_band_settle_beside_the_largest():
    exported = export_model(dft.Thruster() + "command_deadband", "lut", limits=(-2.0, 2.0))
    assert exported.notes == ("No force from -0.04980 V to 0.04980 V: a dead band.",)


def test_dead_bands_jumps_and_saturation_are_told():
    exported = export_model(SEEN["dead band, asymmetry, saturation"], "lut", limits=(-2.0, 2.0))
    assert "No force from -0.2000 V to 0.2000 V: a dead band." in exported.notes
    assert "The force does not change beyond 1.700 V." in exported.notes
    forces, commands = rows_of(exported).T
    assert commands[[0, -1]] == pytest.approx([-1.7, 1.7], abs=5e-4)
    # the smallest force ahead and astern needs the edges of the band, none needs the stop
    edges = np.interp([-1e-3, 0.0, 1e-3], forces, commands)
    assert edges == pytest.approx([-0.2, 0.0, 0.2], abs=1e-3)
    assert forces[0] / forces[-1] == pytest.approx(-0.7, rel=1e-6)
    exported = export_model(SEEN["sticking"], "lut", limits=(-2.0, 2.0))
    assert any("jumps at 0.09" in note for note in exported.notes)


def test_a_force_that_falls_ends_the_table():
    model = dft.Thruster() + CommandOffset(offset=0.1)

    class Stalling(dft.Effect):
        """The thrust falls at high speeds."""

        name = "stalling"
        port = "propeller"
        share: float = dft.parameter(1.0 / 40.0**2, "s^2/rad^2", null=0.0)

        def __call__(self, value, s):
            return value / (1.0 + self.share * s.speed**4 * self.share)

    exported = export_model(model + Stalling(), "lut", limits=(-3.0, 3.0))
    forces, commands = rows_of(exported).T
    assert any("falls beyond" in note for note in exported.notes)
    assert commands[-1] < 2.0
    assert np.all(np.diff(forces) > 0)


def test_other_inputs_are_held_and_told_and_sensors_left_out():
    model = dft.Thruster() + "supply_voltage_sag" + "inflow_thrust_loss" + "thrust_sensor_offset"
    ranges = {"command": (-1.0, 2.0), "supply_voltage": (20.0, 24.0), "inflow": (-1.0, 3.0)}
    exported = export_model(model, "lut", ranges=ranges)
    assert "It holds for supply_voltage = 22.00 V." in exported.notes
    assert "It holds for inflow = 0.000 m/s." in exported.notes
    assert any("thrust_sensor_offset" in note for note in exported.notes)
    forces, commands = rows_of(exported).T
    assert commands[[0, -1]] == pytest.approx([-1.0, 2.0])
    assert np.interp(0.0, commands, forces) == 0.0
    full = 0.019 / 0.037 * 42.0 * 2.0 * (1.0 + 0.5 * (22.0 / 24.0 - 1.0))
    assert forces[-1] == pytest.approx(full, rel=1e-9)


def test_a_thrust_part_alone_is_tabulated_by_speed():
    exported = export_model(dft.Thruster(), "lut", ranges={"speed": (-30.0, 50.0)})
    assert exported.text.splitlines()[0] == "thrust [N],speed [rad/s]"
    forces, speeds = rows_of(exported).T
    assert forces == pytest.approx(0.019 * speeds * np.abs(speeds), rel=1e-9, abs=1e-9)


@needs_compiler
def test_the_header_looks_up_what_the_csv_says(tmp_path):
    model = SEEN["dead band, asymmetry, saturation"]
    forces, commands = rows_of(export_model(model, "lut", limits=(-2.0, 2.0))).T
    export_model(model, "lut", tmp_path / "t200.h", limits=(-2.0, 2.0))
    rng = np.random.default_rng(3)
    asked = [*rng.uniform(1.2 * forces[0], 1.2 * forces[-1], 40), 0.0, forces[3]]
    body = " ".join(f'printf("%.17g %.17g\\n", t200_command({v!r}), t200_thrust({v / 20!r}));'
                    for v in map(float, asked))  # fmt: skip
    (tmp_path / "look.c").write_text(
        f'#include <stdio.h>\n#include "t200.h"\nint main(void) {{ {body} return 0; }}\n'
    )
    compiled(tmp_path / "look.c", tmp_path / "look")
    done = subprocess.run([tmp_path / "look"], capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], float)
    assert found[:, 0] == pytest.approx(np.interp(asked, forces, commands), abs=1e-7)
    wanted = np.interp(np.array(asked) / 20, commands, forces)
    assert found[:, 1] == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize(
    ("model", "options", "problem"),
    [
        (dft.Thruster(), {}, "range of the command .V. is not known"),
        (dft.Thruster(), {"limits": (1.0, -1.0)}, "the lowest and the highest command"),
        (dft.Vessel(), {"limits": (0.0, 1.0)}, "expected a thruster"),
        (
            dft.Thruster() + CommandDeadband(half_width=3.0),
            {"limits": (-1.0, 1.0)},
            "is the same at",
        ),
    ],
)
def test_what_cannot_be_tabulated_is_told(model, options, problem):
    with pytest.raises(dft.InputError, match=problem):
        export_model(model, "lut", **options)
