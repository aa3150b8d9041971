"""Test plans for the papers' methods: files that a rig can run, and a check of what came back."""

from diffthrust.plans._black_box import black_box as black_box
from diffthrust.plans._plan import Finding as Finding
from diffthrust.plans._plan import Level as Level
from diffthrust.plans._plan import Plan as Plan
from diffthrust.plans._plan import PlanCheck as PlanCheck
from diffthrust.plans._sensor import depth_calibration as depth_calibration
from diffthrust.plans._settling import settling_time as settling_time
from diffthrust.plans._speed_steps import speed_steps as speed_steps
from diffthrust.plans._thruster import dynamic_test as dynamic_test
from diffthrust.plans._thruster import static_test as static_test
from diffthrust.plans._thruster import steady_map as steady_map
from diffthrust.plans._vessel import sequential as sequential
