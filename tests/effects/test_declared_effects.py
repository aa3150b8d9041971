"""What each effect declares: starts, units, bounds and trial values.

Fits and diagnoses rest on these numbers, and so do spec files that name none: whoever moves one
moves other people's results, and says so here.
"""

from declared_lines import declared_text

from diffthrust.effects import EFFECTS

DECLARED = """\
actuator_lag.time_constant = 0.05 s; 0 -; null 0; size 0.1; probes 0.03 0.1 0.3
axial_flow.loss = 0.1 N s^2/(m rad); 0 -; null 0; size 0.3; probes 0.002 0.02 0.2 of propeller
axial_flow.mass = 20.0 kg; 0 -; log; probes 0.2 1 of propeller
axial_flow.linear_drag = 1.0 N s/m; 0 -; log; fixed
axial_flow.quadratic_drag = 10.0 N s^2/m^2; 0 -; log; fixed
buoyancy.excess = 5.0 N; - -; null 0; size 10; probes -0.05 0.05 of thrust
cavitation.shortfall = 0.2; 0 1; null 0; size 0.3; probes 0.2 0.6
cavitation.onset = 40.0 {speed}; 0 -; log; probes 0.4 0.7 of speed
command_deadband.half_width = 0.05 {command}; 0 -; null 0; size 0.2; probes 0.05 0.2 of command
command_deadband.restored = 0.0; 0 1; fixed; probes 0 1
command_delay.delay = 0.05 s; 0 -; null 0; size 0.1; probes 0.02 0.08 0.25 0.4
command_offset.offset = 0.1 {command}; - -; null 0; size 0.2; probes -0.1 0.1 of command
command_rate_limit.rate = 10.0 {command}/s; 0 -; log; null inf; probes 1 4 12 of command
command_saturation.limit = 2.0 {command}; 0 -; log; null inf; probes 0.5 0.8 of command
coulomb_friction.level = 2.0 rad/s^2; 0 -; null 0; size 5; probes 0.02 0.1 of drive
coulomb_friction.settling = 0.03 s; 0 -; log; fixed
differential_gain.gain = 0.05; -1 1; null 0; size 0.2; probes -0.2 0.2
force_exponent.exponent = 1.2; 0.3 3; null 1; size 0.3; probes 0.7 1.5
force_exponent.reference = 10.0 {left_force}; 0 -; log; fixed; probes 0.6 of left_force
inflow_load_relief.relief = 0.2 1/m; 0 -; null 0; size 0.3; probes 0.1 0.4 of inflow^-1
inflow_thrust_loss.loss = 0.1 N s^2/(m rad); 0 -; null 0; size 0.3; probes 0.002 0.02 of propeller
linear_damping.rate = 0.3 1/s; 0 -; null 0; size 0.5; probes 0.1 0.5 2
load_exponent.exponent = 1.8; 0.5 4; null 2; size 0.3; probes 1.7 2.3
load_exponent.reference = 40.0 {speed}; 0 -; log; fixed; probes 0.6 of speed
propeller_inflow.loss = 0.1 s/m; 0 -; null 0; size 0.5; probes 0.1 0.5 of surge^-1
propeller_lag.time_constant = 0.3 s; 0 -; null 0; size 0.5; probes 0.1 0.5 1.5
propeller_walk.fraction = 0.05; -1 1; null 0; size 0.1; probes -0.1 0.1
quadratic_surge_drag.drag = 1.0 N s^2/m^2; 0 -; null 0; size 2; probes 0.5 5 of surge^-1
quadratic_sway_drag.drag = 2.0 N s^2/m^2; 0 -; null 0; size 5; probes 0.5 5 of sway^-1
quadratic_yaw_drag.drag = 0.5 N m s^2/rad^2; 0 -; null 0; size 1; probes 0.1 1 of yaw_rate^-1
reverse_drive_asymmetry.change = -0.1; -1 -; null 0; size 0.3; probes -0.3 0.3
reverse_load_asymmetry.change = -0.1; -1 -; null 0; size 0.3; probes -0.3 0.3
reverse_propeller_asymmetry.change = -0.2; -1 -; null 0; size 0.3; probes -0.3 0.3
reverse_thrust_asymmetry.change = -0.1; -1 -; null 0; size 0.3; probes -0.3 0.3
rudder_inflow.gain = 0.3 s/m; - -; null 0; size 1; probes -0.3 0.3 1 of surge^-1
rudder_lag.time_constant = 0.3 s; 0 -; null 0; size 0.5; probes 0.1 0.5 1.5
rudder_offset.offset = 0.05 {rudder_angle}; -0.8 0.8; null 0; size 0.1; probes -0.1 0.1
rudder_rate_limit.rate = 0.5 {rudder_angle}/s; 0 -; log; null inf; probes 0.1 0.5 2 of rudder_angle
slew_limit.rate = 1000.0 rad/s^2; 0 -; log; null inf; probes 0.3 1 of loop
speed_sensor_offset.offset = 1.0 {speed}; - -; null 0; size 2; probes -0.05 0.05 of speed
speed_sensor_scale.change = 0.05; -1 -; null 0; size 0.2; probes -0.1 0.1
static_friction.level = 4.0 rad/s^2; 0 -; null 0; size 5; probes 0.04 0.08 0.16 of drive
static_friction.settling = 0.03 s; 0 -; log; fixed
static_friction.spread = 0.3; 0 2; log; fixed
supply_voltage_sag.share = 0.5; 0 1; null 0; size 0.5; probes 0.3 0.9
supply_voltage_sag.nominal = 24.0 V; 0 -; log; fixed
swapped_thrusters.share = 1.0; 0 1; null 0; size 0.5; probes 1
sway_yaw_coupling.mass = 0.1 kg m; - -; null 0; size 0.5; probes -0.3 0.3
sway_yaw_coupling.damping = 0.1 N s; - -; null 0; size 0.5; probes -0.5 0.5
thrust_degradation.fraction = 0.2; 0 1; null 0; size 0.3; probes 0.2 0.6
thrust_degradation.instant = 30.0 s; - -; size 10; probes 0.2 0.4 0.6 0.8 of duration
thrust_degradation.transition = 1.0 s; 0 -; log; fixed
thrust_exponent.exponent = 1.8; 0.5 4; null 2; size 0.3; probes 1.7 2.3
thrust_exponent.reference = 40.0 {speed}; 0 -; log; fixed; probes 0.6 of speed
thrust_sensor_delay.delay = 0.05 s; 0 -; null 0; size 0.1; probes 0.02 0.08 0.25
thrust_sensor_lag.time_constant = 0.1 s; 0 -; null 0; size 0.1; probes 0.03 0.1 0.3
thrust_sensor_offset.offset = 1.0 {thrust}; - -; null 0; size 2; probes -0.05 0.05 of thrust
thrust_sensor_scale.change = 0.05; -1 -; null 0; size 0.2; probes -0.1 0.1
water_current.to_north = 0.1 m/s; - -; null 0; size 0.3; probes -0.2 0.2 of surge
water_current.to_east = 0.1 m/s; - -; null 0; size 0.3; probes -0.2 0.2 of surge
wind.along = 0.01 N s^2/m^2; 0 -; null 0; size 0.05; probes 0.003 of propulsion
wind.across = 0.02 N s^2/m^2; 0 -; null 0; size 0.1; probes 0.006 of propulsion
wind.turning = 0.005 N s^2/m; - -; null 0; size 0.05; probes 0.001 of propulsion
wind.direction = 0.0 rad; -3.142 3.142; size 1; probes -2.4 -0.8 0.8 2.4
wind.speed = 5.0 m/s; 0 -; log; fixed
"""


NEEDED = {
    "inflow_load_relief": ("inflow",),
    "inflow_thrust_loss": ("inflow",),
    "supply_voltage_sag": ("supply_voltage",),
}
OF_THE_SERIES = {
    "command_delay",
    "command_rate_limit",
    "rudder_rate_limit",
    "thrust_sensor_delay",
    "thrust_sensor_lag",
}


def test_the_parameters_of_the_effects_are_declared_so():
    assert declared_text(EFFECTS).splitlines() == DECLARED.splitlines()


def test_what_effects_need_of_a_log_and_which_read_other_samples():
    assert {name: cls.needs for name, cls in EFFECTS.items() if cls.needs} == NEEDED
    assert {name for name, cls in EFFECTS.items() if cls.memory} == OF_THE_SERIES
