"""Linear black-box models of a log's inputs and outputs.

They say what any linear model of some order can tell of a log, without physics: ARX, ARMAX, output
error and state space, the selection of their orders, and their transfer functions.
"""

from diffthrust.blackbox._model import BlackBox as BlackBox
from diffthrust.blackbox._polynomial import armax as armax
from diffthrust.blackbox._polynomial import arx as arx
from diffthrust.blackbox._polynomial import output_error as output_error
from diffthrust.blackbox._select import Candidate as Candidate
from diffthrust.blackbox._select import Selection as Selection
from diffthrust.blackbox._select import select as select
from diffthrust.blackbox._subspace import state_space as state_space
