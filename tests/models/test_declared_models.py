"""What models and effects declare: starts, units, bounds, probes and time scales.

Fits and diagnoses rest on these numbers, and so do spec files that name none: whoever moves one
moves other people's results, and says so here.
"""

import math

import pytest
from declared_lines import declared_text

import diffthrust as dft
from diffthrust.models import MODELS

DECLARED = """\
axis_vehicle.mass = 340.0 kg; 0 -; log
axis_vehicle.drag = 67.0 N s^2/m^2; 0 -; log
dc_motor_thruster.resistance = 2.5604031 ohm; 0 -; log
dc_motor_thruster.inductance = 0.0046909 H; 0 -; log; fixed
dc_motor_thruster.back_emf = 0.0182595 V s/rad; 0 -; null 0; size 0.02
dc_motor_thruster.torque_constant = 0.0182595 N m/A; 0 -; log
dc_motor_thruster.inertia = 7.2019e-05 kg m^2; 0 -; log
dc_motor_thruster.viscous = 9.1358e-05 N m s/rad; 0 -; null 0; size 0.0001
dc_motor_thruster.coulomb = 0.00033109 N m; 0 -; null 0; size 0.001
dc_motor_thruster.load = 1e-06 N m s^2/rad^2; 0 -; log
dc_motor_thruster.thrust_linear = 0.0 N s/rad; - -; fixed; null 0; size 0.01
dc_motor_thruster.thrust_quadratic = 0.0001 N s^2/rad^2; 0 -; log
ducted_thruster.efficiency = 0.2; 0 -; log
ducted_thruster.volume = 0.016 m^3; 0 -; log
ducted_thruster.pitch = 0.101 m/rad; 0 -; log; fixed
ducted_thruster.area = 0.0527 m^2; 0 -; log; fixed
ducted_thruster.density = 1000.0 kg/m^3; 0 -; log; fixed
linear_sensor.slope = 0.1901 V/m; - -; size 0.1
linear_sensor.offset = -0.0973 V; - -; size 1
speed_loop_thruster.gain = 300.0 rad/({command} s); 0 -; log
speed_loop_thruster.exponent = 1.0; 0.05 4; log
speed_loop_thruster.time_constant = 0.2 s; 0 -; log
speed_loop_thruster.ct = 0.0006 N s^2/rad^2; 0 -; log
thruster.alpha = 0.037 1/rad; 0 -; log
thruster.beta = 42.0 rad/({command} s^2); 0 -; log
thruster.ct = 0.019 N s^2/rad^2; 0 -; log
vessel.m11 = 5.23 kg; 0 -; log
vessel.m22 = 5.93 kg; 0 -; log
vessel.i33 = 1.25 kg m^2; 0 -; log
vessel.d11 = 4.03 N s/m; 0 -; log
vessel.d22 = 5.48 N s/m; 0 -; log
vessel.d33 = 1.13 N m s/rad; 0 -; log
vessel.exponent = 0.27; 0.05 4; log
vessel.lever_arm = 0.5 m; 0 -; log; fixed
"""


SCALES = {
    "axis_vehicle": (0.05, 40.0),
    "dc_motor_thruster": (0.0005, 4.0),
    "ducted_thruster": (0.005, 4.0),
    "linear_sensor": (0.0, float("inf")),
    "speed_loop_thruster": (0.005, 4.0),
    "thruster": (0.005, 4.0),
    "vessel": (0.05, 20.0),
}


def test_the_parameters_of_the_models_are_declared_so():
    assert declared_text(MODELS).splitlines() == DECLARED.splitlines()


def test_the_time_scales_that_logs_must_show():
    assert {name: cls.time_scales for name, cls in MODELS.items()} == SCALES
    assert {name for name, cls in MODELS.items() if cls.horizon is not None} == {"vessel"}
    assert dft.Vessel.horizon == 20.0


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_every_parameter_of_every_model_describes_itself_soundly(model):
    for name, p in model().parameters.items():
        p.check(name)
        low, high = p.coordinate_limits()
        z = float(p.to_coordinate(p.value))
        assert low <= z <= high
        assert float(p.from_coordinate(z)) == pytest.approx(p.value, rel=1e-14)


@pytest.mark.parametrize("effect", dft.effects.EFFECTS.values(), ids=dft.effects.EFFECTS)
def test_probes_lie_on_the_side_that_the_bounds_leave(effect):
    for p in effect.declared.values():
        factors = getattr(p.probes, "factors", p.probes)
        assert not factors or p.limits[0] <= min(0.0, *factors) or min(factors) >= 0


@pytest.mark.parametrize("effect", dft.effects.EFFECTS.values(), ids=dft.effects.EFFECTS)
def test_start_values_sizes_and_probes_fit_each_other(effect):
    for p in effect.declared.values():
        factors = getattr(p.probes, "factors", p.probes)
        assert list(factors) == sorted(set(factors))
        if not p.fixed and p.size and p.null is not None and math.isfinite(p.null):
            assert abs(p.value - p.null) <= 2 * p.size
            far = [abs(x - p.null) / p.size for x in factors if factors is p.probes]
            assert all(0.15 <= one <= 5.0 for one in far)


@pytest.mark.parametrize("effect", dft.effects.EFFECTS.values(), ids=dft.effects.EFFECTS)
def test_every_effect_is_documented_and_its_null_is_inside_its_bounds(effect):
    assert "Null:" in effect.__doc__
    assert "Source:" in effect.__doc__
    null = effect().at_null()
    nulls = {k: p.null for k, p in effect.declared.items() if p.null is not None}
    assert nulls
    assert {k: getattr(null, k) for k in nulls} == nulls
    for name, p in null._parameters.items():
        p.check(name)
