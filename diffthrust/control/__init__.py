"""Closed loops: controllers, compensators of the thruster's lag, faults, and gains that are tuned.

A `Loop` joins a thruster with its effects, a vehicle, and a sampled controller; `Loop.simulate`
gives a `LoopRun` whose ``log`` every other tool of the library reads.
"""

from diffthrust.control._block import Block as Block
from diffthrust.control._block import Controller as Controller
from diffthrust.control._block import rate_of as rate_of
from diffthrust.control._compensators import Compensator as Compensator
from diffthrust.control._compensators import Lead as Lead
from diffthrust.control._compensators import NoCompensator as NoCompensator
from diffthrust.control._compensators import PoleCancellation as PoleCancellation
from diffthrust.control._faults import Change as Change
from diffthrust.control._faults import Limited as Limited
from diffthrust.control._faults import Stuck as Stuck
from diffthrust.control._faults import duct_obstruction as duct_obstruction
from diffthrust.control._loop import Loop as Loop
from diffthrust.control._mpc import MPC as MPC
from diffthrust.control._mpc_step import Plan as Plan
from diffthrust.control._path import HarmonicPath as HarmonicPath
from diffthrust.control._path import Path as Path
from diffthrust.control._path import StraightPath as StraightPath
from diffthrust.control._path import Wanted as Wanted
from diffthrust.control._pid import PID as PID
from diffthrust.control._position import PD as PD
from diffthrust.control._position import PositionController as PositionController
from diffthrust.control._reference import Sinusoid as Sinusoid
from diffthrust.control._reference import Step as Step
from diffthrust.control._reference import Trajectory as Trajectory
from diffthrust.control._run import LoopRun as LoopRun
from diffthrust.control._run import Tracking as Tracking
from diffthrust.control._sliding import AdaptiveSliding as AdaptiveSliding
from diffthrust.control._sliding import Sliding as Sliding
from diffthrust.control._track_run import PathError as PathError
from diffthrust.control._track_run import SolveTime as SolveTime
from diffthrust.control._track_run import TrackRun as TrackRun
from diffthrust.control._tune import Effort as Effort
from diffthrust.control._tune import Tuning as Tuning
from diffthrust.control._tune import tune as tune
from diffthrust.control._vessel_loop import VesselLoop as VesselLoop
