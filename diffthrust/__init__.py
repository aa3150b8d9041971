"""Differentiable models of underwater thrusters and small vessels, with batch estimation.

    log -> simulate -> compare -> diagnose -> model + effect -> fit -> compare ...

Importing the package switches JAX to double precision (``jax_enable_x64``): in single precision a
fit cannot tell a stationary point from rounding.
"""

import os as _os

import jax as _jax

_jax.config.update("jax_enable_x64", True)
# XLA compiles a loop on the CPU as one kernel only while its body is small; models with effects
# are above its limit and run up to ten times slower. Its newer emitters take up to twice as long
# to compile as the older ones, for kernels that run no faster. The flag is read when JAX first
# computes, and an option that XLA no longer knows is ignored. It goes in front of the user's: XLA
# ignores all that follows a word without leading dashes.
if "xla_backend_extra_options" not in _os.environ.get("XLA_FLAGS", ""):
    _os.environ["XLA_FLAGS"] = (
        "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000,"
        "xla_cpu_disable_new_fusion_emitters " + _os.environ.get("XLA_FLAGS", "")
    ).strip()

from diffthrust import blackbox as blackbox  # noqa: E402
from diffthrust import campaigns as campaigns  # noqa: E402
from diffthrust import control as control  # noqa: E402
from diffthrust import datasets as datasets  # noqa: E402
from diffthrust import effects as effects  # noqa: E402
from diffthrust import fleets as fleets  # noqa: E402
from diffthrust import many as many  # noqa: E402
from diffthrust import models as models  # noqa: E402
from diffthrust import papers as papers  # noqa: E402
from diffthrust import plans as plans  # noqa: E402
from diffthrust._classical_elements import Backlash as Backlash  # noqa: E402
from diffthrust._classical_elements import DeadZone as DeadZone  # noqa: E402
from diffthrust._classical_elements import Relay as Relay  # noqa: E402
from diffthrust._classical_elements import Saturation as Saturation  # noqa: E402
from diffthrust._compare import Comparison as Comparison  # noqa: E402
from diffthrust._compare import compare as compare  # noqa: E402
from diffthrust._convergence import Convergence as Convergence  # noqa: E402
from diffthrust._convergence import convergence as convergence  # noqa: E402
from diffthrust._describing import describing_function as describing_function  # noqa: E402
from diffthrust._describing_band import DescribingBand as DescribingBand  # noqa: E402
from diffthrust._describing_band import describing_uncertainty as describing_uncertainty  # noqa: E402
from diffthrust._describing_map import DescribingMap as DescribingMap  # noqa: E402
from diffthrust._diagnose import diagnose as diagnose  # noqa: E402
from diffthrust._diagnosis import Diagnosis as Diagnosis  # noqa: E402
from diffthrust._directions import directions as directions  # noqa: E402
from diffthrust._dynamic_element import ModelElement as ModelElement  # noqa: E402
from diffthrust._effect import Effect as Effect  # noqa: E402
from diffthrust._errors import InputError as InputError  # noqa: E402
from diffthrust._experiment import Experiment as Experiment  # noqa: E402
from diffthrust._experiment import suggest_experiment as suggest_experiment  # noqa: E402
from diffthrust._fit import fit as fit  # noqa: E402
from diffthrust._headroom import Headroom as Headroom  # noqa: E402
from diffthrust._headroom import headroom as headroom  # noqa: E402
from diffthrust._intervals import intervals as intervals  # noqa: E402
from diffthrust._intervals_result import Intervals as Intervals  # noqa: E402
from diffthrust._limit_cycle import limit_cycles as limit_cycles  # noqa: E402
from diffthrust._limit_cycle_result import LimitCycle as LimitCycle  # noqa: E402
from diffthrust._limit_cycle_result import LimitCycles as LimitCycles  # noqa: E402
from diffthrust._log import Log as Log  # noqa: E402
from diffthrust._metrics import Errors as Errors  # noqa: E402
from diffthrust._model import Model as Model  # noqa: E402
from diffthrust._noise_advice import NoiseAdvice as NoiseAdvice  # noqa: E402
from diffthrust._nonlinearity import StaticNonlinearity as StaticNonlinearity  # noqa: E402
from diffthrust._parameters import Normal as Normal  # noqa: E402
from diffthrust._parameters import Parameter as Parameter  # noqa: E402
from diffthrust._parameters import parameter as parameter  # noqa: E402
from diffthrust._parameters import relative_to as relative_to  # noqa: E402
from diffthrust._physical import Quantity as Quantity  # noqa: E402
from diffthrust._physical import derived as derived  # noqa: E402
from diffthrust._physical import physical as physical  # noqa: E402
from diffthrust._pole_figure import plot_pole_motion as plot_pole_motion  # noqa: E402
from diffthrust._posterior_plots import plot_corner as plot_corner  # noqa: E402
from diffthrust._posterior_plots import plot_trace as plot_trace  # noqa: E402
from diffthrust._predict import Prediction as Prediction  # noqa: E402
from diffthrust._predict import predict as predict  # noqa: E402
from diffthrust._profile import profile as profile  # noqa: E402
from diffthrust._profile_result import Profile as Profile  # noqa: E402
from diffthrust._profile_result import Profiles as Profiles  # noqa: E402
from diffthrust._quantities import Quantities as Quantities  # noqa: E402
from diffthrust._quantities import quantities as quantities  # noqa: E402
from diffthrust._read import Column as Column  # noqa: E402
from diffthrust._read import read_log as read_log  # noqa: E402
from diffthrust._result import Estimate as Estimate  # noqa: E402
from diffthrust._result import Fit as Fit  # noqa: E402
from diffthrust._robot_log import read_robot_log as read_robot_log  # noqa: E402
from diffthrust._sample import sample as sample  # noqa: E402
from diffthrust._sandwich import Sandwich as Sandwich  # noqa: E402
from diffthrust._sandwich import sandwich as sandwich  # noqa: E402
from diffthrust._signals import Ports as Ports  # noqa: E402
from diffthrust._signals import Relaxing as Relaxing  # noqa: E402
from diffthrust._signals import Signals as Signals  # noqa: E402
from diffthrust._simulate import simulate as simulate  # noqa: E402
from diffthrust._status import Checks as Checks  # noqa: E402
from diffthrust._status import Status as Status  # noqa: E402
from diffthrust._step_check import CoarseStepWarning as CoarseStepWarning  # noqa: E402
from diffthrust._step_check import choose_substeps as choose_substeps  # noqa: E402
from diffthrust._step_check import step_error as step_error  # noqa: E402
from diffthrust._thruster_loop import ThrusterLoop as ThrusterLoop  # noqa: E402
from diffthrust._thruster_loop import thruster_loop_cycle as thruster_loop_cycle  # noqa: E402
from diffthrust.campaigns import Campaign as Campaign  # noqa: E402
from diffthrust.campaigns import campaign as campaign  # noqa: E402
from diffthrust.fleets import Fleet as Fleet  # noqa: E402
from diffthrust.fleets import Pooled as Pooled  # noqa: E402
from diffthrust.fleets import fleet as fleet  # noqa: E402
from diffthrust.models import AxisVehicle as AxisVehicle  # noqa: E402
from diffthrust.models import DCMotorThruster as DCMotorThruster  # noqa: E402
from diffthrust.models import LinearSensor as LinearSensor  # noqa: E402
from diffthrust.models import Thruster as Thruster  # noqa: E402
from diffthrust.models import Vessel as Vessel  # noqa: E402

__version__ = "0.1.0"
